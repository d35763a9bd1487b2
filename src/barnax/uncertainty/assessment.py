"""Assessment of an optimum: intervals, identifiability, and the residuals.

An assessment needs no further fit; an examination refits some hundred times.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from ..cell import CircuitParameters
from ..display import Brief
from ..execution import in_float64
from ..global_optimum.objective import ConstantObjective
from ..model.prepared import PreparedRecord
from ..schema import Unstored
from .covariance import Covariance, Estimate, Uncertainty, linear_end, linearize
from .identifiability import Identifiability, identifiability
from .profiles import ParameterProfile, profile

if TYPE_CHECKING:
    from ..model.problem import Problem

SOC_EDGES = np.linspace(0, 1, 11)
# Edges of the current's bands: multiples of the current that empties the cell in an hour.
RATE_EDGES = (0.2, 1.0, 2.0)
TEMPERATURE_STEPS = (1.0, 2.0, 5.0, 10.0)
MAX_TEMPERATURES = 8


@dataclass(frozen=True)
class Band:
    """Residuals of the samples from `low` to `high`; None for an open end.

    For SOC these are fractions, for the current C-rates (discharge positive, the band at rest spans
    zero), for temperature degC. `mean_v` is measured minus simulated, `share` their part of the
    summed squared error.
    """

    low: float | None
    high: float | None
    samples: int
    rmse_v: float
    mean_v: float
    share: float


@dataclass(frozen=True, repr=False)
class Diagnostics(Brief):
    """Correlation of the residuals, and where they are large.

    `autocorrelation` is that of the residuals at `lags_s`. `correlation_time_s` is the integrated
    autocorrelation time of the fitted noise: the interval that is worth one independent sample, of
    which the record has `effective_samples`.
    """

    lags_s: tuple[float, ...]
    autocorrelation: tuple[float, ...]
    correlation_time_s: float
    effective_samples: float
    samples: int
    by_soc: tuple[Band, ...]
    by_current: tuple[Band, ...]
    by_temperature: tuple[Band, ...] | None


def diagnostics(problem: "Problem", covariance: Covariance) -> Diagnostics:
    """The residuals of an optimum over the scored samples of its records."""
    linearization, noise = covariance.linearization, covariance.noise
    prepared_records = problem.prepared_records
    interval_s = float(np.median(np.diff(linearization.time_s)))
    time_s = noise.correlation_time_s(interval_s)
    rest_c = max(one.rest_current_a / one.capacity_ah for one in prepared_records)
    soc = np.concatenate([one.soc[one.scored] for one in prepared_records])
    rate = np.concatenate([one.current_a[one.scored] / one.capacity_ah for one in prepared_records])
    return Diagnostics(
        lags_s=tuple(noise.lags_s.tolist()),
        autocorrelation=tuple(noise.autocorrelation.tolist()),
        correlation_time_s=time_s,
        effective_samples=linearization.samples * interval_s / max(time_s, interval_s),
        samples=linearization.samples,
        by_soc=soc_bands(soc, linearization.error_v),
        by_current=_current_bands(rate, linearization.error_v, rest_c),
        by_temperature=_temperature_bands(prepared_records, linearization.error_v),
    )


def soc_bands(
    soc: Float[np.ndarray, "samples"],
    error_v: Float[np.ndarray, "samples"],
    edges: Float[np.ndarray, "edges"] = SOC_EDGES,
) -> tuple[Band, ...]:
    """The errors in each band of the state of charge, by default each tenth. The lowest band
    includes samples below it, the highest those above."""
    inner = edges[1:-1]
    return _bands(soc, error_v, np.array([-np.inf, *inner, np.inf]), edges.tolist())


def _current_bands(rate: np.ndarray, error_v: np.ndarray, rest_c: float) -> tuple[Band, ...]:
    ends = [rest_c, *(edge for edge in RATE_EDGES if edge > rest_c)]
    inner = [*(-end for end in reversed(ends)), *ends]
    return _bands(rate, error_v, np.array([-np.inf, *inner, np.inf]), [None, *inner, None])


def _temperature_bands(
    prepared_records: Sequence[PreparedRecord], error_v: np.ndarray
) -> tuple[Band, ...] | None:
    measured = [prepared.record.temperature_degc for prepared in prepared_records]
    parts = [
        degc[prepared.span][prepared.scored]
        for degc, prepared in zip(measured, prepared_records, strict=True)
        if degc is not None
    ]
    if len(parts) < len(prepared_records):
        return None
    temperature = np.concatenate(parts)
    if np.all(np.isnan(temperature)):
        return None
    low, high = np.nanmin(temperature), np.nanmax(temperature)
    step = next(
        (step for step in TEMPERATURE_STEPS if (high - low) / step <= MAX_TEMPERATURES),
        (high - low) / MAX_TEMPERATURES,
    )
    edges = step * np.arange(np.floor(low / step), np.floor(high / step) + 2)
    return _bands(temperature, error_v, edges, edges.tolist())


def _bands(
    quantity: Float[np.ndarray, "samples"],
    error_v: Float[np.ndarray, "samples"],
    edges: Float[np.ndarray, "edges"],
    ends: Sequence[float | None],
) -> tuple[Band, ...]:
    """The bands that contain samples; each includes its lower edge, and is labeled by its
    `ends`."""
    total = float(error_v @ error_v)
    number = np.digitize(quantity, edges) - 1
    bands = []
    for index, (low, high) in enumerate(itertools.pairwise(ends)):
        inside = error_v[number == index]
        if len(inside):
            squares = float(inside @ inside)
            bands.append(
                Band(
                    low=low,
                    high=high,
                    samples=len(inside),
                    rmse_v=float(np.sqrt(squares / len(inside))),
                    mean_v=float(np.mean(inside)),
                    share=squares / total if total > 0 else 0.0,
                )
            )
    return tuple(bands)


@dataclass(frozen=True, repr=False)
class Examination(Brief):
    """Profiles of all free parameters.

    Attributes:
        rmse_v: RMSE of the unchanged circuit.
        profiles: Profile likelihoods.
    """

    rmse_v: float
    profiles: tuple[ParameterProfile, ...]


@dataclass(frozen=True, eq=False, repr=False)
class Assessment(Brief):
    """Intervals, identifiability and residual diagnostics of an optimum, without further fits.

    Attributes:
        uncertainty: Intervals of all parameters.
        identifiability: Parameters that the data cannot determine.
        diagnostics: Residuals over time, SOC, current and temperature.
        examination: Results of further fits.
        covariance: The covariance behind the other results; None for a stored assessment.
    """

    uncertainty: Uncertainty
    identifiability: Identifiability
    diagnostics: Diagnostics
    examination: Examination | None = None
    covariance: Unstored[Any] = None


@in_float64
def assess(problem: "Problem", parameters: CircuitParameters) -> Assessment:
    """The intervals and diagnostics of an optimum, from one Jacobian.

    Args:
        problem: A problem from `make_problem`.
        parameters: An optimum of it, such as those of `refine` or `find_global_optimum`.

    Raises `InputError` if the errors or their derivatives are not finite.
    """
    covariance = Covariance.of(linearize(problem, parameters))
    uncertainty = _with_upper_ends(problem, parameters, covariance.summary(parameters))
    return Assessment(
        covariance=covariance,
        uncertainty=uncertainty,
        identifiability=identifiability(problem, covariance, uncertainty),
        diagnostics=diagnostics(problem, covariance),
    )


def _with_upper_ends(
    problem: "Problem", parameters: CircuitParameters, uncertainty: Uncertainty
) -> Uncertainty:
    """A copy with upper limits of resistances at their lower bounds."""
    names = [one.name for one in uncertainty.estimates if one.held == "at lower bound"]
    names = tuple(name for name in names if name.endswith("[Ohm]"))
    if not names:
        return uncertainty
    covariance = Covariance.of(linearize(problem, parameters, freed=names))

    def bounded(one: Estimate) -> Estimate:
        direction, _ = covariance.linearization.direction_of(one.name)
        if one.name not in names or not np.any(direction):
            return one
        return replace(one, high=linear_end(one.value, covariance.reach(direction)[1]))

    return replace(uncertainty, estimates=tuple(map(bounded, uncertainty.estimates)))


@in_float64
def examine(
    problem: "Problem", parameters: CircuitParameters, assessment: Assessment
) -> Examination:
    """Profiles of all free parameters, by further fits.

    Args:
        problem: A problem from `make_problem`.
        parameters: An optimum of it.
        assessment: Its assessment from `assess`.
    """
    given = {"covariance": assessment.covariance, "objective": ConstantObjective.of(problem)}
    free = [one.name for one in assessment.uncertainty.estimates if one.relative_error]
    profiles = tuple(profile(problem, parameters, name, **given) for name in free)
    from ..model.problem import rmse_by_scan

    return Examination(rmse_by_scan(problem, [parameters])[0], profiles)

"""Known circuits on a problem's current, identified again under noise, and whether intervals hold.

Simulated with SciPy's lfilter; identified by descents that start at the truth.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter
from scipy.stats import binom
from scipy.stats import t as student

import barnax
from barnax.global_optimum.objective import ConstantObjective
from barnax.model.descent import polish
from barnax.model.problem import Problem
from barnax.uncertainty.covariance import CONFIDENCE, Covariance, Estimate, Uncertainty, linearize


@dataclass(frozen=True)
class Noise:
    """A sum of AR(1) noises: (correlation time in s, standard deviation in V); 0 s is white."""

    name: str
    parts: tuple[tuple[float, float], ...]

    def draw(self, rng: np.random.Generator, records: int, samples: int) -> np.ndarray:
        """Stationary noise at 1 s sampling, one row a record."""
        total = np.zeros((records, samples))
        for correlation_s, sd_v in self.parts:
            drawn = rng.standard_normal((records, samples))
            rho = np.exp(-1 / correlation_s) if correlation_s else 0.0
            drawn[:, 0] /= np.sqrt(1 - rho**2)
            total += sd_v * np.sqrt(1 - rho**2) * lfilter([1.0], [1.0, -rho], drawn, axis=1)
        return total


NOISES = (
    Noise("white, 5 mV", ((0.0, 5e-3),)),
    Noise("60 s, 5 mV", ((60.0, 5e-3),)),
    Noise("300 s, 5 mV", ((300.0, 5e-3),)),
    Noise(
        "as measured: 20 s, 10 mV and 600 s, 10 mV and white, 1 mV",
        ((20.0, 10e-3), (600.0, 10e-3), (0.0, 1e-3)),
    ),
)
CIRCUITS = (
    barnax.CircuitParameters.constant(0.05, (0.02, 0.03), (20 / 0.02, 300 / 0.03)),
    barnax.CircuitParameters.constant(0.073, (0.015, 0.0213), (10.2 / 0.015, 87 / 0.0213)),
)


@dataclass(frozen=True)
class Coverage:
    """Shares of records whose interval holds the truth, and mean inflation, by parameter.

    `profile` has the parameters that are refined themselves, `held` counts records with one at a
    bound, `open` those whose trusted interval is open, which holds everything and counts as none.
    """

    trusted: dict[str, float]
    plain: dict[str, float]
    profile: dict[str, float]
    inflation: dict[str, float]
    open: dict[str, int]
    held: int


def coverage(
    problem: Problem, truth: barnax.CircuitParameters, noise: Noise, records: int, seed: int
) -> Coverage:
    """The coverage of `records` simulated records on the current of a problem sampled at 1 s.

    Refits start at the truth, so that what is counted are intervals and not wrong optima. A
    parameter that ends at a bound has no interval and so does not hold the truth.
    """
    prepared = problem.prepared
    rng = np.random.default_rng(seed)
    base_v = -_drop_v(truth, prepared.current_a) + noise.draw(rng, records, len(prepared.soc))
    scales = tuple(np.log(truth.tau_s).tolist())
    hits: dict[str, list[tuple[bool, bool, float]]] = {}
    rises: dict[str, list[float]] = {}
    every, names = [], problem.log_coordinates.names
    for base in base_v:
        changed = _with_voltage(problem, prepared.source_v + base)
        objective = ConstantObjective.of(changed)
        best = polish(objective, objective.solve(scales))
        parameters = objective.circuit(best)
        uncertainty = Covariance.of(linearize(changed, parameters)).summary(parameters)
        every.append(uncertainty)
        for name, value in values_of(truth).items():
            hits.setdefault(name, []).append(_holds(uncertainty, name, value))
            if name in names:
                # How much of the squared error it adds where it is held at its truth.
                fixed = objective.fixing(name, value)
                there = polish(fixed, fixed.solve(_within(fixed, best.log_scales)))
                rises.setdefault(name, []).append(there.objective_v2 / best.objective_v2 - 1)
    table = {name: np.array(rows, float).mean(axis=0).tolist() for name, rows in hits.items()}
    held = sum(len(uncertainty.free) < len(names) for uncertainty in every)
    return Coverage(
        profile={
            name: float(
                np.mean(
                    [
                        _is_below(uncertainty, name, rise)
                        for uncertainty, rise in zip(every, row, strict=True)
                    ]
                )
            )
            for name, row in rises.items()
        },
        trusted={name: row[0] for name, row in table.items()},
        plain={name: row[1] for name, row in table.items()},
        inflation={name: row[2] for name, row in table.items()},
        open={name: sum(_is_open(uncertainty[name]) for uncertainty in every) for name in table},
        held=held,
    )


def chance_band(records: int, confidence: float = 0.999) -> tuple[float, float]:
    """The shares between which `records` records show a true share of 95 % with `confidence`."""
    low, high = binom.interval(confidence, records, CONFIDENCE)
    return float(low) / records, float(high) / records


def _within(objective: ConstantObjective, log_scales: tuple[float, ...]) -> tuple[float, ...]:
    ends = np.transpose([[axis.low, axis.high] for axis in objective.axes])
    return tuple(np.clip(log_scales, *ends).tolist())


def _is_below(uncertainty: Uncertainty, name: str, rise: float) -> bool:
    """Whether the profile has not risen to its threshold, as `uncertainty.profile` has it."""
    estimate = uncertainty[name]
    if estimate.inflation is None or estimate.degrees_of_freedom is None:
        return False
    quantile = student.ppf((1 + CONFIDENCE) / 2, estimate.degrees_of_freedom)
    return bool(
        rise <= (quantile * estimate.inflation) ** 2 / (uncertainty.samples - len(uncertainty.free))
    )


def _holds(uncertainty: Uncertainty, name: str, truth: float) -> tuple[bool, bool, float]:
    estimate = uncertainty[name]
    if estimate.white_noise_relative_error is None or estimate.inflation is None:
        return False, False, 1.0
    low, high = estimate.low, estimate.high
    is_held = low is not None and high is not None and low <= truth <= high
    plain = student.ppf((1 + CONFIDENCE) / 2, uncertainty.samples - len(uncertainty.free))
    miss = abs(np.log(estimate.value / truth))
    return is_held, miss <= plain * estimate.white_noise_relative_error, estimate.inflation


def _is_open(estimate: Estimate) -> bool:
    return estimate.relative_error is not None and None in (estimate.low, estimate.high)


def values_of(truth: barnax.CircuitParameters) -> dict[str, float]:
    taus = {f"tau{pair} [s]": tau for pair, tau in enumerate(truth.tau_s, 1)}
    return truth.to_dict() | taus


def _drop_v(truth: barnax.CircuitParameters, current_a: np.ndarray) -> np.ndarray:
    """Ohmic and polarization drop by SciPy's filter of a zero-order hold at 1 s."""
    drop_v = truth.r0 * current_a
    for r, tau in zip(truth.r, truth.tau_s, strict=True):
        decay = np.exp(-1 / tau)
        drop_v = drop_v + r * np.asarray(lfilter([0.0, 1 - decay], [1.0, -decay], current_a))
    return drop_v


def _with_voltage(problem: Problem, voltage_v: np.ndarray) -> Problem:
    prepared = problem.prepared
    whole_v = prepared.record.voltage_v.copy()
    whole_v[prepared.span] = voltage_v
    record = replace(prepared.record, voltage_v=whole_v)
    return replace(problem, prepared_records=(replace(prepared, record=record),))

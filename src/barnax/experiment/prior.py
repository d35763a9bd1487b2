"""The prior of a cell before its next test: from a result, or from its chemistry alone."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from ..bundled import bundled_file
from ..cell import CellModel, CircuitParameters, characterize, get_circuit
from ..cell.curves import InterpolatedCurve
from ..cell.elements import RC, is_resistance
from ..cell.model import MIXED_POINTS
from ..cell.parameters import HALF_HYSTERESIS, OCV_CORRECTION
from ..cell.soc_axis import CAPACITY_WARNING, GIVEN
from ..cell.tables import LEAST_OHM
from ..errors import InputError, attempt, require_choice, require_positive
from ..fit.flat_ocv import with_fitted_ocv
from ..fit.intervals import MAX_SLOTS, UNSEEN
from ..fit.registration import averaged_to_seconds
from ..fit.settings import TableSettings
from ..fit.table_fit import TableFit
from ..model.other_sampling import least_r0_share
from ..records import read_record
from ..results import Result
from ..search.evaluate import Evaluation, one_clock
from ..settings import NODES
from ..uncertainty.noise import fit_noise
from .information import (
    NEARLY_SOC,
    OVERSHOT,
    Columns,
    Name,
    Prior,
    ResidualModel,
    columns_of,
)
from .protocol import voltage_limits_of
from .stored import followed, halves_of

Chemistry = Literal["nmc", "lfp"]
# Resistances of a typical cell of 1 Ah half full, R0, R1 and R2, and their relative increase when
# empty.
TYPICAL_OHM, EMPTY, EMPTY_SOC = (0.10, 0.03, 0.05), (0.3, 1.0, 1.0), 0.08
TYPICAL_TAU_S = (12.0, 120.0)
# Their temperature, and the largest difference from a test's.
TYPICAL_DEGC, NEAR_K = 25.0, 5.0
# The factor by which a cell's resistances may differ, and the deviation of its OCV from the bundled
# cell's.
UNKNOWN, UNKNOWN_OCV_V = 2.0, {"nmc": 0.05, "lfp": 0.03}
# Errors of a fit: eight records at 25 degC leave 4 to 9 mV, very roughly in these shares white and
# correlated over 10, 200 and 1000 s. Shares of the RMSE, and the RMSE if none is known.
SHAPE = ((0.0, 0.4), (10.0, 0.65), (200.0, 0.7), (1000.0, 0.5))
TYPICAL_V = 5e-3
# The share of the RMSE that is not caused by effects outside the circuit.
REST = 0.6
# At a SOC where both are known, no cell's OCV deviates more from the typical one of its chemistry.
COMPARED_FROM_SOC, MOST_APART_V = 0.15, 0.2
# A cell held at its OCV until C/50 is within this voltage of it; its starting SOC is then known to
# at most the second number, from the OCV's rise over that range.
HELD_V, TOP_SOC = 10e-3, 0.05
# For a cell with an unknown OCV, loads end here: below 10 % SOC a voltage may fall unexpectedly (1C
# took a PyBaMM cell 0.9 V below its limit at 8 %).
UNKNOWN_LOW_SOC = 0.1
# A table of a known cell may be off by its interval, and by this.
LEAST_WORST, LEAST_OCV_V = 1.15, 5e-3


def prior_of(
    before: Result | Prior | str | Path | None,
    capacity_ah: float | None,
    chemistry: str | None = None,
    temperature_degc: float | None = None,
) -> Prior:
    """The prior of a cell from a result, the folder of one, or capacity and chemistry; with both,
    the OCV beyond the result's range of SOC is the chemistry's.

    Raises `InputError` for an invalid capacity, if there is none, and as those below do.
    """
    require_positive("capacity", capacity_ah, "Ah")
    if before is None:
        if capacity_ah is None:
            raise InputError("a test needs a `capacity` in Ah, or the result of earlier records")
        if temperature_degc is not None and abs(temperature_degc - TYPICAL_DEGC) > NEAR_K:
            raise InputError(
                f"`temperature` {temperature_degc:g}: without a result, resistances are typical of "
                f"{TYPICAL_DEGC:g} degC, and those of a cold cell are several times as large; give "
                "a result over temperature, or leave it out and set `max_discharge`, `max_charge` "
                "and `low_voltage` for the cold cell yourself"
            )
        return prior_of_chemistry(chemistry or "nmc", capacity_ah)
    if isinstance(before, str | Path):
        before = Result.load(before)
    is_prior = isinstance(before, Prior)
    prior = before if is_prior else prior_of_result(before, temperature_degc)
    if capacity_ah is not None:
        # The largest currents are those of the records.
        share = prior.cell.capacity_ah / capacity_ah
        if prior.cell.ocv_is_fitted and abs(share - 1) > CAPACITY_WARNING:
            raise InputError(
                f"`capacity` {capacity_ah:g} Ah: the OCV was identified over "
                f"{prior.cell.capacity_ah:.4g} Ah ({prior.cell.capacity_origin}), and would "
                "be stretched; identify again with `capacity`, and with `initial_soc` where the "
                "record does not start full"
            )
        cell = replace(prior.cell, capacity_ah=capacity_ah, capacity_origin=GIVEN)
        discharge_c, charge_c = prior.rates_c
        prior = replace(prior, cell=cell, rates_c=(share * discharge_c, share * charge_c))
    if chemistry is None or chemistry == prior.typical:
        return prior
    return _going_on(prior, chemistry)


def _going_on(prior: Prior, chemistry: str) -> Prior:
    """A copy whose OCV is continued beyond its range by a chemistry's: continuous at the joint, and
    equal to the chemistry's at full and empty.

    Raises `InputError` if no full charge is identified, and if the two differ too much.
    """
    typical, (low, high) = _typical_cell(chemistry), prior.ocv_soc
    if prior.start_v is not None:
        raise InputError(
            f"`chemistry` {chemistry}: nothing shows where the cell is full, so no typical OCV can "
            "be joined; leave it out for a test within the record's state of charge, or identify "
            "again with `initial_soc` (1 for a record that starts full) and `capacity`"
        )
    ends = np.array([low, high])
    apart_v = typical.average_ocv_v(ends) - prior.ocv_v(ends)
    # Near empty any two cells differ, but no cell is above its highest voltage.
    is_above = prior.ocv_v(ends) > voltage_limits_of(prior.cell, chemistry)[1] + HELD_V
    is_other = is_above | (ends > COMPARED_FROM_SOC) & (np.abs(apart_v) > MOST_APART_V)
    if is_other.any():
        index = int(np.argmax(np.abs(apart_v) * is_other))
        raise InputError(
            f"`chemistry` {chemistry}: at {100 * ends[index]:.0f} % SOC such a cell has about "
            f"{typical.average_ocv_v(ends)[index]:.2f} V, and this one "
            f"{prior.ocv_v(ends)[index]:.2f} V; give another `chemistry` or none, or identify "
            "again with another `capacity` or `initial_soc`"
        )
    prior = replace(prior, typical=chemistry, typical_reach_v=UNKNOWN_OCV_V[chemistry])
    if prior.ocv_soc == (0.0, 1.0):
        return prior
    soc = np.linspace(0.0, 1.0, MIXED_POINTS)
    at = np.clip(soc, low, high)
    more_v = typical.average_ocv_v(soc) - typical.average_ocv_v(at)
    more_v += np.interp(
        soc, [0.0, low, high, 1.0], [apart_v[0] * (low > 0), 0.0, 0.0, apart_v[1] * (high < 1)]
    )
    charge, discharge = (
        InterpolatedCurve.fit(soc, np.maximum.accumulate(branch(at) + more_v))
        for branch in (prior.cell.charge, prior.cell.discharge)
    )
    return replace(prior, cell=replace(prior.cell, charge=charge, discharge=discharge))


def prior_of_chemistry(chemistry: str, capacity_ah: float) -> Prior:
    """A typical cell without any record: the test has to identify its OCV too.

    Raises `InputError` for an unknown chemistry.
    """
    cell = replace(_typical_cell(chemistry), capacity_ah=capacity_ah, capacity_origin=GIVEN)
    nodes = np.array(NODES)
    rise = np.exp(-np.maximum(nodes, 0.0) / EMPTY_SOC)
    r0, *r = (
        tuple((ohm / capacity_ah * (1 + more * rise)).tolist())
        for ohm, more in zip(TYPICAL_OHM, EMPTY, strict=True)
    )
    return Prior(
        cell=cell,
        tables=CircuitParameters.over_soc(NODES, TYPICAL_TAU_S, r0, tuple(r)),
        worst=np.full(len(NODES), UNKNOWN),
        error=typical_error(TYPICAL_V),
        settings=with_fitted_ocv(TableSettings()),
        ocv_reach_v=UNKNOWN_OCV_V[chemistry],
        typical=chemistry,
    )


@cache
def _typical_cell(chemistry: str) -> CellModel:
    """The bundled cell of a chemistry. Raises `InputError` for an unknown one."""
    require_choice("chemistry", chemistry, get_args(Chemistry))
    prefix = "" if chemistry == "nmc" else "lfp_"
    tests = [read_record(bundled_file(f"{prefix}ocv_{side}")) for side in ("charge", "discharge")]
    return characterize(tests, ocv_fit="interpolated")


def prior_of_result(result: Result, temperature_degc: float | None = None) -> Prior:
    """The cell of a result, with the intervals from its records at that temperature; without
    intervals if none was measured there.

    Raises `InputError` if its answer has elements other than RC pairs, or lacks the temperature.
    """
    intervals, untold, parts = result.fit.intervals, "", result.of_role("identification")
    evaluations = attempt(lambda: result.evaluations.identification)
    if isinstance(evaluations, InputError):
        evaluations, untold = (), str(evaluations)
    # Means of fast records determine slow dynamics as well.
    earlier = [
        result.fits.evaluate(averaged_to_seconds(evaluated.prepared))
        for evaluated, part in zip(evaluations, parts, strict=False)
        if temperature_degc is None or part.is_at(temperature_degc)
    ]
    if temperature_degc is not None:
        over = result.fits.over_temperature
        if over is None:
            raise InputError(
                f"`temperature` {temperature_degc:g}: the result has tables of one temperature, or "
                "none; leave it out, or give one that was identified `over` soc,temperature"
            )
        near = over.measured_near(temperature_degc)
        intervals = () if near is None else dict(result.fits.by_degc)[near].intervals
        result = result.at_temperature(temperature_degc)
    cell, rmse_v = result.cell_at(temperature_degc), result.metrics.identification.rmse_v
    if any(element != RC.name for element in get_circuit(result.model).elements):
        raise InputError(
            f"a test is designed for RC pairs, and the answer is {result.model}; identify with "
            "`model` so-rc"
        )
    if result.fit.is_over_soc:
        fit = replace(result.fit, intervals=intervals)
        prior = prior_of_fit(fit, result.fits.settings, cell, rmse_v)
    else:
        circuit = result.circuit_parameters
        r0_ohm, *r_ohm = np.repeat(circuit.ohm, len(NODES), axis=1)
        prior = Prior(
            cell=cell,
            tables=CircuitParameters.over_soc(NODES, circuit.tau_s, r0_ohm, r_ohm),
            worst=np.full(len(NODES), UNKNOWN),
            error=typical_error(rmse_v),
            settings=with_fitted_ocv(TableSettings()) if cell.ocv_is_fitted else TableSettings(),
            ocv_reach_v=LEAST_OCV_V,
        )
    prior = counting(replace(prior, circuit=result.model), earlier)
    largest_c = max((part.peak_current_a or 0.0 for part in parts), default=0.0) / cell.capacity_ah
    rates_c = (largest_c, largest_c / 2) if largest_c else prior.rates_c
    taus = tuple(bound for bound in result.at_bound if bound.name.startswith("tau"))
    used = [one.prepared for one in earlier]
    is_open = result.over is not None and result.fits.hold_shift_ohm is not None
    prior = replace(
        prior, rates_c=rates_c, untold=untold, ocv_soc=_ocv_range(cell), at_bound=taus,
        beyond=("hold",) * is_open + ("pair",) * bool(used and least_r0_share(used) < 1),
    )  # fmt: skip
    is_fitted_ocv = cell.ocv_is_fitted and any(part.start_source == "own span" for part in parts)
    return _started_by_voltage(prior) if is_fitted_ocv else prior


def _ocv_range(cell: CellModel) -> tuple[float, float]:
    """The range of SOC over which a cell's OCV is known; one that nearly reaches an end reaches
    it."""
    low, high = cell.soc_range
    nearly_empty = UNKNOWN_LOW_SOC - OVERSHOT if cell.ocv_is_fitted else NEARLY_SOC
    # Rounded down to the digits in which a start is reported.
    high = 1.0 if high > 1 - NEARLY_SOC else math.floor(1e3 * high) / 1e3
    return 0.0 if low <= nearly_empty else low, high


def _started_by_voltage(prior: Prior) -> Prior:
    """A copy in which full is the fullest point of a record: the OCV gives the voltage that brings
    a cell there.

    Raises `InputError` if that OCV is too flat.
    """
    top = prior.ocv_soc[1]
    below_v, top_v = prior.ocv_v(np.array([top - TOP_SOC, top])).tolist()
    off_soc = HELD_V / max((top_v - below_v) / TOP_SOC, 1e-9)
    if off_soc > TOP_SOC:
        raise InputError(
            "nothing shows where the cell is full, and at its fullest point in the record, "
            f"{top_v:.2f} V, the OCV is too flat to bring it there by its voltage; identify again "
            "with `initial_soc` (1 for a record that starts full) and `capacity`, or design a test "
            "from `capacity` and `chemistry` alone"
        )
    return replace(prior, start_v=top_v, start_reach_soc=off_soc)


def prior_of_fit(fit: TableFit, settings: TableSettings, cell: CellModel, rmse_v: float) -> Prior:
    """The cell of tables that were fitted with these settings and left this RMSE."""
    half_widths, printed = dict[Name, float](), dict[Name, float]()
    for one in fit.intervals:
        if (halves := halves_of(one)) is not None:
            half_widths[one.name, one.soc], printed[one.name, one.soc] = halves
    corrections_v = (half_v for (name, _), half_v in printed.items() if name == OCV_CORRECTION)
    tables = fit.tables.without(HALF_HYSTERESIS)
    ohm = np.maximum(tables.ohm, LEAST_OHM)
    tables = tables.with_tables(dict(zip(tables.resistances, ohm, strict=True)))
    return Prior(
        cell=cell,
        tables=replace(tables, scales=fit.tables.named_tau_s, dependence=None),
        worst=_worst(fit, fit.tables.nodes),
        error=typical_error(rmse_v),
        settings=with_fitted_ocv(settings) if cell.ocv_is_fitted else settings,
        half_widths=half_widths,
        printed=printed,
        follows=followed(fit.tables.dependence),
        ocv_reach_v=LEAST_OCV_V + max(corrections_v, default=0.0),
    )


def counting(prior: Prior, earlier: Sequence[Evaluation]) -> Prior:
    """A copy that counts the records to be identified with the test's, and the error estimated from
    them.
    """
    if not earlier:
        return prior
    records = [evaluated.prepared for evaluated in earlier]
    return replace(prior, earlier=records, error=error_of(prior, earlier))


def typical_error(rmse_v: float) -> ResidualModel:
    """The assumed error of a fit with that RMSE."""
    noise = tuple((time_s, share * rmse_v) for time_s, share in SHAPE)
    return ResidualModel(rmse_v, noise, rmse_v / TYPICAL_V, REST * rmse_v)


def _worst(fit: TableFit, nodes: tuple[float, ...]) -> Float[np.ndarray, "nodes"]:
    """The largest sum of the resistances within their intervals, over the identified sum."""
    values, high = np.zeros(len(nodes)), np.zeros(len(nodes))
    for interval in fit.intervals:
        if interval.soc is not None and is_resistance(interval.name):
            index = nodes.index(interval.soc)
            values[index] += interval.value
            high[index] += min(interval.high or math.inf, UNKNOWN * interval.value)
    ratio = np.where(values > 0, high / np.maximum(values, LEAST_OHM), UNKNOWN)
    return np.maximum(ratio, LEAST_WORST)


def error_of(prior: Prior, earlier: Sequence[Evaluation]) -> ResidualModel:
    """The error of a fit with these tables, estimated from its residuals on its records: the part
    due to noise, and the part due to effects outside the circuit.

    The part of the columns F (`information`) that the tables cannot absorb explains some of the
    errors. Noise would produce similar errors, of an expected size; the excess gives the size of
    the effects outside the circuit.
    """
    usual = replace(prior, error=replace(prior.error, left_out=1.0))
    records = [evaluated.prepared for evaluated in earlier]
    columns = np.concatenate([columns_of(usual, one)[one.scored] for one in records])
    longest_s = max(prepared.scored_duration_s for prepared in records)
    clock = one_clock(records), longest_s, MAX_SLOTS
    followed, left_out = np.split(columns, [len(prior.names)], axis=1)
    basis = _basis(followed)
    # Includes errors that bounds and smoothing kept the fit from removing.
    error_v = np.concatenate([one.error_v[one.prepared.scored] for one in earlier])
    left_out = _without(left_out, basis)
    explaining = _basis(left_out)
    noise = fit_noise(error_v, basis, *clock)
    both = np.concatenate([basis, explaining], axis=1)
    of_rest = fit_noise(_without(error_v, explaining), both, *clock).spread_v2
    expected_v2 = float(np.trace(of_rest[basis.shape[1] :, basis.shape[1] :]))
    explained_v2 = max(float(np.sum((explaining.T @ error_v) ** 2)) - expected_v2, 0.0)
    rmse_v = math.sqrt(float(np.mean(error_v**2)))
    parts = zip(noise.correlation_s.tolist(), np.sqrt(noise.variance_v2).tolist(), strict=True)
    return ResidualModel(
        rmse_v=rmse_v,
        noise=tuple((correlation_s, sd_v) for correlation_s, sd_v in parts if sd_v > 0),
        left_out=math.sqrt(explained_v2 / float(np.sum(left_out**2))),
        rest_v=math.sqrt(max(rmse_v**2 - explained_v2 / len(error_v), 0.0)),
    )


def _basis(columns: Columns) -> Columns:
    """Orthonormal columns with the same span, down to rounding."""
    lengths = np.linalg.norm(columns, axis=0)
    seen = lengths > UNSEEN * lengths.max()
    basis, sizes, _ = np.linalg.svd(columns[:, seen] / lengths[seen], full_matrices=False)
    return basis[:, sizes > UNSEEN * sizes[0]]


def _without(values: np.ndarray, basis: Columns) -> np.ndarray:
    return values - basis @ (basis.T @ values)

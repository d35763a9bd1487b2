"""Beliefs about a cell before its next test: by a result, or by its chemistry alone."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float

from ..bundled import bundled_file
from ..cell import CellModel, CircuitParameters, characterize, get_circuit
from ..cell.elements import RC
from ..cell.parameters import HALF_HYSTERESIS, OCV_CORRECTION
from ..cell.soc_axis import GIVEN
from ..cell.tables import LEAST_OHM
from ..errors import InputError
from ..over_soc import TableFit
from ..over_soc.level import with_own_ocv
from ..over_soc.settings import TableSettings
from ..records import read_record
from ..results import Result
from ..search.evaluate import Evaluation
from ..settings import NODES
from .earlier import by_second, error_of
from .information import Believed, Error

Chemistry = Literal["nmc", "lfp"]
# Lowest and highest voltage of a cell of layered oxide, and of one whose OCV when full is under the
# last.
WINDOW_V, LFP_WINDOW_V, LFP_FULL_V, NEARLY_FULL = (2.5, 4.2), (2.0, 3.65), 3.8, 0.97
# A few minutes of any cell are flat: one of LFP has been seen nearly empty too.
SEEN_EMPTY_V = 3.1
# Resistances of a typical cell of 1 Ah half full, R0, R1 and R2, and how much more they are empty.
TYPICAL_OHM, EMPTY, EMPTY_SOC = (0.10, 0.03, 0.05), (0.3, 1.0, 1.0), 0.08
TYPICAL_TAU_S = (12.0, 120.0)
# How many times that a cell's may be, and how far its OCV from the bundled cell's.
UNKNOWN, UNKNOWN_OCV_V = 2.0, {"nmc": 0.05, "lfp": 0.03}
# What a fit leaves: eight records at 25 degC, six of them of two measured cells, leave 4 to 9 mV,
# very roughly so much of it white and correlated over 10, 200 and 1000 s. Shares of the RMSE, and
# the RMSE where none is known.
SHAPE = ((0.0, 0.4), (10.0, 0.65), (200.0, 0.7), (1000.0, 0.5))
TYPICAL_V = 5e-3
# Of the RMSE, what is not due to what the circuit leaves out.
REST = 0.6
# A table of a known cell may be off by its interval, and by this.
LEAST_WORST, LEAST_OCV_V = 1.15, 5e-3


def believed_of(
    known: Result | Believed | str | Path | None,
    capacity_ah: float | None,
    chemistry: str,
    temperature_degc: float | None = None,
) -> Believed:
    """The belief about a cell of a result, of the folder of one, or of capacity and chemistry.

    Raises `InputError` for what is no capacity, where nothing tells it, and as those below do.
    """
    if capacity_ah is not None and not 0 < capacity_ah < math.inf:
        raise InputError(f"`capacity` {capacity_ah:g} Ah must be positive and finite")
    if known is None:
        if capacity_ah is None:
            raise InputError("a test needs a `capacity` in Ah, or the result of earlier records")
        return believed_of_chemistry(chemistry, capacity_ah)
    if isinstance(known, str | Path):
        known = Result.load(known)
    if isinstance(known, Result):
        known = believed_of_result(known, temperature_degc)
    if capacity_ah is None:
        return known
    cell = replace(known.cell, capacity_ah=capacity_ah, capacity_origin=GIVEN)
    # The largest currents are those of the records.
    share = known.cell.capacity_ah / capacity_ah
    return replace(known, cell=cell, rates_c=(share * known.rates_c[0], share * known.rates_c[1]))


def window_of(cell: CellModel) -> tuple[float, float]:
    """The lowest and the highest voltage that are usual for a cell with such an OCV.

    An OCV that is not known of a full cell may be of either kind, unless it goes beyond one: then
    the narrower limits are taken.
    """
    highest_soc = cell.soc_range[1]
    highest_v = float(cell.average_ocv_v(np.array([highest_soc]))[0])
    # Of a cell without an OCV test, the fullest that was seen may be far from full.
    if highest_soc > NEARLY_FULL and not cell.is_of_records:
        return LFP_WINDOW_V if highest_v < LFP_FULL_V else WINDOW_V
    if highest_v > LFP_WINDOW_V[1]:
        return WINDOW_V
    lowest_v = float(cell.average_ocv_v(np.array([cell.soc_range[0]]))[0])
    is_lfp = cell.has_flat_ocv and (not cell.is_of_records or lowest_v < SEEN_EMPTY_V)
    return LFP_WINDOW_V if is_lfp else (WINDOW_V[0], LFP_WINDOW_V[1])


def believed_of_chemistry(chemistry: str, capacity_ah: float) -> Believed:
    """A typical cell, of which no record exists: the test has to find its OCV too.

    Raises `InputError` for an unknown chemistry.
    """
    if chemistry not in get_args(Chemistry):
        known = ", ".join(get_args(Chemistry))
        raise InputError(f"`chemistry` {chemistry!r} is not known; there are {known}")
    prefix = "" if chemistry == "nmc" else "lfp_"
    tests = [read_record(bundled_file(f"{prefix}ocv_{way}")) for way in ("charge", "discharge")]
    cell = replace(
        characterize(tests, ocv_fit="interpolated"), capacity_ah=capacity_ah, capacity_origin=GIVEN
    )
    nodes = np.array(NODES)
    rise = np.exp(-np.maximum(nodes, 0.0) / EMPTY_SOC)
    r0, *r = (
        tuple((ohm / capacity_ah * (1 + more * rise)).tolist())
        for ohm, more in zip(TYPICAL_OHM, EMPTY, strict=True)
    )
    return Believed(
        cell=cell,
        tables=CircuitParameters.over_soc(NODES, TYPICAL_TAU_S, r0, tuple(r)),
        worst=np.full(len(NODES), UNKNOWN),
        error=typical_error(TYPICAL_V),
        settings=with_own_ocv(TableSettings()),
        ocv_reach_v=UNKNOWN_OCV_V[chemistry],
    )


def believed_of_result(result: Result, temperature_degc: float | None = None) -> Believed:
    """The cell of a result, with what its records tell at that temperature: nothing of intervals
    where none was measured.

    Raises `InputError` where its answer has elements that are no RC pairs, or nothing that follows
    the temperature that is asked for.
    """
    told, untold = result.tables and result.tables.fit.intervals, ""
    peaks_a = [part.peak_current_a or 0.0 for part in result.of_role("identification")]
    try:
        earlier = _records_of(result, temperature_degc)
    except InputError as problem:
        earlier, untold = [], str(problem)
    if temperature_degc is not None:
        over = result.tables and result.tables.over_temperature
        if result.tables is None or over is None:
            raise InputError(
                f"`temperature` {temperature_degc:g}: the result has tables of one temperature, or "
                "none; leave it out, or give one that was identified `over` soc,temperature"
            )
        near = over.measured_near(temperature_degc)
        fits = dict(zip(over.temperatures_degc, result.tables.fits, strict=True))
        told = () if near is None else fits[near].intervals
        result = result.at_temperature(temperature_degc)
    cell, rmse_v = result.cell_at(temperature_degc), result.metrics.identification.rmse_v
    if any(element != RC.name for element in get_circuit(result.model).elements):
        raise InputError(
            f"a test is designed for RC pairs, and the answer is {result.model}; identify with "
            "`model` so-rc"
        )
    if result.tables is not None and result.tables.over != "ocv":
        fit = replace(result.tables.fit, intervals=told or ())
        believed = believed_of_fit(fit, result.tables.settings, cell, rmse_v, earlier)
    else:
        circuit = result.constant.parameters
        r0_ohm, *r_ohm = np.repeat(circuit.ohm, len(NODES), axis=1)
        constants = Believed(
            cell=cell,
            tables=CircuitParameters.over_soc(NODES, circuit.tau_s, r0_ohm, r_ohm),
            worst=np.full(len(NODES), UNKNOWN),
            error=typical_error(rmse_v),
            settings=with_own_ocv(TableSettings()) if cell.is_of_records else TableSettings(),
            ocv_reach_v=LEAST_OCV_V,
        )
        believed = _counting(constants, earlier)
    largest_c = max(peaks_a, default=0.0) / cell.capacity_ah
    rates_c = (largest_c, largest_c / 2) if largest_c else believed.rates_c
    return replace(believed, rates_c=rates_c, untold=untold)


def _records_of(result: Result, temperature_degc: float | None) -> list[Evaluation]:
    """The records that a result is of, at that temperature. Raises `InputError` where they are not
    found."""
    run = result.run
    found = run.identification if run.tables is None else run.tables.identification
    return [
        evaluated
        for evaluated, part in zip(found, result.of_role("identification"), strict=True)
        if temperature_degc is None or part.is_at(temperature_degc)
    ]


def believed_of_fit(
    fit: TableFit,
    settings: TableSettings,
    cell: CellModel,
    rmse_v: float,
    earlier: Sequence[Evaluation] = (),
) -> Believed:
    """The cell of tables that were fitted with these settings and left such an RMSE, with the
    records that will be identified with the next test's."""
    known = {
        (one.name, one.soc): half / one.value if one.name.startswith(("R", "tau")) else half
        for one in fit.intervals
        if one.low is not None and one.high is not None and one.value
        for half in [(one.high - one.low) / 2]
    }
    corrections = [half for (name, _), half in known.items() if name == OCV_CORRECTION]
    found = fit.tables
    tables = replace(
        found,
        tables={
            name: _positive(row) if name in found.resistances else row
            for name, row in found.tables.items()
            if name != HALF_HYSTERESIS
        },
        scales=found.named_tau_s,
        dependence=None,
    )
    believed = Believed(
        cell=cell,
        tables=tables,
        worst=_worst(fit, settings.nodes),
        error=typical_error(rmse_v),
        settings=with_own_ocv(settings) if cell.is_of_records else settings,
        known=known,
        ocv_reach_v=LEAST_OCV_V + max(corrections, default=0.0),
    )
    return _counting(believed, earlier)


def _counting(believed: Believed, earlier: Sequence[Evaluation]) -> Believed:
    """The same with records that are identified with the test's, and the error that they show."""
    if not earlier:
        return believed
    seconds = [by_second(evaluated.prepared) for evaluated in earlier]
    return replace(believed, earlier=seconds, error=error_of(believed, earlier))


def _positive(row: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(max(ohm, LEAST_OHM) for ohm in row)


def typical_error(rmse_v: float) -> Error:
    """The error that a fit with that RMSE is taken to have."""
    noise = tuple((time_s, share * rmse_v) for time_s, share in SHAPE)
    return Error(rmse_v, noise, rmse_v / TYPICAL_V, REST * rmse_v)


def _worst(fit: TableFit, nodes: tuple[float, ...]) -> Float[np.ndarray, "nodes"]:
    """The largest sum of the resistances within their intervals over the sum itself."""
    values, high = np.zeros(len(nodes)), np.zeros(len(nodes))
    told = np.zeros(len(nodes), bool)
    for interval in fit.intervals:
        if interval.soc is None or not interval.name.startswith("R"):
            continue
        place = nodes.index(interval.soc)
        values[place] += interval.value
        high[place] += min(interval.high or math.inf, UNKNOWN * interval.value)
        told[place] = True
    ratio = np.where(told, high / np.maximum(values, LEAST_OHM), UNKNOWN)
    return np.maximum(ratio, LEAST_WORST)

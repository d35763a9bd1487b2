"""From prepared records to the objective of their tables and its optimum: the ranges searched, and
reduced factors."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from ..cell import get_circuit
from ..cell.elements import get_element, names_of
from ..cell.parameters import OHMIC, RATE
from ..errors import InputError
from ..execution import in_float64
from ..model.descent import Descended, GridSizes, LogScales, Polished, lowest_scales, polish
from ..model.exponentials import AT_ONCE, span_through
from ..model.layout import Layout, span_ends, spans_between
from ..model.other_sampling import FASTEST_TAU_S
from ..model.prepared import PreparedRecord
from ..model.reduced import combine_factors, reduce_records
from ..model.search_space import RATE_RANGE, Range
from .folds import blocks_of
from .objective import Solution, TableObjective
from .settings import SLOWEST_SHARE, SLOWEST_TAU_S, TableSettings

# Records whose SOC rises or falls by less than this contain no information about the branch
# in that direction.
BOTH_WAYS_SOC = 0.1
# Rate held for a dynamic hysteresis that records do not determine: it has turned after about 10 %
# SOC.
HELD_GAMMA = 20.0


@in_float64
def reduced_objective(
    prepared_records: Sequence[PreparedRecord],
    settings: TableSettings,
    ranges: Mapping[str, Range] | None = None,
    voltage_offsets_v: Sequence[Float[np.ndarray, "simulated voltages"]] | None = None,
) -> TableObjective:
    """The objective over all records, in the given ranges or their own. With `voltage_offsets_v`,
    as in `reduce_records`, its factor has a base error for each of the voltages."""
    ranges = ranges or search_ranges(prepared_records, settings)
    layout = _layout(prepared_records, settings, ranges)
    if voltage_offsets_v is not None:
        layout = replace(layout, voltages=tuple(range(voltage_offsets_v[0].shape[1])))
    parts = reduce_records(
        prepared_records, layout, *blocks_of(prepared_records, settings), voltage_offsets_v
    )
    # A shortened part is no longer triangular, as taking one of its voltages requires.
    is_kept = len(layout.voltages) > 1 and len(parts) == 1
    whole = parts[0] if is_kept else combine_factors(parts)
    # A group visits few nodes: most rows of its triangle are empty. Each is released at once.
    for index, part in enumerate(parts):
        parts[index] = replace(part, factor=part.factor[part.factor.any(axis=1)])
    return TableObjective(list(prepared_records), settings, ranges, whole, parts)


def _layout(
    prepared_records: Sequence[PreparedRecord], settings: TableSettings, ranges: Mapping[str, Range]
) -> Layout:
    """Columns for the elements' time constants and gamma in these ranges, to the accuracy of the
    scan, and far fewer if all are held. Raises `InputError` if a range is too wide."""
    interval_s = min(float(np.min(np.diff(prepared.time_s))) for prepared in prepared_records)
    limits = [limits for name, limits in ranges.items() if name != RATE]
    elements = get_circuit(prepared_records[0].circuit).elements
    ratios = [get_element(name).ratios for name in elements]
    if all(low == high for low, high in ranges.values()):
        taus_s = {
            max(tau_s * ratio, interval_s / AT_ONCE)
            for (tau_s, _), each in zip(limits, ratios, strict=True)
            for ratio in each
        }
        in_tau = span_through([math.log(tau_s) for tau_s in sorted(taus_s)])
        in_rate = span_through([-math.log(ranges[RATE][0])]) if RATE in ranges else None
        spans = in_tau, in_rate
    else:
        fastest_s = min(low * each[-1] for (low, _), each in zip(limits, ratios, strict=True))
        slowest_s = max(high * each[0] for (_, high), each in zip(limits, ratios, strict=True))
        spans = spans_between(span_ends((fastest_s, slowest_s), ranges.get(RATE), interval_s))
    tables = settings.ocv_correction, settings.half_hysteresis
    return Layout(settings.nodes, settings.nodes_of_ocv, *spans, *tables)


def coarsened(
    finest: TableObjective, prepared_records: Sequence[PreparedRecord], settings: TableSettings
) -> TableObjective:
    """The objective of a circuit with fewer nodes or pairs, or no correction of the OCV, from the
    factors of a finer one on the same records, whose parts it shares."""
    layout, ranges = finest.reduced.layout, search_ranges(prepared_records, settings)
    layout = replace(layout, nodes=settings.nodes, has_correction=settings.ocv_correction)
    reduced = finest.reduced.coarser(layout)
    return TableObjective(list(prepared_records), settings, ranges, reduced, finest.parts)


def held_at(names: Iterable[str], log_scales: Sequence[float]) -> dict[str, Range]:
    """The ranges that hold the time constants and gamma at given scales: far less to reduce for."""
    scales = zip(names, log_scales, strict=True)
    return {name: (math.exp(scale), math.exp(scale)) for name, scale in scales}


def solve_at(
    prepared_records: Sequence[PreparedRecord],
    settings: TableSettings,
    names: Iterable[str],
    log_scales: LogScales,
    exact: bool = False,
) -> tuple[TableObjective, Solution]:
    """The objective at the given scales alone, and its best tables."""
    held = held_at(names, log_scales)
    objective = reduced_objective(prepared_records, settings, held)
    return objective, objective.solve(log_scales, exact=exact)


def search_ranges(prepared_records: Sequence[Any], settings: TableSettings) -> dict[str, Range]:
    """The ranges of every pair's time constant, and of gamma if there is one, by name; also for
    records stored as factors."""
    circuit, ranges = get_circuit(prepared_records[0].circuit), settings.ranges
    interval_s = min(prepared.median_interval_s for prepared in prepared_records)
    duration_s = max(prepared.scored_duration_s for prepared in prepared_records)
    slowest_s = min(SLOWEST_TAU_S, duration_s * (SLOWEST_SHARE if settings.ocv_correction else 1.0))
    # A time constant far below the sampling interval cannot be distinguished from the ohmic
    # resistance. A pulse test logs its rests slowly and its pulses fast; the pulses count.
    dense_s = min(prepared.dense_interval_s for prepared in prepared_records)
    fastest_s = min(max(min(FASTEST_TAU_S, 2 * interval_s), dense_s / 2), slowest_s)
    box, allowed = {}, {OHMIC, RATE}
    for names, element in zip(names_of(circuit.elements), circuit.elements, strict=True):
        # The range of an element is that of its slowest RC pair that matters.
        ratio = get_element(element).slowest_ratio
        box[names.tau] = ranges.get(names.tau, (fastest_s / ratio, slowest_s / ratio))
        allowed |= {names.tau, names.resistance}
    unknown = ranges.keys() - allowed
    if unknown or (RATE in ranges and not circuit.has_rate):
        raise InputError(
            f"the circuit {circuit.name} has no {', '.join(sorted(unknown)) or RATE} to bound or "
            "fix"
        )
    if settings.half_hysteresis and not circuit.has_rate:
        raise InputError(
            f"the circuit {circuit.name} has no dynamic hysteresis, so `half_hysteresis` has no "
            "amplitude to fit; choose the circuit esc"
        )
    if any(high < math.nextafter(low, 0) for low, high in box.values()):
        raise InputError("the bounds leave no range for the time constants; widen them")
    if circuit.has_rate:
        # Held if the records do not determine it, unless it is requested.
        is_shown = settings.half_hysteresis or least_travel_soc(prepared_records) >= BOTH_WAYS_SOC
        box[RATE] = ranges.get(RATE, RATE_RANGE if is_shown else (HELD_GAMMA, HELD_GAMMA))
    return box


def least_travel_soc(prepared_records: Sequence[PreparedRecord]) -> float:
    """The largest rise or fall of the SOC in a record, in the direction where that is smaller."""

    def furthest(soc: Float[np.ndarray, "samples"], extreme: np.ufunc) -> float:
        ends = extreme.accumulate(soc)
        np.subtract(soc, ends, out=ends)
        return float(max(ends.max(), -ends.min()))

    return min(
        max(furthest(prepared.soc, extreme) for prepared in prepared_records)
        for extreme in (np.minimum, np.maximum)
    )


# Grid points per time constant by the number of pairs, alone and with gamma, and of gamma.
GRID = GridSizes({1: 64, 2: 20, 3: 10, 4: 8}, {1: 32, 2: 12, 3: 8, 4: 7}, 8)
# Number of lowest grid points that are polished.
MAX_MINIMA = 4


def find_best(objective: Descended[Polished]) -> Polished:
    """The best tables and time constants from a grid and descents from its minima."""
    # Two pairs with one time constant are one pair, and searched only if there is nothing else.
    starts = lowest_scales(objective, GRID, apart=True)[:MAX_MINIMA]
    ends = [polish(objective, objective.solve(start)) for start in starts]
    best = min(ends, key=lambda end: end.objective_v2)
    return objective.solve(best.log_scales, best.active_set, exact=True)

"""From prepared records to the objective of their tables: what is searched, and reduced factors."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from ..blas import one_blas_thread
from ..cell import get_circuit
from ..cell.elements import get_element, names_of
from ..cell.parameters import OHMIC, RATE
from ..errors import InputError
from ..model.layout import layout_of
from ..model.prepared import PreparedRecord
from ..model.reduced import Reduced, reduce_records, together
from ..model.search_space import RATE_RANGE, Range
from .blocks import blocks_of
from .objective import TableObjective
from .settings import FASTEST_TAU_S, SLOWEST_SHARE, SLOWEST_TAU_S, TableSettings

# Records that go less SOC than this without turning tell nothing of the branch of that direction.
BOTH_WAYS_SOC = 0.1
# Of a dynamic hysteresis that such records do not tell: it has turned after about 10 % SOC.
HELD_GAMMA = 20.0


def reduced_objective(
    prepared_records: Sequence[PreparedRecord],
    settings: TableSettings,
    ranges: Mapping[str, Range] | None = None,
    seen: Callable[[PreparedRecord], PreparedRecord] = lambda prepared: prepared,
    beside_v: Float[np.ndarray, "simulated sides"] | None = None,
) -> TableObjective:
    """The objective over all records, as they are `seen`, in the ranges given or their own. With
    `beside_v`, as `reduce_records` has it, its factor has a side for each voltage of one record."""
    ranges = ranges or box_of(prepared_records, settings)
    layout = layout_of(
        settings.nodes,
        settings.nodes_of_ocv,
        ranges,
        settings.ocv_correction,
        settings.half_hysteresis,
        get_circuit(prepared_records[0].circuit).elements,
        min(float(np.min(np.diff(prepared.time_s))) for prepared in prepared_records),
    )

    if beside_v is not None:
        layout = replace(layout, sides=beside_v.shape[1])
    own = [seen(prepared) for prepared in prepared_records]
    parts = reduce_records(own, layout, *blocks_of(own, settings), beside_v)
    with one_blas_thread():
        # What is shortened is no triangle any more, of which a side is taken.
        whole = together(parts) if beside_v is None else parts[0]
    return TableObjective(own, settings, ranges, whole, parts)


def coarsened(
    finest: TableObjective, prepared_records: Sequence[PreparedRecord], settings: TableSettings
) -> TableObjective:
    """The objective of a circuit with fewer nodes, pairs, or no correction of the OCV, from the
    factors of a finer one on the same records."""
    ranges = box_of(prepared_records, settings)

    def coarser(reduced: Reduced) -> Reduced:
        return reduced.coarser(settings.nodes, settings.ocv_correction)

    parts = tuple(map(coarser, finest.parts))
    return TableObjective(list(prepared_records), settings, ranges, coarser(finest.reduced), parts)


def held_at(names: Iterable[str], log_scales: Sequence[float]) -> dict[str, Range]:
    """The ranges that hold the time constants and gamma at some scales: far less to reduce for."""
    scales = zip(names, log_scales, strict=True)
    return {name: (math.exp(scale), math.exp(scale)) for name, scale in scales}


def box_of(prepared_records: Sequence[Any], settings: TableSettings) -> dict[str, Range]:
    """The ranges of every pair's time constant, and that of gamma where there is one, by name; of
    records that were kept too."""
    circuit, ranges = get_circuit(prepared_records[0].circuit), settings.ranges
    interval_s = min(prepared.median_interval_s for prepared in prepared_records)
    duration_s = max(prepared.scored_duration_s for prepared in prepared_records)
    slowest_s = min(SLOWEST_TAU_S, duration_s * (SLOWEST_SHARE if settings.ocv_correction else 1.0))
    # What is much faster than the sampling cannot be told from the ohmic resistance. A pulse test
    # logs its rests slowly and its pulses fast, which tell.
    dense_s = min(prepared.dense_interval_s for prepared in prepared_records)
    fastest_s = min(max(min(FASTEST_TAU_S, 2 * interval_s), dense_s / 2), slowest_s)
    box, known = {}, {OHMIC, RATE}
    for names, element in zip(names_of(circuit.elements), circuit.elements, strict=True):
        # The box is of the slowest RC pair that counts.
        ratio = get_element(element).slowest_ratio
        box[names.tau] = ranges.get(names.tau, (fastest_s / ratio, slowest_s / ratio))
        known |= {names.tau, names.resistance}
    unknown = ranges.keys() - known
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
        # Held where the records do not tell it, and nothing else is asked for.
        is_told = settings.half_hysteresis or least_travel_soc(prepared_records) >= BOTH_WAYS_SOC
        box[RATE] = ranges.get(RATE, RATE_RANGE if is_told else (HELD_GAMMA, HELD_GAMMA))
    return box


def least_travel_soc(prepared_records: Sequence[PreparedRecord]) -> float:
    """The longest way of the SOC without turning back, in the direction where that is shorter."""

    def furthest(soc: Float[np.ndarray, "samples"], extreme: np.ufunc) -> float:
        ends = extreme.accumulate(soc)
        np.subtract(soc, ends, out=ends)
        return float(max(ends.max(), -ends.min()))

    return min(
        max(furthest(prepared.soc, extreme) for prepared in prepared_records)
        for extreme in (np.minimum, np.maximum)
    )

"""The place of records on the axis of SOC where there is no OCV test: capacity and start."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..cell.soc_axis import GIVEN
from ..errors import InputError
from ..model.prepared import soc_along
from ..model.window import OCV_MARGIN, Window, first_sample, scored_samples
from ..records import Record, rest_current_a
from ..records.segments import FULL_CHARGE, held_charges

# A start lies so far outside 0 to 1 where another full charge was a little fuller.
NEARLY_SOC = 0.02
# A usual cell under load is never empty above this.
NEVER_EMPTY_V = 3.4


def axis_capacity(
    records: Sequence[Record], windows: Mapping[str, Window], given_ah: float | None
) -> tuple[float, str]:
    """One capacity for the axis, given or the widest span, and where it comes from."""
    given = {windows[record.name].capacity_ah for record in records} - {None}
    if len(given) > 1:
        raise InputError(
            "records of one cell without an OCV test need one `capacity`; they were given "
            f"{', '.join(f'{ah:g}' for ah in sorted(filter(None, given)))} Ah"
        )
    given_ah = next(iter(given), None) or given_ah
    if given_ah is not None:
        return given_ah, GIVEN
    widest = max(records, key=span_ah_of)
    span_ah = span_ah_of(widest)
    if not span_ah > 0:
        raise InputError(
            f"{records[0].name}: its current moves no charge, so nothing tells the OCV; give a "
            "record that goes over much of the state of charge"
        )
    lowest_v, more = float(widest.voltage_v.min()), ""
    if lowest_v > NEVER_EMPTY_V:
        more = f", never below {lowest_v:.2f} V, so the cell holds more"
    return span_ah, f"the charge that {widest.name} spans{more}"


def require_on_axis(record: Record, window: Window, capacity_ah: float):
    """Raise `InputError` where a record in its window of `axis_of` leaves the axis of SOC."""
    initial_soc = window.initial_soc or 0.0
    rest_a = window.rest_current_a or rest_current_a(record, capacity_ah)
    first = first_sample(record, window, rest_a)
    soc = soc_along(record, capacity_ah, first, initial_soc)
    soc = soc[scored_samples(record, window, first, soc)]
    low, high = float(soc.min()), float(soc.max())
    if low < -OCV_MARGIN or high > 1 + OCV_MARGIN:
        raise InputError(
            f"{record.name}: from a state of charge of {initial_soc:.4g} at its start, over a "
            f"capacity of {capacity_ah:.4g} Ah, its charge takes the cell from {low:.3f} to "
            f"{high:.3f}; give a larger `capacity` (the record spans {span_ah_of(record):.4g} Ah), "
            "or another `initial_soc`"
        )


def span_ah_of(record: Record) -> float:
    return float(np.ptp(record.discharged_ah))


def axis_of(record: Record, window: Window, capacity_ah: float) -> Window:
    """The window of a record with its start on the axis: as given, by a full charge, or with its
    fullest sample as full."""
    if window.initial_soc is not None:
        return replace(window, soc_source=None, capacity_ah=capacity_ah)
    rest_a = window.rest_current_a or rest_current_a(record, capacity_ah)
    first = first_sample(record, window, rest_a)
    highest_v = float(record.voltage_v.max())
    full = [
        last
        for last in held_charges(record, capacity_ah, rest_a)
        if record.voltage_v[last] >= highest_v - FULL_CHARGE.held_near_v
    ]
    fullest = int(np.argmin(record.discharged_ah))
    at = min(full, key=lambda sample: abs(sample - first)) if full else fullest
    out_ah = float(record.discharged_ah[first] - record.discharged_ah[at])
    soc = 1 - out_ah / capacity_ah
    if not -NEARLY_SOC <= soc <= 1 + NEARLY_SOC:
        raise InputError(
            f"{record.name}: from its fullest sample to the start it loses {out_ah:.4g} Ah, more "
            f"than the capacity of {capacity_ah:.4g} Ah; give a larger `capacity`, or `initial_soc`"
        )
    source = "own full charge" if full else "own span"
    return replace(window, initial_soc=soc, soc_source=source, capacity_ah=capacity_ah)

"""What a pulse test tells of its cell by itself: capacity and OCV from its rests, and its start."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..cell import CellModel, OcvPoint, characterize
from ..model.inputs import PreparedRecord, soc_along
from ..model.window import Window
from ..records import Record, rest_current_a
from .find import SETTLED_S, Pulse, find_pulses

# After so many long rests there must be pulses for a record to be a pulse test.
FEWEST_LEVELS = 3


def own_cell(records: Sequence[Record], capacity_ah: float | None = None) -> CellModel:
    """The cell as the rests of its pulse tests show it, interpolated between them.

    A polynomial would swing between ten points. Raises `InputError` where there are too few.
    """
    return characterize(records, capacity_ah=capacity_ah, ocv_fit="interpolated")


def pulses_of(prepared: PreparedRecord) -> tuple[Pulse, ...]:
    """The pulses of a record made ready; none unless it is a pulse test.

    A pulse test has pulses after at least three of its long rests.
    """
    record, start = prepared.record, prepared.start.soc
    soc = soc_along(record, prepared.capacity_ah, prepared.first, start)
    pulses = find_pulses(record, soc, prepared.rest_current_a)
    settled = [pulse for pulse in pulses if pulse.rest_s >= SETTLED_S]
    return pulses if len(settled) >= FEWEST_LEVELS else ()


def first_pulse(record: Record) -> Pulse | None:
    """The first pulse of a record, None where there is none; its SOC is not known yet."""
    span_ah = float(np.ptp(record.discharged_ah))
    if span_ah == 0:
        return None
    pulses = find_pulses(record, np.ones(record.samples), rest_current_a(record, span_ah))
    return pulses[0] if pulses else None


def own_window(record: Record, cell: CellModel | None, window: Window) -> Window:
    """Where a pulse test starts: at its first OCV point, at that point's state of charge.

    Where the OCV is of another record, or `cell` is None, at the end of the rest before the first
    pulse. What `window` has stays.
    """
    if window.start_time_s is not None or window.start_after_step is not None:
        return window
    branches = () if cell is None else (*cell.charge_points, *cell.discharge_points)
    points = [point for point in branches if point.source == record.name]
    if points:
        first: OcvPoint = min(points, key=lambda point: point.row)
        at = int(np.searchsorted(record.row, first.row))
        soc = min(max(first.soc, 0.0), 1.0) if window.initial_soc is None else window.initial_soc
        return replace(window, start_time_s=float(record.time_s[at]), initial_soc=soc)
    pulse = first_pulse(record)
    if pulse is None:
        return window
    at = int(np.searchsorted(record.row, pulse.row)) - 1
    return replace(window, start_time_s=float(record.time_s[at]))

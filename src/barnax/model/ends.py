"""Where a record itself shows its state of charge: full and empty ends, counters, and rests."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..cell import CellModel
from ..cell.ocv_points import CLOCK_SLACK_S, MINIMUM_REST_S
from ..errors import InputError
from ..records import Record
from ..records.record import rest_blocks, runs
from ..records.samples import record_resistance_ohm

SocSource = Literal["full end", "empty end", "counters", "rest elsewhere"]

# A charge ends full at a held voltage, where its current has tapered to half and below C/10; a
# discharge ends empty at up to C/1.8, for many tests make it at C/2. The voltage without R I then
# is within 2 % of the end. What a brake gives back is no charge.
_FULL_HOURS, _EMPTY_HOURS, _AT_AN_END = 10.0, 1.8, 0.02
_LEAST_S, _LEAST_HELD_S, _HELD_V, _TAPERED = 300.0, 60.0, 0.01, 0.5
# How far the voltage at the start, without R I, may be from the OCV of what an end tells; and of
# what a counter tells, whose beginning no sample shows.
_APART_V, _COUNTED_APART_V = 0.15, 0.05
# A record may run beyond full and empty by this.
_BEYOND = 0.05


@dataclass(frozen=True)
class KnownSoc:
    """The state of charge at one sample, how it is known, and where: at the sample `known_at`."""

    soc: float
    source: SocSource
    known_at: int


def known_soc(
    record: Record,
    cell: CellModel,
    capacity_ah: float,
    at: int,
    rest_a: float,
    *,
    only_counters: bool = False,
) -> KnownSoc | None:
    """The state of charge at the sample `at`, carried by ampere-hours from where it is known.

    The nearest full or empty end counts before the tester's counters, which may have begun at one,
    and those before the nearest long rest. None where nothing tells, or the voltage denies it.
    """
    ohm = record_resistance_ohm(record)
    discharged_ah = record.discharged_ah
    source_v = float(record.voltage_v[at] + ohm * record.current_a[at])

    def carried(known: KnownSoc) -> KnownSoc:
        passed_ah = discharged_ah[known.known_at] - discharged_ah[at]
        return KnownSoc(float(known.soc + passed_ah / capacity_ah), known.source, known.known_at)

    def is_likely(known: KnownSoc) -> bool:
        apart_v = _COUNTED_APART_V if known.source == "counters" else _APART_V
        ocv_v = float(cell.average_ocv_v(np.array([known.soc]))[0])
        is_within = -_BEYOND <= known.soc <= 1 + _BEYOND
        return is_within and abs(source_v - ocv_v) <= apart_v

    low, high = cell.soc_range
    ends: list[KnownSoc] = []
    if high >= 1 - _AT_AN_END and not only_counters:
        ends += _full_ends(record, cell, capacity_ah, rest_a, ohm)
    if low <= _AT_AN_END and not only_counters:
        ends += _empty_ends(record, cell, capacity_ah, rest_a, ohm)
    # A flat OCV neither confirms what counters say nor tells the charge at a rest.
    others = [] if cell.has_flat_ocv else [_counted(record, capacity_ah)]
    if others and not only_counters:
        others.append(_rests(record, cell, rest_a))
    for found in (ends, *others):
        likely = [known for known in map(carried, found) if is_likely(known)]
        if likely:
            nearest = min(likely, key=lambda known: abs(known.known_at - at))
            soc = min(max(nearest.soc, 0.0), 1.0)
            return KnownSoc(soc, nearest.source, nearest.known_at)
    return None


def _full_ends(
    record: Record, cell: CellModel, capacity_ah: float, rest_a: float, ohm: float
) -> Iterator[KnownSoc]:
    """The last samples of charges to full."""
    full_v = float(cell.charge(np.array([1 - _AT_AN_END]))[0])
    for first, last in zip(*runs(record.current_a < -rest_a), strict=True):
        current_a, voltage_v = (
            each[first : last + 1] for each in (record.current_a, record.voltage_v)
        )
        moving = np.flatnonzero(np.abs(voltage_v - voltage_v[-1]) > _HELD_V)
        held = int(moving[-1]) + 1 if len(moving) else 0
        # An LFP cell is full within minutes of holding its voltage.
        is_long = record.time_s[last] - record.time_s[first] >= _LEAST_S
        is_held = record.time_s[last] - record.time_s[first + held] >= _LEAST_HELD_S
        end_a = -float(current_a[-1])
        is_tapered = end_a <= min(capacity_ah / _FULL_HOURS, -_TAPERED * float(current_a[held]))
        if is_long and is_held and is_tapered and voltage_v[-1] - ohm * end_a >= full_v:
            yield KnownSoc(1.0, "full end", int(last))


def _empty_ends(
    record: Record, cell: CellModel, capacity_ah: float, rest_a: float, ohm: float
) -> Iterator[KnownSoc]:
    """The last samples of discharges to empty."""
    empty_v = float(cell.discharge(np.array([_AT_AN_END]))[0])
    for first, last in zip(*runs(record.current_a > rest_a), strict=True):
        is_long = record.time_s[last] - record.time_s[first] >= _LEAST_S
        end_a = float(record.current_a[last])
        is_slow = end_a <= capacity_ah / _EMPTY_HOURS
        if is_long and is_slow and record.voltage_v[last] + ohm * end_a <= empty_v:
            yield KnownSoc(0.0, "empty end", int(last))


def _counted(record: Record, capacity_ah: float) -> Iterator[KnownSoc]:
    """The first sample, were the tester's counters at zero when the cell was full or empty."""
    begun_ah = 0.0 if record.charge_ah is None else float(record.charge_ah[0])
    soc = (1.0 if begun_ah > 0 else 0.0) - begun_ah / capacity_ah
    if begun_ah and -_BEYOND <= soc <= 1 + _BEYOND:
        yield KnownSoc(min(max(soc, 0.0), 1.0), "counters", 0)


def _rests(record: Record, cell: CellModel, rest_a: float) -> Iterator[KnownSoc]:
    """The last samples of rests that are long enough, and come after a load."""
    for first, last in rest_blocks(record, rest_a):
        is_long = record.time_s[last] - record.time_s[first] >= MINIMUM_REST_S - CLOCK_SLACK_S
        if first and is_long:
            direction = -1 if record.current_a[first - 1] > 0 else 1
            try:
                soc = cell.soc_from_rest_voltage(float(record.voltage_v[last]), direction)
            except InputError:  # beyond the OCV
                continue
            yield KnownSoc(soc, "rest elsewhere", int(last))

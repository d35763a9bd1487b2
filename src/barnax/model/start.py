"""The state in which a simulation starts: its SOC, the direction before it, and their sources."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ..cell import CellModel
from ..cell.ocv_points import MINIMUM_REST_S, is_long, rest_duration_s
from ..cell.soc_axis import BEYOND_SOC
from ..errors import InputError
from ..notices import Notice, notice
from ..records import Record, is_rested
from ..records.record import pause_s
from ..records.samples import record_resistance_ohm
from ..records.segments import held_charges, rest_blocks, runs
from ..settings import SocSource
from .rest import cell_at_rest, fitted_soc, mean_at_rest
from .window import Window, relaxing_rest

# A discharge ends empty after so long, at up to C/1.8, for many tests make it at C/2. The voltage
# without R I is within 2 % of an end.
_EMPTY_HOURS, _AT_AN_END = 1.8, 0.02
_EMPTYING_S = 300.0
# A current so small leaves the voltage nearly that of rest.
_SMALL_HOURS = 20.0
# How far the voltage at the start, without R I, may be from the OCV of what an end tells, or of a
# SOC so near to it; and of what a counter tells, whose beginning no sample shows.
_APART_V, _APART_SOC, _COUNTED_APART_V = 0.15, 0.02, 0.05
# What is called full differs by less from one charge to the next.
_BEYOND_AN_END = 0.005


@dataclass(frozen=True)
class KnownSoc:
    """The state of charge at one sample, how it is known, and where: at the sample `known_at`, by
    whose voltage it has the standard error `soc_sd`."""

    soc: float
    source: SocSource
    known_at: int
    soc_sd: float = 0.0


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

    The nearest full or empty end counts before the voltage of a full cell there, that before the
    tester's counters, which may have begun at an end, and those before the nearest long rest. None
    where nothing tells, or the voltage denies it.
    """
    ohm = record_resistance_ohm(record)
    discharged_ah = record.discharged_ah
    source_v = float(record.voltage_v[at] + ohm * record.current_a[at])

    def carried(known: KnownSoc) -> KnownSoc:
        passed_ah = discharged_ah[known.known_at] - discharged_ah[at]
        return replace(known, soc=float(known.soc + passed_ah / capacity_ah))

    def is_likely(known: KnownSoc) -> bool:
        apart_v = _COUNTED_APART_V if known.source == "counters" else _APART_V
        # Near empty 1 % SOC, lost between two testers, is worth hundreds of mV.
        ocv_v = cell.average_ocv_v(known.soc + np.array([-_APART_SOC, _APART_SOC]))
        is_within = -BEYOND_SOC <= known.soc <= 1 + BEYOND_SOC
        return is_within and bool(ocv_v[0] - apart_v <= source_v <= ocv_v[1] + apart_v)

    low, high = cell.soc_range
    ends: list[KnownSoc] = []
    full: list[KnownSoc] = []
    if high >= 1 - _AT_AN_END and not only_counters:
        ends += _full_ends(record, cell, capacity_ah, rest_a, ohm)
        full_v = float(cell.average_ocv_v(np.array([1 - _AT_AN_END]))[0])
        if abs(record.current_a[at]) <= capacity_ah / _SMALL_HOURS and source_v >= full_v:
            full.append(KnownSoc(1.0, "full voltage", at))
    if low <= _AT_AN_END and not only_counters:
        ends += _empty_ends(record, cell, capacity_ah, rest_a, ohm)
    # A flat OCV neither confirms what counters say nor tells the charge at a rest.
    others = [] if cell.has_flat_ocv else [_counted(record, capacity_ah)]
    if others and not only_counters:
        others.append(_rests(record, cell, rest_a))
    for found in (ends, full, *others):
        likely = [known for known in map(carried, found) if is_likely(known)]
        if likely:
            return min(likely, key=lambda known: abs(known.known_at - at))
    return None


def _full_ends(
    record: Record, cell: CellModel, capacity_ah: float, rest_a: float, ohm: float
) -> Iterator[KnownSoc]:
    """The last samples of charges to full."""
    full_v = float(cell.charge(np.array([1 - _AT_AN_END]))[0])
    for last in held_charges(record, capacity_ah, rest_a):
        if record.voltage_v[last] + ohm * record.current_a[last] >= full_v:
            yield KnownSoc(1.0, "full end", last)


def _empty_ends(
    record: Record, cell: CellModel, capacity_ah: float, rest_a: float, ohm: float
) -> Iterator[KnownSoc]:
    """The last samples of discharges to empty."""
    empty_v = float(cell.discharge(np.array([_AT_AN_END]))[0])
    for first, last in zip(*runs(record.current_a > rest_a), strict=True):
        is_long = record.time_s[last] - record.time_s[first] >= _EMPTYING_S
        end_a = float(record.current_a[last])
        is_slow = end_a <= capacity_ah / _EMPTY_HOURS
        if is_long and is_slow and record.voltage_v[last] + ohm * end_a <= empty_v:
            yield KnownSoc(0.0, "empty end", int(last))


def _counted(record: Record, capacity_ah: float) -> Iterator[KnownSoc]:
    """The first sample, were the tester's counters at zero when the cell was full or empty."""
    begun_ah = 0.0 if record.charge_ah is None else float(record.charge_ah[0])
    soc = (1.0 if begun_ah > 0 else 0.0) - begun_ah / capacity_ah
    if begun_ah and -BEYOND_SOC <= soc <= 1 + BEYOND_SOC:
        yield KnownSoc(soc, "counters", 0)


def _rests(record: Record, cell: CellModel, rest_a: float) -> Iterator[KnownSoc]:
    """The last samples of rests that are long enough, and come after a load."""
    for first, last in rest_blocks(record, rest_a):
        if first and is_long(rest_duration_s(record, first, last)):
            direction = -1 if record.current_a[first - 1] > 0 else 1
            try:
                rest = cell_at_rest(record, cell, last, rest_a, direction)
            except InputError:  # beyond the OCV
                continue
            yield KnownSoc(rest.soc, "rest elsewhere", int(last), rest.soc_sd)


# So near full or empty, the last current was the one that leads there.
NEAR_AN_END = 0.02
# A given SOC is in doubt where the rested voltage is so far from its OCV, and tells another SOC.
DOUBTFUL_V, DOUBTFUL_SOC = 0.01, 0.02
# Charge is counted within this share of it.
_COUNTED_SD = 0.02
# A rested voltage so far above or below the OCV is not of this cell, or of another temperature.
BEYOND_OCV_V = 0.005

# How the direction before the start is known: given; from the load before it; from a start at full
# or empty; because a fit with the other is worse; or not at all, whether or not that matters.
DirectionSource = Literal[
    "given", "load before", "full or empty", "better fit", "without effect", "assumed"
]


@dataclass(frozen=True)
class Start:
    """The state in which a simulation starts, and where that is known from.

    `voltage_v` and `row` are those of the sample that the SOC comes from, at rest or at an end of
    the state of charge; of a rest the voltage is its mean. `direction` is the last current before
    the start, +1 charging, -1 discharging; where both were tried, the RMSE with the other is
    `other_rmse_v`. `soc_sd` is the standard error of a SOC that voltages tell, by their noise.
    """

    soc: float
    soc_source: Literal["given", "rested voltage"] | SocSource
    direction: Literal[-1, 1]
    direction_source: DirectionSource
    row: int
    voltage_v: float
    other_rmse_v: float | None = None
    soc_sd: float = 0.0


def find_start(
    record: Record, cell: CellModel, window: Window, capacity_ah: float, first: int, rest_a: float
) -> tuple[Start, float, list[Notice]]:
    """The state at the start, the capacity that the record is counted over, and what speaks
    against them.

    Raises `InputError` where the SOC is neither given nor shown, nor told by the record as a whole.
    A SOC that is given is that of the first row, or of the start where that is given too.
    Between an end and the start the record may move more charge than the capacity has room for.
    The end stays where the data show it: the record is counted over that charge, or, where its
    capacity was given, starts beyond the other end.
    A rested cell is on the OCV branch of the direction it comes from. Where it has not rested, the
    SOC is carried to the start from where the record shows it.
    """
    relaxed_at, rise_v = relaxing_rest(record, rest_a)
    is_relaxing = 0 < relaxed_at == first
    direction, source = _direction_before(record, window, first, rest_a)
    if source == "assumed" and is_relaxing:
        direction, source = -1 if rise_v > 0 else 1, "load before"
    row, voltage_v, soc_sd = int(record.row[first]), float(record.voltage_v[first]), 0.0
    unrested, sd_v = _unrested(record, first, rest_a), 0.0
    if not unrested:
        voltage_v, sd_v = mean_at_rest(record, first, rest_a)
    is_short = record.time_s[first] - record.time_s[0] < MINIMUM_REST_S
    known: KnownSoc | None = None
    told: list[Notice] = []
    if window.initial_soc is None and (unrested or is_short):
        # Of a record's opening rest nobody knows how long it was; counters tell more, and of one
        # that still relaxes whatever does.
        only = not (unrested or is_relaxing)
        known = known_soc(record, cell, capacity_ah, first, rest_a, only_counters=only)
        if only and known is not None and _denies(cell, voltage_v, sd_v, known.soc):
            known = None
    if window.initial_soc is not None:
        soc, soc_source = window.initial_soc, window.soc_source or "given"
        soc_sd = 0.0 if window.registration is None else window.registration.told_sd
        if soc_source == "given":
            soc -= _counted_soc(record, window, first, capacity_ah)
    elif known is not None:
        soc, soc_source, soc_sd = known.soc, known.source, known.soc_sd
        row, voltage_v = int(record.row[known.known_at]), float(record.voltage_v[known.known_at])
        if (room := abs(soc - 0.5) + 0.5) > 1 + _BEYOND_AN_END:
            moved = {"soc": soc, "known_row": row, "capacity_ah": capacity_ah}
            other_end = {"full end": soc < 0, "empty end": soc > 1}
            if window.capacity_ah is None and other_end.get(soc_source):
                soc, capacity_ah = float(soc > 1), room * capacity_ah
                told = [notice("start.moves-more", record.name, **moved, moved_ah=capacity_ah)]
            else:
                told = [notice("start.beyond-an-end", record.name, **moved)]
    elif not unrested:
        rest = cell_at_rest(record, cell, first, rest_a, direction)
        soc, soc_source, soc_sd = rest.soc, "rested voltage", rest.soc_sd
    elif fitted := None if cell.is_of_records else fitted_soc(record, cell, capacity_ah, first):
        (soc, soc_sd), soc_source = fitted, "fitted"
        told = [notice("start.fitted", record.name, start_row=row, soc=soc, soc_sd=soc_sd)]
    else:
        raise unrested.error()
    if source == "assumed" and min(soc, 1 - soc) < NEAR_AN_END:
        direction, source = (1 if soc > 0.5 else -1), "full or empty"
        if soc_source == "rested voltage":
            soc = cell_at_rest(record, cell, first, rest_a, direction).soc
    start = Start(soc, soc_source, direction, source, row, voltage_v, soc_sd=soc_sd)
    if unrested is None:
        told += _beyond_ocv(record, cell, start, sd_v)
    rests = (known.known_at for known in _rests(record, cell, rest_a)) if unrested else [first]
    for at in sorted(rests, key=lambda at: abs(at - first))[:1]:
        told += _denied_by_rest(record, cell, window, capacity_ah, first, at, rest_a)
    if is_relaxing:
        told.append(_relaxing(record, first, soc_source == "rested voltage"))
    return start, capacity_ah, told


def require_whole_log(record: Record, records: Sequence[Record], unknown: InputError) -> None:
    """Raise `InputError` where a record, whose start is not known, is one log with others.

    Their clock goes on from file to file, or their dates do.
    """

    def goes_on(later: Record, earlier: Record) -> bool:
        # The row at which a log was cut may be in both files.
        return 0 <= pause_s(earlier, later) <= 2 * float(np.median(later.interval_s))

    log = [record]
    while before := next((other for other in records if goes_on(log[0], other)), None):
        log.insert(0, before)
    while after := next((other for other in records if goes_on(other, log[-1])), None):
        log.append(after)
    if len(log) > 1:
        others = ", ".join(other.name for other in log if other is not record)
        told = {"others": others, "files": ", ".join(other.name for other in log)}
        raise notice("start.goes-on", record.name, **told).error() from unknown


def _direction_before(
    record: Record, window: Window, first: int, rest_a: float
) -> tuple[Literal[-1, 1], DirectionSource]:
    """The last current before the start; where the record has none, the given one or a guess."""
    # The current of the start's own sample flows before it only under a backward hold.
    before = slice(0, first + 1 if record.hold.value == "backward" else first)
    moving = np.flatnonzero(~is_rested(record, rest_a)[before] & (record.current_a[before] != 0))
    if len(moving) and first > 0:
        return -1 if record.current_a[moving[-1]] > 0 else 1, "load before"
    if window.initial_direction is not None:
        return window.initial_direction, "given"
    # Of a record that starts under load nothing is known but the load.
    return -1 if record.current_a[first] >= rest_a else 1, "assumed"


def _unrested(record: Record, first: int, rest_a: float) -> Notice | None:
    """The reason why the voltage at the start tells no state of charge; None where it does."""
    row = int(record.row[first])
    is_loaded = ~is_rested(record, rest_a)[: first + 1]
    if is_loaded[first]:
        current_a = record.current_a[first]
        return notice("start.under-load", record.name, start_row=row, current_a=current_a)
    before = np.flatnonzero(is_loaded)
    # One sample without current, at the beginning of a record, is no rest.
    is_single = len(before) == first == 0 and not is_rested(record, rest_a)[1]
    if len(before) or is_single:
        rest_s = record.time_s[first] - record.time_s[before[-1]] if len(before) else 0.0
        if not is_long(rest_s):
            rests_s = {"rest_s": rest_s, "needed_s": MINIMUM_REST_S}
            return notice("start.short-rest", record.name, start_row=row, **rests_s)
    return None


def _relaxing(record: Record, first: int, tells_soc: bool) -> Notice:
    """What an opening rest that relaxes tells; a doubt where it is short and tells the SOC."""
    rest_s = float(record.time_s[first] - record.time_s[0])
    is_doubtful = tells_soc and rest_s < MINIMUM_REST_S
    code = "start.relaxing-briefly" if is_doubtful else "start.relaxing"
    ends_v = {"first_v": record.voltage_v[0], "last_v": record.voltage_v[first]}
    return notice(code, record.name, **ends_v, start_row=record.row[first], rest_s=rest_s)


def _counted_soc(record: Record, window: Window, first: int, capacity_ah: float) -> float:
    """What is taken out from where a SOC was given, the first row unless the start is given too,
    to the start of the simulation."""
    is_moved = window.start_time_s is None and window.start_after_step is None
    return float(record.discharged_ah[first]) / capacity_ah if is_moved else 0.0


def _denies(
    cell: CellModel, voltage_v: float, voltage_sd_v: float, soc: float, soc_sd: float = 0.0
) -> bool:
    """True where a rested voltage lies off both branches at a SOC, by voltage and by SOC."""
    doubtful_v, doubtful_soc = DOUBTFUL_V + 3 * voltage_sd_v, DOUBTFUL_SOC + 3 * soc_sd
    try:
        ends = [cell.soc_from_rest_voltage(voltage_v, direction) for direction in (-1, 1)]
    except InputError:  # far from where the other branch ends
        return False
    expected_v = [float(curve(np.array([soc]))[0]) for curve in (cell.discharge, cell.charge)]
    is_far = not min(expected_v) - doubtful_v <= voltage_v <= max(expected_v) + doubtful_v
    return is_far and not min(ends) - doubtful_soc <= soc <= max(ends) + doubtful_soc


def _beyond_ocv(record: Record, cell: CellModel, start: Start, sd_v: float) -> Iterator[Notice]:
    """A warning where the rested voltage at the start lies beyond the OCV."""
    branch = cell.charge if start.direction > 0 else cell.discharge
    low_v, high_v = (float(branch(np.array([end]))[0]) for end in cell.soc_range)
    beyond_v = max(start.voltage_v - high_v, low_v - start.voltage_v)
    if beyond_v > BEYOND_OCV_V + 3 * sd_v and not cell.is_of_records:
        where = {"voltage_v": start.voltage_v, "start_row": start.row}
        ends = {"beyond_v": beyond_v, "low_v": low_v, "high_v": high_v}
        yield notice("start.beyond-ocv", record.name, **where, **ends)


def _denied_by_rest(
    record: Record,
    cell: CellModel,
    window: Window,
    capacity_ah: float,
    first: int,
    at: int,
    rest_a: float,
) -> Iterator[Notice]:
    """A warning where the rest around the sample `at` contradicts the SOC that was given."""
    # What other records of the cell made of it is no doubt of what was given.
    window = window.as_told
    if cell.is_of_records or window.initial_soc is None:
        return
    counted = float(record.discharged_ah[at] - record.discharged_ah[first]) / capacity_ah
    given_soc = window.initial_soc - counted - _counted_soc(record, window, first, capacity_ah)
    voltage_v, sd_v = mean_at_rest(record, at, rest_a)
    if _denies(cell, voltage_v, sd_v, given_soc, _COUNTED_SD * abs(counted)):
        direction = _direction_before(record, window, at, rest_a)[0]
        rest = cell_at_rest(record, cell, at, rest_a, direction)
        where = {"voltage_v": voltage_v, "start_row": record.row[at]}
        socs = {"rested_soc": rest.soc, "rested_sd": rest.soc_sd}
        before = record.discharged_ah[first] / capacity_ah
        before = before if window.soc_source == "given earlier" else 0.0
        given = {"given_soc": window.initial_soc + before, "counted_soc": given_soc}
        yield notice("start.other-soc", record.name, **where, **socs, **given)

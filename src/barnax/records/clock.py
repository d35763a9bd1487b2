"""Rules for the clock: time never decreases, and no sample occurs twice."""

from datetime import datetime

import numpy as np
import polars as pl
from jaxtyping import Bool, Float

from ..notices import Notice
from .cell_values import DAY_S, is_clock, is_local_date, uneven
from .record import runs
from .samples import Samples

# More misplaced time stamps than three, or than one in a hundred, are not isolated slips; neither
# are that many that follow an equal stamp.
_SLIPS, _FEW = 3, 0.01
# The largest number of zeros among the time stamps, and the deviation up to which intervals are
# even.
_MOSTLY, _EVEN = 0.5, 0.1
# How far clocks are set back, and how late the next stamp may then come: this many intervals, or
# the longest interval, up to a share of the step back.
_HOUR_S = 3600.0
_SET_BACK = {_HOUR_S: "hour-back", DAY_S / 2: "twelve-back"}
_LATE, _LATEST_SHARE = 3, 0.1
# A stamp is misplaced, and the clock was not set back, if it jumps ahead by this share of the step
# back within a few rows of it.
_BACK_AT_ONCE = 0.9
# Summer time begins on a Sunday in one of these months, before five o'clock. At other times the
# clock was set if the rest of the jump is a usual interval within this share, and the voltage
# changes by no more than over this share of the intervals.
_SPRING, _SPRING_HOURS, _EXACT, _GOES_ON = (3, 4, 9, 10), 5, 0.05, 0.9

Clock = Float[np.ndarray, "samples"]
Flags = Bool[np.ndarray, "samples"]


def examine_clock(samples: Samples) -> Samples:
    """The samples with a clock that never decreases, and notices of what was wrong with it.

    Misplaced stamps are dropped, rows out of order are sorted, and a clock that starts again is
    continued.
    """
    if not len(samples) or samples.intervals_s.min(initial=0) >= 0:
        return _set_forward(samples)
    for mend in (_without_zeros, _set_back, _by_counter, _join_steps, _without_jitter):
        samples = mend(samples)
    for find in (_single_strays, _stray_runs):
        strays = find(samples.time_s)
        if 0 < strays.sum() <= max(_SLIPS, _FEW * len(strays)):
            first = int(np.argmax(strays))
            values = {"time_s": samples.time_s[first], "rows": strays.sum()}
            values |= {"beside_s": samples.time_s[first - 1 if first else 1]}
            samples = samples.telling(first, "clock.stray", **values).keep(~strays)
    time, interval_s = samples.time_s, samples.intervals_s
    falls = np.flatnonzero(interval_s < 0)
    if not len(falls):
        return samples
    at = int(falls[0]) + 1
    files = "several" if samples.table.files > 1 else None
    given = {"before_s": time[at - 1], "after_s": time[at], "times": len(falls), "files": files}
    is_midnight = bool(np.all(np.abs(-interval_s[falls] - DAY_S) < 0.01 * DAY_S))
    is_shuffled = not is_midnight and _is_shuffled(time, len(falls))
    cause = "midnight" if is_midnight else "shuffled" if is_shuffled else "restart"
    samples = samples.telling(
        at, "clock.falls", **given, cause=cause, column=samples.header("time")
    )
    if is_shuffled:
        return samples.keep(np.argsort(time, kind="stable"))
    # An ordinary interval is put in place of the jump.
    usual_s = float(np.median(interval_s[interval_s > 0])) if np.any(interval_s > 0) else 1.0
    passed_s = np.cumsum(np.where(interval_s < 0, usual_s, interval_s))
    return samples.having(time=np.concatenate([time[:1], time[0] + passed_s]))


def _without_zeros(samples: Samples) -> Samples:
    """The samples without those at which the clock shows 0 between stamps that never decrease, or
    that continue as if it were not there: the clock of a step restarts with every step."""
    time = samples.time_s
    is_zero = (time + (samples.zero_date_s or 0.0) == 0) & (np.arange(len(time)) > 0)
    # A single one may be the first row, out of order.
    is_first = is_zero.sum() == 1 and time[0] > 0
    if is_first or is_zero.mean() > _MOSTLY:
        return samples
    if np.any(np.diff(time[~is_zero]) < 0):
        if samples.step is not None:
            is_zero[1:] &= np.diff(samples.step) == 0
        is_zero = _within_steady_stamps(time, is_zero)
    if not is_zero.any():
        return samples
    given = {"column": samples.header("time"), "rows": is_zero.sum()}
    return samples.telling(is_zero, "clock.zeros", **given).keep(~is_zero)


def _within_steady_stamps(time: Clock, is_out: Flags) -> Flags:
    """The stamps that lie between others at an even interval, where they replace as many."""
    first, last = runs(is_out)
    is_inside = (first > 0) & (last < len(time) - 1)
    first, last = first[is_inside], last[is_inside]
    each_s = (time[last + 1] - time[first - 1]) / (last - first + 2)
    interval_s = np.concatenate([[-np.inf], np.diff(time), [-np.inf]])
    beside_s = np.stack([interval_s[first - 1], interval_s[last + 2]])
    is_even = np.abs(beside_s - each_s) < _EVEN * each_s
    # There is nothing before the first stamp of a step, nor after its last.
    is_steady = (each_s > 0) & np.all(is_even | (beside_s <= 0), axis=0) & np.any(is_even, axis=0)
    is_within = np.zeros(len(time), bool)
    for begin, end in zip(first[is_steady], last[is_steady] + 1, strict=True):
        is_within[begin:end] = True
    return is_within


def _set_back(samples: Samples) -> Samples:
    """The samples on a continuous clock where it is set back: by an hour in autumn, or by twelve
    hours without AM and PM.

    An error for numbers that are not dates, which may simply restart, and for dates that also jump
    ahead: a clock of twelve hours does so at midnight.
    """
    time, late_s = samples.time_s, _LATE * samples.interval_s
    latest_s, falls = samples.intervals_s.max(), samples.intervals_s < 0
    back_s = -samples.intervals_s[falls]
    is_dated = samples.zero_date_s is not None
    is_dated |= is_clock(samples.table.columns[samples.columns["time"].index])
    if not falls.any() or (not is_dated and np.abs(time[1:][falls]).min() <= late_s):
        return samples
    for fall in np.flatnonzero(falls):
        fall_s = -samples.intervals_s[fall]
        before_s = samples.intervals_s[max(fall - 1 - _SLIPS, 0) : fall].max(initial=0)
        # A clock of twelve hours jumps ahead by a day before it falls by half a day.
        is_back = _BACK_AT_ONCE * fall_s < before_s < fall_s / _BACK_AT_ONCE
        leap_s = samples.intervals_s[fall + 1 : fall + 2 + _SLIPS].max(initial=0)
        if leap_s > max(late_s, _BACK_AT_ONCE * fall_s) or (is_back and before_s > late_s):
            return samples
    for period_s, change in _SET_BACK.items():
        late_s = max(_LATE * samples.interval_s, min(latest_s, _LATEST_SHARE * period_s))
        if np.all((back_s <= period_s) & (period_s <= back_s + late_s)):
            fall = int(np.argmax(falls))
            is_dated &= latest_s < 2 * period_s - late_s
            mended = time + period_s * np.append(0, np.cumsum(falls))
            return _noting_change(samples, fall, change, bool(is_dated)).having(time=mended)
    return samples


def _set_forward(samples: Samples) -> Samples:
    """The samples on a continuous clock where it is set forward by an hour in spring: local dates
    that skip one hour, either the one of the calendar or under a load that continues."""
    time = samples.columns["time"]
    is_local = is_local_date(samples.table.columns[time.index], time)
    if samples.zero_date_s is None or len(samples) < _SLIPS or not is_local:
        return samples
    hour_s, interval_s = _HOUR_S, samples.interval_s
    over_s = samples.intervals_s - hour_s
    # The next stamp may come as late as the longest interval allows, up to a share of the hour.
    latest_s = min(np.max(over_s[over_s < 0], initial=-hour_s) + hour_s, _LATEST_SHARE * hour_s)
    late_s = max(_LATE * interval_s, latest_s)
    jumps = np.flatnonzero((over_s >= 0) & (over_s <= late_s))
    if len(jumps) != 1 or interval_s > _LATEST_SHARE * hour_s:
        return samples
    at = int(jumps[0])
    before_s, after_s = samples.time_s[at : at + 2]
    zero = np.datetime64(round(1e3 * samples.zero_date_s), "ms")
    last, first = (
        (zero + np.timedelta64(round(1e3 * s), "ms")).astype(datetime) for s in (before_s, after_s)
    )
    is_spring = last.isoweekday() == 7 and last.month in _SPRING and last.hour < _SPRING_HOURS
    # From just before a full hour to just after the next one.
    is_spring &= first.hour == last.hour + 2 and 60 * first.minute <= late_s
    step_a, step_v = samples.step_a, samples.step_v
    ohm = step_v @ step_a / max(step_a @ step_a, 1e-300)
    beside_v = np.abs(step_v - ohm * step_a)
    goes_on = beside_v[at] <= np.quantile(beside_v, _GOES_ON)
    goes_on &= np.abs(samples.current_a[at : at + 2]).min() > _MOSTLY * samples.peak_a
    goes_on &= abs(over_s[at] - interval_s) <= _EXACT * interval_s
    if not (is_spring or goes_on):
        return samples
    mended = samples.time_s - hour_s * (np.arange(len(samples)) > at)
    return _noting_change(samples, at, "hour-on", is_taken=True).having(time=mended)


def _noting_change(samples: Samples, at: int, change: str, is_taken: bool) -> Samples:
    """The samples, with a notice that the clock was set after one of them."""
    given = {"change": change, "taken": "true" if is_taken else None}
    given |= {"before_s": samples.time_s[at], "after_s": samples.time_s[at + 1]}
    return samples.telling(at + 1, "clock.set", **given, column=samples.header("time"))


def _by_counter(samples: Samples) -> Samples:
    """The samples in the order of a column that counts rows, if time decreases less often in that
    order.

    Without such a column, time that only decreases is reversed.
    """
    falls = int(np.sum(samples.intervals_s < 0))
    used = {column.index for column in samples.columns.values()}
    for index, column in enumerate(samples.table.columns):
        if index in used or not column.dtype.is_numeric():
            continue
        count = column.cast(pl.Float64).to_numpy()[samples.at]
        order = np.argsort(count, kind="stable")
        if not np.all(np.diff(count[order]) == 1) or np.all(np.diff(order) == 1):
            continue
        if np.sum(np.diff(samples.time_s[order]) < 0) <= _FEW * falls:
            given = {"by": "count", "places": falls, "column": samples.table.header.names[index]}
            return samples.keep(order).noting(Notice("clock.ordered", given))
    if falls > _SLIPS and falls >= (1 - _FEW) * len(samples.intervals_s):
        given = {"by": "reversal"}
        return samples.keep(np.arange(len(samples))[::-1]).noting(Notice("clock.ordered", given))
    return samples


# A clock that falls by less than this share of the usual interval has too coarse a resolution.
_JITTER_SHARE = 0.1


def _without_jitter(samples: Samples) -> Samples:
    """The samples with stamps slightly behind the previous one moved to where they belong.

    Such a stamp is put one interval before the next one, or immediately after the previous one.
    """
    time, usual_s = samples.time_s, samples.interval_s
    falls = np.flatnonzero(samples.intervals_s < 0)
    fall_s = time[falls] - time[falls + 1]
    if not 0 < len(falls) <= max(_SLIPS, _FEW * len(time)):
        return samples
    # After the last sample there is room for one more.
    after = np.append(time, time[-2] + 2 * usual_s)[falls + 2]
    room_s = after - time[falls]
    if np.any(fall_s > _JITTER_SHARE * usual_s) or np.any(room_s <= 0):
        return samples
    behind = time[falls] + np.minimum(_APART_SHARE * room_s, _APART_S)
    mended = time.copy()
    mended[falls + 1] = np.maximum(after - usual_s, behind)
    given = {"by": "time", "fall_s": fall_s.max(), "places": len(falls)}
    return samples.telling(int(falls[0]) + 1, "clock.ordered", **given).having(time=mended)


# The smallest share of a clock's falls that coincide with a change of step, and how low the clock
# then reads.
_AT_STEPS, _FROM_ZERO = 0.8, 0.1


def _join_steps(samples: Samples) -> Samples:
    """The samples on the clock of the test, if theirs restarts with every step."""
    time = samples.time_s
    falls = np.diff(time) < 0
    if not falls.any():
        return samples
    starts, is_steps = falls, samples.columns["time"].quantity.name == "step time"
    if samples.step is not None:
        changes = np.diff(samples.step) != 0
        is_low = time[1:] <= _FROM_ZERO * time[:-1]
        is_at_steps = np.mean((changes & is_low)[falls]) > _AT_STEPS
        # The first sample of a step may come late.
        is_at_steps |= falls.sum() > _SLIPS and np.mean(changes == falls) == 1
        # In joined files, the clock falls at one change of step among many.
        is_steps |= bool(is_at_steps and np.mean(falls[changes]) > 0.5)
        starts = falls | changes
    if not is_steps:
        return samples
    # A step begins when the previous one has ended.
    before = np.cumsum(np.where(starts, time[:-1], 0.0))
    at, joined = int(np.argmax(falls)) + 1, time + np.append(0.0, before)
    given = {"column": samples.header("time"), "times": falls.sum()}
    return samples.telling(at, "clock.steps", **given).having(time=joined)


def _single_strays(time: Clock) -> Flags:
    """Stamps without which their neighbors are in order: too low, or too high."""
    strays = np.zeros(len(time), bool)
    falls = np.flatnonzero(np.diff(time) < 0)
    padded = np.concatenate([[-np.inf], time, [np.inf]])
    # For the fall from sample k to k + 1; padded[k + 1] is sample k.
    is_low = padded[falls + 3] > padded[falls + 1]
    is_high = padded[falls + 2] > padded[falls]
    strays[falls[is_low & ~is_high] + 1] = True
    strays[falls[is_high & ~is_low]] = True
    return strays


def _stray_runs(time: Clock) -> Flags:
    """Runs of stamps that lie behind earlier ones, or ahead of later ones; whichever are fewer.

    None if sorting would put them in their places.
    """
    behind = time < np.maximum.accumulate(time)
    ahead = time > np.minimum.accumulate(time[::-1])[::-1]
    strays = behind if behind.sum() <= ahead.sum() else ahead
    if uneven(np.sort(time), 0.5) < uneven(time[~strays], 0.5):
        return np.zeros(len(time), bool)
    return strays


def _is_shuffled(time: Clock, falls: int) -> bool:
    """True if sorting puts whole pieces in their places, rather than interleaving two clocks."""
    order = np.argsort(time, kind="stable")
    sorted_s = np.diff(time[order])
    # The pieces of a clock that restarted would be further apart than all of them are long.
    passed_s = np.maximum(np.diff(time), 0).sum()
    if np.any(sorted_s == 0) or sorted_s.max() > passed_s:
        return False
    piece = np.cumsum(np.concatenate([[0], np.diff(time) < 0]))[order]
    return int(np.sum(np.diff(piece) != 0)) <= 3 * falls + 2


# Two samples with the same stamp that differ by no more than this are one sample, logged twice.
_SAME_VOLTAGE_V, _SAME_CURRENT_SHARE = 2e-3, 0.02
# Above this share of stamps with two different values, the clock has too few digits.
_COARSE = 0.05


# The distance put between the two sides of a change of step that share a stamp: less than testers
# resolve, and a small part of the next interval.
_APART_S, _APART_SHARE = 5e-4, 0.1


def examine_repeats(samples: Samples) -> Samples:
    """The samples on a strictly increasing clock, with notices of those logged twice.

    The two sides of a change of step that share a stamp are moved slightly apart. Of two other
    samples with one stamp the first is kept. If more samples with different values share stamps
    than changes of step explain, they are spread over the next interval.
    """
    is_repeat = samples.intervals_s == 0
    sides = is_repeat & (samples.step is not None and np.diff(samples.step) != 0)
    if sides.any():
        time_s, at = samples.time_s, int(np.argmax(sides)) + 1
        apart_s = _spread(time_s, _APART_SHARE, _APART_S)
        samples = samples.telling(at, "repeats.both-sides", changes=sides.sum())
        samples = samples.having(time=np.where(np.isin(time_s, time_s[1:][sides]), apart_s, time_s))
    # For each interval: starts at the same stamp, all values equal, equal within the resolution, or
    # different.
    is_repeat = samples.intervals_s == 0
    if not is_repeat.any():
        return samples
    step_a, step_v = samples.step_a, samples.step_v
    is_exact = is_repeat & (step_a == 0) & (step_v == 0)
    is_alike = np.abs(step_a) <= _SAME_CURRENT_SHARE * samples.peak_a * (1 + 1e-9)
    is_alike &= np.abs(step_v) <= _SAME_VOLTAGE_V * (1 + 1e-9)
    is_any, is_other = is_repeat & ~is_exact, is_repeat & ~is_alike
    in_a_row = (is_other[1:] & is_any[:-1]) | (is_any[1:] & is_other[:-1])
    others, at = int(is_other.sum()), int(np.argmax(is_other)) + 1
    given = {"time_s": samples.time_s[at], "rows": others}
    for name, row in (("first", at - 1), ("second", at)):
        # Adding zero turns the -0 of a resting tester into 0.
        given[f"{name}_a"] = samples.current_a[row] + 0.0
        given[f"{name}_v"] = samples.voltage_v[row]
    if in_a_row.sum() > max(_SLIPS, _FEW * len(samples)) or np.mean(is_other) > _COARSE:
        mean = len(samples) / len(np.unique(samples.time_s))
        noted = samples.telling(at, "repeats.differ", **given, rows_a_stamp=mean)
        return noted.having(time=_spread(samples.time_s))
    for is_merged, alike in ((is_exact, "exact"), (is_any & ~is_other, "near")):
        if is_merged.any():
            first, rows = int(np.argmax(is_merged)) + 1, is_merged.sum()
            samples = samples.telling(first, "repeats.merged", rows=rows, alike=alike)
    if others:
        samples = samples.telling(at, "repeats.differ", **given)
    return samples.keep(np.append(True, ~is_repeat))


def _spread(time_s: Clock, share: float = 1.0, most_s: float = np.inf) -> Clock:
    """The clock with samples of the same stamp evenly spread over a share of the time up to the
    next stamp, at most `most_s` apart."""
    stamps, stamp, times = np.unique(time_s, return_inverse=True, return_counts=True)
    gaps_s = np.diff(stamps)
    room_s = np.append(gaps_s, np.median(gaps_s) if len(gaps_s) else 1.0)
    within = np.arange(len(time_s)) - (np.cumsum(times) - times)[stamp]
    return time_s + within * np.minimum(share * room_s / times, most_s)[stamp]

"""A clock that runs backwards, starts again, or stands still."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from ..records.plausibility import find_repeats
from ..records.samples import Samples
from .finding import Finding, counted, found_at

_DAY_S = 86_400.0
# More stamps out of line than three, or one in a hundred, are no slips.
_SLIPS, _FEW = 3, 0.01

Clock = Float[np.ndarray, "samples"]


def examine_clock(samples: Samples) -> tuple[Samples, list[Finding]]:
    """The samples with a clock that never falls, and what was wrong with it.

    Stamps out of line are dropped, rows out of order are sorted, and a clock that starts again is
    made to run on.
    """
    findings = []
    for find in (_single_strays, _stray_runs):
        strays = find(samples.time_s)
        if 0 < strays.sum() <= max(_SLIPS, _FEW * len(strays)):
            findings.append(_stray(samples, strays))
            samples = samples.keep(~strays)
    time = samples.time_s
    falls = np.flatnonzero(np.diff(time) < 0)
    if not len(falls):
        return samples, findings
    at = int(falls[0]) + 1
    drop = f"time runs backwards, from {time[at - 1]:.10g} s to {time[at]:.10g} s"
    fall_s = time[falls] - time[falls + 1]
    is_midnight = bool(np.all(np.abs(fall_s - _DAY_S) < 0.01 * _DAY_S))
    if not is_midnight and _is_shuffled(time, len(falls)):
        what = f"{drop}: rows stand out of order ({counted(len(falls), 'place')})"
        findings.append(found_at(samples, at, "error", what, "sort the rows by time"))
        return samples.keep(np.argsort(time, kind="stable")), findings
    what, remedy = _restart(samples, falls, is_midnight)
    findings.append(found_at(samples, at, "error", f"{drop}: {what}", remedy))
    return replace(samples, time_s=_running_on(time)), findings


def _stray(samples: Samples, strays: Bool[np.ndarray, "samples"]) -> Finding:
    first = int(np.argmax(strays))
    beside = samples.time_s[first - 1] if first else samples.time_s[first + 1]
    return found_at(
        samples,
        first,
        "error",
        f"time is out of line, {samples.time_s[first]:.10g} s beside {beside:.10g} s "
        f"({counted(int(strays.sum()), 'such row')})",
        "delete these rows, or correct their times",
    )


def _single_strays(time: Clock) -> Bool[np.ndarray, "samples"]:
    """Stamps without which their neighbors are in order: too low, or too high."""
    strays = np.zeros(len(time), bool)
    falls = np.flatnonzero(np.diff(time) < 0)
    padded = np.concatenate([[-np.inf], time, [np.inf]])
    # Of the fall from sample k to k + 1; padded[k + 1] is sample k.
    is_low = padded[falls + 3] > padded[falls + 1]
    is_high = padded[falls + 2] > padded[falls]
    strays[falls[is_low & ~is_high] + 1] = True
    strays[falls[is_high & ~is_low]] = True
    return strays


def _stray_runs(time: Clock) -> Bool[np.ndarray, "samples"]:
    """Runs of stamps behind what came before, or ahead of what comes after; the fewer of the two.

    None where sorting would put them in their places.
    """
    behind = time < np.maximum.accumulate(time)
    ahead = time > np.minimum.accumulate(time[::-1])[::-1]
    strays = behind if behind.sum() <= ahead.sum() else ahead
    if _irregular(np.sort(time)) < _irregular(time[~strays]):
        return np.zeros(len(time), bool)
    return strays


def _irregular(time: Clock) -> int:
    """How many intervals are far from the usual one."""
    interval = np.diff(time)
    usual = float(np.median(interval)) if len(interval) else 0.0
    return int(np.sum((interval < usual / 2) | (interval > 1.5 * usual)))


def _is_shuffled(time: Clock, falls: int) -> bool:
    """Whether sorting puts whole pieces into their places, rather than mixing two clocks."""
    order = np.argsort(time, kind="stable")
    if np.any(np.diff(time[order]) == 0):
        return False
    piece = np.cumsum(np.concatenate([[0], np.diff(time) < 0]))[order]
    return int(np.sum(np.diff(piece) != 0)) <= 3 * falls + 2


def _restart(samples: Samples, falls: np.ndarray, is_midnight: bool) -> tuple[str, str]:
    """What kind of clock starts again, and what to do about it."""
    name, times = samples.names["time"], counted(len(falls), "time")
    if is_midnight:
        what = f"'{name}' is a time of day, past midnight {times}"
        return what, "give the time since the test began"
    if samples.step is not None and np.mean(np.diff(samples.step)[falls] != 0) > 0.8:
        what = f"'{name}' starts again with each step ({times})"
        return what, "give the test's own clock, not the step's"
    return (
        f"the clock starts again {times}",
        "split joined tests into files of their own, or give the test's own clock",
    )


def _running_on(time: Clock) -> Clock:
    """The clock with an ordinary interval where it fell."""
    interval = np.diff(time)
    usual = float(np.median(interval[interval > 0])) if np.any(interval > 0) else 1.0
    passed = np.cumsum(np.where(interval < 0, usual, interval))
    return np.concatenate([time[:1], time[0] + passed])


# Both sides of a change of step are logged within some milliseconds.
_CLOSE_S, _CLOSE_SHARE = 0.05, 0.1
# Past this share of repeated stamps the clock is printed with too few digits.
_COARSE = 0.2


def examine_repeats(samples: Samples) -> tuple[Samples, list[Finding]]:
    """The samples on a clock that strictly rises, and which of them were logged twice.

    Samples that repeat another are dropped; those that differ from it are spread over the
    interval that follows.
    """
    repeats = find_repeats(samples)
    conflicts = repeats.is_conflict
    findings = [_conflict(samples, conflicts)] if conflicts.any() else []
    if conflicts.mean() > _COARSE:
        samples = replace(samples, time_s=_spread(samples.time_s))
        return samples, findings
    for is_repeat, words in (
        (repeats.is_exact, "exactly the row before"),
        (repeats.is_near, "the row before, within the tester's resolution"),
    ):
        if is_repeat.any():
            first = int(np.argmax(is_repeat)) + 1
            what = f"{counted(int(is_repeat.sum()), 'row')} logged twice: {words}"
            findings.append(found_at(samples, first, "note", what, "merged by barnax"))
    samples = samples.keep(np.concatenate([[True], ~(repeats.is_exact | repeats.is_near)]))
    if conflicts.any():
        samples = replace(samples, time_s=_spread(samples.time_s))
    close = _close(samples)
    return samples, [*findings, close] if close is not None else findings


def _conflict(samples: Samples, conflicts: Bool[np.ndarray, "intervals"]) -> Finding:
    at = int(np.argmax(conflicts)) + 1
    values = [f"{samples.current_a[k]:.6g} A, {samples.voltage_v[k]:.6g} V" for k in (at - 1, at)]
    what = (
        f"time {samples.time_s[at]:.10g} s stands twice with different values ({values[0]}, then "
        f"{values[1]}); {counted(int(conflicts.sum()), 'such row')}"
    )
    if conflicts.mean() > _COARSE:
        each = len(samples.time_s) / len(np.unique(samples.time_s))
        what += f", about {each:.3g} rows a stamp: the clock has too few digits"
        return found_at(samples, at, "error", what, "export the time with more digits")
    return found_at(
        samples,
        at,
        "error",
        what,
        "delete one of the two rows, or export the time with more digits",
    )


def _spread(time_s: Float[np.ndarray, "samples"]) -> Float[np.ndarray, "samples"]:
    """The clock with samples of one stamp laid evenly up to the next stamp."""
    stamps, place, times = np.unique(time_s, return_inverse=True, return_counts=True)
    gaps = np.diff(stamps)
    last = float(np.median(gaps)) if len(gaps) else 1.0
    within = np.arange(len(time_s)) - (np.cumsum(times) - times)[place]
    return time_s + np.append(gaps, last)[place] * within / times[place]


def _close(samples: Samples) -> Finding | None:
    """A note of samples hard upon the one before, which testers log where a step ends."""
    interval_s = np.diff(samples.time_s)
    if not len(interval_s):
        return None
    is_close = interval_s < min(_CLOSE_S, _CLOSE_SHARE * float(np.median(interval_s)))
    if not is_close.any():
        return None
    first = int(np.argmax(is_close)) + 1
    return found_at(
        samples,
        first,
        "note",
        f"{counted(int(is_close.sum()), 'sample')} within "
        f"{1e3 * interval_s[is_close].max():.3g} ms of the one before, as testers log both sides "
        "of a step",
    )

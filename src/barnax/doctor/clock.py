"""A clock that runs backwards: what kind of fault it is, and the samples without it."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

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

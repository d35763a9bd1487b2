"""A clock that runs backwards: what kind of fault it is, and the samples without it."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from ..records.samples import Samples
from .finding import Finding, counted, found_at

_DAY_S = 86_400.0

Clock = Float[np.ndarray, "samples"]


def examine_clock(samples: Samples) -> tuple[Samples, list[Finding]]:
    """The samples with a clock that never falls, and what was wrong with it.

    Single stamps out of line are dropped, rows out of order are sorted, and a clock that starts
    again is made to run on.
    """
    findings = []
    glitches = _single_glitches(samples.time_s)
    if glitches.any():
        first = int(np.argmax(glitches))
        neighbor = samples.time_s[first - 1] if first else samples.time_s[first + 1]
        findings.append(
            found_at(
                samples,
                first,
                "error",
                f"time is out of line at {counted(int(glitches.sum()), 'single row')}: "
                f"{samples.time_s[first]:.10g} s beside {neighbor:.10g} s",
                "delete the row, or correct its time",
            )
        )
        samples = samples.keep(~glitches)
    time = samples.time_s
    falls = np.flatnonzero(np.diff(time) < 0)
    if not len(falls):
        return samples, findings
    at = int(falls[0]) + 1
    drop = f"time runs backwards, from {time[at - 1]:.10g} s to {time[at]:.10g} s"
    if _is_shuffled(time, len(falls)):
        what = f"{drop}: rows stand out of order ({counted(len(falls), 'place')})"
        findings.append(found_at(samples, at, "error", what, "sort the rows by time"))
        order = np.argsort(time, kind="stable")
        return samples.keep(order), findings
    what, remedy = _restart(samples, falls, drop)
    findings.append(found_at(samples, at, "error", what, remedy))
    return replace(samples, time_s=_running_on(time)), findings


def _single_glitches(time: Clock) -> Bool[np.ndarray, "samples"]:
    """Stamps without which their neighbors are in order: too low, or too high."""
    glitches = np.zeros(len(time), bool)
    falls = np.flatnonzero(np.diff(time) < 0)
    padded = np.concatenate([[-np.inf], time, [np.inf]])
    # Of the fall from sample k to k + 1; padded[k + 1] is sample k.
    is_low = padded[falls + 3] > padded[falls + 1]
    is_high = padded[falls + 2] > padded[falls]
    glitches[falls[is_low & ~is_high] + 1] = True
    glitches[falls[is_high & ~is_low]] = True
    return glitches


def _is_shuffled(time: Clock, falls: int) -> bool:
    """Whether sorting puts whole pieces into their places, rather than mixing two clocks."""
    order = np.argsort(time, kind="stable")
    if np.any(np.diff(time[order]) == 0):
        return False
    piece = np.cumsum(np.concatenate([[0], np.diff(time) < 0]))[order]
    return int(np.sum(np.diff(piece) != 0)) <= 3 * falls + 2


def _restart(samples: Samples, falls: np.ndarray, drop: str) -> tuple[str, str]:
    time, name = samples.time_s, samples.names["time"]
    fall_s = time[falls] - time[falls + 1]
    if np.all(np.abs(fall_s - _DAY_S) < 0.01 * _DAY_S):
        return (
            f"{drop}: '{name}' is a time of day, past midnight {counted(len(falls), 'time')}",
            "give the time since the test began",
        )
    if samples.step is not None and np.mean(np.diff(samples.step)[falls] != 0) > 0.8:
        return (
            f"{drop}: '{name}' starts again with each step ({counted(len(falls), 'time')})",
            "give the test's own clock, not the step's",
        )
    return (
        f"{drop}: the clock starts again {counted(len(falls), 'time')}",
        "split joined tests into files of their own, or give the test's own clock",
    )


def _running_on(time: Clock) -> Clock:
    """The clock with an ordinary interval where it fell."""
    interval = np.diff(time)
    usual = float(np.median(interval[interval > 0])) if np.any(interval > 0) else 1.0
    passed = np.cumsum(np.where(interval < 0, usual, interval))
    return np.concatenate([time[:1], time[0] + passed])

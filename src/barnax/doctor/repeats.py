"""Samples that carry the time stamp of another, or nearly so."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from ..records.checks import find_repeats
from ..records.samples import Samples
from .finding import Finding, counted, found_at

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

"""The samples of a record that a difference equation can be fitted to."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from ..course import Course
from .answer import MethodFailure

# Intervals this close to the median, relative to it, are taken as it; a tester's clock jitters.
EVEN = 0.05
# With fewer scored samples than these, as a share, the answer would be of another record.
LEAST_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class EvenSamples:
    """Drop (source minus terminal voltage, in V) and current (in A) on an almost even clock.

    `is_row` says of every sample whether it and the `lags` before it are scored and evenly spaced,
    so that a difference equation holds there. The current flows in the interval after a sample
    where `is_forward`, else in the one before.
    """

    time_s: Float[np.ndarray, "samples"]
    drop_v: Float[np.ndarray, "samples"]
    current_a: Float[np.ndarray, "samples"]
    is_row: Bool[np.ndarray, "samples"]
    interval_s: float
    is_forward: bool
    notes: tuple[str, ...]


def even_samples(course: Course, lags: int) -> EvenSamples:
    """The scored samples of a record, those marked whose `lags` intervals are even.

    Nothing is resampled: a voltage between samples was not measured, and interpolating it biases
    the poles. Raises `MethodFailure` where too few samples are left, and for a circuit whose
    source depends on what is identified.
    """
    if course.hysteresis_amplitude_v is not None:
        raise MethodFailure(
            "it needs the open-circuit voltage beforehand, and a dynamic hysteresis moves it"
        )
    interval_s = np.diff(course.time_s)
    scored = course.scored
    within = scored[1:] & scored[:-1]
    if not np.any(within):
        raise MethodFailure("no scored samples follow one another")
    median_s = float(np.median(interval_s[within]))
    is_even = within & (np.abs(interval_s - median_s) <= EVEN * median_s)
    is_row = np.zeros(len(scored), bool)
    is_row[lags:] = np.lib.stride_tricks.sliding_window_view(is_even, lags).all(axis=1)
    rows, samples = np.count_nonzero(is_row), np.count_nonzero(scored)
    if rows < LEAST_SHARE * samples:
        raise MethodFailure(
            f"the clock is uneven: only {rows} of {samples} scored samples follow {lags} intervals "
            f"within {100 * EVEN:.0f} % of the median {median_s:.4g} s, and a difference equation "
            "needs one interval"
        )
    notes = ()
    if rows < samples - lags:
        notes = (f"fitted to the {rows} of {samples} scored samples that are evenly spaced",)
    return EvenSamples(
        time_s=course.time_s,
        drop_v=course.source_v - course.voltage_v,
        current_a=course.current_a,
        is_row=is_row,
        interval_s=median_s,
        is_forward=course.record.hold.value == "forward",
        notes=notes,
    )

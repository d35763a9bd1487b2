"""A record on an even clock, as difference equations need it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from ..course import Course
from .answer import MethodFailure

# Intervals that differ by less, relative to their median, are one interval.
EVEN = 1e-3
# Across a longer gap, in median intervals, the voltage is not known; nothing is fitted there.
LONGEST_GAP = 1.5


@dataclass(frozen=True, eq=False)
class EvenSamples:
    """Drop (source minus terminal voltage, in V) and held current (in A) on an even clock.

    `current_a` flows in the interval after each sample where `is_forward`, else in the one before.
    `is_known` is true where a sample lies between scored, closely spaced ones.
    """

    time_s: Float[np.ndarray, "samples"]
    drop_v: Float[np.ndarray, "samples"]
    current_a: Float[np.ndarray, "samples"]
    is_known: Bool[np.ndarray, "samples"]
    interval_s: float
    is_forward: bool
    notes: tuple[str, ...]


def even_samples(course: Course) -> EvenSamples:
    """The scored stretch of a record on its median interval.

    An uneven clock is resampled: the current by its ampere-hours, so that none are lost, the
    voltage by straight lines; a note says so. Raises `MethodFailure` for a circuit whose source
    depends on what is identified.
    """
    if course.hysteresis_amplitude_v is not None:
        raise MethodFailure(
            "it needs the open-circuit voltage beforehand, and a dynamic hysteresis moves it"
        )
    inside = np.flatnonzero(course.scored)
    stretch = slice(inside[0], inside[-1] + 1)
    time_s = course.time_s[stretch]
    drop_v = (course.source_v - course.voltage_v)[stretch]
    scored = course.scored[stretch]
    interval_s = np.diff(time_s)
    median_s = float(np.median(interval_s))
    is_forward = course.record.hold.value == "forward"
    if np.all(np.abs(interval_s - median_s) <= EVEN * median_s):
        current_a = course.current_a[stretch]
        return EvenSamples(time_s, drop_v, current_a, scored, median_s, is_forward, ())

    flowing_a = course.held_a[stretch][:-1]
    charge_as = np.append(0.0, np.cumsum(flowing_a * interval_s))
    even_s = np.arange(time_s[0], time_s[-1], median_s)
    edges_s = even_s + median_s if is_forward else even_s - median_s
    low_s, high_s = np.minimum(even_s, edges_s), np.maximum(even_s, edges_s)
    passed_as = np.interp(high_s, time_s, charge_as) - np.interp(low_s, time_s, charge_as)
    before = np.clip(np.searchsorted(time_s, even_s, "right") - 1, 0, len(interval_s) - 1)
    is_close = interval_s <= LONGEST_GAP * median_s
    return EvenSamples(
        time_s=even_s,
        drop_v=np.interp(even_s, time_s, drop_v),
        current_a=passed_as / median_s,
        is_known=is_close[before] & scored[before] & scored[before + 1],
        interval_s=median_s,
        is_forward=is_forward,
        notes=(
            f"resampled to even intervals of {median_s:.6g} s: those of the record run from "
            f"{interval_s.min():.4g} to {interval_s.max():.4g} s, and a difference equation needs "
            "one",
        ),
    )

"""Where in a whole cycler test the dynamic profile lies, and where its state of charge is known."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from ..cell.rest_points import CLOCK_SLACK_S, MINIMUM_REST_S, SETTLED_V
from .case import Case

# Current steps inside a step of the tester that make it a profile.
_FEWEST_STEPS = 10
# A record that is profile to this share needs no window.
_WHOLE = 0.95
# A held voltage, and a current that tapers under it to this share.
_HELD_V, _FULL_V, _TAPERED = 0.01, 0.06, 0.5


@dataclass(frozen=True)
class Window:
    """How to cut a whole test to its profile: options of barnax, and the reason in words."""

    options: tuple[str, ...]
    reason: str


def suggest_window(case: Case) -> Window:
    """The options that start the simulation where the charge is known and score the profile."""
    record = case.record
    numbers = _profile_numbers(case)
    if record.step is None or not len(numbers):
        return _from_the_beginning(case)
    inside = np.flatnonzero(np.isin(record.step, numbers))
    first, last = int(inside[0]), int(inside[-1])
    if last - first + 1 >= _WHOLE * record.samples:
        return _from_the_beginning(case)
    # Steps that are met inside the profile only belong to it.
    outside = np.concatenate([record.step[:first], record.step[last + 1 :]])
    own = [str(number) for number in np.setdiff1d(record.step[first : last + 1], outside)]
    score = f"--score-steps {','.join(own)}"
    at, rest_s = _rest_before(case, first)
    is_settled = rest_s >= MINIMUM_REST_S - CLOCK_SLACK_S
    rest = f"after {_duration(rest_s)} of rest" + ("" if is_settled else ", too short to settle")
    if not rest_s:
        rest = "without a rest before it"
    profile = f"the profile is step{'s' if len(own) > 1 else ''} {', '.join(own)}, {rest}"
    full = _full_step(case, first)
    if full is not None:
        return Window(
            (f"--start-after-step {full}", "--initial-soc 1", score),
            f"{profile}; the cell is full at the end of step {full}",
        )
    if is_settled:
        start = f"--start-time {_clock_before(case, at)}"
        return Window((start, score), f"{profile} at {record.voltage_v[at]:.4f} V")
    # Ampere-hours carry the charge from the record's own beginning.
    start = _from_the_beginning(case)
    return Window((*start.options, score), f"{profile}; {start.reason}")


def _from_the_beginning(case: Case) -> Window:
    """How a simulation of the whole record learns its state of charge."""
    record = case.record
    if not case.is_rested[0]:
        return Window(("--initial-soc SOC",), "it starts under load")
    loaded = np.flatnonzero(~case.is_rested)
    at = int(loaded[0]) - 1 if len(loaded) else record.samples - 1
    first_v, last_v = record.voltage_v[0], record.voltage_v[at]
    if abs(last_v - first_v) <= SETTLED_V:
        return Window((), f"it starts at rest at {first_v:.4f} V")
    moves = f"the voltage goes from {first_v:.4f} to {last_v:.4f} V in its opening rest"
    if record.time_s[at] - record.time_s[0] >= MINIMUM_REST_S - CLOCK_SLACK_S:
        return Window((f"--start-time {_clock_before(case, at)}",), moves)
    return Window(("--initial-soc SOC",), moves)


def _rest_before(case: Case, first: int) -> tuple[int, float]:
    """The last rested sample before the profile's load, and how long the rest had been."""
    loaded = np.flatnonzero(~case.is_rested)
    before, after = loaded[loaded < first], loaded[loaded >= first]
    at = int(after[0]) - 1 if len(after) else first
    if not len(before) or at <= before[-1]:
        return max(at, 0), 0.0
    return at, float(case.record.time_s[at] - case.record.time_s[before[-1]])


def _clock_before(case: Case, at: int) -> str:
    """A time that selects the sample `at` as the first one not before it."""
    time_s = case.record.time_s
    short = math.floor(time_s[at] * 1e3) / 1e3
    return f"{short:.10g}" if at == 0 or short > time_s[at - 1] else repr(float(time_s[at]))


def _profile_numbers(case: Case) -> Int[np.ndarray, "numbers"]:
    """The tester's step numbers inside which the current steps about."""
    step = case.record.step
    if step is None:
        return np.zeros(0, int)
    is_inside = case.is_step & (np.diff(step) == 0)
    numbers, times = np.unique(step[1:][is_inside], return_counts=True)
    return numbers[times >= _FEWEST_STEPS]


def _full_step(case: Case, before: int) -> int | None:
    """The number of the step that ends full: a charge at a held voltage, its current tapered."""
    record = case.record
    step = record.step
    if step is None:
        return None
    starts = np.flatnonzero(np.diff(step, prepend=step[0] - 1) != 0)
    ends = np.append(starts[1:], record.samples) - 1
    for start, end in zip(starts[::-1], ends[::-1], strict=True):
        if end >= before or end - start < 3:
            continue
        current_a, voltage_v = record.current_a[start : end + 1], record.voltage_v[start : end + 1]
        is_held = np.ptp(voltage_v[1:]) < _HELD_V
        is_full = np.median(voltage_v) > record.voltage_v.max() - _FULL_V
        is_tapered = current_a.max() < 0 and current_a[-1] > _TAPERED * current_a[0]
        # The last block of a step is what --start-after-step takes.
        if is_held and is_full and is_tapered and not np.any(step[end + 1 :] == step[start]):
            return int(step[start])
    return None


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.3g} s"
    return f"{seconds / 60:.3g} min" if seconds < 7200 else f"{seconds / 3600:.3g} h"

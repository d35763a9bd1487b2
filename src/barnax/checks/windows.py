"""Windows that cut a whole test to its profile, from where the charge is known on."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Int

from ..cell.ocv_points import CLOCK_SLACK_S, MINIMUM_REST_S, SETTLED_V
from ..records.segments import FULL_CHARGE, equal_runs, runs
from .check_input import CheckInput

# A rest of this length settles the cell.
_LONG_REST_S = MINIMUM_REST_S - CLOCK_SLACK_S
# Current steps inside a step of the tester that make it a profile.
_FEWEST_STEPS = 10
# A record that is profile to this share needs no window.
_WHOLE = 0.95
# Intervals up to this many times the usual one under load are sampled alike.
_ALIKE = 1.5


@dataclass(frozen=True)
class SuggestedWindow:
    """A window that cuts a whole test to its profile, and why.

    The fields are those of `barnax.Window`; what is None stays at its default.
    `needs_initial_soc` says that the record does not tell the state of charge at the start, so
    that the user must; `is_settled` that the cell has rested when the profile begins.
    """

    reason: str
    start_time_s: float | None = None
    start_after_step: int | None = None
    initial_soc: float | None = None
    score_steps: tuple[int, ...] | None = None
    needs_initial_soc: bool = False
    is_settled: bool = True

    @property
    def options(self) -> dict[str, Any]:
        """Arguments of `barnax.Window`."""
        names = ("start_time_s", "start_after_step", "initial_soc", "score_steps")
        return {name: value for name in names if (value := getattr(self, name)) is not None}

    @property
    def advice(self) -> str:
        """The options to give where not all of a record is to be simulated."""
        options = [
            f"`{name.removesuffix('_s')}={','.join(f'{n:.10g}' for n in np.atleast_1d(value))}`"
            for name, value in self.options.items()
        ]
        return f"give {' '.join(options)}" if options else ""


def suggest_window(given: CheckInput) -> SuggestedWindow:
    """The window that starts where the charge is known and scores the profile."""
    record = given.record
    whole = _from_the_beginning(given)
    step = record.step
    numbers = () if step is None else _profile_numbers(given, step)
    if step is None or not len(numbers):
        return _after_charge(given) or whole
    inside = np.flatnonzero(np.isin(step, numbers))
    first, last = int(inside[0]), int(inside[-1])
    if last - first + 1 >= _WHOLE * record.samples:
        return whole
    # Steps that are met inside the profile only belong to it.
    outside = np.concatenate([step[:first], step[last + 1 :]])
    own = tuple(np.setdiff1d(step[first : last + 1], outside).tolist())
    at, rest_s = _rest_before(given, first)
    is_settled = rest_s >= _LONG_REST_S
    rest = f"after {_duration(rest_s)} of rest" + ("" if is_settled else ", too short to settle")
    if not rest_s:
        rest = "without a rest before it"
    profile = f"the profile is step{'s' if len(own) > 1 else ''} {', '.join(map(str, own))}, {rest}"
    full = _full_step(given, step, first)
    if full is not None:
        reason = f"{profile}; the cell is full at the end of step {full}"
        return SuggestedWindow(
            reason, start_after_step=full, initial_soc=1.0, score_steps=own, is_settled=is_settled
        )
    if is_settled:
        reason = f"{profile} at {record.voltage_v[at]:.4f} V"
        return SuggestedWindow(reason, start_time_s=_clock_before(given, at), score_steps=own)
    # Ampere-hours carry the charge from the record's own beginning.
    reason = f"{profile}; {whole.reason}"
    if _is_fine_throughout(given):
        # What comes before the profile is simulated anyhow, and tells as much.
        return replace(whole, reason=f"{reason}; its sampling is uniform")
    return replace(whole, reason=reason, score_steps=own, is_settled=is_settled)


def _after_charge(given: CheckInput) -> SuggestedWindow | None:
    """From the end of the rest after a long charge, where all current steps come after it."""
    record = given.record
    if given.sweeps and not isinstance(given.sweeps, str):
        return None
    steps = np.flatnonzero(given.samples.is_step)
    for start, end in zip(*runs((record.current_a < 0) & ~given.is_rested), strict=True):
        before, after = np.sum(steps < end), np.sum(steps > end)
        if before >= _FEWEST_STEPS or after < _FEWEST_STEPS:
            return None
        at, rest_s = _rest_before(given, end + 1)
        charge_s = record.time_s[end] - record.time_s[start]
        if rest_s >= _LONG_REST_S and charge_s >= FULL_CHARGE.least_s:
            charge = f"the charge that ends in row {record.row[end]}"
            reason = f"the profile follows {charge}, after {_duration(rest_s)} of rest"
            return SuggestedWindow(reason, _clock_before(given, at))
    return None


def _is_fine_throughout(given: CheckInput) -> bool:
    """True if nearly all of the record is logged at the interval of its loads."""
    interval_s = given.record.interval_s
    loaded_s = float(np.median(interval_s[~given.is_rested[1:]]))
    return bool(np.quantile(interval_s, _WHOLE) <= _ALIKE * loaded_s)


def _from_the_beginning(given: CheckInput) -> SuggestedWindow:
    """The window of the whole record, by how it tells its state of charge."""
    record = given.record
    if not given.is_rested[0]:
        return SuggestedWindow("it starts under load", needs_initial_soc=True, is_settled=False)
    loaded = np.flatnonzero(~given.is_rested)
    at = int(loaded[0]) - 1 if len(loaded) else record.samples - 1
    first_v, last_v = record.voltage_v[0], record.voltage_v[at]
    if abs(last_v - first_v) <= SETTLED_V:
        return SuggestedWindow(f"it starts at rest at {first_v:.4f} V")
    moves = f"the voltage goes from {first_v:.4f} to {last_v:.4f} V in its opening rest"
    if record.time_s[at] - record.time_s[0] >= _LONG_REST_S:
        return SuggestedWindow(moves, start_time_s=_clock_before(given, at))
    return SuggestedWindow(moves, needs_initial_soc=True, is_settled=False)


def _rest_before(given: CheckInput, first: int) -> tuple[int, float]:
    """The last rested sample before the profile's load, and how long the rest had been."""
    loaded = np.flatnonzero(~given.is_rested)
    before, after = loaded[loaded < first], loaded[loaded >= first]
    at = int(after[0]) - 1 if len(after) else first
    if not len(before) or at <= before[-1]:
        return max(at, 0), 0.0
    return at, float(given.record.time_s[at] - given.record.time_s[before[-1]])


def _clock_before(given: CheckInput, at: int) -> float:
    """A time of few digits that selects the sample `at` as the first one not before it."""
    time_s = given.record.time_s
    short = float(f"{math.floor(time_s[at] * 1e3) / 1e3:.10g}")
    return short if at == 0 or short > time_s[at - 1] else float(time_s[at])


def _profile_numbers(
    given: CheckInput, step: Int[np.ndarray, "samples"]
) -> Int[np.ndarray, "numbers"]:
    """The tester's step numbers inside which the current steps about."""
    is_inside = given.samples.is_step & (np.diff(step) == 0)
    numbers, times = np.unique(step[1:][is_inside], return_counts=True)
    return numbers[times >= _FEWEST_STEPS]


def _full_step(given: CheckInput, step: Int[np.ndarray, "samples"], before: int) -> int | None:
    """The number of the step that ends full: a charge at a held voltage, its current tapered."""
    record = given.record
    starts, ends = equal_runs(step)
    for start, end in zip(starts[::-1], ends[::-1], strict=True):
        if end >= before or record.time_s[end] - record.time_s[start] < FULL_CHARGE.least_s:
            continue
        current_a, voltage_v = record.current_a[start : end + 1], record.voltage_v[start : end + 1]
        is_held = np.ptp(voltage_v[1:]) < FULL_CHARGE.held_v
        is_full = np.median(voltage_v) > record.voltage_v.max() - FULL_CHARGE.held_near_v
        is_tapered = current_a.max() < 0 and FULL_CHARGE.has_tapered(current_a[0], current_a[-1])
        # The last block of a step is what `start_after_step` takes.
        if is_held and is_full and is_tapered and not np.any(step[end + 1 :] == step[start]):
            return int(step[start])
    return None


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.3g} s"
    return f"{seconds / 60:.3g} min" if seconds < 7200 else f"{seconds / 3600:.3g} h"

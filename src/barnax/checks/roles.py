"""The roles that a record can serve in, and the window that cuts a whole test to its profile."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Int

from ..cell import OcvPoint, OcvTable
from ..cell.soc_axis import CHARGE, DISCHARGE, WORD, by_direction, decide_capacity
from ..errors import InputError, counted
from ..notices import Notice
from ..records.record import SETTLED_V, is_long
from ..settings import Window
from .check_input import CheckInput, Kind, Traits

# This many current steps inside a step of the tester make it a profile.
_FEWEST_STEPS = 10
# A record with at least this share of profile needs no window.
_WHOLE = 0.95
# Intervals up to this many times the usual one under load count as equally sampled.
_ALIKE = 1.5


@dataclass(frozen=True)
class SuggestedWindow:
    """A window that cuts a whole test to its profile, and why.

    `needs_initial_soc` is True if the record does not determine the initial state of charge, so
    that the user must give it; `is_settled` if the cell has rested when the profile begins.
    """

    reason: str
    window: Window = field(default_factory=Window)
    needs_initial_soc: bool = False
    is_settled: bool = True

    @property
    def options(self) -> dict[str, Any]:
        """Arguments of `barnax.Window`."""
        return {name: value for name, value in vars(self.window).items() if value is not None}

    @property
    def advice(self) -> str:
        """The options of `identify` if not all of a record is to be simulated."""
        options = [
            f"`{name.removesuffix('_s')}={','.join(f'{n:.10g}' for n in np.atleast_1d(value))}`"
            for name, value in self.options.items()
        ]
        return f"identify takes {' '.join(options)}" if options else ""


def suggest_window(given: CheckInput) -> SuggestedWindow:
    """The window that starts where the charge is known and scores the profile."""
    record = given.record
    whole = _from_the_beginning(given)
    step = np.zeros(record.samples, int) if record.step is None else record.step
    # The tester's step numbers with many current steps inside.
    is_inside = given.samples.is_step & (np.diff(step) == 0)
    numbers, times = np.unique(step[1:][is_inside], return_counts=True)
    numbers = numbers[times >= _FEWEST_STEPS]
    if record.step is None or not len(numbers):
        return _after_charge(given) or whole
    inside = np.flatnonzero(np.isin(step, numbers))
    first, last = int(inside[0]), int(inside[-1])
    if last - first + 1 >= _WHOLE * record.samples:
        return whole
    # Steps that occur only inside the profile belong to it.
    outside = np.concatenate([step[:first], step[last + 1 :]])
    profile_steps = tuple(np.setdiff1d(step[first : last + 1], outside).tolist())
    at, rest_s = given.segments.rest_before(first)
    is_settled = is_long(rest_s)
    rest = f"after {_duration(rest_s)} of rest" + ("" if is_settled else ", too short to settle")
    if not rest_s:
        rest = "without a rest before it"
    several, named = "s" if len(profile_steps) > 1 else "", ", ".join(map(str, profile_steps))
    profile = f"the profile is step{several} {named}, {rest}"
    full = _full_step(given, step, first)
    if full is not None:
        reason = f"{profile}; the cell is full at the end of step {full}"
        window = Window(start_after_step=full, initial_soc=1.0, score_steps=profile_steps)
        return SuggestedWindow(reason, window, is_settled=is_settled)
    if is_settled:
        reason = f"{profile} at {record.voltage_v[at]:.4f} V"
        start_s = _clock_before(given, at)
        return SuggestedWindow(reason, Window(start_time_s=start_s, score_steps=profile_steps))
    # Ampere-hours carry the charge from the record's beginning.
    reason = f"{profile}; {whole.reason}"
    interval_s = record.interval_s
    loaded_s = float(np.median(interval_s[~given.segments.is_rested[1:]]))
    if np.quantile(interval_s, _WHOLE) <= _ALIKE * loaded_s:
        # The part before the profile is simulated anyway, and is just as informative.
        return replace(whole, reason=f"{reason}; its sampling is uniform")
    window = replace(whole.window, score_steps=profile_steps)
    return replace(whole, reason=reason, window=window, is_settled=is_settled)


def _after_charge(given: CheckInput) -> SuggestedWindow | None:
    """From the end of the rest after a long charge, if all current steps come after it."""
    record, steps = given.record, given.samples.steps
    for _, last in () if given.ocv.sweeps else given.segments.long_loads(1):
        before, after = np.sum(steps < last), np.sum(steps > last)
        if before >= _FEWEST_STEPS or after < _FEWEST_STEPS:
            return None
        at, rest_s = given.segments.rest_before(last + 1)
        if is_long(rest_s):
            charge = f"the charge that ends in row {record.row[last]}"
            reason = f"the profile follows {charge}, after {_duration(rest_s)} of rest"
            return SuggestedWindow(reason, Window(start_time_s=_clock_before(given, at)))
    return None


def _from_the_beginning(given: CheckInput) -> SuggestedWindow:
    """The window of the whole record, by how its initial state of charge can be determined."""
    record, loaded = given.record, given.segments.loaded
    at = int(loaded[0]) - 1 if len(loaded) else record.samples - 1
    if at < 0:
        return SuggestedWindow("it starts under load", needs_initial_soc=True, is_settled=False)
    first_v, last_v = record.voltage_v[0], record.voltage_v[at]
    if abs(last_v - first_v) <= SETTLED_V:
        return SuggestedWindow(f"it starts at rest at {first_v:.4f} V")
    moves = f"the voltage goes from {first_v:.4f} to {last_v:.4f} V in its opening rest"
    if is_long(record.time_s[at] - record.time_s[0]):
        return SuggestedWindow(moves, Window(start_time_s=_clock_before(given, at)))
    return SuggestedWindow(moves, needs_initial_soc=True, is_settled=False)


def _clock_before(given: CheckInput, at: int) -> float:
    """A time with few digits that selects sample `at` as the first one not before it."""
    time_s = given.record.time_s
    short = float(f"{math.floor(time_s[at] * 1e3) / 1e3:.10g}")
    return short if at == 0 or short > time_s[at - 1] else float(time_s[at])


def _full_step(given: CheckInput, step: Int[np.ndarray, "samples"], before: int) -> int | None:
    """The number of the last step before a sample that ends with the cell full."""
    number = None
    for last in given.segments.full_charges(math.inf):
        # `start_after_step` uses the last block of a step.
        end = int(np.flatnonzero(step == step[last])[-1])
        if end < before and np.all(step[last:end] == step[last]):
            number = int(step[last])
    return number


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.3g} s"
    return f"{seconds / 60:.3g} min" if seconds < 7200 else f"{seconds / 3600:.3g} h"


def are_unfit(names: Collection[str], warnings: Iterable[Notice], by_steps: bool = False) -> bool:
    """True if there are records and the warnings say that none of them is suitable for
    identification; with `by_steps`, because the current steps of each leave R0 too uncertain.

    Such records cannot separate the OCV from slow resistances, and so are no evidence against an
    OCV test.
    """
    unfit = {
        warning.subject
        for warning in warnings
        if warning.code == "role.unfit" and warning.values["role"] == "identification"
        if not by_steps or "half_width" in warning.values
    }
    return bool(names) and unfit.issuperset(names)


def require_load(kinds: Mapping[str, Kind]) -> None:
    """Raise `InputError` for files, by name, if one is a slow sweep, or none has changes of current
    from which a circuit follows: a charge together with a drive shows the other direction."""
    for file, kind in kinds.items():
        if kind == "slow sweep" or (kind == "charge" and set(kinds.values()) == {"charge"}):
            raise Notice("role.no-load", {"what": kind}, file).error()


@dataclass(frozen=True)
class Role:
    """A role that a record can serve in or not, the reason, and the window it needs, if any;
    `half_width` is the predicted share of R0 if only the current steps are insufficient."""

    name: str
    is_usable: bool
    reason: str
    window: SuggestedWindow | None = None
    half_width: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """The role as plain values."""
        return {
            "usable": self.is_usable,
            "reason": self.reason,
            "window": self.window.options if self.window else {},
            "needs initial SOC": bool(self.window and self.window.needs_initial_soc),
        }


def find_roles(given: CheckInput, traits: Traits) -> tuple[Role, ...]:
    """Every role, possible or not."""
    window, roles = suggest_window(given), [_ocv_test(given)]
    steps = counted(traits.steps, "current step")
    seen = f"{steps}, sampled every {traits.interval_s:.3g} s under load"
    moves = f"{seen}; it spans {given.record.span_ah:.3g} Ah; {window.reason}"
    for name, is_validated in (("identification", False), ("validation", True)):
        missing = traits.missing_for(given.capacity_ah, is_validated)
        by_steps = missing and not traits.unfit(given.capacity_ah)
        loose = traits.half_width(is_validated) if by_steps else None
        use = None if missing else window
        roles.append(Role(name, not missing, missing or moves, use, loose))
    return tuple(roles)


def roles_of_table(table: OcvTable) -> tuple[Role, ...]:
    """Every role of a table of OCV over SOC."""
    names = {DISCHARGE: "discharge: ", CHARGE: "charge: "}
    reason = "; ".join(
        f"{names.get(direction, '')}{len(points)} points, SOC {points[0].soc:.4g} to "
        f"{points[-1].soc:.4g}, {min(point.voltage_v for point in points):.3f} to "
        f"{max(point.voltage_v for point in points):.3f} V, "
        f"{'falling in places' if find_fall(points) else 'rising throughout'}"
        for direction, points in table.branches.items()
    )
    missing = "a table of OCV has no load"
    others = (Role(name, False, missing) for name in ("identification", "validation"))
    return Role("OCV test", True, f"{reason}; give it with `ocv`"), *others


def find_fall(points: Sequence[OcvPoint]) -> tuple[OcvPoint, OcvPoint] | None:
    """The two neighboring points between which an OCV falls the most, if it does."""
    drop = min(pairwise(points), key=lambda pair: pair[1].voltage_v - pair[0].voltage_v)
    return drop if drop[1].voltage_v < drop[0].voltage_v else None


def _ocv_test(given: CheckInput) -> Role:
    name = "OCV test"
    sweeps, _, missing = given.ocv
    if missing:
        return Role(name, False, str(missing.values["reason"]))
    try:
        whole = by_direction(sweeps)
        if given.capacity_ah is not None:
            decide_capacity(whole, given.capacity_ah)
    except InputError as problem:
        return Role(name, False, str(problem))
    ways = dict.fromkeys(sweep.direction for sweep in sweeps)
    reasons = []
    for way, points in ((way, whole[way].points) for way in ways):
        is_slow = whole[way].kind == "slow"
        kind = f"slow {WORD[way]}" if is_slow else f"{WORD[way]} with {len(points)} rests"
        ends = f"{points[0].voltage_v:.3f} to {points[-1].voltage_v:.3f} V"
        reasons.append(f"{kind}, {whole[way].passed_ah:.4g} Ah, {ends}")
    if len(ways) == 1:
        reasons.append("one direction only, so the hysteresis voltage stays unknown")
    return Role(name, True, "; ".join(reasons))

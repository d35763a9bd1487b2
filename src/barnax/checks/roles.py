"""What kind of test a record is, what it can serve as, and the window it then needs.

The kind is told by its sweeps, its current steps and how far they reach.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from jaxtyping import Int

from ..cell import OcvPoint, OcvTable
from ..cell.ocv_points import CLOCK_SLACK_S, MINIMUM_REST_S, SETTLED_V
from ..cell.soc_axis import CHARGE, DISCHARGE, WORD, Sweep, decide_capacity, join_sweeps
from ..errors import InputError, counted
from .check_input import CheckInput

Kind = Literal[
    "OCV test", "slow sweep", "pulse test", "drive cycle", "capacity test", "charge", "nothing"
]

# Current steps that an identification wants, and the interval that still shows what follows one.
STEPS, FINE_S = 20, 10.5
# Steps that reach over less of the capacity, or the bulk time of a steep end, say little.
LEAST_SHARE, STEEP_S = 0.05, 20.0
# Of the steps so much lies between the ends of their reach; a few may stand apart.
_REACH = (0.05, 0.95)
# Pulses and rests alone make two steps a point; an HPPC test has pulses of its own beside them.
_STEPS_A_POINT = 3
# A discharge that passes so much of all the charge was one of a capacity test.
_MOST = 0.8
_NAMED_DEGC = re.compile(r"(?<![\d.])(-?\d{1,2}(?:\.\d+)?)[ _]?(?:degC|deg_?C|°C)(?![a-zA-Z])")


@dataclass(frozen=True)
class Traits:
    """Numbers of a record that tell what it can serve as.

    `steps` are those of the current that are sampled finely enough; they reach over `reach_ah` of
    charge and last `reach_s`. `steep_v` is the travel of the voltage where the cell stands at a
    steep end throughout, else zero. `temperature_degc` is the column's median, else the one in the
    name, else None.
    """

    sweeps: tuple[Sweep, ...]
    steps: int
    reach_ah: float
    reach_s: float
    span_ah: float
    charged_ah: float
    discharged_ah: float
    longest_discharge_ah: float
    interval_s: float
    steep_v: float
    temperature_degc: float | None

    @property
    def is_slow(self) -> bool:
        """Whether all that it holds are slow sweeps."""
        return bool(self.sweeps) and all(sweep.kind == "slow" for sweep in self.sweeps)

    def kind(self, capacity_ah: float | None) -> Kind:
        """What it is, of a cell of that capacity."""
        if self.sweeps:
            points = sum(len(sweep.points) - 1 for sweep in self.sweeps)
            has_pulses = self.steps >= max(STEPS, _STEPS_A_POINT * points)
            return "slow sweep" if self.is_slow else "pulse test" if has_pulses else "OCV test"
        if not self.lacks(capacity_ah):
            return "drive cycle"
        whole_ah = capacity_ah or self.span_ah
        if self.steep_v or self.span_ah < LEAST_SHARE * whole_ah:
            return "nothing"
        if self.longest_discharge_ah > _MOST * whole_ah:
            return "capacity test"
        return "charge" if self.charged_ah > self.discharged_ah else "nothing"

    def lacks(self, capacity_ah: float | None, fewest: int = STEPS) -> str:
        """What it lacks to identify or validate a circuit on, in words; nothing if it is fit."""
        if self.is_slow and self.steps >= STEPS:
            steps = counted(self.steps, "current step")
            return f"it holds a slow sweep beside {steps}; give the part with the steps by itself"
        if self.is_slow:
            return "a slow sweep does not show what follows a step of current"
        if self.steep_v:
            return (
                f"the cell stands at a steep end: {self.span_ah:.3g} Ah move its voltage by "
                f"{self.steep_v:.2g} V"
            )
        if capacity_ah is not None and self.span_ah < LEAST_SHARE * capacity_ah:
            share = 100 * self.span_ah / capacity_ah
            return f"it moves {self.span_ah:.3g} Ah, {share:.2g} % of the capacity"
        steps = counted(self.steps, "current step")
        if self.steps < fewest:
            return f"{steps} sampled finely enough; {fewest} are wanted"
        # Without a capacity a dither gives itself away by how often it turns.
        whole_ah = capacity_ah or self.charged_ah + self.discharged_ah
        if self.reach_ah < LEAST_SHARE * whole_ah:
            share = 100 * self.reach_ah / whole_ah
            of = "the capacity" if capacity_ah else "what it passes"
            return f"its {steps} lie within {self.reach_ah:.2g} Ah, {share:.2g} % of {of}"
        return ""


def traits_of(given: CheckInput) -> Traits:
    """The numbers that tell the kind of a record."""
    record = given.record
    fine = np.flatnonzero(given.is_step & (record.interval_s <= FINE_S))
    discharged_ah = record.discharged_ah
    reach_ah = reach_s = 0.0
    if len(fine):
        reach_ah = float(np.ptp(np.quantile(discharged_ah[fine], _REACH)))
        reach_s = float(record.time_s[fine[-1] + 1] - record.time_s[fine[0]])
    loaded_s = record.interval_s[~given.is_rested[1:]]
    bulk_s, travel_v = given.samples.bulk_time
    # The deepest point below the highest one before it: charge taken out without going back up.
    out_ah = discharged_ah - np.minimum.accumulate(discharged_ah)
    return Traits(
        sweeps=() if isinstance(given.sweeps, str) else tuple(given.sweeps),
        steps=len(fine),
        reach_ah=reach_ah,
        reach_s=reach_s,
        span_ah=given.span_ah,
        charged_ah=given.charged_ah,
        discharged_ah=given.discharged_ah,
        longest_discharge_ah=float(out_ah.max()),
        interval_s=float(np.median(loaded_s)) if len(loaded_s) else np.inf,
        steep_v=travel_v if 0 < bulk_s < STEEP_S else 0.0,
        temperature_degc=_temperature_degc(given),
    )


def _temperature_degc(given: CheckInput) -> float | None:
    measured = given.record.temperature_degc
    if measured is not None and np.isfinite(measured).any():
        return float(np.nanmedian(measured))
    named = _NAMED_DEGC.search(given.record.name)
    return float(named[1]) if named else None


# Current steps inside a step of the tester that make it a profile.
_FEWEST_STEPS = 10
# A record that is profile to this share needs no window.
_WHOLE = 0.95
# Intervals up to this many times the usual one under load are sampled alike.
_ALIKE = 1.5
# A held voltage, and a current that tapers under it to this share.
_HELD_V, _FULL_V, _TAPERED, _TAPER_S = 0.01, 0.06, 0.5, 300.0


@dataclass(frozen=True)
class SuggestedWindow:
    """How to cut a whole test to its profile, and why.

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
        """What to give to `barnax.Window`."""
        names = ("start_time_s", "start_after_step", "initial_soc", "score_steps")
        return {name: value for name in names if (value := getattr(self, name)) is not None}

    @property
    def advice(self) -> str:
        """What to give, where a record is not to be simulated from its first sample to its last."""
        options = [
            f"`{name.removesuffix('_s')}={','.join(f'{n:.10g}' for n in np.atleast_1d(value))}`"
            for name, value in self.options.items()
        ]
        return f"give {' '.join(options)}" if options else ""


def suggest_window(given: CheckInput) -> SuggestedWindow:
    """The window that starts where the charge is known and scores the profile."""
    record = given.record
    whole = _from_the_beginning(given)
    numbers = _profile_numbers(given)
    if record.step is None or not len(numbers):
        return whole
    inside = np.flatnonzero(np.isin(record.step, numbers))
    first, last = int(inside[0]), int(inside[-1])
    if last - first + 1 >= _WHOLE * record.samples:
        return whole
    # Steps that are met inside the profile only belong to it.
    outside = np.concatenate([record.step[:first], record.step[last + 1 :]])
    own = tuple(np.setdiff1d(record.step[first : last + 1], outside).tolist())
    at, rest_s = _rest_before(given, first)
    is_settled = rest_s >= MINIMUM_REST_S - CLOCK_SLACK_S
    rest = f"after {_duration(rest_s)} of rest" + ("" if is_settled else ", too short to settle")
    if not rest_s:
        rest = "without a rest before it"
    profile = f"the profile is step{'s' if len(own) > 1 else ''} {', '.join(map(str, own))}, {rest}"
    full = _full_step(given, first)
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
        return replace(whole, reason=f"{reason}; all of it is sampled alike")
    return replace(whole, reason=reason, score_steps=own, is_settled=is_settled)


def _is_fine_throughout(given: CheckInput) -> bool:
    """Whether nearly all of the record is logged at the interval of its loads."""
    interval_s = given.record.interval_s
    loaded_s = float(np.median(interval_s[~given.is_rested[1:]]))
    return bool(np.quantile(interval_s, _WHOLE) <= _ALIKE * loaded_s)


def _from_the_beginning(given: CheckInput) -> SuggestedWindow:
    """How a simulation of the whole record learns its state of charge."""
    record = given.record
    if not given.is_rested[0]:
        return SuggestedWindow("it starts under load", needs_initial_soc=True, is_settled=False)
    loaded = np.flatnonzero(~given.is_rested)
    at = int(loaded[0]) - 1 if len(loaded) else record.samples - 1
    first_v, last_v = record.voltage_v[0], record.voltage_v[at]
    if abs(last_v - first_v) <= SETTLED_V:
        return SuggestedWindow(f"it starts at rest at {first_v:.4f} V")
    moves = f"the voltage goes from {first_v:.4f} to {last_v:.4f} V in its opening rest"
    if record.time_s[at] - record.time_s[0] >= MINIMUM_REST_S - CLOCK_SLACK_S:
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


def _profile_numbers(given: CheckInput) -> Int[np.ndarray, "numbers"]:
    """The tester's step numbers inside which the current steps about."""
    step = given.record.step
    if step is None:
        return np.zeros(0, int)
    is_inside = given.is_step & (np.diff(step) == 0)
    numbers, times = np.unique(step[1:][is_inside], return_counts=True)
    return numbers[times >= _FEWEST_STEPS]


def _full_step(given: CheckInput, before: int) -> int | None:
    """The number of the step that ends full: a charge at a held voltage, its current tapered."""
    record = given.record
    step = record.step
    if step is None:
        return None
    starts = np.flatnonzero(np.diff(step, prepend=step[0] - 1) != 0)
    ends = np.append(starts[1:], record.samples) - 1
    for start, end in zip(starts[::-1], ends[::-1], strict=True):
        # What a brake gives back is no charge to full.
        if end >= before or record.time_s[end] - record.time_s[start] < _TAPER_S:
            continue
        current_a, voltage_v = record.current_a[start : end + 1], record.voltage_v[start : end + 1]
        is_held = np.ptp(voltage_v[1:]) < _HELD_V
        is_full = np.median(voltage_v) > record.voltage_v.max() - _FULL_V
        is_tapered = current_a.max() < 0 and current_a[-1] > _TAPERED * current_a[0]
        # The last block of a step is what `start_after_step` takes.
        if is_held and is_full and is_tapered and not np.any(step[end + 1 :] == step[start]):
            return int(step[start])
    return None


def _duration(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.3g} s"
    return f"{seconds / 60:.3g} min" if seconds < 7200 else f"{seconds / 3600:.3g} h"


# Current steps that a validation wants.
_VALIDATION_STEPS = 10


@dataclass(frozen=True)
class Role:
    """Whether a record can serve as `name`, why, and the window that it then needs, if any."""

    name: str
    is_usable: bool
    reason: str
    window: SuggestedWindow | None = None

    def to_dict(self) -> dict[str, Any]:
        """The role as plain values."""
        return {
            "usable": self.is_usable,
            "reason": self.reason,
            "window": self.window.options if self.window else {},
            "needs initial SOC": bool(self.window and self.window.needs_initial_soc),
        }


def find_roles(given: CheckInput, traits: Traits) -> tuple[Role, ...]:
    """Every role, usable or not."""
    return (_ocv_test(given), *_profiles(given, traits))


def roles_of_table(table: OcvTable) -> tuple[Role, ...]:
    """Every role of a table of OCV over SOC."""
    names = {DISCHARGE: "discharge: ", CHARGE: "charge: "}
    reason = "; ".join(
        f"{names.get(direction, '')}{len(points)} points, SOC {points[0].soc:.4g} to "
        f"{points[-1].soc:.4g}, {min(each.voltage_v for each in points):.3f} to "
        f"{max(each.voltage_v for each in points):.3f} V, {_rising(points)}"
        for direction, points in table.branches.items()
    )
    others = ("identification", "validation")
    lacks = "a table of OCV has no load"
    return (
        Role("OCV test", True, f"{reason}; give it with `ocv`"),
        *(Role(name, False, lacks) for name in others),
    )


def _rising(points: Sequence[OcvPoint]) -> str:
    return "falling in places" if find_fall(points) else "rising throughout"


def find_fall(points: Sequence[OcvPoint]) -> tuple[OcvPoint, OcvPoint] | None:
    """The two neighboring points between which an OCV falls the most, if it does."""
    drop = min(pairwise(points), key=lambda pair: pair[1].voltage_v - pair[0].voltage_v)
    return drop if drop[1].voltage_v < drop[0].voltage_v else None


def _ocv_test(given: CheckInput) -> Role:
    name = "OCV test"
    if isinstance(given.sweeps, str):
        return Role(name, False, given.sweeps)
    try:
        by_direction = {
            direction: join_sweeps([each for each in given.sweeps if each.direction == direction])
            for direction in dict.fromkeys(sweep.direction for sweep in given.sweeps)
        }
        if given.capacity_ah is not None:
            decide_capacity(by_direction, given.capacity_ah)
    except InputError as problem:
        return Role(name, False, str(problem))
    reason = "; ".join(_sweep_words(sweep) for sweep in by_direction.values())
    if len(by_direction) == 1:
        reason += "; one direction only, so the hysteresis voltage stays unknown"
    return Role(name, True, reason)


def _sweep_words(sweep: Sweep) -> str:
    start_v, end_v = sweep.points[0].voltage_v, sweep.points[-1].voltage_v
    kind = "slow " + WORD[sweep.direction]
    if sweep.kind == "rests":
        kind = f"{WORD[sweep.direction]} by {len(sweep.points)} rests"
    return f"{kind}, {sweep.passed_ah:.4g} Ah, {start_v:.3f} to {end_v:.3f} V"


def _profiles(given: CheckInput, traits: Traits) -> list[Role]:
    window = suggest_window(given)
    steps = counted(traits.steps, "current step")
    seen = f"{steps}, sampled every {traits.interval_s:.3g} s under load"
    moves = f"{seen}; it moves {given.span_ah:.3g} Ah; {window.reason}"
    roles = []
    for name, fewest in (("identification", STEPS), ("validation", _VALIDATION_STEPS)):
        lacks = traits.lacks(given.capacity_ah, fewest)
        roles.append(Role(name, False, lacks) if lacks else Role(name, True, moves, window))
    return roles

"""The kind of test that a record is, and the roles it can serve in.

The kind is told by its sweeps, its current steps and how far they reach.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from scipy.special import stdtrit

from ..cell import OcvPoint, OcvTable
from ..cell.soc_axis import CHARGE, DISCHARGE, WORD, Sweep, decide_capacity, join_sweeps
from ..errors import InputError, counted
from ..notices import Notice, notice
from ..records.record import degc_in_name
from ..records.segments import reach
from .check_input import CheckInput
from .windows import SuggestedWindow, suggest_window

Kind = Literal[
    "OCV test", "slow sweep", "pulse test", "drive cycle", "capacity test", "charge", "no test"
]

# The share of R0 that its 95 % interval may reach to either side, and the sampling interval that
# still shows what follows a step of the current.
MAX_HALF_WIDTH, FINE_S = 1 / 3, 10.5
# The standard deviation of log R0 between the first step and the last, by which it is predicted
# between steps: a random walk, for R0 follows the SOC.
_DRIFT, _NORMAL_95, _BETWEEN = 0.5, 1.96, 201
# Steps that reach over less of the capacity, or the bulk time of a steep end, say little.
LEAST_SHARE, STEEP_S = 0.05, 20.0
# Pulses and rests alone make two steps a point; an HPPC test has pulses of its own beside them.
_STEPS_A_POINT = 3
# A discharge that passes so much of all the charge was one of a capacity test.
_MOST = 0.8


def are_unfit(names: Collection[str], warnings: Iterable[Notice], by_steps: bool = False) -> bool:
    """True if the records, of which there are some, are identified on without any being suitable,
    by what warns of them; `by_steps` if the current steps of each tell R0 too loosely.

    These tell no OCV from slow resistances, and so speak against no OCV test.
    """
    unfit = {
        warning.subject
        for warning in warnings
        if warning.code == "role.unfit" and warning.values["role"] == "identification"
        if not by_steps or "half_width" in warning.values
    }
    return bool(names) and unfit.issuperset(names)


@dataclass(frozen=True)
class Traits:
    """Numbers of a record that tell what it can serve as.

    `steps` are those of the current that are sampled finely enough; they reach over `reach_ah` of
    charge. `half_width_at_steps` and `half_width_between` are predicted half-widths of the 95 %
    interval of R0, as shares of it, at the steps and at half of the charge between them; infinite
    where they tell none. `steep_v` is the travel of the voltage where the cell stands at a steep
    end throughout, else zero. `temperature_degc` is the column's median, else the one in the name,
    else None.
    """

    sweeps: tuple[Sweep, ...]
    steps: int
    reach_ah: float
    half_width_at_steps: float
    half_width_between: float
    span_ah: float
    charged_ah: float
    discharged_ah: float
    longest_discharge_ah: float
    interval_s: float
    steep_v: float
    temperature_degc: float | None

    @property
    def is_slow(self) -> bool:
        """True if all that it holds are slow sweeps."""
        return bool(self.sweeps) and all(sweep.kind == "slow" for sweep in self.sweeps)

    def kind(self, capacity_ah: float | None, has_test: bool = False) -> Kind:
        """The kind of test, for a cell of that capacity; with an OCV test, the fit's interval of R0
        decides whether the steps of a charge are enough."""
        if self.sweeps:
            points = sum(len(sweep.points) - 1 for sweep in self.sweeps)
            has_pulses = self.steps >= _STEPS_A_POINT * points
            return "slow sweep" if self.is_slow else "pulse test" if has_pulses else "OCV test"
        if not self.missing_for(capacity_ah):
            return "drive cycle"
        whole_ah = capacity_ah or self.span_ah
        if self.steep_v or self.span_ah < LEAST_SHARE * whole_ah:
            return "no test"
        if self.longest_discharge_ah > _MOST * whole_ah:
            return "capacity test"
        if has_test and self.half_width_at_steps < math.inf:
            return "drive cycle"
        return "charge" if self.charged_ah > self.discharged_ah else "no test"

    def half_width(self, is_validated: bool) -> float:
        """The predicted half-width of the interval of R0 that decides whether a record serves: what
        is validated on need not tell it between the steps."""
        return self.half_width_at_steps if is_validated else self.half_width_between

    def missing_for(self, capacity_ah: float | None, is_validated: bool = False) -> str:
        """The reason why no circuit can be identified, or validated, on it; empty if one can."""
        if self.is_slow and self.half_width_at_steps <= MAX_HALF_WIDTH:
            steps = counted(self.steps, "current step")
            return f"it holds a slow sweep beside {steps}; give the part with the steps by itself"
        if self.is_slow:
            return "a slow sweep does not show what follows a step of current"
        if self.steep_v:
            return (
                f"the cell is at the steep end of its OCV: {self.span_ah:.3g} Ah move its voltage "
                f"by {self.steep_v:.2g} V"
            )
        if capacity_ah is not None and self.span_ah < LEAST_SHARE * capacity_ah:
            share = 100 * self.span_ah / capacity_ah
            return (
                f"it spans {self.span_ah:.3g} Ah, {share:.2g} % of the capacity of "
                f"{capacity_ah:.4g} Ah"
            )
        return self.steps_lack(capacity_ah, is_validated)

    def steps_lack(self, capacity_ah: float | None, is_validated: bool) -> str:
        """What the current steps by themselves lack to tell the resistances, if anything."""
        half_width = self.half_width(is_validated)
        steps = counted(self.steps, "current step")
        if half_width > MAX_HALF_WIDTH:
            within = f"tell R0 within {100 * half_width:.0f} %"
            told = within if half_width < math.inf else "do not tell R0"
            return (
                f"{steps} sampled finely enough {told}; "
                f"{100 * MAX_HALF_WIDTH:.0f} % is wanted where no OCV test tells it"
            )
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
    fine = np.flatnonzero(given.samples.is_step & (record.interval_s <= FINE_S))
    discharged_ah = record.discharged_ah
    loaded_s = record.interval_s[~given.is_rested[1:]]
    bulk_s, travel_v = given.samples.bulk_time
    # The deepest point below the highest one before it: charge taken out without going back up.
    out_ah = discharged_ah - np.minimum.accumulate(discharged_ah)
    at_steps = _half_width(given.samples.step_a[fine], given.samples.answer_v[fine])
    return Traits(
        sweeps=() if isinstance(given.sweeps, str) else tuple(given.sweeps),
        steps=len(fine),
        reach_ah=reach(discharged_ah[fine]) if len(fine) else 0.0,
        half_width_at_steps=at_steps,
        half_width_between=math.hypot(at_steps, _NORMAL_95 * _drift(discharged_ah[fine])),
        span_ah=given.span_ah,
        charged_ah=given.charged_ah,
        discharged_ah=given.discharged_ah,
        longest_discharge_ah=float(out_ah.max()),
        interval_s=float(np.median(loaded_s)) if len(loaded_s) else np.inf,
        steep_v=travel_v if 0 < bulk_s < STEEP_S else 0.0,
        temperature_degc=_temperature_degc(given),
    )


def _half_width(step_a: Float[np.ndarray, "steps"], step_v: Float[np.ndarray, "steps"]) -> float:
    """The half-width of the 95 % interval of the resistance that fits all steps, as a share of it;
    infinite of fewer than two, for one shows no scatter."""
    product = float(np.sum(step_a * step_v))
    if len(step_a) < 2 or product == 0:
        return math.inf
    left_v = step_v - product / np.sum(step_a**2) * step_a
    error = float(np.linalg.norm(left_v * step_a)) / abs(product)
    freedom = len(step_a) - 1
    return float(stdtrit(freedom, 0.975)) * error * math.sqrt(len(step_a) / freedom)


def _drift(at_ah: Float[np.ndarray, "steps"]) -> float:
    """The standard deviation of log R0 that half of the charge between the steps stays below."""
    ends_ah = np.sort(at_ah)
    if len(ends_ah) < 2 or ends_ah[0] == ends_ah[-1]:
        return 0.0
    between_ah = np.linspace(ends_ah[0], ends_ah[-1], _BETWEEN)
    after = np.clip(np.searchsorted(ends_ah, between_ah), 1, len(ends_ah) - 1)
    before_ah, after_ah = between_ah - ends_ah[after - 1], ends_ah[after] - between_ah
    # The variance of a random walk between two of its values that are known.
    bridge_ah = before_ah * after_ah / np.maximum(before_ah + after_ah, np.finfo(float).tiny)
    return _DRIFT * math.sqrt(np.median(bridge_ah) / (ends_ah[-1] - ends_ah[0]))


def _temperature_degc(given: CheckInput) -> float | None:
    measured = given.record.temperature_degc
    if measured is not None and np.isfinite(measured).any():
        return float(np.nanmedian(measured))
    return degc_in_name(given.record.name)


def require_load(kinds: Mapping[str, Kind]) -> None:
    """Raise `InputError` for files, by name, of which one is a slow sweep, or none holds changes of
    current that a circuit follows from: a charge beside a drive shows the other direction."""
    for file, kind in kinds.items():
        if kind == "slow sweep" or (kind == "charge" and set(kinds.values()) == {"charge"}):
            raise notice("role.no-load", file, what=kind).error()


@dataclass(frozen=True)
class Role:
    """A role that a record can serve in or not, why, and the window that it then needs, if any;
    `half_width` is the predicted share of R0 where only the steps of a record lack something."""

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
    """Every role, usable or not."""
    return (_ocv_test(given), *_profiles(given, traits))


def roles_of_table(table: OcvTable) -> tuple[Role, ...]:
    """Every role of a table of OCV over SOC."""
    names = {DISCHARGE: "discharge: ", CHARGE: "charge: "}
    reason = "; ".join(
        f"{names.get(direction, '')}{len(points)} points, SOC {points[0].soc:.4g} to "
        f"{points[-1].soc:.4g}, {min(point.voltage_v for point in points):.3f} to "
        f"{max(point.voltage_v for point in points):.3f} V, {_rising(points)}"
        for direction, points in table.branches.items()
    )
    others = ("identification", "validation")
    missing = "a table of OCV has no load"
    return (
        Role("OCV test", True, f"{reason}; give it with `ocv`"),
        *(Role(name, False, missing) for name in others),
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
            direction: join_sweeps(
                [sweep for sweep in given.sweeps if sweep.direction == direction]
            )
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
        kind = f"{WORD[sweep.direction]} with {len(sweep.points)} rests"
    return f"{kind}, {sweep.passed_ah:.4g} Ah, {start_v:.3f} to {end_v:.3f} V"


def _profiles(given: CheckInput, traits: Traits) -> list[Role]:
    window = suggest_window(given)
    steps = counted(traits.steps, "current step")
    seen = f"{steps}, sampled every {traits.interval_s:.3g} s under load"
    moves = f"{seen}; it spans {given.span_ah:.3g} Ah; {window.reason}"
    roles = []
    for name in ("identification", "validation"):
        is_validated = name == "validation"
        missing = traits.missing_for(given.capacity_ah, is_validated)
        lack = traits.steps_lack(given.capacity_ah, is_validated)
        loose = traits.half_width(is_validated) if missing and missing == lack else None
        unusable = Role(name, False, missing, half_width=loose)
        roles.append(unusable if missing else Role(name, True, moves, window))
    return roles

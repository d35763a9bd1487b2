"""The roles that a record can serve in."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from ..cell import OcvPoint, OcvTable
from ..cell.soc_axis import CHARGE, DISCHARGE, WORD, by_direction, decide_capacity
from ..errors import InputError, counted
from ..notices import Notice
from .check_input import CheckInput
from .suggested_window import SuggestedWindow, suggest_window
from .traits import Kind, Traits


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


def require_load(kinds: Mapping[str, Kind]) -> None:
    """Raise `InputError` for files, by name, of which one is a slow sweep, or none holds changes of
    current that a circuit follows from: a charge beside a drive shows the other direction."""
    for file, kind in kinds.items():
        if kind == "slow sweep" or (kind == "charge" and set(kinds.values()) == {"charge"}):
            raise Notice("role.no-load", {"what": kind}, file).error()


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

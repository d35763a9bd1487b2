"""What a record can serve as: OCV test, identification record, validation record."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..cell.soc_axis import decide_capacity
from ..cell.sweep import WORD, Sweep, join_sweeps
from ..errors import InputError
from .bulk_time import bulk_time_s
from .case import Case
from .profile import suggest_window

# Current steps that an identification and a validation want, and the interval that still shows
# what follows a step.
_STEPS, _VALIDATION_STEPS, _FINE_S = 20, 10, 10.5
# A record that moves less of the capacity, or the bulk time of a steep end, says little.
_LEAST_SHARE, _STEEP_S = 0.05, 20.0


@dataclass(frozen=True)
class Role:
    """Whether a record can serve as `name`, why, and the options that it then needs."""

    name: str
    is_usable: bool
    reason: str
    options: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """The role as plain values."""
        return {"usable": self.is_usable, "reason": self.reason, "options": list(self.options)}


def find_roles(case: Case) -> tuple[Role, ...]:
    """Every role, usable or not."""
    return (_ocv_test(case), *_drives(case))


def _ocv_test(case: Case) -> Role:
    name = "OCV test"
    if isinstance(case.sweeps, str):
        return Role(name, False, case.sweeps)
    try:
        by_direction = _by_direction(case.sweeps)
        if case.capacity_ah is not None:
            decide_capacity(by_direction, case.capacity_ah)
    except InputError as problem:
        return Role(name, False, str(problem))
    reason = "; ".join(_sweep_words(sweep) for sweep in by_direction.values())
    if len(by_direction) == 1:
        reason += "; one direction only, so the hysteresis stays unknown without the other"
    return Role(name, True, reason)


def _by_direction(sweeps: list[Sweep]) -> Mapping[int, Sweep]:
    return {
        direction: join_sweeps([sweep for sweep in sweeps if sweep.direction == direction])
        for direction in dict.fromkeys(sweep.direction for sweep in sweeps)
    }


def _sweep_words(sweep: Sweep) -> str:
    start_v, end_v = sweep.points[0].voltage_v, sweep.points[-1].voltage_v
    kind = "slow " + WORD[sweep.direction]
    if sweep.kind == "rests":
        kind = f"{WORD[sweep.direction]} by {len(sweep.points)} rests"
    return f"{kind}, {sweep.passed_ah:.4g} Ah, {start_v:.3f} to {end_v:.3f} V"


def _drives(case: Case) -> tuple[Role, Role]:
    record = case.record
    is_fine = case.is_step & (record.interval_s <= _FINE_S)
    steps = int(is_fine.sum())
    loaded_s = record.interval_s[~case.is_rested[1:]]
    interval_s = float(np.median(loaded_s)) if len(loaded_s) else np.inf
    seen = f"{steps} current steps, sampled every {interval_s:.3g} s under load"
    reason = _too_little(case)
    window = suggest_window(case)
    moves = f"{seen}; it moves {case.span_ah:.3g} Ah; {window.reason}"
    roles = []
    for name, fewest in (("identification", _STEPS), ("validation", _VALIDATION_STEPS)):
        few = f"{steps} current steps sampled finely enough, and {name} wants {fewest}"
        if reason or steps < fewest:
            roles.append(Role(name, False, reason or few))
        else:
            roles.append(Role(name, True, moves, window.options))
    return roles[0], roles[1]


def _too_little(case: Case) -> str:
    """Why the record shows too little of the cell, if it does."""
    if not isinstance(case.sweeps, str) and all(sweep.kind == "slow" for sweep in case.sweeps):
        return "a slow sweep does not show what follows a step of current"
    bulk_s, travel_v = bulk_time_s(case.samples)
    if 0 < bulk_s < _STEEP_S:
        return (
            f"the cell stands at a steep end: {case.span_ah:.3g} Ah move its voltage by "
            f"{travel_v:.2g} V"
        )
    if case.capacity_ah is not None and case.span_ah < _LEAST_SHARE * case.capacity_ah:
        share = 100 * case.span_ah / case.capacity_ah
        return f"it moves {case.span_ah:.3g} Ah, {share:.2g} % of the capacity"
    return ""

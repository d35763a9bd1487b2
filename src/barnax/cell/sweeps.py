"""A sweep of an OCV test: its points between full and empty, in one direction."""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Literal

from ..errors import InputError

CHARGE = 1
DISCHARGE = -1
WORD = {CHARGE: "charge", DISCHARGE: "discharge"}
SAME_REST_V = 10e-3
# A pulse below this fraction of all before it was cut short; timers hold to better than that.
SHORT_PULSE = 0.99
# Steps below this fraction of the sweep are no pulses.
SAME_CHARGE = 1e-3


@dataclass(frozen=True)
class SweepPoint:
    """One OCV reading.

    `discharged_ah` counts on the sweep's own axis; `row` is the row of the source file, `rest_s`
    how long the cell had rested there, 0 for a slow sweep.
    """

    discharged_ah: float
    voltage_v: float
    source: str
    row: int
    rest_s: float


@dataclass(frozen=True)
class Sweep:
    """OCV points in the order they were met, in `direction` +1 (charge) or -1 (discharge).

    `start_ah` and `end_ah` are where the sweep began and ended on the axis of discharged
    ampere-hours; the first and last points may lie inside.
    """

    kind: Literal["rests", "slow"]
    direction: int
    source: str
    start_ah: float
    end_ah: float
    points: tuple[SweepPoint, ...]

    @property
    def passed_ah(self) -> float:
        """The charge of the whole sweep, positive."""
        return abs(self.end_ah - self.start_ah)

    @property
    def stops_at_cutoff(self) -> bool:
        """Whether it ran until full or empty, as far as its points tell.

        A slow sweep does. Between rests a cut-off shortens the last pulse below all before it, or
        the last but one where a taper at constant voltage follows.
        """
        if self.kind == "slow":
            return True
        at_ah = [point.discharged_ah for point in self.points]
        steps_ah = [abs(after - before) for before, after in pairwise([*at_ah, self.end_ah])]
        pulses_ah = [step_ah for step_ah in steps_ah if step_ah > SAME_CHARGE * self.passed_ah]
        return any(
            pulses_ah[last] < SHORT_PULSE * min(pulses_ah[:last])
            for last in (-1, -2)
            if pulses_ah[:last]
        )


def join_sweeps(sweeps: list[Sweep]) -> Sweep:
    """One sweep of several of the same direction, each beginning at the rest where another ended.

    Raises `InputError` where they do not meet, or where a slow sweep is among them.
    """
    if len(sweeps) == 1:
        return sweeps[0]
    word = WORD[sweeps[0].direction]
    names = ", ".join(sweep.source for sweep in sweeps)
    if any(sweep.kind == "slow" for sweep in sweeps):
        raise InputError(f"there are {len(sweeps)} {word} sweeps ({names}): give one of them only")
    ordered = sorted(sweeps, key=lambda s: s.direction * s.points[0].voltage_v)
    joined = ordered[0]
    for part in ordered[1:]:
        before, after = joined.points[-1], part.points[0]
        if abs(before.voltage_v - after.voltage_v) > SAME_REST_V:
            raise InputError(
                f"the {word} sweeps of {before.source} and {after.source} do not join: one ends "
                f"at a rest of {before.voltage_v:.4f} V, the next begins at {after.voltage_v:.4f} "
                "V. Give one test only, or all of its files."
            )
        shift_ah = before.discharged_ah - after.discharged_ah
        moved = tuple(
            replace(point, discharged_ah=point.discharged_ah + shift_ah) for point in part.points
        )
        joined = replace(joined, end_ah=part.end_ah + shift_ah, points=joined.points + moved[1:])
    return joined

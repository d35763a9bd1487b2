"""The sweeps of an OCV test, the position of their points on the SOC axis, and the capacity."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from ..errors import InputError
from ..notices import Notice

CHARGE = 1
DISCHARGE = -1
WORD = {CHARGE: "charge", DISCHARGE: "discharge"}
SAME_REST_V = 10e-3
# A pulse below this fraction of all previous ones was cut short; timers are more exact than that.
SHORT_PULSE = 0.99
# Steps below this fraction of the sweep are not pulses.
SAME_CHARGE = 1e-3
# A record may exceed full and empty by this.
BEYOND_SOC = 0.05
# Errors are also stated above this SOC: below, resistances rise so steeply that an error of the
# capacity dominates.
ABOVE_SOC = 0.1


def is_above(soc: Float[np.ndarray, "samples"]) -> Bool[np.ndarray, "samples"]:
    """True where a cell is not nearly empty, including at `ABOVE_SOC`, as bands include their lower
    edge."""
    return soc >= ABOVE_SOC


@dataclass(frozen=True)
class OcvPoint:
    """One OCV reading; `rest_s` is the duration of the rest before it, 0 for a slow sweep.

    `soc` is NaN until the axis is known, `row` the row of the source file, and `current_a` the
    current, discharge positive; 0 at rest.
    """

    soc: float
    voltage_v: float
    source: str
    row: int
    rest_s: float
    current_a: float = 0.0


@dataclass(frozen=True)
class Sweep:
    """OCV points in measured order, in `direction` +1 (charge) or -1 (discharge).

    `start_ah` and `end_ah` are the ends of the sweep on its own axis of discharged ampere-hours,
    `discharged_ah` the positions of its points; the first and last may be inside.
    """

    kind: Literal["rests", "slow"]
    direction: int
    source: str
    start_ah: float
    end_ah: float
    discharged_ah: tuple[float, ...]
    points: tuple[OcvPoint, ...]

    @property
    def passed_ah(self) -> float:
        """The charge of the whole sweep, positive."""
        return abs(self.end_ah - self.start_ah)

    @property
    def hours(self) -> float:
        """The hours that its charge takes at its usual current; for a slow sweep only."""
        return self.passed_ah / float(np.median([abs(point.current_a) for point in self.points]))

    @property
    def stops_at_cutoff(self) -> bool:
        """True if it ran until full or empty, judging by its points.

        A slow sweep does. Between rests, a cut-off shortens the last pulse below all previous ones,
        or the last but one if a taper at constant voltage follows.
        """
        if self.kind == "slow":
            return True
        steps_ah = np.abs(np.diff([*self.discharged_ah, self.end_ah]))
        pulses_ah = steps_ah[steps_ah > SAME_CHARGE * self.passed_ah]
        return any(
            pulses_ah[last] < SHORT_PULSE * pulses_ah[:last].min()
            for last in (-1, -2)
            if len(pulses_ah) > -last
        )

    def placed(self, anchor: "Sweep", scale_ah: float) -> tuple[OcvPoint, ...]:
        """The points by increasing SOC, which is 1 where a discharge begins and 0 where a charge
        begins that anchors the axis."""
        anchor_soc = 1.0 if anchor.direction == DISCHARGE else 0.0
        points = (
            replace(point, soc=anchor_soc + (anchor.start_ah - at_ah) / scale_ah)
            for at_ah, point in zip(self.discharged_ah, self.points, strict=True)
        )
        return tuple(sorted(points, key=lambda point: point.soc))


def by_direction(sweeps: Sequence[Sweep]) -> dict[int, Sweep]:
    """One sweep per direction, from those that begin at the rest where another ended. Raises
    `InputError` if they do not meet, or a slow sweep is among several."""
    joined: dict[int, Sweep] = {}
    for direction in (DISCHARGE, CHARGE):
        same = [sweep for sweep in sweeps if sweep.direction == direction]
        word = WORD[direction]
        if len(same) > 1 and any(sweep.kind == "slow" for sweep in same):
            where = ", ".join(
                f"{one.source} rows {one.points[0].row} to {one.points[-1].row}" for one in same
            )
            raise InputError(
                f"there are {len(same)} {word} sweeps ({where}); give only one of them"
            )
        for part in sorted(same, key=lambda one: one.direction * one.points[0].voltage_v):
            whole = joined.setdefault(direction, part)
            if whole is part:
                continue
            before, after = whole.points[-1], part.points[0]
            if abs(before.voltage_v - after.voltage_v) > SAME_REST_V:
                raise InputError(
                    f"the {word} sweeps of {before.source} and {after.source} do not join: one "
                    f"ends at a rest of {before.voltage_v:.4f} V, the next begins at "
                    f"{after.voltage_v:.4f} V. Give only one test, or all of its files."
                )
            shift_ah = whole.discharged_ah[-1] - part.discharged_ah[0]
            moved_ah = tuple(at_ah + shift_ah for at_ah in part.discharged_ah[1:])
            at_ah, points = whole.discharged_ah + moved_ah, whole.points + part.points[1:]
            end_ah = part.end_ah + shift_ah
            joined[direction] = replace(whole, end_ah=end_ah, discharged_ah=at_ah, points=points)
    return joined


# How close two charges have to be, as a fraction: within the first one capacity may have been
# measured twice, within the last one it was.
AGREEMENT = 0.10
CLOSURE = 0.02
# A capacity this far from the charge of the OCV test is a warning, or an error: for a test that
# does not span both ends, and for one that does, where only another unit or cell explains it.
CAPACITY_WARNING = 0.05
CAPACITY_ERROR = 0.20
HALF = 0.5
# The origin of a capacity given by the user.
GIVEN = "given"


@dataclass(frozen=True)
class Capacity:
    """The cell's capacity in Ah, and its origin in words.

    `axis_ah` scales the OCV sweeps that do not span both ends.
    """

    value_ah: float
    origin: str
    axis_ah: float
    warnings: tuple[Notice, ...] = ()


def decide_capacity(
    sweeps: Mapping[int, Sweep], given_ah: float | None, ocv_given_ah: float | None = None
) -> Capacity:
    """The given capacity, checked against the sweeps, or the one they measured.

    `sweeps` maps the direction to its sweep. `given_ah` is the capacity of the cell in the
    simulated record, which may be older or colder than in its OCV test; `ocv_given_ah` is the
    capacity in the OCV test, if that does not span both ends.

    A sweep measures the capacity if the other sweep passed the same charge within 10 %, if it is
    slow (cut-off to cut-off), or if it is the only one and no capacity was given. That it ran
    between full and empty is then an assumption, with a warning, unless it is slow or both sweeps
    close and stop at a cut-off.

    Raises `InputError` if the given one is off by more than 20 % (by a factor of 2 if the test
    spans both ends), or none was given and none was measured.
    """
    main = _main(sweeps)
    measured = f"the {WORD[main.direction]} of {main.source} passed {main.passed_ah:.4g} Ah"
    passed = {"direction": WORD[main.direction], "passed_ah": main.passed_ah}
    spans = spans_both_ends(sweeps)
    warnings: tuple[Notice, ...] = ()
    if len(sweeps) == 2 and not _agree(sweeps, CLOSURE):
        names = ", ".join(dict.fromkeys(sweep.source for sweep in sweeps.values()))
        out_ah, in_ah = sweeps[DISCHARGE].passed_ah, sweeps[CHARGE].passed_ah
        charges = {"out_ah": out_ah, "in_ah": in_ah, "error_share": in_ah / out_ah - 1}
        warnings += (Notice("ocv-test.open", charges, names),)
    if ocv_given_ah is not None and spans:
        warnings += (Notice("ocv-test.capacity-unused", passed, main.source),)
        ocv_given_ah = None
    axis_ah = ocv_given_ah or given_ah
    if axis_ah is None:
        if len(sweeps) == 2 and not _agree(sweeps, AGREEMENT) and main.kind != "slow":
            charges = {"out_ah": sweeps[DISCHARGE].passed_ah, "in_ah": sweeps[CHARGE].passed_ah}
            raise Notice("ocv-test.capacity-unknown", charges, main.source).error()
        origin = f"measured: {measured}"
        if not spans:
            origin = f"assumed: {measured}, taken as full to empty"
            ends = {"first_v": main.points[0].voltage_v, "last_v": main.points[-1].voltage_v}
            ends |= {"ends": "full" if main.direction == DISCHARGE else "empty"}
            warnings += (Notice("ocv-test.capacity-assumed", {**passed, **ends}, main.source),)
        return Capacity(main.passed_ah, origin, main.passed_ah, warnings)
    most = max(sweeps.values(), key=lambda sweep: sweep.passed_ah)
    if not _is_possible(sweeps, axis_ah, most.passed_ah, spans):
        raise InputError(
            f"capacity {axis_ah:.4g} Ah was given, but the OCV test passed "
            f"{most.passed_ah:.4g} Ah ({WORD[most.direction]} of {most.source}): check the "
            "capacity, its unit (Ah) and the unit of the current, or leave `capacity` out"
        )
    if abs(main.passed_ah / axis_ah - 1) > CAPACITY_WARNING:
        notice = Notice("ocv-test.other-capacity", {"capacity_ah": axis_ah, **passed}, main.source)
        warnings += (notice,)
    return Capacity(given_ah or axis_ah, GIVEN, axis_ah, warnings)


def _is_possible(sweeps: Mapping[int, Sweep], axis_ah: float, most_ah: float, spans: bool) -> bool:
    """True if the sweeps may be those of a cell with this capacity."""
    ratio = _main(sweeps).passed_ah / axis_ah
    if spans:
        return HALF <= ratio <= 1 / HALF
    if most_ah > (1 + CAPACITY_ERROR) * axis_ah:
        return False
    return abs(ratio - 1) <= CAPACITY_ERROR if _agree(sweeps, AGREEMENT) else ratio >= HALF


def scale_to_soc(
    sweeps: Mapping[int, Sweep], capacity: Capacity, shares_axis: bool
) -> tuple[dict[int, tuple[OcvPoint, ...]], list[Notice]]:
    """The points of each direction by increasing SOC, and warnings.

    With `shares_axis`, for points from one record, the rests are on one ampere-hour axis: 1 where
    the discharge begins, else 0 where the charge begins. It is scaled by the charge of the test if
    that spans both ends and differs from the capacity by over 2 %, else by the capacity. The same
    holds for slow sweeps that close within 2 %, by their own charge, because a sweep that ends
    under load at its cut-off ends short of full. Other sweeps are independent: a discharge begins
    at 1, a charge at 0, and each is scaled by its own charge if it runs between full and empty
    (slow, or within 2 % of the capacity or of the other sweep), else by the capacity. A warning
    says which one applies to rests whose charge differs from the capacity by over 2 %.
    """
    is_by_rests = all(sweep.kind == "rests" for sweep in sweeps.values())
    if shares_axis and (is_by_rests or _agree(sweeps, CLOSURE)):
        anchor = _main(sweeps)
        is_other = not _is_near(anchor.passed_ah, capacity.axis_ah, CLOSURE)
        is_by_charge = anchor.kind == "slow" or (is_other and spans_both_ends(sweeps))
        scale_ah = anchor.passed_ah if is_by_charge else capacity.axis_ah
        return {way: sweep.placed(anchor, scale_ah) for way, sweep in sweeps.items()}, []
    placed, warnings = {}, []
    for direction, sweep in sweeps.items():
        # A slow sweep defines full and empty.
        is_whole = sweep.kind == "slow" or _is_near(sweep.passed_ah, capacity.axis_ah, CLOSURE)
        agrees = _agree(sweeps, CLOSURE, direction)
        scale_ah = sweep.passed_ah if is_whole or agrees else capacity.axis_ah
        placed[direction] = sweep.placed(sweep, scale_ah)
        if not is_whole:
            charges = {"passed_ah": sweep.passed_ah, "capacity_ah": capacity.axis_ah}
            by = {"direction": WORD[direction], "by": "own" if agrees else "capacity"}
            warnings.append(Notice("ocv-test.scaled", {**charges, **by}, sweep.source))
    return placed, warnings


def _main(sweeps: Mapping[int, Sweep]) -> Sweep:
    return sweeps.get(DISCHARGE) or sweeps[CHARGE]


def _agree(sweeps: Mapping[int, Sweep], tolerance: float, direction: int = CHARGE) -> bool:
    """True if there are both directions, with the same charge."""
    return len(sweeps) == 2 and _is_near(
        sweeps[direction].passed_ah, sweeps[-direction].passed_ah, tolerance
    )


def _is_near(charge_ah: float, reference_ah: float, tolerance: float) -> bool:
    return abs(charge_ah - reference_ah) <= tolerance * reference_ah


def spans_both_ends(sweeps: Mapping[int, Sweep]) -> bool:
    """True if the test ran between full and empty.

    A slow sweep does; so do two directions that close and each stop at a cut-off, one at empty and
    one at full.
    """
    are_whole = all(sweep.stops_at_cutoff for sweep in sweeps.values())
    return _main(sweeps).kind == "slow" or (_agree(sweeps, CLOSURE) and are_whole)

"""Where the OCV points lie on the axis of SOC, and the capacity that scales it."""

from collections.abc import Mapping
from dataclasses import dataclass

from ..errors import InputError
from .sweeps import CHARGE, DISCHARGE, WORD, Sweep

AGREEMENT = 0.10
CAPACITY_WARNING = 0.05
CAPACITY_ERROR = 0.20
CLOSURE = 0.02
HALF = 0.5


@dataclass(frozen=True)
class OcvPoint:
    """One OCV reading on the axis of SOC; `rest_s` is 0 where it comes from a slow sweep."""

    soc: float
    voltage_v: float
    source: str
    row: int
    rest_s: float


@dataclass(frozen=True)
class Capacity:
    """The capacity in Ah and where it comes from, in words."""

    value_ah: float
    origin: str
    warnings: tuple[str, ...]


def decide_capacity(sweeps: Mapping[int, Sweep], given_ah: float | None) -> Capacity:
    """The given capacity, checked against the sweeps, or the one they measured.

    `sweeps` maps the direction to its sweep. A sweep measures the capacity where the other sweep
    passed the same charge within 10 %, where it is slow (cut-off to cut-off), or where it is
    alone and no capacity was given. That it ran between full and empty is then an assumption,
    and a warning, unless it is slow or both sweeps close and stop at a cut-off. Raises
    `InputError` where the given capacity is off by more than 20 %, or where none was given and
    none was measured.
    """
    main = sweeps.get(DISCHARGE) or sweeps[CHARGE]
    measured = f"the {WORD[main.direction]} of {main.source} passed {main.passed_ah:.4g} Ah"
    agrees = len(sweeps) == 1 or _is_near(
        sweeps[CHARGE].passed_ah, sweeps[DISCHARGE].passed_ah, AGREEMENT
    )
    if given_ah is None:
        if not agrees and main.kind != "slow":
            raise InputError(
                f"the OCV test discharged {sweeps[DISCHARGE].passed_ah:.4g} Ah but charged "
                f"{sweeps[CHARGE].passed_ah:.4g} Ah, so it does not tell the capacity: give it "
                "with --capacity, in Ah"
            )
        warnings = _closure_warnings(sweeps)
        if main.kind == "slow" or _runs_between_cutoffs(sweeps):
            return Capacity(main.passed_ah, f"measured: {measured}", warnings)
        warnings += (_assumption(main),)
        return Capacity(main.passed_ah, f"assumed: {measured}, taken as full to empty", warnings)
    spans = main.kind == "slow" or (len(sweeps) == 2 and agrees)
    most = max(sweeps.values(), key=lambda sweep: sweep.passed_ah)
    ratio = main.passed_ah / given_ah
    is_wrong = abs(ratio - 1) > CAPACITY_ERROR if spans else ratio < HALF
    if is_wrong or most.passed_ah > (1 + CAPACITY_ERROR) * given_ah:
        raise InputError(
            f"capacity {given_ah:.4g} Ah was given, but the OCV test passed "
            f"{most.passed_ah:.4g} Ah ({WORD[most.direction]} of {most.source}): check the "
            "capacity, its unit (Ah) and the unit of the current, or leave --capacity out"
        )
    warnings = _closure_warnings(sweeps)
    if abs(ratio - 1) > CAPACITY_WARNING:
        warnings += (f"capacity {given_ah:.4g} Ah was given, but {measured}",)
    return Capacity(given_ah, "given", warnings)


def place_on_soc(
    sweeps: Mapping[int, Sweep], capacity: Capacity, shares_axis: bool
) -> dict[int, tuple[OcvPoint, ...]]:
    """The points of each direction with their SOC, increasing.

    With `shares_axis`, all from one record, the rests lie on one ampere-hour axis scaled by the
    capacity: 1 where the discharge begins, else 0 where the charge begins. Other sweeps stand
    alone: a discharge begins at 1, a charge at 0, and each is scaled by its own charge when it
    runs between full and empty (slow, or within 2 % of the capacity or of the other sweep), else
    by the capacity.
    """
    if _has_one_axis(sweeps, shares_axis):
        anchor = sweeps.get(DISCHARGE) or sweeps[CHARGE]
        return {
            direction: _place(sweep, anchor, capacity.value_ah)
            for direction, sweep in sweeps.items()
        }
    return {
        direction: _place(sweep, sweep, _scale_ah(sweep, sweeps.get(-direction), capacity))
        for direction, sweep in sweeps.items()
    }


def scale_warnings(
    sweeps: Mapping[int, Sweep], capacity: Capacity, shares_axis: bool
) -> tuple[str, ...]:
    """What `place_on_soc` scaled each sweep by, where its charge and the capacity differ by 2 %.

    Slow sweeps are left out: they define full and empty.
    """
    if _has_one_axis(sweeps, shares_axis):
        return ()
    found = []
    for direction, sweep in sweeps.items():
        if sweep.kind == "slow" or _is_near(sweep.passed_ah, capacity.value_ah, CLOSURE):
            continue
        scale_ah = _scale_ah(sweep, sweeps.get(-direction), capacity)
        by = "the capacity" if scale_ah == capacity.value_ah else "its own charge, as both agree"
        found.append(
            f"the {WORD[direction]} of {sweep.source} passed {sweep.passed_ah:.4g} Ah, the "
            f"capacity is {capacity.value_ah:.4g} Ah: its SOC is scaled by {by}"
        )
    return tuple(found)


def _has_one_axis(sweeps: Mapping[int, Sweep], shares_axis: bool) -> bool:
    return shares_axis and all(sweep.kind == "rests" for sweep in sweeps.values())


def _scale_ah(sweep: Sweep, other: Sweep | None, capacity: Capacity) -> float:
    """The charge that is SOC 1 for a sweep that stands alone."""
    is_whole = (
        sweep.kind == "slow"
        or _is_near(sweep.passed_ah, capacity.value_ah, CLOSURE)
        or (other is not None and _is_near(sweep.passed_ah, other.passed_ah, CLOSURE))
    )
    return sweep.passed_ah if is_whole else capacity.value_ah


def _place(sweep: Sweep, anchor: Sweep, scale_ah: float) -> tuple[OcvPoint, ...]:
    anchor_soc = 1.0 if anchor.direction == DISCHARGE else 0.0
    points = [
        OcvPoint(
            soc=anchor_soc + (anchor.start_ah - point.discharged_ah) / scale_ah,
            voltage_v=point.voltage_v,
            source=point.source,
            row=point.row,
            rest_s=point.rest_s,
        )
        for point in sweep.points
    ]
    return tuple(sorted(points, key=lambda point: point.soc))


def _is_near(charge_ah: float, reference_ah: float, tolerance: float) -> bool:
    return abs(charge_ah - reference_ah) <= tolerance * reference_ah


def _runs_between_cutoffs(sweeps: Mapping[int, Sweep]) -> bool:
    """Whether both directions close and each stops at a cut-off: one at empty, one at full."""
    return (
        len(sweeps) == 2
        and _is_near(sweeps[CHARGE].passed_ah, sweeps[DISCHARGE].passed_ah, CLOSURE)
        and all(sweep.stops_at_cutoff for sweep in sweeps.values())
    )


def _assumption(main: Sweep) -> str:
    first_v, last_v = main.points[0].voltage_v, main.points[-1].voltage_v
    ends = "full to empty" if main.direction == DISCHARGE else "empty to full"
    return (
        f"no capacity was given: the {WORD[main.direction]} of {main.source}, {first_v:.4g} to "
        f"{last_v:.4g} V and {main.passed_ah:.4g} Ah, is taken as {ends}; if it is not, give "
        "--capacity, in Ah"
    )


def _closure_warnings(sweeps: Mapping[int, Sweep]) -> tuple[str, ...]:
    if len(sweeps) < 2:
        return ()
    out_ah, in_ah = sweeps[DISCHARGE].passed_ah, sweeps[CHARGE].passed_ah
    error = in_ah / out_ah - 1
    if abs(error) <= CLOSURE:
        return ()
    return (
        f"the OCV test does not close: {out_ah:.4g} Ah out, {in_ah:.4g} Ah in "
        f"({100 * error:+.1f} %)",
    )

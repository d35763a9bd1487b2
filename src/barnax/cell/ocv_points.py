"""The points of an OCV test: rested voltages between pulses, or a slow sweep thinned."""

import math
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from ..errors import InputError, counted
from ..notices import Notice, notice
from ..records import rest_current_a as usual_rest_current_a
from ..records.record import Record
from ..records.segments import is_rested, rest_blocks, runs
from .soc_axis import CHARGE, DISCHARGE, WORD, Sweep, SweepPoint

MINIMUM_REST_S = 1800.0
MINIMUM_POINTS = 4
# A rest programmed as 30 min ends some hundredths of a second early on the tester's clock.
CLOCK_SLACK_S = 1.0
# That of a record's end is an interval of its sampling, and no longer than this.
_LARGEST_SLACK_S = 180.0
# As fractions of the charge the record spans: rests closer than the first are one rest; a swing
# beyond both neighboring rests larger than the second is a cycle, not the pulses of an HPPC test.
SAME_SOC = 1e-3
CYCLE = 1e-2
# A record that begins at rest begins where a rest ended that the file cut off, if its voltage is
# settled and lies where a neighbor of the next point would.
SETTLED_V = 5e-3
NEIGHBOR_V = 1.0

Charge = Float[np.ndarray, "samples"]


def find_rest_sweeps(record: Record, rest_current_a: float) -> list[Sweep]:
    """The sweeps of a pulse-rest record, at most one of each direction, all on one charge axis.

    A point is the last sample of a rest of at least 30 min; a sweep is a run of points between
    turning points of the charge, and the turning rest belongs to both. Of several sweeps of a
    direction the one with the most points counts: a test may be preceded by conditioning. Raises
    `InputError` that says what was found where no sweep has four points.
    """
    discharged_ah = record.discharged_ah
    blocks = rest_blocks(record, rest_current_a)
    rests_s = {last: rest_duration_s(record, first, last) for first, last in blocks}
    at_end = record.samples - 1
    if any(map(is_long, rests_s.values())) and not is_long(rests_s.get(at_end, math.inf)):
        # No sample after it shows its last interval.
        rests_s[at_end] += min(float(record.interval_s[-1]), _LARGEST_SLACK_S)
    lasts = _point_samples(record, blocks, rests_s, discharged_ah)
    directions = _directions(discharged_ah, lasts)
    sweeps = []
    for direction in (DISCHARGE, CHARGE):
        found = _runs(directions, direction)
        first, last = max(found, key=lambda run: run[1] - run[0], default=(0, 0))
        if last - first + 1 < MINIMUM_POINTS:
            continue
        start_ah, end_ah = _extent(discharged_ah, lasts, directions, first, last)
        points = tuple(
            _point(record, sample, discharged_ah[sample], record.voltage_v[sample], rests_s[sample])
            for sample in lasts[first : last + 1]
        )
        sweeps.append(Sweep("rests", direction, record.name, start_ah, end_ah, points))
    if not sweeps:
        raise _no_test(record, _nothing_found(list(rests_s.values()), directions))
    return sweeps


def _point(
    record: Record,
    sample: int,
    discharged_ah: float,
    voltage_v: float,
    rest_s: float = 0.0,
    current_a: float = 0.0,
) -> SweepPoint:
    row = int(record.row[sample])
    charge_ah, ocv_v = float(discharged_ah), float(voltage_v)
    return SweepPoint(charge_ah, ocv_v, record.name, row, rest_s, float(current_a))


def rest_duration_s(record: Record, first: int, last: int) -> float:
    """The time without current, the interval of the hold at one end included."""
    if record.hold.value == "backward":
        return float(record.time_s[last] - record.time_s[max(first - 1, 0)])
    return float(record.time_s[min(last + 1, record.samples - 1)] - record.time_s[first])


def is_long(rest_s: float) -> bool:
    """True for a rest after which the voltage is the OCV."""
    return rest_s >= MINIMUM_REST_S - CLOCK_SLACK_S


def _point_samples(
    record: Record, blocks: list[tuple[int, int]], rests_s: dict[int, float], discharged_ah: Charge
) -> list[int]:
    """The samples at which OCV points stand, in time order."""
    span_ah = float(np.ptp(discharged_ah))
    samples: list[int] = []
    for _, last in blocks:
        if not is_long(rests_s[last]):
            continue
        if samples:
            net_ah = abs(discharged_ah[last] - discharged_ah[samples[-1]])
            swing_ah = np.ptp(discharged_ah[samples[-1] : last + 1])
            if net_ah <= SAME_SOC * span_ah and swing_ah <= CYCLE * span_ah:
                samples.pop()
        samples.append(last)
    if samples and blocks[0][0] == 0:
        last = blocks[0][1]
        apart_ah = abs(discharged_ah[samples[0]] - discharged_ah[last])
        if apart_ah > SAME_SOC * span_ah and _is_plausible_start(record, last, samples[0]):
            samples.insert(0, last)
    return samples


def _is_plausible_start(record: Record, last: int, following: int) -> bool:
    """True where the short rest that begins the record, up to `last`, is the end of a long one."""
    charged = np.sign(record.discharged_ah[last] - record.discharged_ah[following])
    step_v = charged * (record.voltage_v[following] - record.voltage_v[last])
    drift_v = abs(record.voltage_v[last] - record.voltage_v[0])
    return bool(drift_v <= SETTLED_V and 0 < step_v <= NEIGHBOR_V)


def _directions(discharged_ah: Charge, lasts: list[int]) -> list[int]:
    """+1, -1, or 0 for a full cycle, between each two neighboring points."""
    span_ah = float(np.ptp(discharged_ah))
    directions = []
    for start, end in pairwise(lasts):
        low_ah, high_ah = sorted((discharged_ah[start], discharged_ah[end]))
        between_ah = discharged_ah[start:end]
        beyond_ah = max(low_ah - between_ah.min(), between_ah.max() - high_ah)
        way = CHARGE if discharged_ah[end] < discharged_ah[start] else DISCHARGE
        directions.append(0 if beyond_ah > CYCLE * span_ah else way)
    return directions


def _runs(directions: list[int], direction: int) -> list[tuple[int, int]]:
    """First and last point of each maximal run of `direction`."""
    first, last = runs(np.array(directions) == direction)
    return list(zip(first.tolist(), (last + 1).tolist(), strict=True))


def _extent(
    discharged_ah: Charge, lasts: list[int], directions: list[int], first: int, last: int
) -> tuple[float, float]:
    """The ends of the sweep, charge beyond its end points included.

    A test may start loaded at full or stop at the cut-off without a rest. Where the neighboring
    sweep turns at the rest itself, the sweep ends there.
    """
    direction = directions[first]
    start_ah, end_ah = discharged_ah[lasts[first]], discharged_ah[lasts[last]]
    if first == 0 or directions[first - 1] == 0:
        before_ah = discharged_ah[(0 if first == 0 else lasts[first - 1]) : lasts[first] + 1]
        start_ah = before_ah.max() if direction == CHARGE else before_ah.min()
    if last == len(lasts) - 1 or directions[last] == 0:
        stop = len(discharged_ah) if last == len(lasts) - 1 else lasts[last + 1] + 1
        after_ah = discharged_ah[lasts[last] : stop]
        end_ah = after_ah.min() if direction == CHARGE else after_ah.max()
    return float(start_ah), float(end_ah)


def _no_test(record: Record, reason: str) -> InputError:
    told = {"record": record.name, "reason": reason, "fewest": MINIMUM_POINTS}
    return notice("ocv-test.none", **told).error(".")


def _nothing_found(rests_s: list[float], directions: list[int]) -> str:
    """The reason why the rests make no sweep."""
    if not rests_s:
        return "it has no rests"
    long = sum(is_long(rest_s) for rest_s in rests_s)
    if not long:
        return f"its longest rest is {max(rests_s) / 60:.1f} min"
    found = _runs(directions, DISCHARGE) + _runs(directions, CHARGE)
    most = max((last - first + 1 for first, last in found), default=1)
    max_in_one = f", at most {most} in one direction" if most < long else ""
    return f"it has {counted(long, 'rest')} of at least 30 min{max_in_one}"


# C/10 with the slack of a cell that holds a little less than its rating.
SHORTEST_HOURS = 9.5
POINTS = 101
# Samples without current inside a sweep, as a fraction: a tester pauses now and then.
PAUSES = 0.01
# Half the window each point is averaged over, as a fraction of the sweep.
HALF_WINDOW = 1e-3

Places = Int[np.ndarray, "runs"]


def find_slow_sweeps(record: Record, rest_current_a: float, minimum_rest_s: float) -> list[Sweep]:
    """The slow sweeps of a record, cut-off to cut-off, in time order; often none.

    A slow sweep passes its charge in one direction, without long rests, at C/10 of that charge
    or less. Its voltage still holds the overpotential of that current.
    """
    is_loaded = ~is_rested(record, rest_current_a)
    if not is_loaded.any():
        return []
    first, last = _one_way_runs(record, is_loaded, minimum_rest_s)
    is_backward = record.hold.value == "backward"
    begin = np.maximum(first - 1, 0) if is_backward else first
    end = last if is_backward else np.minimum(last + 1, record.samples - 1)
    discharged_ah = record.discharged_ah
    passed_ah = np.abs(discharged_ah[end] - discharged_ah[begin])
    loaded_a = np.abs(record.current_a) * is_loaded
    # Weighted by itself, lest pulses pass for slow between rests that a tester reads as loaded.
    usual_a = _sums(loaded_a**2, first, last) / _sums(loaded_a, first, last)
    pauses = 1 - _sums(is_loaded, first, last) / (last - first + 1)
    is_sweep = (usual_a * SHORTEST_HOURS <= passed_ah) & (pauses <= PAUSES)
    return [
        _thin(record, *map(int, ends))
        for ends in zip(*(at[is_sweep] for at in (first, last, begin, end)), strict=True)
    ]


def _sums(values: np.ndarray, first: Places, last: Places) -> np.ndarray:
    """The sum over each run."""
    total = np.concatenate([[0], np.cumsum(values)])
    return total[last + 1] - total[first]


def _one_way_runs(
    record: Record, is_loaded: Bool[np.ndarray, "samples"], minimum_rest_s: float
) -> tuple[Places, Places]:
    """First and last loaded sample of each run of one direction without a long rest."""
    loaded = np.flatnonzero(is_loaded)
    turns = np.diff(np.sign(record.current_a[loaded])) != 0
    # A gap of the logger is no rest: some samples in it must show no current.
    rests = (np.diff(loaded) > 1) & (np.diff(record.time_s[loaded]) >= minimum_rest_s)
    cuts = np.flatnonzero(turns | rests)
    firsts = loaded[np.concatenate([[0], cuts + 1])]
    lasts = loaded[np.concatenate([cuts, [len(loaded) - 1]])]
    return firsts, lasts


def _thin(record: Record, first: int, last: int, begin: int, end: int) -> Sweep:
    """The sweep with its voltage averaged at points evenly spaced in charge.

    Fewer than `POINTS` where neighbors of them would be the same sample.
    """
    axis_ah = record.discharged_ah
    direction = CHARGE if axis_ah[end] < axis_ah[begin] else DISCHARGE
    charge_ah, voltage_v, current_a = (
        values[first : last + 1] for values in (axis_ah, record.voltage_v, record.current_a)
    )
    half_ah = HALF_WINDOW * abs(axis_ah[end] - axis_ah[begin])
    points = []
    before = None
    for target_ah in np.linspace(charge_ah[0], charge_ah[-1], POINTS):
        nearest = int(np.argmin(np.abs(charge_ah - target_ah)))
        if nearest == before:
            continue
        before = nearest
        is_near = np.abs(charge_ah - target_ah) <= half_ah
        # The end points are the cut-offs; an average there would pull the curve inward.
        if target_ah in (charge_ah[0], charge_ah[-1]) or not is_near.any():
            is_near = np.arange(len(charge_ah)) == nearest
        mean_ah, mean_v, mean_a = (
            values[is_near].mean() for values in (charge_ah, voltage_v, current_a)
        )
        point = _point(record, first + nearest, mean_ah, mean_v, current_a=mean_a)
        points.append(point)
    start_ah, end_ah = float(axis_ah[begin]), float(axis_ah[end])
    return Sweep("slow", direction, record.name, start_ah, end_ah, tuple(points))


# A kind that passes less than this share of what the other passes is conditioning beside a test.
CONDITIONING = 0.5


def find_sweeps(
    record: Record, capacity_ah: float | None, rest_current_a: float | None = None
) -> tuple[list[Sweep], list[Notice]]:
    """The OCV sweeps of one record, on its own axis of charge, and warnings.

    Current below `rest_current_a` is rest; without it `capacity_ah` says what is, and without
    that the charge that the record spans. A record may hold a pulse-rest test and slow sweeps:
    one kind counts, and a warning names the other. Raises `InputError` where the record is no OCV
    test.
    """
    span_ah = float(np.ptp(record.discharged_ah))
    if span_ah == 0:
        raise _no_test(record, "no charge passed")
    threshold_a = rest_current_a
    if threshold_a is None:
        # A capacity given in mAh would turn the whole record into one rest.
        provisional_ah = span_ah if capacity_ah is None else min(capacity_ah, span_ah)
        threshold_a = usual_rest_current_a(record, provisional_ah)
    elif threshold_a > np.abs(record.current_a).max():
        raise InputError(
            f"{record.name}: no current reaches {threshold_a:.4g} A, so the whole record counts as "
            "rest; give a lower `rest_current`"
        )
    slow = find_slow_sweeps(record, threshold_a, MINIMUM_REST_S)
    if not slow:
        return find_rest_sweeps(record, threshold_a), []
    try:
        rested = find_rest_sweeps(record, threshold_a)
    except InputError:
        return slow, []
    used, ignored = (rested, slow) if _is_test(rested, slow) else (slow, rested)
    return used, [_ignored_warning(used[0], sweep) for sweep in ignored]


def _is_test(rested: list[Sweep], slow: list[Sweep]) -> bool:
    """True where the sweeps between rests are the test, and the slow ones something beside it.

    The kind that measures both directions is; where both kinds do, rests, which hold no
    overpotential.
    """
    rested_ah, slow_ah = (max(sweep.passed_ah for sweep in kind) for kind in (rested, slow))
    if min(rested_ah, slow_ah) < CONDITIONING * max(rested_ah, slow_ah):
        return rested_ah > slow_ah
    return len(rested) >= len({sweep.direction for sweep in slow})


def _ignored_warning(used: Sweep, ignored: Sweep) -> Notice:
    return notice(
        "ocv-test.other-ignored",
        source=ignored.source,
        direction=WORD[ignored.direction],
        ignored=ignored.kind,
        first_row=ignored.points[0].row,
        last_row=ignored.points[-1].row,
        passed_ah=ignored.passed_ah,
        used=used.kind,
    )

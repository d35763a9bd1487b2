"""OCV points of a pulse-rest test: the voltage at the end of each long rest."""

from itertools import pairwise

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from ..records.record import Record
from ..records.rests import rest_blocks
from .sweep import CHARGE, DISCHARGE, Sweep, SweepPoint

MINIMUM_REST_S = 1800.0
MINIMUM_POINTS = 4
# A rest programmed as 30 min ends some hundredths of a second early on the tester's clock.
CLOCK_SLACK_S = 1.0
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
    rests_s = {last: _rest_s(record, first, last) for first, last in blocks}
    lasts = _point_samples(record, blocks, rests_s, discharged_ah)
    directions = _directions(discharged_ah, lasts)
    sweeps = []
    for direction in (DISCHARGE, CHARGE):
        runs = _runs(directions, direction)
        if not runs:
            continue
        first, last = max(runs, key=lambda run: run[1] - run[0])
        if last - first + 1 < MINIMUM_POINTS:
            continue
        start_ah, end_ah = _extent(discharged_ah, lasts, directions, first, last, direction)
        points = tuple(
            SweepPoint(
                discharged_ah=float(discharged_ah[sample]),
                voltage_v=float(record.voltage_v[sample]),
                source=record.name,
                row=int(record.row[sample]),
                rest_s=rests_s[sample],
            )
            for sample in lasts[first : last + 1]
        )
        sweeps.append(Sweep("rests", direction, record.name, start_ah, end_ah, points))
    if not sweeps:
        raise InputError(_nothing_found(record, list(rests_s.values()), directions))
    return sweeps


def _rest_s(record: Record, first: int, last: int) -> float:
    """How long no current flowed, the interval of the hold at one end included."""
    if record.hold.value == "backward":
        return float(record.time_s[last] - record.time_s[max(first - 1, 0)])
    return float(record.time_s[min(last + 1, record.samples - 1)] - record.time_s[first])


def _is_long(rest_s: float) -> bool:
    return rest_s >= MINIMUM_REST_S - CLOCK_SLACK_S


def _point_samples(
    record: Record,
    blocks: list[tuple[int, int]],
    rests_s: dict[int, float],
    discharged_ah: Charge,
) -> list[int]:
    """The samples at which OCV points stand, in time order."""
    span_ah = float(np.ptp(discharged_ah))
    samples: list[int] = []
    for _, last in blocks:
        if not _is_long(rests_s[last]):
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
        is_apart = apart_ah > SAME_SOC * span_ah
        if is_apart and _is_plausible_start(record, last, samples[0]):
            samples.insert(0, last)
    return samples


def _is_plausible_start(record: Record, last: int, following: int) -> bool:
    """Whether the short rest that begins the record, up to `last`, is the end of a long one."""
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
        if beyond_ah > CYCLE * span_ah:
            directions.append(0)
        else:
            directions.append(CHARGE if discharged_ah[end] < discharged_ah[start] else DISCHARGE)
    return directions


def _runs(directions: list[int], direction: int) -> list[tuple[int, int]]:
    """First and last point of each maximal run of `direction`."""
    is_run = np.concatenate([[False], np.array(directions) == direction, [False]])
    edges = np.flatnonzero(np.diff(is_run.astype(int)))
    return [(int(first), int(last)) for first, last in edges.reshape(-1, 2)]


def _extent(
    discharged_ah: Charge,
    lasts: list[int],
    directions: list[int],
    first: int,
    last: int,
    direction: int,
) -> tuple[float, float]:
    """Where the sweep began and ended, charge beyond its end points included.

    A test may start loaded at full or stop at the cut-off without a rest. Where the neighboring
    sweep turns at the rest itself, the sweep ends there.
    """
    start_ah, end_ah = discharged_ah[lasts[first]], discharged_ah[lasts[last]]
    if first == 0 or directions[first - 1] == 0:
        before_ah = discharged_ah[(0 if first == 0 else lasts[first - 1]) : lasts[first] + 1]
        start_ah = before_ah.max() if direction == CHARGE else before_ah.min()
    if last == len(lasts) - 1 or directions[last] == 0:
        stop = len(discharged_ah) if last == len(lasts) - 1 else lasts[last + 1] + 1
        after_ah = discharged_ah[lasts[last] : stop]
        end_ah = after_ah.min() if direction == CHARGE else after_ah.max()
    return float(start_ah), float(end_ah)


def _nothing_found(record: Record, rests_s: list[float], directions: list[int]) -> str:
    needed = (
        "An OCV test needs rests of at least 30 min between its pulses, "
        f"at least {MINIMUM_POINTS} in one direction, or one slow sweep at C/10 or less."
    )
    long = sum(_is_long(rest_s) for rest_s in rests_s)
    if not rests_s:
        return f"{record.name} is not an OCV test: it has no rests. {needed}"
    if not long:
        return (
            f"{record.name} is not an OCV test: its longest rest is {max(rests_s) / 60:.1f} min. "
            f"{needed}"
        )
    runs = _runs(directions, DISCHARGE) + _runs(directions, CHARGE)
    most = max((last - first + 1 for first, last in runs), default=1)
    return (
        f"{record.name} is not an OCV test: of its {long} rests of at least 30 min the longest "
        f"run in one direction has {most}. {needed}"
    )

"""OCV over SOC: as a table, or as the points of a test in a record, either rests between pulses or
a slow sweep."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from ..display import Brief
from ..errors import InputError, counted
from ..notices import Notice
from ..records import Record, Source, read_record, read_source
from ..records.quantities import CELL_RANGE_V
from ..records.record import MINIMUM_REST_S, SETTLED_V, Rest, Segments, is_long, run_sums, runs
from ..records.scale import of_one_cell
from ..records.table import Lines, notice_at, take_lines
from .soc_axis import CHARGE, DISCHARGE, WORD, OcvPoint, Sweep

MINIMUM_POINTS = 4
# A rest at a record's end may continue for one more interval of its sampling, but no longer than
# this.
_LARGEST_SLACK_S = 180.0
# As fractions of the charge the record spans: rests closer than the first are one rest; a swing
# beyond both neighboring rests larger than the second is a cycle, not the pulses of an HPPC test.
SAME_SOC, CYCLE = 1e-3, 1e-2
# A record that begins at rest begins with the end of a rest that the file omits, if its voltage is
# settled and fits a neighbor of the next point.
NEIGHBOR_V = 1.0
# A slow sweep has this duration, C/10 with a tolerance for a cell that has slightly less than its
# rated capacity, and this small share of samples without current: a tester pauses now and then.
SHORTEST_HOURS, PAUSES = 9.5, 0.01
# It is thinned to this many points, each averaged over a window of half this fraction of the sweep.
POINTS, HALF_WINDOW = 101, 1e-3
# A kind that passes less than this share of the other's charge is conditioning.
CONDITIONING = 0.5

Charge = Float[np.ndarray, "samples"]


class OcvSweeps(NamedTuple):
    """The OCV sweeps of a record on its own axis of charge, and warnings; `missing` has the reason
    if there are none."""

    sweeps: tuple[Sweep, ...] = ()
    warnings: tuple[Notice, ...] = ()
    missing: Notice | None = None


def find_sweeps(
    record: Record, capacity_ah: float | None, rest_current_a: float | None = None
) -> OcvSweeps:
    """The OCV sweeps of one record.

    Current below `rest_current_a` is rest; without it, the limit follows from `capacity_ah`, or
    from the charge that the record spans. If a record has both a pulse-rest test and slow sweeps,
    one kind is used, and a warning names the other. Raises `InputError` for a `rest_current_a` that
    no current reaches.
    """
    if record.span_ah == 0:
        return _no_test(record, "no charge passed")
    if not np.ptp(record.voltage_v):
        return _no_test(record, f"every voltage is {record.voltage_v[0]:.6g} V")
    if rest_current_a is None:
        # A capacity given in mAh would turn the whole record into one rest.
        rest_current_a = record.rest_current_a(min(capacity_ah or math.inf, record.span_ah))
    elif rest_current_a > np.abs(record.current_a).max():
        raise InputError(
            f"{record.name}: no current reaches {rest_current_a:.4g} A, so the whole record counts "
            "as rest; give a lower `rest_current`"
        )
    segments = record.segments(rest_current_a)
    slow, rested = find_slow_sweeps(segments), find_rest_sweeps(segments)
    if isinstance(rested, str):
        return OcvSweeps(tuple(slow)) if slow else _no_test(record, rested)
    used, ignored = (rested, slow) if _is_test(rested, slow) else (slow, rested)
    return OcvSweeps(tuple(used), tuple(_ignored(used[0], sweep) for sweep in ignored))


def _no_test(record: Record, reason: str) -> OcvSweeps:
    values = {"record": record.name, "reason": reason, "fewest": MINIMUM_POINTS}
    return OcvSweeps(missing=Notice("ocv-test.none", values))


def _is_test(rested: list[Sweep], slow: list[Sweep]) -> bool:
    """True if the sweeps between rests are the test, and not the slow ones.

    The kind that measures both directions is the test; if both kinds do, the one with rests, which
    have no overpotential.
    """
    rested_ah, slow_ah = (
        max((sweep.passed_ah for sweep in kind), default=0.0) for kind in (rested, slow)
    )
    if min(rested_ah, slow_ah) < CONDITIONING * max(rested_ah, slow_ah):
        return rested_ah > slow_ah
    return len(rested) >= len({sweep.direction for sweep in slow})


def _ignored(used: Sweep, ignored: Sweep) -> Notice:
    values = {"source": ignored.source, "direction": WORD[ignored.direction]}
    values |= {"ignored": ignored.kind, "first_row": ignored.points[0].row}
    values |= {"last_row": ignored.points[-1].row, "passed_ah": ignored.passed_ah}
    return Notice("ocv-test.other-ignored", values | {"used": used.kind})


def find_rest_sweeps(segments: Segments) -> list[Sweep] | str:
    """The sweeps of a pulse-rest record, at most one per direction, all on one charge axis; or the
    reason why there is none with four points.

    A point is the last sample of a rest of at least 30 min; a sweep is a run of points between
    turning points of the charge, and the rest at a turning point belongs to both. Of several sweeps
    in one direction the one with the most points is used: a test may follow conditioning.
    """
    record, discharged_ah = segments.record, segments.record.discharged_ah
    rests = _with_last_interval(segments)
    points = _points_at(record, rests, discharged_ah)
    lasts = [rest.last for rest in points]
    ways = _ways(discharged_ah, lasts)
    sweeps, most = [], 1
    for direction in (DISCHARGE, CHARGE):
        begins, ends = runs(np.array(ways) == direction)
        most = max([most, *(ends - begins + 2).tolist()])
        longest = int(np.argmax(ends - begins)) if len(begins) else 0
        first, last = (begins[longest] - 1, ends[longest]) if len(begins) else (0, 0)
        if last - first + 1 < MINIMUM_POINTS:
            continue
        # Charge beyond the end points belongs to the sweep: a test may start under load from full
        # or stop at the cut-off without a rest. If the neighboring sweep turns at the rest itself,
        # it ends there.
        along_ah, edges = -direction * discharged_ah, [0, *lasts, record.samples - 1]
        start_ah, end_ah = along_ah[lasts[first]], along_ah[lasts[last]]
        if ways[first] == 0:
            start_ah = along_ah[edges[first] : edges[first + 1] + 1].min()
        if ways[last + 1] == 0:
            end_ah = along_ah[edges[last + 1] : edges[last + 2] + 1].max()
        ends_ah = -direction * float(start_ah), -direction * float(end_ah)
        met = points[first : last + 1]
        read = [_point(record, at, record.voltage_v[at], rest_s) for _, at, rest_s in met]
        charges_ah = tuple(discharged_ah[lasts[first : last + 1]].tolist())
        sweeps.append(Sweep("rests", direction, record.name, *ends_ah, charges_ah, tuple(read)))
    return sweeps or _why_no_sweep([rest.duration_s for rest in rests], most)


def _with_last_interval(segments: Segments) -> list[Rest]:
    """The rests; a rest at the end of a record includes the last interval, which no sample
    shows."""
    record, rests = segments.record, list(segments.rests)
    is_cut = rests and rests[-1].last == record.samples - 1 and not is_long(rests[-1].duration_s)
    if is_cut and any(is_long(rest.duration_s) for rest in rests):
        more_s = min(float(record.interval_s[-1]), _LARGEST_SLACK_S)
        rests[-1] = rests[-1]._replace(duration_s=rests[-1].duration_s + more_s)
    return rests


def _points_at(record: Record, rests: list[Rest], discharged_ah: Charge) -> list[Rest]:
    """The rests that end at OCV points, in order of time."""
    points: list[Rest] = []
    for rest in rests:
        if not is_long(rest.duration_s):
            continue
        if points:
            before = points[-1].last
            net_ah = abs(discharged_ah[rest.last] - discharged_ah[before])
            swing_ah = np.ptp(discharged_ah[before : rest.last + 1])
            if net_ah <= SAME_SOC * record.span_ah and swing_ah <= CYCLE * record.span_ah:
                points.pop()
        points.append(rest)
    if points and rests[0].first == 0:
        # The short rest at the beginning of the record may be the end of a long one.
        last, following = rests[0].last, points[0].last
        charged_ah = discharged_ah[last] - discharged_ah[following]
        step_v = np.sign(charged_ah) * (record.voltage_v[following] - record.voltage_v[last])
        is_settled = abs(record.voltage_v[last] - record.voltage_v[0]) <= SETTLED_V
        is_apart = abs(charged_ah) > SAME_SOC * record.span_ah
        if is_apart and is_settled and 0 < step_v <= NEIGHBOR_V:
            points.insert(0, rests[0])
    return points


def _ways(discharged_ah: Charge, lasts: list[int]) -> list[int]:
    """+1, -1, or 0 for a full cycle, between each two neighboring points; 0 beyond both ends."""
    span_ah = float(np.ptp(discharged_ah))
    ways = [0]
    for start, end in pairwise(lasts):
        low_ah, high_ah = sorted((discharged_ah[start], discharged_ah[end]))
        between_ah = discharged_ah[start:end]
        beyond_ah = max(low_ah - between_ah.min(), between_ah.max() - high_ah)
        way = CHARGE if discharged_ah[end] < discharged_ah[start] else DISCHARGE
        ways.append(0 if beyond_ah > CYCLE * span_ah else way)
    return [*ways, 0]


def _why_no_sweep(rests_s: list[float], most: int) -> str:
    if not rests_s:
        return "it has no rests"
    long = sum(map(is_long, rests_s))
    if not long:
        return f"its longest rest is {max(rests_s) / 60:.1f} min"
    max_in_one = f", at most {most} in one direction" if most < long else ""
    return f"it has {counted(long, 'rest')} of at least 30 min{max_in_one}"


def _point(
    record: Record, sample: int, voltage_v: float, rest_s: float = 0.0, current_a: float = 0.0
) -> OcvPoint:
    """An OCV point of unknown SOC."""
    row = int(record.row[sample])
    return OcvPoint(math.nan, float(voltage_v), record.name, row, rest_s, float(current_a))


def find_slow_sweeps(segments: Segments) -> list[Sweep]:
    """The slow sweeps of a record, cut-off to cut-off, in order of time; often none.

    A slow sweep passes its charge in one direction, without long rests, at C/10 of that charge or
    less. Its voltage includes the overpotential of that current.
    """
    record, loaded = segments.record, segments.loaded
    if not len(loaded):
        return []
    turns = np.diff(np.sign(record.current_a[loaded])) != 0
    # A gap of the logger is not a rest: some samples in it have to show no current.
    is_rest = (np.diff(loaded) > 1) & (np.diff(record.time_s[loaded]) >= MINIMUM_REST_S)
    cuts = np.flatnonzero(turns | is_rest)
    first, last = loaded[np.append(0, cuts + 1)], loaded[np.append(cuts, len(loaded) - 1)]
    begin, end = record.flowing_between(first, last)
    discharged_ah = record.discharged_ah
    passed_ah = np.abs(discharged_ah[end] - discharged_ah[begin])
    loaded_a = np.where(segments.is_rested, 0.0, np.abs(record.current_a))
    # Weighted by itself, so that pulses do not count as slow between rests that a tester reads as
    # loaded.
    usual_a = run_sums(loaded_a**2, first, last) / run_sums(loaded_a, first, last)
    pauses = run_sums(segments.is_rested, first, last) / (last - first + 1)
    is_sweep = (usual_a * SHORTEST_HOURS <= passed_ah) & (pauses <= PAUSES)
    chosen = np.stack([first, last, begin, end], axis=1)[is_sweep].tolist()
    return [_thin(record, discharged_ah, *ends) for ends in chosen]


def _thin(record: Record, axis_ah: Charge, first: int, last: int, begin: int, end: int) -> Sweep:
    """The sweep with its voltage averaged at points evenly spaced in charge.

    Fewer than `POINTS` if neighbors of them would be the same sample.
    """
    direction = CHARGE if axis_ah[end] < axis_ah[begin] else DISCHARGE
    readings = np.stack([axis_ah, record.voltage_v, record.current_a])[:, first : last + 1]
    charge_ah, half_ah = readings[0], HALF_WINDOW * abs(axis_ah[end] - axis_ah[begin])
    points: dict[int, tuple[float, OcvPoint]] = {}
    for target_ah in np.linspace(charge_ah[0], charge_ah[-1], POINTS):
        nearest = int(np.argmin(np.abs(charge_ah - target_ah)))
        is_near = np.abs(charge_ah - target_ah) <= half_ah
        # The end points are the cut-offs; an average there would pull the curve inward.
        if target_ah in (charge_ah[0], charge_ah[-1]) or not is_near.any():
            is_near = np.arange(len(charge_ah)) == nearest
        mean_ah, mean_v, mean_a = (values[is_near].mean() for values in readings)
        point = _point(record, first + nearest, mean_v, current_a=mean_a)
        points.setdefault(nearest, (float(mean_ah), point))
    charges_ah, read = zip(*points.values(), strict=True)
    ends_ah = float(axis_ah[begin]), float(axis_ah[end])
    return Sweep("slow", direction, record.name, *ends_ah, charges_ah, read)


# SOC may exceed full and empty slightly; values far beyond are in percent, or not SOC.
_SOC_RANGE, _PERCENT_FROM = (-0.1, 1.1), 1.5
# The direction of a table with a single column of voltage.
EITHER = 0
_DIRECTIONS = {"discharge OCV": DISCHARGE, "charge OCV": CHARGE, "OCV": EITHER}


@dataclass(frozen=True, repr=False)
class OcvTable(Brief):
    """OCV over SOC from a file or data frame.

    Attributes:
        name: Name of the file.
        branches: Points (SOC as a fraction, OCV in V), by increasing SOC, of the discharge (-1), of
            the charge (+1), or of a single curve for both (0).
        sha256: Digest of the file.
        warnings: What is doubtful, with what to do.
    """

    name: str
    branches: Mapping[int, tuple[OcvPoint, ...]]
    sha256: str
    warnings: tuple[Notice, ...] = ()


def read_ocv_table(source: str | Path | Source) -> OcvTable:
    """The OCV table in a file: SOC with one voltage, or with one of charge and one of discharge.

    Args:
        source: The file. Its columns are called "SOC [-]" or "SOC / %", and "OCV [V]" or "discharge
            OCV [V]" and "charge OCV [V]"; the usual other spellings are understood.

    Raises `InputError` that names the file and the row where it holds anything else.

    >>> import pathlib, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "ocv.csv")
    ...     _ = file.write_text("SOC / %,OCV / V\\n0,3.0\\n30,3.5\\n60,3.7\\n100,4.2\\n")
    ...     table = read_ocv_table(file)
    >>> [point.soc for point in table.branches[0]]
    [0.0, 0.3, 0.6, 1.0]
    """
    if not isinstance(source, Source):
        source = read_source(source)
    columns = dict(source.table.header.ocv_columns)
    if not source.table.header.is_ocv_table:
        raise InputError(
            f"{source.name}: not an OCV table; name its columns, for example, 'SOC [-]' and "
            "'OCV [V]', or 'SOC [-]', 'discharge OCV [V]' and 'charge OCV [V]'."
        )
    if "discharge OCV" in columns or "charge OCV" in columns:
        columns.pop("OCV", None)
    lines = take_lines(source.table, columns)
    voltages = [name for name in columns if name != "SOC"]
    of_one = {name: of_one_cell(lines.values[name], source.series) for name in voltages}
    lines = lines.having(**of_one)
    assumed = [column.header for column in columns.values() if column.is_unit_assumed]
    taken = [{"column": name, "unit": "V"} for name in assumed]
    scale = 1.0
    if np.nanmax(lines.values["SOC"], initial=0.0) > _PERCENT_FROM:
        scale = 0.01
        taken.append({"column": columns["SOC"].header, "unit": "percent"})
    warnings = [Notice("ocv-table.assumed", values, source.name) for values in taken]
    branches = {_DIRECTIONS[name]: _branch(source.name, lines, name, scale) for name in voltages}
    return OcvTable(source.name, branches, source.sha256, tuple(warnings))


def _branch(file: str, lines: Lines, name: str, scale: float) -> tuple[OcvPoint, ...]:
    """The points of one voltage column, without lines in which its cell is empty."""
    soc, voltage_v = scale * lines.values["SOC"], lines.values[name]
    points: list[OcvPoint] = []
    for line in np.argsort(soc, kind="stable").tolist():
        if lines.cell(name, line) is None:
            continue
        point = OcvPoint(float(soc[line]), float(voltage_v[line]), file, int(lines.row[line]), 0.0)
        is_wrong = {
            "soc": not _SOC_RANGE[0] <= point.soc <= _SOC_RANGE[1],
            "voltage": not CELL_RANGE_V[0] <= point.voltage_v <= CELL_RANGE_V[1],
            "twice": bool(points) and point.soc == points[-1].soc,
        }
        for wrong in filter(is_wrong.get, is_wrong):
            soc_cell, cell = (repr(lines.cell(each, line)) for each in ("SOC", name))
            given = {"wrong": wrong, "soc": point.soc, "soc_cell": soc_cell, "cell": cell}
            raise notice_at(lines, line, "ocv-table.point", **given).about(file).error(".")
        points.append(point)
    if len(points) < MINIMUM_POINTS:
        raise InputError(
            f"{file}: an OCV table needs at least {MINIMUM_POINTS} points, and "
            f"'{lines.columns[name].header}' has {len(points)}."
        )
    return tuple(points)


def read_ocv_test(source: str | Path | Source, **how: Any) -> Record | OcvTable:
    """The OCV test in a file: a table of OCV over SOC, else a record, read by `read_record` with
    the arguments `how`."""
    if not isinstance(source, Source):
        source = read_source(source)
    is_table = source.table.header.is_ocv_table
    return read_ocv_table(source) if is_table else read_record(source, **how)

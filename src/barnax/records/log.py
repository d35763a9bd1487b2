"""Which records belong together: logs that were cut into several files, and records of the same
samples, whatever files they stand in: converted, rounded, cut or thinned; and one in means.

A fingerprint is some samples of a record. Another record holds them where current and voltage are
alike to within what they were rounded to, once its clock is shifted. Where a test was repeated, or
run on another cell, the current is alike, and the voltage is not.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from ..errors import InputError
from .counters import decimal_step
from .record import Record, is_long
from .source import Source

# Between the names of the files of a log.
NEXT_FILE = " + "
# A log continues within so many intervals, and its files are sampled alike to within this factor.
# This share of so many intervals on either side of the cut is no further from R0's step, which may
# be off by so much.
_INTERVALS, _SAMPLED_ALIKE, _USUAL, _BESIDE, _OFF = 2.0, 1.5, 0.9, 300, 0.3


def joined(sources: Sequence[Source]) -> Source:
    """One log that was cut into several files, in their order; rows go on from file to file.

    Raises InputError where their columns differ.
    """
    first, *others = sources
    if not others:
        return first
    for other in others:
        if other.table.header != first.table.header:
            raise InputError(
                f"{other.name}: has other columns than {first.name}, so the two are not one log"
            )
    tables = [source.table for source in sources]
    before = np.cumsum([0, *(table.row[-1] if len(table.row) else 1 for table in tables[:-1])])
    name = NEXT_FILE.join(source.name for source in sources)
    columns = zip(first.table.header.names, *(table.columns for table in tables), strict=True)
    table = replace(
        first.table,
        columns=tuple(_concatenated(name, header, parts) for header, *parts in columns),
        row=np.concatenate([table.row + rows for table, rows in zip(tables, before, strict=True)]),
        sheets=sum((table.sheets for table in tables), ()) if all(t.sheets for t in tables) else (),
        notes=tuple(dict.fromkeys(note for table in tables for note in table.notes)),
        files=len(tables),
    )
    sha256 = " ".join(source.sha256 for source in sources)
    return replace(first, name=name, table=table, sha256=sha256)


def _concatenated(name: str, header: str, parts: Sequence[pl.Series]) -> pl.Series:
    """A column of several files, of a type that holds all its values."""
    dtypes = [part.dtype for part in parts if part.dtype != pl.Null]
    if len({dtype.is_temporal() for dtype in dtypes}) > 1:
        raise InputError(f"{name}: '{header}' has dates in some of the files and none in others")
    frames = [part.to_frame(header) for part in parts]
    try:
        return pl.concat(frames, how="vertical_relaxed").to_series()
    except pl.exceptions.PolarsError:
        kinds = " and ".join(dict.fromkeys(map(str, dtypes)))
        raise InputError(f"{name}: '{header}' is of {kinds}, which make no one column") from None


def pause_s(earlier: Record, later: Record) -> float:
    """Seconds from the end of one record to the start of another, by the dates of both, or else by
    their clocks."""
    between_s = float(later.time_s[0] - earlier.time_s[-1])
    if earlier.zero_date_s is None or later.zero_date_s is None:
        return between_s
    # Dates that are numbers of days are no more exact.
    return round(between_s + later.zero_date_s - earlier.zero_date_s, 3)


def goes_on(earlier: Record, later: Record) -> bool:
    """True if a record continues where another ends: by their dates, where the clocks of both have
    dates, and else by their clocks."""
    # The row at which a log was cut may be in both files.
    return 0 <= pause_s(earlier, later) <= _INTERVALS * later.usual_s


def continuation(earlier: Record, later: Record) -> str:
    """The evidence that two records are one log that was cut under load; empty without any.

    Beside the clock, the columns and the sampling, the voltage continues: over the cut it changes
    by what R0 makes of the current's step, to within a share of that or nine of ten deviations in
    the intervals beside.
    """
    pair = earlier, later
    headers = [record.evidence and record.evidence.header for record in pair]
    if headers[0] != headers[1] or not goes_on(earlier, later):
        return ""
    shortest_s, longest_s = np.quantile(earlier.interval_s, [0.02, 0.98])
    is_alike = shortest_s / _SAMPLED_ALIKE <= later.usual_s <= _SAMPLED_ALIKE * longest_s
    before, after = (one.segments(one.rest_current_a(one.span_ah)).loaded for one in pair)
    if not is_alike or not len(before) or not len(after):
        return ""
    # A rest around the cut that is long enough lets the RC pairs relax.
    rest_s = earlier.time_s[-1] - earlier.time_s[before[-1]]
    if is_long(float(rest_s + later.time_s[after[0]] - later.time_s[0])):
        return ""
    step_a, step_v = (
        np.diff(np.concatenate([getattr(record, channel) for record in pair]))
        for channel in ("current_a", "voltage_v")
    )
    if not step_a.any():
        return ""
    r0_ohm, cut = -float(step_a @ step_v) / float(step_a @ step_a), earlier.samples - 1
    left_v = np.abs(step_v + r0_ohm * step_a)
    beside_v = np.append(left_v[max(cut - _BESIDE, 0) : cut], left_v[cut + 1 : cut + _BESIDE])
    if r0_ohm <= 0 or left_v[cut] > max(
        np.quantile(beside_v, _USUAL), _OFF * r0_ohm * abs(step_a[cut])
    ):
        return ""
    clock = "clock is" if None in (earlier.zero_date_s, later.zero_date_s) else "dates are"
    return (
        f"{later.name} continues the log under load: its {clock} {pause_s(earlier, later):.3g} s "
        f"later, its voltage within {1e3 * left_v[cut]:.2g} mV of what R0 predicts, and its rows "
        "count on"
    )


def in_means(record: Record, interval_s: float) -> Record:
    """The record in means over intervals, with all its charge; itself where it is no faster.

    >>> from barnax.bundled import bundled_file
    >>> from barnax.records import read_record
    >>> means = in_means(read_record(bundled_file("identification")), 10.0)
    >>> means.samples, float(np.median(means.interval_s))
    (1968, 10.0)
    """
    if 2 * record.usual_s > interval_s:
        return record
    number = np.floor((record.time_s - record.time_s[0]) / interval_s)
    is_first = np.diff(number, prepend=-1.0) > 0
    if record.step is not None:
        is_first |= np.diff(record.step, prepend=record.step[0]) != 0
    first = np.flatnonzero(is_first)
    counts = np.diff(np.append(first, record.samples))

    def mean(values: Float[np.ndarray, "samples"]) -> Float[np.ndarray, "means"]:
        return np.add.reduceat(values, first) / counts

    columns = "temperature_degc", "step", "row", "charge_ah", "cycle", "state"
    begun = {name: row[first] for name in columns if (row := getattr(record, name)) is not None}
    means = replace(
        record,
        time_s=mean(record.time_s),
        current_a=mean(record.current_a),
        voltage_v=mean(record.voltage_v),
        hold=replace(record.hold, value="centered"),
        skipped_ah=None,
        flowing=None,
        **begun,
    )
    moved_ah = np.diff(mean(record.discharged_ah))
    if record.flowing is not None:
        # Where the logger wrote nothing at rest, a mean's current does not flow through that.
        group = np.cumsum(is_first) - 1
        silent = group[:-1][record.flowing < 1]
        silent = silent[silent < len(moved_ah)]
        flowing, held_ah = np.ones(len(moved_ah)), means.moved_ah[silent]
        shares = np.divide(moved_ah[silent], held_ah, np.ones(len(silent)), where=held_ah != 0)
        flowing[silent] = np.clip(shares, 0.0, 1.0)
        means = replace(means, flowing=flowing)
    return replace(means, skipped_ah=moved_ah - means.moved_ah)


# Time in s, current in A and voltage in V of neighboring samples; how far the latter may differ.
Run = Float[np.ndarray, "3 samples"]
Near = Float[np.ndarray, "2 1"]

# So many runs of samples, each about the largest step of the voltage in its part of the record.
_RUNS, _LENGTH = 8, 12
# So many samples tell; of them nearly all must be alike, of whole records more, and of those of any
# run at least half.
_FEWEST, _ALIKE, _ALIKE_THROUGHOUT, _HALF = 12, 0.98, 0.995, 0.5
# Single precision, and what a current may be rounded to, as a share of the largest.
_SINGLE, _CURRENT_SHARE = 1e-6, 1e-3
# A voltage that was read more often than this does not tell its time.
_MANY = 1000


class Content:
    """The samples of a record, to be compared with those of others."""

    def __init__(self, record: Record):
        self.record = record
        # What was moved to the voltages' moments is no current of the file: no copy has it.
        current_a = record.current_a + (np.nan if record.voltage_lag_s else 0.0)
        self.run: Run = np.stack([record.time_s, current_a, record.voltage_v])
        # To what current and voltage were rounded.
        self.rounded = np.array([*map(decimal_step, self.run[1:])])

    @cached_property
    def fingerprint(self) -> str:
        """The first and the last time, and behind semicolons runs of samples, of each its time,
        current (discharge positive, "nan" of one that was moved) and voltage in s, A and V."""
        step_v = np.abs(np.diff(self.run[2]))
        length = min(_LENGTH, len(step_v))
        texts = [f"{self.run[0, 0]:.12g} {self.run[0, -1]:.12g}"]
        for part in np.array_split(np.arange(len(step_v)), min(_RUNS, len(step_v) // length)):
            first = int(part[np.argmax(step_v[part])]) + 1 - length // 2
            first = int(np.clip(first, 0, len(step_v) + 1 - length))
            samples = self.run[:, first : first + length].T
            texts.append(" ".join(f"{t:.12g} {i:.8g} {v:.8g}" for t, i, v in samples))
        return ";".join(texts)

    def is_like(self, other: "Content") -> bool:
        """True if they share a good part of the samples of either."""
        return self.holds(other.fingerprint, other) or other.holds(self.fingerprint, self)

    def holds(self, fingerprint: str, whole: "Content | None" = None) -> bool:
        """True if the samples of a fingerprint are among these, so far as the two overlap; and
        all others too of the record that it is of, where that is given."""
        (first_s, last_s), runs = read_fingerprint(fingerprint)
        samples = np.concatenate(runs, axis=1)
        rounded = np.maximum(self.rounded, [*map(decimal_step, samples[1:])])
        least = np.array([_CURRENT_SHARE, _SINGLE]) * np.abs(samples[1:]).max(axis=1)
        near = (rounded / 2 + least)[:, None]
        clocks_s = 0.0, first_s - self.run[0, 0], last_s - self.run[0, -1]
        return any(
            self._agrees(runs, shift_s, near, _ALIKE)
            and (not whole or self._agrees([whole.run], shift_s, near, _ALIKE_THROUGHOUT))
            for shift_s in (*clocks_s, *self._likely_shifts(samples, near))
        )

    @cached_property
    def _by_voltage(self) -> Int[np.ndarray, "samples"]:
        return np.argsort(self.run[2])

    def _likely_shifts(self, samples: Run, near: Near) -> Iterator[float]:
        """The difference of the clocks that most of the known samples may have."""
        time_s, current_a, voltage_v = self.run
        order, (near_a, near_v) = self._by_voltage, near.ravel()
        low = np.searchsorted(voltage_v, samples[2] - near_v, "left", order)
        high = np.searchsorted(voltage_v, samples[2] + near_v, "right", order)
        shifts_s = [np.zeros(0)]
        for sample_s, sample_a, first, last in zip(samples[0], samples[1], low, high, strict=True):
            if last - first <= _MANY:
                places = order[first:last]
                is_far = np.abs(current_a[places] - sample_a) > near_a
                shifts_s.append(sample_s - time_s[places[~is_far]])
        all_s, width_s = np.concatenate(shifts_s), np.median(np.diff(time_s))
        if len(all_s):
            bins, counts = np.unique(np.round(all_s / width_s), return_counts=True)
            middle_s = bins[np.argmax(counts)] * width_s
            yield float(np.median(all_s[np.abs(all_s - middle_s) <= width_s]))

    def _agrees(self, runs: list[Run], shift_s: float, near: Near, share: float) -> bool:
        """True if these samples are those of the runs, or lie on the lines between them, or they on
        lines between these: a copy may be thinned or interpolated."""
        around = []
        for run in runs:
            # Those about the run's, on its clock.
            first, last = np.searchsorted(self.run[0], run[0, [0, -1]] - shift_s)
            around.append(self.run[:, max(first - 2, 0) : last + 2].copy())
            around[-1][0] += shift_s
        return _lie_on(runs, around, near, share) or _lie_on(around, runs, near, share)


def read_fingerprint(text: str) -> tuple[tuple[float, float], list[Run]]:
    """The ends and the runs of a fingerprint. Raises ValueError where the text is none."""
    ends, *runs = (np.array(part.split(), float) for part in text.split(";"))
    first_s, last_s = ends
    if not runs:
        raise ValueError("a fingerprint holds samples")
    return (float(first_s), float(last_s)), [run.reshape(-1, 3).T for run in runs]


def _lie_on(lines: list[Run], points: list[Run], near: Near, share: float) -> bool:
    """True if that share of the points that overlap with their lines lies on them."""
    alike: list[np.bool_] = []
    for line, points_beside in zip(lines, points, strict=True):
        is_on = _is_on(line, points_beside, near)
        if len(is_on) and is_on.mean() < _HALF:
            return False
        alike.extend(is_on)
    return len(alike) >= _FEWEST and float(np.mean(alike)) >= share


def _is_on(line: Run, points: Run, near: Near) -> Bool[np.ndarray, "points"]:
    """True for points that overlap with a line and are on it, or like a sample beside them."""
    if line.shape[1] < 2:
        return np.zeros(0, bool)
    inside = np.searchsorted(points[0], line[0, [0, -1]] + [-_SINGLE, _SINGLE])
    points = points[:, slice(*inside)]
    after = np.clip(np.searchsorted(line[0], points[0]), 1, line.shape[1] - 1)
    between = np.array([np.interp(points[0], line[0], row) for row in line[1:]])
    candidates = np.stack([line[1:, after - 1], line[1:, after], between])
    # A current that is not a number is like any.
    return ~np.any(np.abs(points[1:] - candidates) > near, axis=1).all(axis=0)

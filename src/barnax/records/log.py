"""Logs split into several files: which records continue each other, and the whole log; and a record
in means."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ..errors import InputError, naming
from .record import Record, is_long
from .source import Source
from .table import Table

# Between the names of a log's files.
NEXT_FILE = " + "
# A log continues within this many intervals, and its files have equal sampling within this factor.
# At the cut the voltage deviates from -R0 times the step of the current by no more than in this
# share of this many intervals on either side, or by the last share of it.
_INTERVALS, _SAMPLED_ALIKE, _USUAL, _BESIDE, _OFF = 2.0, 1.5, 0.9, 300, 0.3


def joined(sources: Sequence[Source]) -> Source:
    """One log from its files, in their order; row numbers continue from file to file.

    Raises InputError if their columns differ.
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
    parts = [
        replace(table, row=table.row + rows) for table, rows in zip(tables, before, strict=True)
    ]
    names, digests = zip(*((source.name, source.sha256) for source in sources), strict=True)
    with naming(name := NEXT_FILE.join(names)):
        table = replace(Table.stacked(parts), files=len(parts))
    return replace(first, name=name, table=table, sha256=" ".join(digests))


def pause_s(earlier: Record, later: Record) -> float:
    """Seconds from the end of one record to the start of another, by the dates of both, else by
    their clocks."""
    between_s = float(later.time_s[0] - earlier.time_s[-1])
    if earlier.zero_date_s is None or later.zero_date_s is None:
        return between_s
    # Dates that count days are no more exact.
    return round(between_s + later.zero_date_s - earlier.zero_date_s, 3)


def goes_on(earlier: Record, later: Record) -> bool:
    """True if a record continues another one: by their dates, if the clocks of both have dates,
    else by their clocks."""
    # The row at which a log was cut may be in both files.
    return 0 <= pause_s(earlier, later) <= _INTERVALS * later.usual_s


def continuation(earlier: Record, later: Record) -> str:
    """The evidence that two records are one log that was cut under load; empty if there is none.

    In addition to clock, columns and sampling, the voltage continues: across the cut it changes by
    R0 times the current step, within a share of it or within nine of ten deviations in the
    neighboring intervals.
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
    # A long enough rest around the cut lets the RC pairs relax.
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
    """The record in means over intervals, with all its charge; unchanged if it is no faster.

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
        # Where the logger wrote nothing at rest, a mean's current does not flow through the gap.
        group = np.cumsum(is_first) - 1
        silent = group[:-1][record.flowing < 1]
        silent = silent[silent < len(moved_ah)]
        flowing, held_ah = np.ones(len(moved_ah)), means.moved_ah[silent]
        shares = np.divide(moved_ah[silent], held_ah, np.ones(len(silent)), where=held_ah != 0)
        flowing[silent] = np.clip(shares, 0.0, 1.0)
        means = replace(means, flowing=flowing)
    return replace(means, skipped_ah=moved_ah - means.moved_ah)

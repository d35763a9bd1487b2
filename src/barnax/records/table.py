"""A file's cells: the table as it was read, its lines as numbers in base units, and their rules."""

import hashlib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from ..errors import LONGEST_CELL, InputError, cut
from ..notices import Notice, Severity
from .cell_values import DAY_S, dated_numbers, numbers
from .columns import Column, Header, in_its_unit, names_cell_voltage, normal
from .counters import inner
from .quantities import CELL_RANGE_V, NEEDED, QUANTITY_OF
from .record import OTHER_STATE

# A line, or the first of several.
LineIndex = int | Bool[np.ndarray, "lines"]

# Even nanoseconds since 1970 are less; anything larger overflows when squared.
LARGEST_NUMBER = 1e20
COUNTS, _LARGEST_WHOLE = frozenset({"step", "cycle", "state"}), 2**31
_IMPEDANCE = r"^\s*(FRA|EIS|P?EIS|GEIS|ACI|AC ?IMP.*)\s*$"
LARGEST_FILE = 2_000_000_000
# Rows are steps or cycles if there are this many, and this share of them begins another; counted
# samples follow each other this fast.
_FEWEST_ROWS, _OF_STEPS, _OF_CYCLES, _SAMPLED_S = 4, 0.9, 0.3, 60.0
# A voltage without a unit from this value on is in mV; this many cells are a pack.
_MILLIVOLTS, FEWEST_CELLS = 500.0, 2
# The least share of the rows with a current that also have a voltage, or vice versa.
_COMMON = 0.1


@dataclass(frozen=True, eq=False)
class Table:
    """A header and one series per column, all of the same length.

    `row` is each line's row in the source, with the header in row 1. `sheets` has the sheets of the
    lines, with the number of lines of each, in order; it is empty for formats without sheets.
    `notes` are for the user. `has_known_units`: the format defines the units. The lines of a split
    log come from several `files`.
    """

    header: Header
    columns: tuple[pl.Series, ...]
    row: Int[np.ndarray, "lines"]
    sheets: tuple[tuple[str, int], ...] = ()
    notes: tuple[Notice, ...] = ()
    has_fixed_units: bool = False
    files: int = 1

    @classmethod
    def of(cls, frame: pl.DataFrame, **fields: Any) -> Self:
        """The table of a frame, with its names in row 1."""
        rows = np.arange(2, frame.height + 2)
        return cls(Header(tuple(frame.columns)), tuple(frame.get_columns()), rows, **fields)

    @classmethod
    def stacked(cls, tables: Sequence[Self]) -> Self:
        """Tables with the same header, one below the other; a column is text if only text can
        represent all of its values, so that a stray word can be quoted.

        Raises `InputError` if no column can represent them.
        """
        has_sheets = all(table.sheets for table in tables)
        columns = zip(*(table.columns for table in tables), strict=True)
        return replace(
            tables[0],
            columns=tuple(map(_stacked, tables[0].header.names, columns)),
            row=np.concatenate([table.row for table in tables]),
            sheets=sum((table.sheets for table in tables), ()) if has_sheets else (),
            notes=tuple(dict.fromkeys(note for table in tables for note in table.notes)),
        )

    def leaving_out(self, part: str, **values: Any) -> Self:
        """The table, with a note of what is left out."""
        note = Notice("columns.left-out", {"part": part, **values})
        return replace(self, notes=(*self.notes, note))

    @cached_property
    def examined(self) -> dict[tuple[int, float | None], Any]:
        """The result of `examine`, which is needed when a record is read and checked: as a
        candidate, in its role, and for every part of it."""
        return {}

    @property
    def names_row(self) -> int:
        """The row with the names of the columns."""
        return int(self.row[0]) - 1 if len(self.row) else 1

    @cached_property
    def is_impedance(self) -> Bool[np.ndarray, "lines"]:
        """The lines with a frequency, if the table has columns of impedance."""
        is_impedance = np.zeros(len(self.row), bool)
        for name, column in zip(self.header.names, self.columns, strict=True):
            if self.header.other_table and normal(name).startswith("freq"):
                # Polars takes NaN as the largest number.
                hertz = column.cast(pl.Float64, strict=False).fill_nan(None)
                is_impedance |= (hertz > 0).fill_null(False).to_numpy()
        return is_impedance

    @cached_property
    def one_row_a(self) -> str | None:
        """What each row describes, "step" or "cycle", by the columns that count them; None for
        samples.

        In a log with short and equal intervals, the counter counts samples.
        """
        columns = self.header.columns
        if len(self.row) < _FEWEST_ROWS or not columns.keys() & {"cycle", "step"}:
            return None
        is_new = np.zeros(len(self.row) - 1, bool)
        for name in [name for name in ("cycle", "step", "state") if name in columns]:
            cells = self.columns[columns[name].index]
            if name != "state" and cells.dtype.is_numeric():
                rises = cells.cast(pl.Float64).diff().drop_nulls()
                if (rises % 1 > 0).any() or ((rises == 1).all() and self._is_sampled):
                    continue
            is_new |= cells[1:].ne_missing(cells[:-1]).to_numpy()
            if name == "cycle" and is_new.mean() > _OF_CYCLES:
                return name
        return "step" if is_new.mean() > _OF_STEPS else None

    @cached_property
    def _is_sampled(self) -> bool:
        """True if the clock has short and nearly equal intervals."""
        clock = self.header.columns.get("time") or self.header.columns.get("date")
        if clock is None:
            return False
        interval_s = np.diff(numbers(self.columns[clock.index], clock))
        usual_s = np.median(interval_s)
        is_usual = np.abs(interval_s - usual_s) < 0.1 * usual_s
        return bool(usual_s < _SAMPLED_S and is_usual.mean() > _OF_STEPS)

    @cached_property
    def cell_voltages(self) -> list[dict[str, Float[np.ndarray, "lines"]]]:
        """The sets of columns that may be the voltages of a pack's cells, in V by name, with at
        least two in the range of a cell: a failed sensor belongs to its set."""
        named = self.header.columns.items()
        others = {column.header for quantity, column in named if quantity != "voltage"}
        alike: dict[str, dict[str, Any]] = {}
        for name in self.header.names:
            if name not in others and re.search(r"\d", name) and names_cell_voltage(name):
                set_of = alike.setdefault(re.sub(r"\d+", "#", normal(name)), {})
                set_of[name] = self.in_volts(name)
        sets = alike.values()
        return [one for one in sets if sum(map(is_of_cell, one.values())) >= FEWEST_CELLS]

    def in_volts(self, name: str) -> Float[np.ndarray, "lines"]:
        """The voltages of a column, in V or mV by their size if its name has no unit."""
        index = self.header.names.index(name)
        column = in_its_unit(index, name, QUANTITY_OF["voltage"])
        values_v = numbers(self.columns[index], column)
        finite = values_v[np.isfinite(values_v)]
        if column.is_unit_assumed and len(finite) and np.median(np.abs(finite)) > _MILLIVOLTS:
            values_v = values_v / 1000
        return values_v


def _stacked(name: str, parts: Sequence[pl.Series]) -> pl.Series:
    dtypes = [part.dtype for part in parts if part.dtype != pl.Null]
    if len({dtype.is_temporal() for dtype in dtypes if dtype != pl.String}) > 1:
        raise InputError(f"'{name}' has dates or durations in some of the parts and none in others")
    for is_text in (pl.String in dtypes, True):
        with suppress(pl.exceptions.PolarsError):
            frames = [(part.cast(pl.String) if is_text else part).to_frame("") for part in parts]
            return pl.concat(frames, how="vertical_relaxed").to_series()
    kinds = " and ".join(dict.fromkeys(map(str, dtypes)))
    raise InputError(f"'{name}' is of {kinds}, which make no one column")


def is_of_cell(values_v: Float[np.ndarray, "lines"]) -> bool:
    """True if the usual voltage of a column is possible for a cell."""
    finite_v = values_v[np.isfinite(values_v)]
    return bool(len(finite_v) and CELL_RANGE_V[0] < np.median(finite_v) < CELL_RANGE_V[1])


@dataclass(frozen=True)
class Reader:
    """One file format: how its content is recognized and read.

    `read` takes the file's bytes and the user's names of columns by quantity. It raises InputError
    if the content is damaged; the message follows the file's name.
    """

    name: str
    recognizes: Callable[[bytes], bool]
    read: Callable[[bytes, Mapping[str, str]], Table]


@dataclass(frozen=True, eq=False)
class Lines:
    """The lines of a table that are not blank, by quantity and in base units.

    A value is NaN if its cell is not a number. `at` has each line's index in `table`; `zero_date_s`
    is the date at which the time is zero, in s since 1970, if the clock has dates. `findings` are
    those of the rules so far.
    """

    table: Table
    columns: Mapping[str, Column]
    values: dict[str, np.ndarray]
    at: Int[np.ndarray, "lines"]
    zero_date_s: float | None = None
    findings: tuple[Notice, ...] = ()

    def __len__(self) -> int:
        return len(self.at)

    @cached_property
    def row(self) -> Int[np.ndarray, "lines"]:
        """Each line's row in the source."""
        return self.table.row[self.at]

    def header(self, name: str) -> str:
        """The name of a quantity's column, as written."""
        return self.columns[name].header

    def cell(self, name: str, line: int) -> object:
        """The cell in the file of the quantity `name`, with long text cut; None if it is empty."""
        cell = self.table.columns[self.columns[name].index][int(self.at[line])]
        return cut(cell, LONGEST_CELL) if isinstance(cell, str) else cell

    def bad(self, name: str) -> Bool[np.ndarray, "lines"]:
        """True where the quantity `name` has no number, or one that no tester reads."""
        values = self.values[name]
        # For most columns the sum of squares suffices, also with NaN; a mask takes several times as
        # long.
        if inner(values, values) <= LARGEST_NUMBER**2:
            return np.zeros(len(values), bool)
        return ~(np.abs(values) <= LARGEST_NUMBER)

    def keep(self, chosen: Bool[np.ndarray, "lines"] | Int[np.ndarray, "kept"]) -> Self:
        """The lines where `chosen` is true, or at these indices, in that order."""
        if chosen.dtype == bool and chosen.all():
            return self
        values = {name: numbers[chosen] for name, numbers in self.values.items()}
        return replace(self, values=values, at=self.at[chosen])

    def noting(self, *findings: Notice) -> Self:
        """The lines with additional findings."""
        return replace(self, findings=(*self.findings, *findings))

    def telling(
        self, line: LineIndex, code: str, rating: Severity | None = None, /, **values: Any
    ) -> Self:
        """The lines with a notice of one of them, or of the first of several."""
        return self.noting(notice_at(self, line, code, rating, **values))

    def having(self, **values: np.ndarray) -> Self:
        """The lines with other values of some quantities."""
        return replace(self, values={**self.values, **values})

    def without(self, name: str) -> Self:
        """The lines without the quantity `name`."""
        columns = {key: column for key, column in self.columns.items() if key != name}
        values = {key: numbers for key, numbers in self.values.items() if key != name}
        return replace(self, columns=columns, values=values)


def take_lines(table: Table, columns: Mapping[str, Column]) -> Lines:
    """The lines of a table with the given columns, without blank ones.

    A date in addition to the time is the day of a time of day.
    """
    dated = {name: dated_numbers(table.columns[one.index], one) for name, one in columns.items()}
    values = {name: numbers for name, (numbers, _) in dated.items()}
    zero_date_s = dated["time"][1] if "time" in dated else None
    if "date" in values and "time" in values:
        days_s = values.pop("date")
        zero_date_s = float(days_s[0]) if len(days_s) else None
        values["time"] = values["time"] % DAY_S + (days_s - days_s[:1])
        columns = {name: column for name, column in columns.items() if name != "date"}
    lines = Lines(table, columns, values, np.arange(len(table.row)), zero_date_s)
    if not table.columns or not all(column.null_count() for column in table.columns):
        return lines
    return lines.keep(~np.all([column.is_null().to_numpy() for column in table.columns], axis=0))


def notice_at(
    source: Lines, line: LineIndex, code: str, rating: Severity | None = None, /, **values: Any
) -> Notice:
    """A notice of one line, or the first of several, with its row and sheet, and the usual severity
    of its code unless it is rated."""
    at = source.at[int(np.argmax(line)) if isinstance(line, np.ndarray) else line]
    ends, sheet = np.cumsum([lines for _, lines in source.table.sheets]), None
    if len(ends) > 1:
        sheet, _ = source.table.sheets[int(np.searchsorted(ends, at, "right"))]
    return Notice(code, values, row=int(source.table.row[at]), rating=rating, sheet=sheet)


def table_sha256(table: Table) -> str:
    """The SHA-256 of the names and values of a table without a file."""
    digest = hashlib.sha256(repr(table.header.names).encode("utf-8", "backslashreplace"))
    for column in table.columns:
        if column.dtype.is_numeric():
            digest.update(column.cast(pl.Float64).fill_null(np.nan).to_numpy().tobytes())
        else:
            digest.update(repr(column.to_list()).encode("utf-8", "backslashreplace"))
    return digest.hexdigest()


def examine_cells(lines: Lines) -> Lines:
    """The lines with finite time, current and voltage, and notices of the others.

    An optional column with such cells is left out.
    """
    is_good = np.ones(len(lines), bool)
    is_unread = ~is_good
    if lines.columns.keys() >= NEEDED:
        # Current and voltage may be written in separate rows.
        has_current, has_voltage = ~lines.bad("current"), ~lines.bad("voltage")
        both = int(np.sum(has_current & has_voltage))
        if both < _COMMON * min(has_current.sum(), has_voltage.sum()):
            names = {name: lines.header(name) for name in ("current", "voltage")}
            apart = Notice("cells.apart", {**names, "rows": both})
            # First of all, because nothing else can be said about such rows; if they are all rows,
            # the notice has no row.
            return replace(lines.keep(is_unread), findings=(apart, *lines.findings))
    for is_none, code, given in _no_samples(lines):
        if (is_none & is_good).any():
            lines = lines.telling(is_none & is_good, code, **given)
            is_good &= ~is_none
    for name, column in lines.columns.items():
        values, bad = lines.values[name], lines.bad(name) & is_good
        if name in COUNTS:
            bad |= is_good & ((values != np.floor(values)) | (np.abs(values) >= _LARGEST_WHOLE))
        if not bad.any():
            continue
        first = int(np.argmax(bad))
        cell, value = lines.cell(name, first), values[first]
        given = {
            "column": column.header,
            "stands": None if cell is None else repr(cell),
            "limit": LARGEST_NUMBER if np.abs(value) > LARGEST_NUMBER else None,
            "cells": bad.sum(),
        }
        # The time may have to come from a clock of dates or of steps.
        if name not in NEEDED:
            is_coded = name == "state" and not isinstance(cell, str)
            is_number = np.abs(value) <= LARGEST_NUMBER
            reason = "codes" if is_coded else "fractions" if is_number else "cells"
            lines = lines.without(name).telling(first, "cells.left-out", **given, reason=reason)
            continue
        unit = column.unit.symbol if bad.sum() == is_good.sum() else None
        lines = lines.telling(first, "cells.no-number", **given, unit=unit)
        is_unread |= bad
    lines = lines.keep(is_good & ~is_unread)
    state = lines.values.get("state", np.zeros(0))
    if np.any(is_other := state == OTHER_STATE) and not np.any(np.abs(state) == 1):
        given = {"column": lines.header("state")}
        given |= {"word": str(lines.cell("state", int(is_other.argmax())))}
        lines = lines.telling(is_other, "cells.state-words", **given)
    return lines


def _no_samples(lines: Lines) -> Iterator[tuple[Bool[np.ndarray, "lines"], str, dict[str, Any]]]:
    """The lines of each kind that are not samples, with the code and the values of their notice."""
    # Those with the state, or with a frequency, of an impedance measurement.
    words, state = None, lines.values.get("state", np.zeros(len(lines)))
    is_other = state == OTHER_STATE
    if "state" in lines.columns:
        words = lines.table.columns[lines.columns["state"].index].gather(lines.at[is_other])
        is_spectrum = words.cast(pl.String).str.contains(_IMPEDANCE).fill_null(False)
        is_other[is_other] = is_spectrum.to_numpy()
    is_other |= lines.table.is_impedance[lines.at]
    if is_other.any():
        word = None if words is None else lines.cell("state", int(np.argmax(is_other)))
        given = {"part": "impedance", "rows": is_other.sum(), "state": word or None}
        yield is_other, "columns.left-out", given
    if lines.table.header.dialect.writes_zero_volts and "voltage" in lines.columns:
        is_zero = ~is_other & (lines.values["voltage"] == 0)
        given = {"column": lines.header("voltage"), "rows": is_zero.sum()}
        yield is_zero, "cells.zero-volts", given
    index, columns = np.arange(len(lines)), lines.table.columns
    needed = {name: column for name, column in lines.columns.items() if name in NEEDED}
    if len(lines) > 1 and not lines.table.sheets:
        ends = lines.at[-2:].tolist()
        before, last = ([column[line] is not None for column in columns] for line in ends)
        # The end of the last line lacks cells that the previous line has.
        end = len(last) - last[::-1].index(True)
        if any(before[end:]) and any(column.index >= end for column in needed.values()):
            yield index == len(lines) - 1, "cells.cut-short", {}
    # The first line repeats the units of time, current and voltage.
    cells = [lines.cell(name, 0) for name in needed] if len(lines) else []
    spelled = (str(cell).strip().strip("[]()").lower() for cell in cells)
    are_units = map(lambda text, column: text in column.quantity.units, spelled, needed.values())
    if cells and all(are_units):
        yield index == 0, "cells.units-row", {"units": ", ".join(map(repr, cells))}

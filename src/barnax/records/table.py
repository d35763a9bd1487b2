"""A file's cells: the table as it was read, its lines as numbers in base units, and their rules."""

import hashlib
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from ..errors import LONGEST_CELL, InputError, counted, cut, listed
from .columns import (
    NEEDED,
    QUANTITIES,
    Column,
    Quantity,
    find_columns,
    is_ocv_table,
    likely_column,
    likely_names,
)
from .findings import Finding, found_at
from .record import OTHER_STATE

# Even nanoseconds since 1970 are less; what is more overflows where it is squared.
LARGEST_NUMBER = 1e20


@dataclass(frozen=True, eq=False)
class Table:
    """A header and one series a column, all of one length.

    `row` is each line's row in the source, the header being row 1. `sheets` names the sheets the
    lines come from, with the number of lines of each, in order; it is empty for formats without
    sheets. `notes` are for the user.
    """

    header: tuple[str, ...]
    columns: tuple[pl.Series, ...]
    row: Int[np.ndarray, "lines"]
    sheets: tuple[tuple[str, int], ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def names_row(self) -> int:
        """The row in which the columns' names stand."""
        return int(self.row[0]) - 1 if len(self.row) else 1

    @property
    def sheet_of_line(self) -> Int[np.ndarray, "lines"]:
        """Which of `sheets` each line comes from; zero everywhere for formats without sheets."""
        if not self.sheets:
            return np.zeros(len(self.row), int)
        return np.repeat(np.arange(len(self.sheets)), [lines for _, lines in self.sheets])


@dataclass(frozen=True)
class Reader:
    """One file format: how its content is recognized, and how a table is taken from it.

    `read` takes the file's bytes and the name for messages, and raises InputError when the
    content is damaged.
    """

    name: str
    recognizes: Callable[[bytes], bool]
    read: Callable[[bytes, str], Table]


@dataclass(frozen=True, eq=False)
class Lines:
    """The lines of a table that are not blank, by quantity and in base units.

    A value is NaN where its cell is no number. `row` and `sheet` say where each line stands in
    the source, `at` where it stands in `table`.
    """

    table: Table
    columns: Mapping[str, Column]
    values: dict[str, Float[np.ndarray, "lines"]]
    at: Int[np.ndarray, "lines"]
    row: Int[np.ndarray, "lines"]
    sheet: Int[np.ndarray, "lines"]

    @property
    def sheets(self) -> tuple[str, ...]:
        return tuple(name for name, _ in self.table.sheets)

    def cell(self, name: str, line: int) -> object:
        """What stands in the file under the quantity `name`, long text cut; None for nothing."""
        cell = self.table.columns[self.columns[name].index][int(self.at[line])]
        return cut(cell, LONGEST_CELL) if isinstance(cell, str) else cell

    def bad(self, name: str) -> Bool[np.ndarray, "lines"]:
        """Where the quantity `name` has no number, or one that no tester reads."""
        return ~(np.abs(self.values[name]) <= LARGEST_NUMBER)

    def keep(self, mask: Bool[np.ndarray, "lines"]) -> "Lines":
        """The lines where `mask` holds."""
        values = {name: numbers[mask] for name, numbers in self.values.items()}
        return replace(
            self, values=values, at=self.at[mask], row=self.row[mask], sheet=self.sheet[mask]
        )

    def without(self, name: str) -> "Lines":
        """The lines without the quantity `name`."""
        columns = {key: column for key, column in self.columns.items() if key != name}
        values = {key: numbers for key, numbers in self.values.items() if key != name}
        return replace(self, columns=columns, values=values)


def take_lines(table: Table, columns: Mapping[str, Column]) -> Lines:
    """The lines of a table under the given columns, blank ones left out."""
    is_blank = np.all([column.is_null().to_numpy() for column in table.columns], axis=0)
    at = np.flatnonzero(~is_blank)
    values = {
        name: _numbers(table.columns[found.index], found)[at] for name, found in columns.items()
    }
    return Lines(table, columns, values, at, table.row[at], table.sheet_of_line[at])


def _numbers(cells: pl.Series, found: Column) -> Float[np.ndarray, "lines"]:
    """The column in its base unit, NaN where a cell is no number."""
    if isinstance(cells.dtype, pl.Categorical | pl.Enum):
        cells = cells.cast(pl.String)
    if found.quantity.name == "state" and cells.dtype == pl.String:
        return _states(cells)
    if not (cells.dtype.is_numeric() or cells.dtype == pl.String):
        # A date, a duration or a truth value is no number of the stated unit.
        return np.full(len(cells), np.nan)
    numbers = cells.cast(pl.Float64, strict=False).to_numpy()
    if found.unit.factor == 1 and found.unit.offset == 0:
        return numbers
    return numbers * found.unit.factor + found.unit.offset


# How testers call what a step does; what is neither is another state.
_STATES = (
    (1, r"^(d|dis|dch|dch?g|rated|.*dchg|.*dis-?charg(e|ing)|.*entladen|.*放电)$"),
    (-1, r"^(c|chg?|cha|ratec|.*chg|.*charg(e|ing)|.*laden|.*充电)$"),
    (0, r"^(r|rest|p|pau|pause|idle|ocv|ocp|.*rest|open circuit.*|静置|搁置)$"),
)


def _states(cells: pl.Series) -> Float[np.ndarray, "lines"]:
    """The codes of `Record.state` for a column of words; there are few words in many lines."""
    codes = {}
    for word in cells.unique().drop_nulls():
        plain = re.sub(r"[\s_]+", " ", word).strip().lower()
        codes[word] = next((code for code, words in _STATES if re.match(words, plain)), OTHER_STATE)
    return cells.replace_strict(codes, default=OTHER_STATE, return_dtype=pl.Float64).to_numpy()


def table_sha256(table: Table) -> str:
    """The SHA-256 of a table that has no file: of its names and values."""
    digest = hashlib.sha256(repr(table.header).encode("utf-8", "backslashreplace"))
    for column in table.columns:
        if column.dtype.is_numeric():
            digest.update(column.cast(pl.Float64).fill_null(np.nan).to_numpy().tobytes())
        else:
            digest.update(repr(column.to_list()).encode("utf-8", "backslashreplace"))
    return digest.hexdigest()


Columns = Mapping[str, Column]

REQUIRED = tuple(quantity for quantity in QUANTITIES if quantity.is_required)
_LARGEST = 2**31


def examine_columns(table: Table, file: str) -> tuple[dict[str, Column], list[Finding]]:
    """The columns to go on with, and what is to be said of them.

    Where a required column has no accepted name but one likely one, that is taken, so that its
    values are looked at too. A column still missing is in the findings alone. Raises InputError
    where no name is like any that a record has.
    """
    found = find_columns(table.header)
    is_nameless = any(map(_is_number, table.header[:1]))
    is_like = any(q.name in found or likely_names(q, table.header) for q in REQUIRED)
    if not is_like and not is_nameless:
        raise InputError(_no_record(table, file))
    findings = [Finding("note", note, is_told=True) for note in table.notes]
    findings.extend(_repeated_names(table, found))
    findings.extend(_units(found))
    for quantity in REQUIRED:
        if quantity.name in found:
            continue
        # What another quantity has taken is no candidate.
        free = ["" if name in _headers(found) else name for name in table.header]
        guess = likely_column(quantity, free)
        if guess is not None:
            found[quantity.name] = guess
        what, remedy = _missing(quantity, guess, free, table)
        if is_nameless:
            what += "; the first row holds numbers, not names"
        findings.append(Finding("error", what, remedy, row=table.names_row))
    return found, findings


def _no_record(table: Table, file: str) -> str:
    names = listed(name for name in table.header if name) or "none"
    message = f"{file}: no column for time, current, voltage; columns found: {names}. "
    if is_ocv_table(table.header):
        return f"{message}It is a table of OCV over SOC; give it as the OCV test."
    accepted = "; ".join(
        f"for the {quantity.name} {_examples(quantity)} (units {_symbols(quantity)})"
        for quantity in REQUIRED
    )
    return f"{message}Accepted names: {accepted}. Rename the columns so, in the file's first row."


def _missing(
    quantity: Quantity, guess: Column | None, free: list[str], table: Table
) -> tuple[str, str]:
    """What is missing, and what to do about it."""
    what = f"no column for the {quantity.name}"
    names = f"{_examples(quantity)}, with its unit ({_symbols(quantity)})"
    if guess is not None:
        what += f"; '{guess.header}' is likely it"
        return what, f"rename '{guess.header}' to {names}"
    likely = likely_names(quantity, free)
    if likely:
        return f"{what}; likely: {_quoted(likely)}", f"rename the right one to {names}"
    return f"{what} among {_quoted(list(table.header))}", f"export it, or name it {names}"


def _examples(quantity: Quantity) -> str:
    return " or ".join(f"'{name}'" for name in quantity.examples[:2])


def _symbols(quantity: Quantity) -> str:
    return ", ".join(dict.fromkeys(unit.symbol for unit in quantity.units.values()))


def _quoted(names: list[str]) -> str:
    shown = [f"'{name[:40]}'" for name in names if name][:8]
    return ", ".join(shown) + (" ..." if len(names) > 8 else "") if shown else "no names"


def _headers(found: Columns) -> set[str]:
    return {column.header for column in found.values()}


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _repeated_names(table: Table, found: Columns) -> Iterator[Finding]:
    row = table.names_row
    for name, times in Counter(table.header).items():
        what = f"{times} columns are called '{name}'"
        if not name:
            yield Finding("note", f"{counted(times, 'column')} without a name; not used", "", row)
        elif times > 1 and name in _headers(found):
            remedy = f"rename or delete the other{'s' if times > 2 else ''}"
            yield Finding("warning", f"{what}; the first of them is taken", remedy, row)
        elif times > 1:
            yield Finding("note", f"{what}; none is used", "", row)


def _units(found: Columns) -> Iterator[Finding]:
    """Notes of the units that were assumed, and of those that were converted."""
    bare = [column for column in found.values() if column.is_unit_assumed]
    if bare:
        units = [f"{column.unit.symbol} for '{column.header.strip()}'" for column in bare]
        needed = [column for column in bare if column.quantity.is_required] or bare
        names = ", ".join(f"'{column.quantity.examples[0]}'" for column in needed)
        what = f"no units in the names; assumed {', '.join(units)}"
        yield Finding("note", what, f"name the columns {names} to be sure", is_told=True)
    converted = [
        f"'{column.header}' from {column.unit.symbol} to {column.quantity.base_unit.symbol}"
        for column in found.values()
        if not column.is_unit_assumed and column.unit != column.quantity.base_unit
    ]
    if converted:
        yield Finding("note", f"converted {', '.join(converted)}", is_told=True)


def examine_cells(lines: Lines) -> tuple[Lines, list[Finding]]:
    """The lines whose time, current and voltage are finite, and what stands in the others.

    An optional column with such cells is left out.
    """
    findings = []
    is_good = np.ones(len(lines.row), bool)
    units = _units_row(lines)
    if units:
        what = f"the row below the names holds no numbers but {units}, as units"
        remedy = "write the units into the names, as in 'Current / mA', and delete the row"
        findings.append(found_at(lines, 0, "error", what, remedy))
        is_good[0] = False
    for name, column in lines.columns.items():
        bad = lines.bad(name) & is_good
        if not bad.any():
            continue
        first = int(np.argmax(bad))
        cell = lines.cell(name, first)
        stands = "nothing" if cell is None else repr(cell)
        is_large = np.abs(lines.values[name][first]) > LARGEST_NUMBER
        number = f"a number below {LARGEST_NUMBER:g}" if is_large else "a number"
        cells = counted(int(bad.sum()), "cell")
        what = f"{stands} stands under '{column.header}', where {number} is needed ({cells})"
        if not column.quantity.is_required:
            lines = lines.without(name)
            what += "; the column is left out"
            findings.append(found_at(lines, first, "note", what, is_told=True))
            continue
        remedy = "delete the row, or fill it from the tester's own file"
        if bad.sum() == is_good.sum():
            remedy = f"export the column as plain numbers in {column.unit.symbol}"
        findings.append(found_at(lines, first, "error", what, remedy))
    for name in set(lines.columns) & NEEDED:
        is_good &= ~lines.bad(name)
    lines = lines.keep(is_good)
    for name in ("step", "cycle", "state"):
        numbers = lines.values.get(name)
        if numbers is None or np.all((numbers == np.round(numbers)) & (np.abs(numbers) < _LARGEST)):
            continue
        what = f"the numbers under '{lines.columns[name].header}' are not whole: left out"
        findings.append(Finding("note", what, is_told=True))
        lines = lines.without(name)
    return lines, findings


def _units_row(lines: Lines) -> str:
    """The units that the first line spells under time, current and voltage, or nothing."""
    needed = [name for name in lines.columns if name in NEEDED]
    cells = [lines.cell(name, 0) for name in needed] if len(lines.row) else []
    are_units = [
        isinstance(cell, str)
        and cell.strip().strip("[]()").lower() in lines.columns[name].quantity.units
        for name, cell in zip(needed, cells, strict=False)
    ]
    return ", ".join(map(repr, cells)) if all(are_units) else ""

"""A file's cells: a table of columns as they were read, and its lines as numbers in base units."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from ..errors import LONGEST_CELL, cut
from .columns import Column

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
    return Lines(
        table=table,
        columns=columns,
        values={
            name: _numbers(table.columns[found.index], found)[at] for name, found in columns.items()
        },
        at=at,
        row=table.row[at],
        sheet=table.sheet_of_line[at],
    )


def _numbers(cells: pl.Series, found: Column) -> Float[np.ndarray, "lines"]:
    """The column in its base unit, NaN where a cell is no number."""
    if isinstance(cells.dtype, pl.Categorical | pl.Enum):
        cells = cells.cast(pl.String)
    if not (cells.dtype.is_numeric() or cells.dtype == pl.String):
        # A date, a duration or a truth value is no number of the stated unit.
        return np.full(len(cells), np.nan)
    numbers = cells.cast(pl.Float64, strict=False).to_numpy()
    if found.unit.factor == 1 and found.unit.offset == 0:
        return numbers
    return numbers * found.unit.factor + found.unit.offset


def table_sha256(table: Table) -> str:
    """The SHA-256 of a table that has no file: of its names and values."""
    digest = hashlib.sha256(repr(table.header).encode("utf-8", "backslashreplace"))
    for column in table.columns:
        if column.dtype.is_numeric():
            digest.update(column.cast(pl.Float64).fill_null(np.nan).to_numpy().tobytes())
        else:
            digest.update(repr(column.to_list()).encode("utf-8", "backslashreplace"))
    return digest.hexdigest()

"""A table's known columns as numbers, with what is wrong in them still in place."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from .columns import Column
from .limits import LARGEST_NUMBER, LONGEST_CELL, cut
from .table import Table


@dataclass(frozen=True, eq=False)
class Lines:
    """The lines of a file that are not blank, by quantity and in base units.

    A value is NaN where its cell is no number. `row` and `sheet` say where each line stands in
    the source, `at` where it stands in `table`.
    """

    file: str
    table: Table
    columns: Mapping[str, Column]
    values: dict[str, Float[np.ndarray, "lines"]]
    at: Int[np.ndarray, "lines"]
    row: Int[np.ndarray, "lines"]
    sheet: Int[np.ndarray, "lines"]

    @property
    def sheets(self) -> tuple[str, ...]:
        return tuple(name for name, _ in self.table.sheets)

    def place(self, line: int) -> str:
        """Where a line stands, for messages."""
        return place(int(self.row[line]), int(self.sheet[line]), self.sheets)

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


def take_lines(table: Table, columns: Mapping[str, Column], file: str) -> Lines:
    """The lines of a table under the given columns, blank ones left out."""
    is_blank = np.all([column.is_null().to_numpy() for column in table.columns], axis=0)
    at = np.flatnonzero(~is_blank)
    return Lines(
        file=file,
        table=table,
        columns=columns,
        values={
            name: _numbers(table.columns[found.index], found)[at] for name, found in columns.items()
        },
        at=at,
        row=table.row[at],
        sheet=table.sheet_of_line[at],
    )


def place(row: int, sheet: int, sheets: tuple[str, ...]) -> str:
    """A row in words, with its sheet where there are several."""
    return f"row {row} of sheet '{sheets[sheet]}'" if len(sheets) > 1 else f"row {row}"


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

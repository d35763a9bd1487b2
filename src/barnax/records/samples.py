"""From a file's cells to numbers in s, A and V, before sign and hold are known."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from ..errors import LARGEST_NUMBER, LONGEST_CELL, InputError, cut
from .columns import Column, Dialect, dialect_of, require_columns


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


_LARGEST_STEP = 2**31


@dataclass(frozen=True, eq=False)
class Counters:
    """The tester's own ampere-hours, as far as the file has them.

    `charged_ah` and `discharged_ah` only grow, but for resets; `net_ah` follows the file's own
    sign of current, or nothing at all: names such as "Capacity" mean many things.
    """

    charged_ah: Float[np.ndarray, "samples"] | None = None
    discharged_ah: Float[np.ndarray, "samples"] | None = None
    net_ah: Float[np.ndarray, "samples"] | None = None


@dataclass(frozen=True, eq=False)
class Samples:
    """A file's samples in s, A and V; the current's sign is still the file's own.

    `row` and `sheet` say where each stands in the source; `names` holds the columns' names as
    written, by quantity.
    """

    file: str
    time_s: Float[np.ndarray, "samples"]
    current_a: Float[np.ndarray, "samples"]
    voltage_v: Float[np.ndarray, "samples"]
    temperature_degc: Float[np.ndarray, "samples"] | None
    step: Int[np.ndarray, "samples"] | None
    counters: Counters
    row: Int[np.ndarray, "samples"]
    sheet: Int[np.ndarray, "samples"]
    sheets: tuple[str, ...]
    names: dict[str, str]
    dialect: Dialect
    warnings: tuple[str, ...]

    def place(self, sample: int) -> str:
        """Where a sample stands, for messages."""
        return place(int(self.row[sample]), int(self.sheet[sample]), self.sheets)

    def warn(self, *messages: str) -> "Samples":
        """The same samples with more warnings."""
        return replace(self, warnings=self.warnings + messages)

    def keep(self, chosen: Bool[np.ndarray, "samples"] | Int[np.ndarray, "kept"]) -> "Samples":
        """The samples where `chosen` holds, or those at its places, in its order."""
        arrays = {
            name: values[chosen]
            for name, values in vars(self).items()
            if isinstance(values, np.ndarray)
        }
        counters = Counters(
            **{
                name: None if values is None else values[chosen]
                for name, values in vars(self.counters).items()
            }
        )
        return replace(self, counters=counters, **arrays)


def take_samples(table: Table, file: str) -> Samples:
    """The samples of a table whose columns are known by their names.

    Blank lines are passed over. Raises InputError when time, current or voltage is missing, is
    no number, or none that a tester reads.
    """
    lines = take_lines(table, require_columns(table.header, file), file)
    for name in required(lines):
        bad = lines.bad(name)
        if bad.any():
            first = int(np.argmax(bad))
            cell = lines.cell(name, first)
            stands = "nothing" if cell is None else repr(cell)
            raise InputError(
                f"{file}: {lines.place(first)}: {stands} stands under "
                f"'{lines.columns[name].header}', where a number below {LARGEST_NUMBER:g} is "
                f"needed ({int(bad.sum())} such cells in the column); "
                f"{_remedy(bad, lines.columns[name])}."
            )
    return samples_of(lines)


def required(lines: Lines) -> list[str]:
    """The quantities among the lines' columns that no record can do without."""
    return [name for name, found in lines.columns.items() if found.quantity.is_required]


def samples_of(lines: Lines) -> Samples:
    """The samples of lines that have a finite time, current and voltage throughout."""
    columns = lines.columns
    notes = list(lines.table.notes) + [_unit_note(found) for found in columns.values()]
    temperature, temperature_notes = _optional(lines, "temperature")
    step, step_notes = _optional(lines, "step")
    if step is not None and np.any((step != np.round(step)) | (np.abs(step) > _LARGEST_STEP)):
        step, step_notes = None, ["the step numbers are not whole numbers and are left out"]
    return Samples(
        file=lines.file,
        time_s=lines.values["time"],
        current_a=lines.values["current"],
        voltage_v=lines.values["voltage"],
        temperature_degc=temperature,
        step=None if step is None else step.astype(int),
        counters=Counters(
            _optional(lines, "charging capacity")[0],
            _optional(lines, "discharging capacity")[0],
            _optional(lines, "net capacity")[0],
        ),
        row=lines.row,
        sheet=lines.sheet,
        sheets=lines.sheets,
        names={name: found.header for name, found in columns.items()},
        dialect=dialect_of(lines.table.header),
        warnings=tuple(note for note in [*notes, *temperature_notes, *step_notes] if note),
    )


def _remedy(is_bad: Bool[np.ndarray, "lines"], found: Column) -> str:
    if is_bad.all():
        return f"give the whole column as plain numbers in {found.unit.symbol}"
    return "delete the row, or fill it from the tester's own file"


def _unit_note(found: Column) -> str:
    if found.is_unit_assumed:
        return f"column '{found.header}' names no unit; {found.unit.symbol} is assumed"
    if found.unit != found.quantity.base_unit:
        base = found.quantity.base_unit.symbol
        return f"column '{found.header}' converted from {found.unit.symbol} to {base}"
    return ""


def _optional(lines: Lines, name: str) -> tuple[np.ndarray | None, list[str]]:
    """An optional column if it is there whole, else nothing and the reason."""
    if name not in lines.values:
        return None, []
    if lines.bad(name).any():
        return None, [f"column '{lines.columns[name].header}' has gaps and is left out"]
    return lines.values[name], []

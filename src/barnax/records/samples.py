"""A table's columns turned into numbers in s, A, V, before sign and hold are known."""

from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from ..errors import InputError
from .columns import Column, Dialect, dialect_of, require_columns
from .table import Table


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
        return _place(int(self.row[sample]), int(self.sheet[sample]), self.sheets)

    def warn(self, *messages: str) -> "Samples":
        """The same samples with more warnings."""
        return replace(self, warnings=self.warnings + messages)

    def keep(self, mask: Bool[np.ndarray, "samples"]) -> "Samples":
        """The samples where `mask` holds."""
        chosen = {
            name: values[mask]
            for name, values in vars(self).items()
            if isinstance(values, np.ndarray)
        }
        counters = Counters(
            **{
                name: None if values is None else values[mask]
                for name, values in vars(self.counters).items()
            }
        )
        return replace(self, counters=counters, **chosen)


def take_samples(table: Table, file: str) -> Samples:
    """The samples of a table whose columns are known by their names.

    Blank lines are passed over. Raises InputError when time, current or voltage is missing, is
    no number, or is not finite.
    """
    columns = require_columns(table.header, file)
    sheets = tuple(name for name, _ in table.sheets)
    lines = {name: _numbers(table.columns[found.index], found) for name, found in columns.items()}
    required = [name for name, found in columns.items() if found.quantity.is_required]
    is_blank = np.all([column.is_null().to_numpy() for column in table.columns], axis=0)
    for name in required:
        bad = ~np.isfinite(lines[name]) & ~is_blank
        if bad.any():
            first = int(np.argmax(bad))
            cell = table.columns[columns[name].index][first]
            place = _place(int(table.row[first]), int(table.sheet_of_line[first]), sheets)
            raise InputError(
                f"{file}: {place}: {'nothing' if cell is None else repr(cell)} stands under "
                f"'{columns[name].header}', where a finite number is needed "
                f"({int(bad.sum())} such cells in the column); "
                f"{_remedy(bad[~is_blank], columns[name])}."
            )
    kept = {name: values[~is_blank] for name, values in lines.items()}
    notes = list(table.notes) + [_unit_note(found) for found in columns.values()]
    temperature, temperature_notes = _optional(kept, columns, "temperature")
    step, step_notes = _optional(kept, columns, "step")
    if step is not None and np.any(step != np.round(step)):
        step, step_notes = None, ["the step numbers are not whole numbers and are left out"]
    return Samples(
        file=file,
        time_s=kept["time"],
        current_a=kept["current"],
        voltage_v=kept["voltage"],
        temperature_degc=temperature,
        step=None if step is None else step.astype(int),
        counters=Counters(
            _optional(kept, columns, "charging capacity")[0],
            _optional(kept, columns, "discharging capacity")[0],
            _optional(kept, columns, "net capacity")[0],
        ),
        row=table.row[~is_blank],
        sheet=table.sheet_of_line[~is_blank],
        sheets=sheets,
        names={name: found.header for name, found in columns.items()},
        dialect=dialect_of(table.header),
        warnings=tuple(note for note in [*notes, *temperature_notes, *step_notes] if note),
    )


def _remedy(is_bad: Bool[np.ndarray, "lines"], found: Column) -> str:
    if is_bad.all():
        return f"give the whole column as plain numbers in {found.unit.symbol}"
    return "delete the row, or fill it from the tester's own file"


def _place(row: int, sheet: int, sheets: tuple[str, ...]) -> str:
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


def _unit_note(found: Column) -> str:
    if found.is_unit_assumed:
        return f"column '{found.header}' names no unit; {found.unit.symbol} is assumed"
    if found.unit != found.quantity.base_unit:
        base = found.quantity.base_unit.symbol
        return f"column '{found.header}' converted from {found.unit.symbol} to {base}"
    return ""


def _optional(
    kept: dict[str, np.ndarray], columns: dict[str, Column], name: str
) -> tuple[np.ndarray | None, list[str]]:
    """An optional column if it is there whole, else nothing and the reason."""
    if name not in kept:
        return None, []
    if not np.all(np.isfinite(kept[name])):
        return None, [f"column '{columns[name].header}' has gaps and is left out"]
    return kept[name], []

"""One current and many cell voltages in one file: a record of their mean, and each beside it."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float

from ..errors import InputError, listed
from .cell_values import numbers
from .column_rules import QUANTITY_OF
from .columns import columns_of, named_column, normal
from .quantities import CELL_RANGE_V
from .read import read_record
from .record import Record
from .source import Source

VOLTAGE = QUANTITY_OF["voltage"]
# The column of the mean, under a name that no file has.
MEAN = "mean of the cell voltages"
# A voltage without a unit that is so large is in mV.
MILLIVOLTS = 500.0
FEWEST = 2


@dataclass(frozen=True, eq=False)
class PackRecord:
    """A record of the mean cell voltage, and what every cell's is above it at each of its samples.

    `left_out` are the cells whose voltages cannot be used, each with the reason.
    """

    record: Record
    cells: tuple[str, ...]
    beside_v: Float[np.ndarray, "samples cells"]
    left_out: Mapping[str, str]


def read_pack(source: Source, cells: str | None = None, **reading: Any) -> PackRecord:
    """The pack in a table with one current and several cell voltages.

    Args:
        source: The table.
        cells: Names of the columns of cell voltages, as patterns such as "V*", with commas between
            several; None finds them: numbered alike, and within what a cell has.
        reading: How it is read, as `read_record` takes it.

    Raises `InputError` where fewer than two cells are found, or several sets of them.
    """
    table = source.table
    columns = _voltages(source, cells)
    names = list(columns)
    values_v = np.column_stack([columns[name] for name in names])
    low_v, high_v = CELL_RANGE_V
    left_out = {}
    for place, name in enumerate(names):
        bad = np.flatnonzero(~np.isfinite(values_v[:, place]))
        middle_v = np.nanmedian(values_v[:, place]) if len(bad) < len(values_v) else np.nan
        if len(bad):
            left_out[name] = f"no number in {len(bad)} rows, the first row {table.row[bad[0]]}"
        elif not low_v < middle_v < high_v:
            left_out[name] = f"a median of {middle_v:.4g} V, which no cell has"
    used = [place for place, name in enumerate(names) if name not in left_out]
    if len(used) < FEWEST:
        raise InputError(
            f"{source.name}: fewer than two cells have voltages that can be used "
            f"({'; '.join(f'{name}: {why}' for name, why in left_out.items())}); name others with "
            "`cells`"
        )
    values_v = values_v[:, used]
    mean_v = values_v.mean(axis=1)
    own = [place for place, name in enumerate(table.header) if name not in columns]
    alone = replace(
        table,
        header=(*(table.header[place] for place in own), MEAN),
        columns=(*(table.columns[place] for place in own), pl.Series(MEAN, mean_v)),
    )
    given = {**source.columns, "voltage": f"{MEAN}:V"}
    record = read_record(replace(source, table=alone, columns=given), **reading)
    lines = np.searchsorted(table.row, record.row)
    if np.any(np.diff(table.row) <= 0) or np.any(table.row[lines] != record.row):
        raise InputError(f"{source.name}: its rows are not in order; give one sheet of them")
    beside_v = (values_v - mean_v[:, None])[lines]
    return PackRecord(record, tuple(names[place] for place in used), beside_v, left_out)


def _voltages(source: Source, pattern: str | None) -> dict[str, Float[np.ndarray, "lines"]]:
    """The columns of cell voltages by name, in V."""
    header = source.table.header
    if pattern is not None:
        wanted = [part.strip() for part in pattern.split(",")]
        names = [name for name in header if any(fnmatchcase(name, part) for part in wanted)]
        if len(names) < FEWEST:
            raise InputError(
                f"{source.name}: `cells` {pattern!r} fits {listed(names) or 'no column'}; there "
                f"are {listed(header)}"
            )
        return {name: _in_volts(source, name) for name in names}
    taken = {column.header for name, column in columns_of(header, source.columns).items()
             if name != "voltage"}  # fmt: skip
    alike: dict[str, dict[str, np.ndarray]] = {}
    for name in header:
        if name in taken or not re.search(r"\d", name):
            continue
        values_v = _in_volts(source, name)
        known_v = values_v[np.isfinite(values_v)]
        # A sensor that has failed leaves the others of its kind.
        if len(known_v) and CELL_RANGE_V[0] < np.median(known_v) < CELL_RANGE_V[1]:
            alike.setdefault(re.sub(r"\d+", "#", normal(name)), {})[name] = values_v
    sets = [own for own in alike.values() if len(own) >= FEWEST]
    if len(sets) != 1:
        found = " or ".join(listed(own) for own in sets)
        problem = (
            f"the cell voltages may be {found}" if sets else "no columns of cell voltages found"
        )
        whole = "" if sets else "; for the voltage of a whole pack, identify with `series`"
        raise InputError(
            f"{source.name}: {problem}; name them with `cells`, such as 'V*'{whole}; its columns "
            f"are {listed(header)}"
        )
    (kind,) = (key for key, own in alike.items() if own is sets[0])
    names = [n for n in header if n not in taken and re.sub(r"\d+", "#", normal(n)) == kind]
    return {name: _in_volts(source, name) for name in names}


def _in_volts(source: Source, name: str) -> Float[np.ndarray, "lines"]:
    column = named_column(source.table.header, VOLTAGE, name)
    if column is None:
        return np.full(len(source.table.row), np.nan)
    values_v = numbers(source.table.columns[column.index], column)
    known = values_v[np.isfinite(values_v)]
    if column.is_unit_assumed and len(known) and np.median(np.abs(known)) > MILLIVOLTS:
        values_v = values_v / 1000
    return values_v

"""One current and many cell voltages in one file: a record of their mean, and each beside it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float

from ..errors import InputError, listed
from .columns import Header
from .lag import Scan, aligned, find_scan
from .quantities import CELL_RANGE_V
from .read import read_record
from .record import Record
from .source import Source
from .table import FEWEST_CELLS

# The column of the mean, under a name that no file has.
MEAN = "mean of the cell voltages"


@dataclass(frozen=True, eq=False)
class PackRecord:
    """A record of the mean cell voltage, and what every cell's is above it at each of its samples.

    `source` is the table of the record; `left_out` are the cells whose voltages cannot be used,
    each with the reason. `scan` has the lag of every cell where they were measured one after
    another; the voltages are as if all had the lag of the record.
    """

    source: Source
    record: Record
    cells: tuple[str, ...]
    beside_v: Float[np.ndarray, "samples cells"]
    left_out: Mapping[str, str]
    scan: Scan | None = None


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
    if len(used) < FEWEST_CELLS:
        raise InputError(
            f"{source.name}: fewer than two cells have voltages that can be used "
            f"({'; '.join(f'{name}: {why}' for name, why in left_out.items())}); name others with "
            "`cells`"
        )
    values_v = values_v[:, used]
    mean_v = values_v.mean(axis=1)
    all_columns = zip(table.header.names, table.columns, strict=True)
    others = [(name, cells) for name, cells in all_columns if name not in columns]
    names_beside, cells_beside = zip(*others, (MEAN, pl.Series(MEAN, mean_v)), strict=True)
    given = {**table.header.given, "voltage": f"{MEAN}:V"}
    alone = replace(table, header=Header(names_beside, given), columns=cells_beside)
    of_mean = replace(source, table=alone)
    lag_s = reading.get("voltage_lag")
    how: dict[str, Any] = {**reading, "voltage_lag": 0.0}
    logged = read_record(of_mean, **how)
    lines = np.searchsorted(table.row, logged.row)
    if np.any(np.diff(table.row) <= 0) or np.any(table.row[lines] != logged.row):
        raise InputError(f"{source.name}: its rows are not in order; give one sheet of them")
    cells_v = values_v[lines]
    scan = find_scan(logged, cells_v) if lag_s is None else None
    if scan is not None:
        cells_v, lag_s = scan.aligned_v(logged, cells_v), float(np.mean(scan.lag_s))
    beside_v = cells_v - mean_v[lines][:, None]
    names = tuple(names[place] for place in used)
    return PackRecord(of_mean, aligned(logged, lag_s), names, beside_v, left_out, scan)


def _voltages(source: Source, pattern: str | None) -> dict[str, Float[np.ndarray, "lines"]]:
    """The columns of cell voltages by name, in V."""
    header = source.table.header.names
    if pattern is not None:
        wanted = [part.strip() for part in pattern.split(",")]
        names = [name for name in header if any(fnmatchcase(name, part) for part in wanted)]
        if len(names) < FEWEST_CELLS:
            raise InputError(
                f"{source.name}: `cells` {pattern!r} fits {listed(names) or 'no column'}; there "
                f"are {listed(header)}"
            )
        return {name: source.table.in_volts(name) for name in names}
    sets = source.table.cell_voltages
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
    return sets[0]

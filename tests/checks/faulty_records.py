"""The bundled records with one fault each, and their diagnoses."""

import numpy as np
import polars as pl

from barnax.bundled import bundled_file
from barnax.checks import check_file

TIME, CURRENT, VOLTAGE = "Test Time / s", "Current / A", "Voltage / V"
CAPACITY_AH = 2.0


def frame(name="identification"):
    """A bundled record as a table."""
    return pl.read_parquet(bundled_file(name))


def changed(table, column, values, rows=None):
    """The table with other values in a column, throughout or at some places (from 0)."""
    if rows is not None:
        column_values = table[column].to_numpy().copy()
        column_values[rows] = values
        values = column_values
    return table.with_columns(pl.Series(column, values, strict=False))


def diagnosed(folder, table, *, name="cell.csv", **options):
    """The diagnosis of a table written to a file."""
    path = folder / name
    table.write_parquet(path) if name.endswith(".parquet") else table.write_csv(path)
    return check_file(path, **options)


def found(diagnosis, check):
    """The only finding of a check."""
    (finding,) = [finding for finding in diagnosis.findings if finding.check == check]
    return finding


def counting(diagnosis):
    """The checks that found more than a note, and how severe it is."""
    return {finding.check: finding.severity for finding in diagnosis.findings if finding.counts}


def with_counters(table, scale=1.0):
    """The table with a tester's counters, under the forward hold of the bundled records."""
    time_h, current_a = table[TIME].to_numpy() / 3600, table[CURRENT].to_numpy()
    moved = np.concatenate([[0], current_a[:-1] * np.diff(time_h)]) * scale
    return table.with_columns(
        pl.Series("Charging Capacity / Ah", np.cumsum(np.maximum(moved, 0))),
        pl.Series("Discharging Capacity / Ah", np.cumsum(np.maximum(-moved, 0))),
    )

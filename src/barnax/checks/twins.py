"""Columns that hold one quantity twice and disagree: a voltage at the leads, a current in mA."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ..records.columns import Column, find_columns, likely_column
from ..records.findings import Finding
from ..records.quantities import QUANTITIES
from ..records.read import Source
from ..records.table import Table, take_lines
from .check_input import CheckInput

# Two voltages differ by a lead where the current explains so much of their difference, which it
# moves by so many volts; currents differ where they are proportional to within a percent, but not
# equal to within one.
_EXPLAINED, _LEAST_V = 0.8, 3e-3
_PROPORTIONAL, _EQUAL = 0.999, 0.01
_MOST_NAMES = 200

Channel = Float[np.ndarray, "samples"]


def find_twins(source: Source, given: CheckInput) -> Iterator[Finding]:
    """Other columns of voltage and current that differ as only a wrong one does.

    What the user has named is the right one.
    """
    table = source.table
    for name, judge in (("voltage", _lead), ("current", _scale)):
        if name in source.columns:
            continue
        own = getattr(given.samples, f"{name}_{'v' if name == 'voltage' else 'a'}")
        for column in _others(table, name, given.samples.columns[name]):
            lines = take_lines(table, {name: column})
            rows = given.samples.row
            at = np.minimum(np.searchsorted(lines.row, rows), len(lines.row) - 1)
            if len(given.samples.table.sheets) > 1 or np.any(lines.row[at] != rows):
                continue
            values = lines.values[name][at]
            if np.isfinite(values).all() and np.ptp(values) > 0:
                yield from judge(given, own, values, column)


def _others(table: Table, name: str, own: Column) -> Iterator[Column]:
    """Further columns that can hold the quantity, by their names."""
    (quantity,) = [each for each in QUANTITIES if each.name == name]
    for index, header in enumerate(table.header[:_MOST_NAMES]):
        found = find_columns([header], QUANTITIES)
        column = found.get(name) or (None if found else likely_column(quantity, [header]))
        if column is not None and index != own.index and header != own.header:
            yield replace(column, index=index)


def _lead(given: CheckInput, own: Channel, other: Channel, column: Column) -> Iterator[Finding]:
    """A voltage that differs by the current times a resistance."""
    apart_v = other - own
    current_a = given.samples.current_a - given.samples.current_a.mean()
    slope = float(current_a @ apart_v / (current_a @ current_a))
    swing_v = abs(slope) * float(np.ptp(current_a))
    left_v = apart_v - apart_v.mean() - slope * current_a
    if swing_v > _LEAST_V and left_v.var() < (1 - _EXPLAINED) * apart_v.var():
        header = given.samples.header("voltage")
        what = (
            f"the voltages '{header}' and '{column.header}' differ by {1e3 * abs(slope):.3g} mohm "
            f"times the current, up to {1e3 * swing_v:.3g} mV: one of them holds the drop of the "
            f"leads, and R0 with it; '{header}' is used"
        )
        yield given.at(int(np.argmax(np.abs(apart_v))), "warning", what, _remedy(column))


def _scale(given: CheckInput, own: Channel, other: Channel, column: Column) -> Iterator[Finding]:
    """A current that is another by a factor."""
    size = float(np.sqrt((own @ own) * (other @ other)))
    if not size or abs(own @ other) < _PROPORTIONAL * size:
        return
    ratio = float(own @ other / (own @ own))
    if abs(ratio - 1) > _EQUAL:
        header = given.samples.header("current")
        what = (
            f"the currents '{header}' and '{column.header}' disagree: the second is {ratio:.4g} "
            f"times the first throughout; '{header}' is used"
        )
        yield given.at(int(np.argmax(np.abs(own))), "warning", what, _remedy(column))


def _remedy(other: Column) -> str:
    return f"`columns='{other.quantity.name}={other.header}'` takes the other"

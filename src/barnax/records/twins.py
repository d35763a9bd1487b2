"""Columns that hold one quantity twice and disagree: two voltages, or currents by a factor."""

import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ..notices import Notice, notice
from .column_rules import in_volts
from .columns import Column, find_columns, likely_column, normal
from .quantities import CELL_RANGE_V, QUANTITIES
from .samples import Samples
from .source import Source
from .table import Table, found_at, take_lines

Channel = Float[np.ndarray, "samples"]

# Makes whose names have no rule for which of two voltage columns comes first.
_ANYBODYS = ("plain", "Battery Data Format", "PyBaMM")
_TINY = 1e-30
# A set point, or a statistic of measured values, is no second measurement.
_NOT_MEASURED = re.compile(r"\b(set|max|min|limit|target|end|start|cut|mean|avg|average)")
# Two voltages differ by a lead where the current explains so much of their difference, which it
# moves by so many volts; currents differ where they are proportional to within a percent, but not
# equal to within one.
_BY_LEADS, _LEAST_V = 0.8, 3e-3
_PROPORTIONAL, _EQUAL = 0.999, 0.01
# Two voltages of one cell agree to so much; what is further apart and looks unlike is another's.
_SAME_V, _OTHER_V, _ALIKE = 5e-3, 0.2, 0.9
_MAX_NAMES = 200


def examine_twins(source: Source, samples: Samples) -> Iterator[Notice]:
    """Other columns of voltage and current that differ as only a wrong one does.

    What the user has named is the right one, and a pack has voltages of other cells.
    """
    table, rows = source.table, samples.row
    if len(table.sheets) > 1:
        return
    yield from _electrode(source, samples)
    for name, own, judge in (
        ("voltage", samples.voltage_v, _voltages),
        ("current", samples.current_a, _scale),
    ):
        if name in source.columns or (name == "voltage" and source.series > 1):
            continue
        for column in _others(table, name, samples.columns[name]):
            lines = take_lines(table, {name: column})
            at = np.minimum(np.searchsorted(lines.row, rows), len(lines.row) - 1)
            if np.any(lines.row[at] != rows):
                continue
            values = lines.values[name][at]
            if np.isfinite(values).all() and np.ptp(values) > 0:
                yield from judge(samples, own, values, column)


def _electrode(source: Source, samples: Samples) -> Iterator[Notice]:
    """A note where the voltage is that of a working electrode, and the cell's is another."""
    column = samples.header("voltage")
    names = {re.sub("[<>]", "", normal(name)): name for name in source.table.header}
    other = names.get("ewe-ece/v") or names.get("ece/v")
    if other is None or "voltage" in source.columns or column != names.get("ewe/v"):
        return
    other_v = in_volts(source.table, other)[samples.at]
    apart_v = np.abs(other_v if other == names.get("ece/v") else samples.voltage_v - other_v)
    if np.any(apart_v > _SAME_V):
        yield notice("twin-columns.electrode", column=column, apart_v=np.nanmax(apart_v))


def _others(table: Table, name: str, own: Column) -> Iterator[Column]:
    """Further columns that can hold the quantity, by their names."""
    (quantity,) = [quantity for quantity in QUANTITIES if quantity.name == name]
    for index, header in enumerate(table.header[:_MAX_NAMES]):
        found = find_columns([header], QUANTITIES)
        column = found.get(name) or (None if found else likely_column(quantity, [header]))
        is_other = index != own.index and header != own.header
        if column is not None and is_other and not _NOT_MEASURED.search(normal(header)):
            yield replace(column, index=index)


def _voltages(samples: Samples, own: Channel, other: Channel, column: Column) -> Iterator[Notice]:
    """A voltage that differs by the current times a resistance, or otherwise."""
    if not CELL_RANGE_V[0] < np.median(other) < CELL_RANGE_V[1]:
        return
    apart_v = other - own
    header, at = samples.header("voltage"), int(np.argmax(np.abs(apart_v)))
    current_a = samples.current_a - samples.current_a.mean()
    slope = float(current_a @ apart_v / max(current_a @ current_a, _TINY))
    swing_v = abs(slope) * float(np.ptp(current_a))
    left_v = apart_v - apart_v.mean() - slope * current_a
    both = {"own": header, **_other(column)}
    if swing_v > _LEAST_V and left_v.var() < (1 - _BY_LEADS) * apart_v.var():
        drop = {"leads_ohm": abs(slope), "apart_v": swing_v}
        yield found_at(samples, at, "twin-columns.leads", **both, **drop)
        return
    usual_v = float(np.median(np.abs(apart_v)))
    if usual_v <= _SAME_V:
        return
    if samples.dialect.name in _ANYBODYS and "voltage" in find_columns([column.header], QUANTITIES):
        yield found_at(samples, at, "twin-columns.undecided", **both, apart_v=usual_v)
    elif usual_v < _OTHER_V and _likeness(own - own.mean(), other - other.mean()) > _ALIKE:
        yield found_at(samples, at, "twin-columns.voltage", **both, apart_v=usual_v)


def _likeness(own: Channel, other: Channel) -> float:
    """The cosine between two channels; zero where one is."""
    return float(own @ other) / max(float(np.sqrt((own @ own) * (other @ other))), _TINY)


def _scale(samples: Samples, own: Channel, other: Channel, column: Column) -> Iterator[Notice]:
    """A current that is another by a factor."""
    ratio = float(own @ other) / max(float(own @ own), _TINY)
    if abs(_likeness(own, other)) > _PROPORTIONAL and abs(ratio - 1) > _EQUAL:
        header = samples.header("current")
        given, at = {"own": header, **_other(column), "ratio": ratio}, int(np.argmax(np.abs(own)))
        yield found_at(samples, at, "twin-columns.current", **given)


def _other(column: Column) -> dict[str, str]:
    return {"other": column.header, "quantity": column.quantity.name}

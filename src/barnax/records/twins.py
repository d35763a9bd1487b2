"""Columns that hold one quantity twice, and may disagree: two voltages, or currents by a factor."""

import re
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ..notices import Notice
from .columns import Column, Header, normal
from .counters import cosine
from .quantities import CELL_RANGE_V, QUANTITIES, QUANTITY_OF
from .samples import Samples
from .source import Source
from .table import found_at, take_lines

Channel = Float[np.ndarray, "samples"]

# Makes whose names have no rule for which of two voltage columns comes first.
_ANYBODYS = ("plain", "Battery Data Format", "PyBaMM")
_TINY = 1e-30
# A set point, or a statistic of measured values, is no second measurement.
_NOT_MEASURED = re.compile(r"\b(set|max|min|limit|target|end|start|cut|mean|avg|average)")
# Two voltages differ by a lead where the current explains so much of their difference, which it
# moves by so many volts; currents differ where they are proportional to within a percent, but not
# equal to within one.
_BY_LEADS, _SWING_V = 0.8, 3e-3
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
    for name, judge in (("voltage", _voltages), ("current", _currents)):
        if name in table.header.given or (name == "voltage" and source.series > 1):
            continue
        for column in _others(table.header, name, samples.columns[name]):
            lines = take_lines(table, {name: column})
            at = np.minimum(np.searchsorted(lines.row, rows), len(lines.row) - 1)
            if np.any(lines.row[at] != rows):
                continue
            values = lines.values[name][at]
            if np.isfinite(values).all() and np.ptp(values) > 0:
                yield from judge(samples, samples.values[name], values, column.header)


def _electrode(source: Source, samples: Samples) -> Iterator[Notice]:
    """A note where the voltage is that of a working electrode, and the cell's is another."""
    column = samples.header("voltage")
    header = source.table.header
    names = {re.sub("[<>]", "", normal(name)): name for name in header.names}
    other = names.get("ewe-ece/v") or names.get("ece/v")
    is_electrode = re.fullmatch("<?ewe>?/v", normal(column))
    if other is None or "voltage" in header.given or not is_electrode:
        return
    other_v = source.table.in_volts(other)[samples.at]
    apart_v = np.abs(other_v if other == names.get("ece/v") else samples.voltage_v - other_v)
    if np.any(apart_v > _SAME_V):
        yield Notice("twin-columns.electrode", {"column": column, "apart_v": np.nanmax(apart_v)})


def _others(header: Header, quantity: str, own: Column) -> Iterator[Column]:
    """Further columns that can hold the quantity, by their names."""
    for index, name in enumerate(header.names[:_MAX_NAMES]):
        if index == own.index or name == own.header or _NOT_MEASURED.search(normal(name)):
            continue
        alone = Header((name,))
        columns = alone.find(QUANTITIES)
        likely = [] if columns else alone.likely(QUANTITY_OF[quantity])
        for column in [columns[quantity]] if quantity in columns else likely:
            yield replace(column, index=index)


def _voltages(samples: Samples, own: Channel, other: Channel, name: str) -> Iterator[Notice]:
    """A voltage that differs by the current times a resistance, or otherwise."""
    if not CELL_RANGE_V[0] < np.median(other) < CELL_RANGE_V[1]:
        return
    apart_v = other - own
    at = int(np.argmax(np.abs(apart_v)))
    current_a = samples.current_a - samples.current_a.mean()
    slope = float(current_a @ apart_v / max(current_a @ current_a, _TINY))
    swing_v = abs(slope) * float(np.ptp(current_a))
    left_v = apart_v - apart_v.mean() - slope * current_a
    both = {"own": samples.header("voltage"), "other": name, "quantity": "voltage"}
    if swing_v > _SWING_V and left_v.var() < (1 - _BY_LEADS) * apart_v.var():
        drop = {"by": "leads", "leads_ohm": abs(slope), "apart_v": swing_v}
        yield found_at(samples, at, "twin-columns.differ", **both, **drop)
        return
    usual_v = float(np.median(np.abs(apart_v)))
    if usual_v <= _SAME_V:
        return
    if samples.dialect.name in _ANYBODYS and "voltage" in Header((name,)).find(QUANTITIES):
        yield found_at(samples, at, "twin-columns.undecided", **both, apart_v=usual_v)
    elif usual_v < _OTHER_V and cosine(own - own.mean(), other - other.mean()) > _ALIKE:
        yield found_at(samples, at, "twin-columns.differ", **both, by="volts", apart_v=usual_v)


def _currents(samples: Samples, own: Channel, other: Channel, name: str) -> Iterator[Notice]:
    """A current that is another by a factor."""
    ratio = float(own @ other) / max(float(own @ own), _TINY)
    if abs(cosine(own, other)) > _PROPORTIONAL and abs(ratio - 1) > _EQUAL:
        both = {"own": samples.header("current"), "other": name, "quantity": "current"}
        at = int(np.argmax(np.abs(own)))
        yield found_at(samples, at, "twin-columns.differ", **both, by="factor", ratio=ratio)

"""The rules on the voltage: whether it is in the unit that its name says, and of one cell.

A unit that the user gives is not in doubt.
"""

from typing import Any

import numpy as np

from ..notices import Severity
from .quantities import CELL_RANGE_V
from .samples import Samples
from .table import found_at

# Past 10 V it is no cell but a module, past 1000 V a cell in millivolts, and past 10,000 V no pack
# at all; 100 V is no reading of a single cell.
_MODULE_V, _MILLIVOLT_V, _IMPOSSIBLE_V = 10.0, 1000.0, 100.0
# Volts that were divided by a thousand once too often.
_KILOVOLT_V = 0.01
_NEARLY_ALL = 0.95
# Every reading of a cell in use lies within.
_LEAST_V, _FULL_V = 1.5, 5.0
# The voltage by which cells in series are counted.
_NOMINAL_V = 3.6


def examine_voltage_unit(samples: Samples) -> Samples:
    """The samples with a voltage in volts, told what was wrong with it."""
    middle_v = samples.middle_v

    def mended(code: str, factor: float, **values: Any) -> Samples:
        given = {"column": samples.header("voltage"), "middle_v": middle_v, **values}
        return samples.telling(0, code, **given).having(voltage=samples.voltage_v * factor)

    current_a, voltage_v = samples.current_a, samples.voltage_v
    low_v, high_v = CELL_RANGE_V
    # With its sign turned, nearly all of it must be a cell's voltage.
    is_swapped = np.mean((-voltage_v >= low_v) & (-voltage_v <= high_v)) > _NEARLY_ALL
    is_cells = _LEAST_V < current_a.min() < current_a.max() < _FULL_V
    is_none = middle_v < _LEAST_V or np.mean(voltage_v < 0) > 1 - _NEARLY_ALL
    if is_cells and is_none and not is_swapped:
        held = {"low_v": current_a.min(), "high_v": current_a.max()}
        samples = mended("voltage-unit.exchanged", 1.0, current=samples.header("current"), **held)
        return samples.having(current=voltage_v, voltage=current_a)
    if middle_v < 0:
        code = "voltage-unit.swapped" if is_swapped else "voltage-unit.negative"
        samples = mended(code, -1.0 if is_swapped else 1.0)
        middle_v = abs(middle_v)
    is_given = samples.columns["voltage"].is_unit_given
    if middle_v > _MILLIVOLT_V and not is_given:
        # Beside a current in milliamperes, that is how the tester was set.
        is_one = middle_v < 1e3 * _MODULE_V
        is_milli = samples.columns["current"].unit.symbol == "mA" and is_one
        rename = samples.columns["voltage"].quantity.name_in("mV")
        given = {"quantity": "voltage", "unit": "mV", "rename": rename}
        if is_milli:
            current = samples.header("current")
            samples = mended("voltage-unit.converted", 1e-3, **given, current=current)
        else:
            several = None if is_one else "true"
            samples = mended("voltage-unit.milli", 1e-3, **given, several=several)
    elif middle_v > _MODULE_V:
        cells = max(2, round(middle_v / _NOMINAL_V))
        samples = mended("voltage-unit.pack", 1 / cells, series=cells)
    elif 0 < middle_v < _KILOVOLT_V and 1e3 * middle_v < CELL_RANGE_V[0]:
        samples = mended("voltage-unit.open", 1.0)
    elif 0 < middle_v < _KILOVOLT_V and not is_given:
        samples = mended("voltage-unit.kilo", 1e3)
    elif voltage_v.min() == voltage_v.max():
        samples = mended("voltage-unit.constant", 1.0)
    return samples


# A cell of LTO is full below the first, one of LFP rests above the second but near empty, and no
# cell goes above the third; most are full at the fourth.
_LTO_V, _LFP_V, _HIGHEST_V, _CHARGED_V = 2.95, 3.0, 4.65, 4.2
_ENDS = (1e-3, 0.5, 0.999)


def examine_series(samples: Samples, series: int) -> Samples:
    """The samples, warned of where no known lithium-ion cell has the voltage of one of those in
    series."""
    low_v, middle_v, high_v = np.quantile(samples.voltage_v, _ENDS)
    if high_v <= _LTO_V or (middle_v >= _LFP_V and high_v <= _HIGHEST_V):
        return samples
    fewest = int(np.ceil(series * high_v / _CHARGED_V))
    most = max(fewest, int(series * middle_v / _NOMINAL_V))
    told = {"series": series, "fewest": fewest, "most": most, "full_v": _CHARGED_V}
    ends = {"low_v": low_v, "high_v": high_v, "column": samples.header("voltage")}
    return samples.telling(0, "series.unlikely", **told, **ends)


def examine_voltage_range(samples: Samples) -> Samples:
    """The samples whose voltage one cell can have, told what the others are."""
    name, (low_v, high_v) = samples.header("voltage"), CELL_RANGE_V
    voltage_v = samples.voltage_v
    outside = (voltage_v < low_v) | (voltage_v > high_v)
    if not outside.any():
        return samples
    impossible = np.abs(voltage_v) > _IMPOSSIBLE_V
    first = int(np.argmax(impossible if impossible.any() else outside))
    beside = np.abs(np.diff(voltage_v, prepend=voltage_v[:1]))
    if voltage_v.min() >= 0 and voltage_v.max() <= high_v and beside[outside].max() < low_v / 2:
        # A cell that loses its contact jumps there.
        at, least_v = int(np.argmin(voltage_v)), voltage_v.min()
        return samples.telling(at, "voltage-unit.half-cell", column=name, least_v=least_v)
    severity: Severity = "error" if impossible.any() else "warning"
    given = {"voltage_v": voltage_v[first], "column": name, "samples": outside.sum()}
    limits = {"low_v": low_v, "high_v": high_v}
    code = "voltage-unit.no-cell" if outside.mean() > 0.5 else "voltage-unit.outside"
    samples = samples.noting(found_at(samples, first, code, **given, **limits).rated(severity))
    # If nearly all is outside, the rest shows nothing either.
    return samples if outside.mean() > 0.5 else samples.keep(~outside)

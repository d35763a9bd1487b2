"""The rules on units: whether voltage, time and current are in those that their names say.

A unit that the user gives is not in doubt. Another is an error where two signs that do not depend
on each other tell it, and a warning where one does.
"""

from typing import Any

import numpy as np

from ..notices import Notice, Severity
from .counters import gain_ah
from .quantities import CELL_RANGE_V
from .samples import Samples, few
from .table import found_at

# Past 10 V it is no cell but a module, past 1000 V a cell in millivolts, and past 10,000 V no pack
# at all; 100 V is no reading of a single cell.
_MODULE_V, _MILLIVOLT_V, _IMPOSSIBLE_V = 10.0, 1000.0, 100.0
# Volts that were divided by a thousand once too often.
_KILOVOLT_V = 0.01
_NEARLY_ALL = 0.95
# The voltage by which cells in series are counted.
_NOMINAL_V = 3.6


def examine_voltage_unit(samples: Samples) -> tuple[Samples, list[Notice]]:
    """The samples with a voltage in volts, and what was wrong with it."""
    middle_v = samples.middle_v
    findings = []

    def mended(code: str, factor: float, **values: Any) -> Samples:
        given = {"column": samples.header("voltage"), "middle_v": middle_v, **values}
        findings.append(found_at(samples, 0, code, **given))
        return samples.having(voltage=samples.voltage_v * factor)

    if middle_v < 0:
        low_v, high_v = CELL_RANGE_V
        turned_v = -samples.voltage_v
        # With its sign turned, nearly all of it must be a cell's voltage.
        is_swapped = np.mean((turned_v >= low_v) & (turned_v <= high_v)) > _NEARLY_ALL
        code = "voltage-unit.swapped" if is_swapped else "voltage-unit.negative"
        samples = mended(code, -1.0 if is_swapped else 1.0)
        middle_v = abs(middle_v)
    is_given = samples.columns["voltage"].is_unit_given
    if middle_v > _MILLIVOLT_V and not is_given:
        # Beside a current in milliamperes, that is how the tester was set.
        is_one = middle_v < 1e3 * _MODULE_V
        is_milli = samples.columns["current"].unit.symbol == "mA" and is_one
        given = _read_as(samples, "voltage", "mV")
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
    return samples, findings


def _read_as(samples: Samples, quantity: str, symbol: str) -> dict[str, str | None]:
    """Values of a notice that a column is in another unit than its name says."""
    column = samples.columns[quantity]
    given = {"column": column.header, "quantity": quantity, "unit": symbol}
    examples = column.quantity.examples
    return {
        **given,
        "rename": f"{examples[0].partition(' / ')[0]} / {symbol}" if examples else None,
    }


def examine_voltage_range(samples: Samples) -> tuple[Samples, list[Notice]]:
    """The samples whose voltage one cell can have, and what the others are."""
    name, (low_v, high_v) = samples.header("voltage"), CELL_RANGE_V
    voltage_v = samples.voltage_v
    outside = (voltage_v < low_v) | (voltage_v > high_v)
    if not outside.any():
        return samples, []
    impossible = np.abs(voltage_v) > _IMPOSSIBLE_V
    first = int(np.argmax(impossible if impossible.any() else outside))
    beside = np.abs(np.diff(voltage_v, prepend=voltage_v[:1]))
    if voltage_v.min() >= 0 and voltage_v.max() <= high_v and beside[outside].max() < low_v / 2:
        # A cell that loses its contact jumps there.
        at, given = int(np.argmin(voltage_v)), {"column": name, "least_v": voltage_v.min()}
        return samples, [found_at(samples, at, "voltage-unit.half-cell", **given)]
    severity: Severity = "error" if impossible.any() else "warning"
    given = {"voltage_v": voltage_v[first], "column": name, "samples": outside.sum()}
    limits = {"low_v": low_v, "high_v": high_v}
    code = "voltage-unit.no-cell" if outside.mean() > 0.5 else "voltage-unit.outside"
    finding = found_at(samples, first, code, **given, **limits).rated(severity)
    # If nearly all is outside, the rest shows nothing either.
    return (samples if outside.mean() > 0.5 else samples.keep(~outside)), [finding]


# A unit, its seconds, and the bulk time that would be too short for any cell if they were seconds.
# Too long is what no whole record comes near; on a plateau, where the voltage stands, it may.
_LONGER = (
    ("days", "d", 86400.0, 0.05),
    ("hours", "h", 3600.0, 0.5),
    ("minutes", "min", 60.0, 40.0),
)
_SLOW_S = 1e4
# The voltage must have moved for that to mean anything, and through more than the steep end.
_TRAVEL_V, _STEEP_BELOW_V = 0.3, 3.0
# Whole seconds in longer units, and how close the median interval comes to them. Past a fifth of a
# second the numbers are as good in seconds.
_SECONDS, _PATTERN, _SHORT_S = (1.0, 2.0, 5.0, 10.0, 30.0), 0.03, 0.2
_LONG_S = 500.0
# Dates from 1900 to 2100 in days, as MATLAB and Excel count them.
_DATENUMS = ((693_962.0, 767_011.0), (20_000.0, 80_000.0))
# No record lasts longer.
_LONGEST_S = 1e8
# Testers sample no faster.
_FINEST_S = 5e-4
_RATIO = 0.15
# Readings of numbers that are too large for seconds; the first where nothing tells which.
_SHORTER = (
    ("milliseconds", "ms", 1e-3),
    ("microseconds", "us", 1e-6),
    ("nanoseconds", "ns", 1e-9),
    ("hours, converted to seconds twice", "", 1 / 3600),
    ("minutes, converted to seconds twice", "", 1 / 60),
)


def examine_time_unit(samples: Samples) -> tuple[Samples, list[Notice]]:
    """The samples with time in s, and whether its column's name was wrong."""
    time = samples.columns["time"]
    suspicion = _too_fast(samples) or _too_slow(samples, time.unit.factor)
    if suspicion is None or time.is_unit_given:
        return samples, []
    words, symbol, factor, severity, reason = suspicion
    given = {**_read_as(samples, "time", symbol), "reading": words, "reason": reason}
    if not symbol:
        given |= {"rename": "divided", "divisor": 1 / factor}
    if severity == "warning":
        return samples, [found_at(samples, 0, "time-unit.doubtful", **given)]
    mended = samples.having(time=samples.time_s * factor)
    return mended, [found_at(samples, 0, "time-unit.wrong", **given)]


_Suspicion = tuple[str, str, float, Severity, str]


def _too_fast(samples: Samples) -> _Suspicion | None:
    interval_s = samples.interval_s
    bulk_s, travel_v = samples.bulk_time
    ratio = _throughput_ratio(samples)
    is_steep = samples.middle_v < _STEEP_BELOW_V or travel_v < 2 * _TRAVEL_V
    is_bare = samples.columns["time"].is_unit_assumed
    for words, symbol, factor, shortest_s in _LONGER:
        is_counted = ratio is not None and abs(ratio * factor - 1) < _RATIO
        if (ratio is not None and not is_counted) or samples.length_s * factor > _LONGEST_S:
            continue
        is_pattern = interval_s < _SHORT_S and _is_whole(interval_s * factor)
        is_fast = 0 < bulk_s < shortest_s and travel_v >= _TRAVEL_V
        # A load in a gap was not logged: its charge is missing, and the unit may be right.
        is_fast &= samples.hidden_v < travel_v / 2
        pattern = f"samples lie {interval_s:.5g} apart, {interval_s * factor:.3g} s if in {words}"
        if ratio is not None:
            severity = "error" if is_pattern or is_fast else "warning"
            reason = f"the current integrates to 1/{1 / ratio:.4g} of the tester's Ah"
            return words, symbol, factor, severity, reason
        first = samples.time_s[0]
        is_dated = symbol == "d" and any(low < first < high for low, high in _DATENUMS)
        is_pattern |= is_bare and _is_bare_pattern(samples.interval_s, factor)
        if is_pattern and (is_fast or (is_dated and interval_s < _FINEST_S)):
            other = "its values are dates in days" if is_dated else _bulk(bulk_s)
            return words, symbol, factor, "error", f"{pattern}; {other}"
        is_mute = bulk_s == 0 or (travel_v < _TRAVEL_V and (is_bare or interval_s < _FINEST_S))
        if is_pattern and is_mute:
            return words, symbol, factor, "warning", pattern
        if is_fast and symbol != "d" and (symbol == "h" or not is_steep):
            return words, symbol, factor, "warning", _bulk(bulk_s)
    return None


def _too_slow(samples: Samples, stated_s: float) -> _Suspicion | None:
    """`stated_s` is how long a unit of time is by the column's name.

    Which unit it is instead is told by the sampling or by the tester's counters, where they do.
    """
    interval_s = samples.interval_s
    bulk_s, travel_v = samples.bulk_time
    ratio = _throughput_ratio(samples)
    units = _SHORTER if stated_s == 1 else (("seconds", "s", 1 / stated_s),)
    if ratio is not None:
        units = [unit for unit in units if abs(ratio * unit[2] - 1) < _RATIO]
        if not units:
            return None
    is_bare = samples.columns["time"].is_unit_assumed
    fitting = [unit for unit in units if _is_whole(interval_s * unit[2], is_bare)]
    words, symbol, factor = (fitting or units)[0]
    reason = f"samples lie {interval_s:.5g} s apart"
    if len(fitting) == 1:
        reason += f", {interval_s * factor:.3g} s if so"
    elif len(units) > 1:
        words += " or a longer unit converted twice"
    # A thousandfold charge alone may be milliamperes, which leave the bulk time as it is.
    if bulk_s > _SLOW_S and travel_v >= _TRAVEL_V and interval_s >= _LONG_S / 10:
        severity = "error" if ratio is not None or len(fitting) == 1 else "warning"
        return words, symbol, factor, severity, f"{reason}; {_bulk(bulk_s)}"
    # A name without a unit says nothing: samples so far apart are in another one.
    if samples.columns["time"].is_unit_assumed and interval_s >= _LONG_S and fitting:
        return words, symbol, factor, "error" if len(fitting) == 1 else "warning", reason
    if bulk_s == 0 and interval_s >= _LONG_S:
        return words, symbol, factor, "warning", reason
    return None


def _is_bare_pattern(interval_s: float, factor: float) -> bool:
    """True where samples lie whole seconds apart in a longer unit, and at no decimal in seconds."""
    whole_s = interval_s * factor
    is_whole = 1 <= round(whole_s) <= 60 and abs(whole_s - round(whole_s)) < 1e-3 * whole_s
    is_decimal = interval_s > 5e-3 and abs(100 * interval_s - round(100 * interval_s)) < 0.05
    return is_whole and not is_decimal


def _is_whole(interval_s: float, is_bare: bool = False) -> bool:
    """True for an interval that testers are set to; with a bare name, for whole seconds."""
    seconds = (*range(1, 61), 0.1, 0.2, 0.5) if is_bare else _SECONDS
    return any(
        abs(interval_s / second - 1) < _PATTERN / (10 if is_bare else 1) for second in seconds
    )


def _bulk(bulk_s: float) -> str:
    return f"in seconds the resistance would be so low that all charge could pass in {bulk_s:.3g} s"


# Charge against the given capacity, in favor of a factor of a thousand either way.
_TOO_MUCH, _TOO_LITTLE = 20.0, 0.01
_MOVED_V = 0.3
# The largest cells made hold a little over 1000 Ah; 500 A is the load of a large one, and a 2 Ah
# cell at 1C reads 2000 in milliamperes. A slow sweep of a small cell gives itself away by its
# ampere-hours instead: 2 Ah read as 2000.
_LOADED_A, _SWING_AH = 500.0, 1500.0
# Far below what any tester resolves; squares of much less are lost.
_LEAST_A = 1e-12
# No cell has less than a tenth of a milliohm; those that come near carry hundreds of amperes.
_LEAST_OHM, _HEAVY_A = 1e-4, 50.0
# Coin cells come near to this one.
_MAX_OHM = 20.0
# So many signs make an error.
_SIGNS = 2


def examine_current_unit(
    samples: Samples, capacity_ah: float | None
) -> tuple[Samples, list[Notice]]:
    """The samples with current in A, and whether its column's name was wrong."""
    if samples.peak_a < _LEAST_A:
        column = samples.header("current")
        return samples, [found_at(samples, 0, "current-unit.zero", column=column)]
    if samples.columns["current"].is_unit_given:
        return samples, []
    for symbol, words, factor, reasons in (
        ("mA", "milliamperes, not amperes", 1e-3, _milliamperes_signs(samples, capacity_ah)),
        ("A", "amperes, not milliamperes", 1e3, _amperes_signs(samples, capacity_ah)),
    ):
        if not reasons:
            continue
        at = int(np.argmax(np.abs(samples.current_a)))
        given = {**_read_as(samples, "current", symbol), "reading": words}
        given["reason"] = "; ".join(reasons)
        if len(reasons) < _SIGNS:
            return samples, [found_at(samples, at, "current-unit.doubtful", **given)]
        mended = samples.having(current=samples.current_a * factor)
        return mended, [found_at(samples, at, "current-unit.wrong", **given)]
    return samples, []


def _amperes_signs(samples: Samples, capacity_ah: float | None) -> list[str]:
    """Signs that a current in mA is a thousand times too small."""
    if samples.columns["current"].unit.factor != 1e-3:
        return []
    signs = []
    ratio = _throughput_ratio(samples)
    _, travel_v = samples.bulk_time
    charge_ah = samples.span_ah
    if ratio is not None:
        if abs(1e3 * ratio - 1) > _RATIO:
            return []
        signs.append(f"it integrates to 1/{1 / ratio:.4g} of the tester's Ah")
    elif capacity_ah and charge_ah <= _TOO_LITTLE * capacity_ah and travel_v >= _MOVED_V:
        moves = f"{charge_ah:.3g} of its {capacity_ah:.4g} Ah move the cell's voltage by"
        signs.append(f"{moves} {travel_v:.2g} V")
    if samples.resistance_ohm > _MAX_OHM:
        signs.append(f"the cell's resistance would be {samples.resistance_ohm:.3g} ohm")
    return signs if len(signs) == _SIGNS or samples.resistance_ohm <= _MAX_OHM else []


def _milliamperes_signs(samples: Samples, capacity_ah: float | None) -> list[str]:
    """Signs that currents are milliamperes under an ampere's name."""
    if samples.columns["current"].unit.factor == 1e-3:
        return []
    magnitude_a = np.abs(few(samples.current_a))
    loaded_a = float(np.median(magnitude_a[magnitude_a > 0.05 * samples.peak_a]))
    moves = f"the record moves {samples.span_ah:.4g} Ah"
    signs = []
    if loaded_a > _LOADED_A:
        signs.append(f"the current under load is {loaded_a:.6g} A")
    elif samples.span_ah > _SWING_AH:
        signs.append(f"{moves} one way")
    ratio = _throughput_ratio(samples)
    if ratio is not None and abs(ratio / 1e3 - 1) < _RATIO:
        signs.append(f"it integrates to {ratio:.4g} times the tester's own ampere-hours")
    if capacity_ah is not None and samples.span_ah > _TOO_MUCH * capacity_ah:
        signs.append(f"{moves} of a cell of {capacity_ah:.4g} Ah")
    if 0 < samples.resistance_ohm < _LEAST_OHM and samples.peak_a > _HEAVY_A:
        signs.append(f"the cell's resistance would be {1e6 * samples.resistance_ohm:.3g} microohm")
    return signs


def _throughput_ratio(samples: Samples) -> float | None:
    """Integrated |I| over what the tester counted in and out, where it counted enough to tell."""
    counted_ah = sum(map(gain_ah, samples.counters.both))
    # A counter printed to 0.1 mAh that moved a few times proves nothing.
    if counted_ah <= 1e-3:
        return None
    return float(np.sum(np.abs(samples.ended_ah))) / counted_ah

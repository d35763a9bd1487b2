"""The rules on units: whether voltage, time and current are in those that their names say.

A unit that the user gives is not in doubt. Another is an error where two signs that do not depend
on each other tell it, and a warning where one does.
"""

import numpy as np

from ..errors import counted
from .counters import gain_ah
from .findings import Finding, Severity
from .quantities import CELL_RANGE_V
from .samples import Samples, few
from .table import found_at

# Past 10 V it is no cell but a module, past 1000 V a cell in millivolts, and past 10,000 V no pack
# at all; 100 V is no reading of a single cell.
_MODULE_V, _MILLIVOLT_V, _IMPOSSIBLE_V = 10.0, 1000.0, 100.0
# A cell's volts divided by a thousand once too often.
_KILOVOLT_V = 0.01
_NEARLY_ALL = 0.95
# What cells in series are counted by.
_NOMINAL_V = 3.6


def examine_voltage_unit(samples: Samples) -> tuple[Samples, list[Finding]]:
    """The samples with a voltage in volts, and what was wrong with it."""
    name = samples.header("voltage")
    middle_v = samples.middle_v
    findings = []

    def mended(what: str, remedy: str, factor: float, severity: Severity = "error") -> Samples:
        what = f"the median voltage in '{name}' is {what}"
        findings.append(found_at(samples, 0, severity, what, remedy))
        return samples.having(voltage=samples.voltage_v * factor)

    if middle_v < 0:
        low_v, high_v = CELL_RANGE_V
        turned_v = -samples.voltage_v
        # Turned, nearly all of it has to be a cell's.
        is_swapped = np.mean((turned_v >= low_v) & (turned_v <= high_v)) > _NEARLY_ALL
        remedy = "turn its sign (the sense leads were swapped), or give the right column"
        if not is_swapped:
            remedy = "give the column of the cell's voltage"
        samples = mended(f"negative, {middle_v:.6g} V", remedy, -1.0 if is_swapped else 1.0)
        middle_v = abs(middle_v)
    is_given = samples.columns["voltage"].is_unit_given
    if middle_v > _MILLIVOLT_V and not is_given:
        # Beside a current in milliamperes, that is how the tester was set.
        is_one = middle_v < 1e3 * _MODULE_V
        is_milli = samples.columns["current"].unit.symbol == "mA" and is_one
        remedy = _read_as(samples, "voltage", "mV")
        what = f"{middle_v:.6g}: millivolts, not volts"
        if is_milli:
            what += f", as '{samples.header('current')}' is in mA; converted"
        if not is_one:
            remedy += ", with the cells in series as `series`"
        samples = mended(what, remedy, 1e-3, "warning" if is_milli else "error")
    elif middle_v > _MODULE_V:
        cells = max(2, round(middle_v / _NOMINAL_V))
        what = f"{middle_v:.6g} V, too much for one cell: about {cells} in series"
        remedy = f"give how many, such as `series={cells}`, or the voltage of one cell"
        samples = mended(what, remedy, 1 / cells)
    elif 0 < middle_v < _KILOVOLT_V and not is_given:
        remedy = "multiply it by 1000, or name the unit that its values have"
        samples = mended(f"{middle_v:.4g} V: kilovolts, not volts", remedy, 1e3)
    return samples, findings


def _read_as(samples: Samples, quantity: str, symbol: str) -> str:
    """How to say that a column is in another unit than its name says."""
    column = samples.columns[quantity]
    if not column.quantity.examples:
        return f"correct the unit of '{column.header}'"
    label = column.quantity.examples[0].partition(" / ")[0]
    option = f"`columns='{quantity}={column.header}:{symbol}'`"
    return (
        f"rename the column to '{label} / {symbol}', or give {option} if that holds for all files"
    )


def examine_voltage_range(samples: Samples) -> tuple[Samples, list[Finding]]:
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
        what = f"the voltage in '{name}' goes down to {voltage_v.min():.4g} V: is it a half cell?"
        return samples, [found_at(samples, int(np.argmin(voltage_v)), "note", what)]
    what = (
        f"{voltage_v[first]:.6g} V in '{name}' is no cell's voltage "
        f"({counted(int(outside.sum()), 'sample')} outside {low_v} to {high_v} V)"
    )
    severity = "error" if impossible.any() else "warning"
    remedy = "correct or delete these rows; `score_from` and `score_to` leave out an end"
    if outside.mean() > 0.5:
        remedy = "give the column of the cell's voltage, in volts"
    finding = found_at(samples, first, severity, what, remedy)
    # Where nearly all is outside, the rest shows nothing either.
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
# MATLAB's dates from 1900 to 2100, in days.
_DATENUMS = (693_962.0, 767_011.0)
# No record lasts longer.
_LONGEST_S = 1e8
# Testers sample no faster.
_FINEST_S = 5e-4
_RATIO = 0.15
# What numbers are that are too large for seconds, the first where nothing tells which.
_SHORTER = (
    ("milliseconds", "ms", 1e-3),
    ("hours, converted to seconds twice", "", 1 / 3600),
    ("minutes, converted to seconds twice", "", 1 / 60),
)


def examine_time_unit(samples: Samples) -> tuple[Samples, list[Finding]]:
    """The samples with time in s, and whether its column's name was wrong."""
    time = samples.columns["time"]
    suspicion = _too_fast(samples) or _too_slow(samples, time.unit.factor)
    if suspicion is None or time.is_unit_given:
        return samples, []
    words, symbol, factor, severity, reason = suspicion
    name = samples.header("time")
    remedy = _read_as(samples, "time", symbol)
    if not symbol:
        remedy = f"divide it by {1 / factor:.0f}"
    if severity == "warning":
        what = f"'{name}' may be in {words}: {reason}"
        return samples, [found_at(samples, 0, severity, what, f"if it is, {remedy}")]
    what = f"'{name}' looks like {words}: {reason}"
    mended = samples.having(time=samples.time_s * factor)
    return mended, [found_at(samples, 0, severity, what, remedy)]


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
        # What moved the voltage in a gap was not logged: its charge is missing, not the unit wrong.
        is_fast &= samples.hidden_v < travel_v / 2
        pattern = f"samples lie {interval_s:.5g} apart, {interval_s * factor:.3g} s if in {words}"
        if ratio is not None:
            severity = "error" if is_pattern or is_fast else "warning"
            reason = f"the current integrates to 1/{1 / ratio:.4g} of the tester's Ah"
            return words, symbol, factor, severity, reason
        is_dated = symbol == "d" and _DATENUMS[0] < samples.time_s[0] < _DATENUMS[1]
        if is_pattern and (is_fast or is_dated):
            other = "its values are MATLAB's dates" if is_dated else _bulk(bulk_s)
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
        units = [each for each in units if abs(ratio * each[2] - 1) < _RATIO]
        if not units:
            return None
    fitting = [each for each in units if _is_whole(interval_s * each[2])]
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
    if bulk_s == 0 and interval_s >= _LONG_S:
        return words, symbol, factor, "warning", reason
    return None


def _is_whole(interval_s: float) -> bool:
    """Whether it is an interval that testers are set to."""
    return any(abs(interval_s / second - 1) < _PATTERN for second in _SECONDS)


def _bulk(bulk_s: float) -> str:
    return f"in seconds the cell's resistance could move its charge in {bulk_s:.3g} s"


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
_MOST_OHM = 20.0
# So many signs make an error.
_SIGNS = 2


def examine_current_unit(
    samples: Samples, capacity_ah: float | None
) -> tuple[Samples, list[Finding]]:
    """The samples with current in A, and whether its column's name was wrong."""
    name = samples.header("current")
    peak_a = samples.peak_a
    if peak_a < _LEAST_A:
        what = f"every current in '{name}' is zero: nothing can be learned from the record"
        remedy = "give the column that holds the measured current"
        return samples, [found_at(samples, 0, "warning", what, remedy)]
    if samples.columns["current"].is_unit_given:
        return samples, []
    for symbol, words, factor, reasons in (
        ("mA", "milliamperes, not amperes", 1e-3, _milliamperes_signs(samples, capacity_ah)),
        ("A", "amperes, not milliamperes", 1e3, _amperes_signs(samples, capacity_ah)),
    ):
        if not reasons:
            continue
        at = int(np.argmax(np.abs(samples.current_a)))
        remedy = _read_as(samples, "current", symbol)
        if len(reasons) < _SIGNS:
            what = f"'{name}' may be in {words}: {reasons[0]}"
            return samples, [found_at(samples, at, "warning", what, f"if it is, {remedy}")]
        what = f"'{name}' looks like {words}: {'; '.join(reasons)}"
        mended = samples.having(current=samples.current_a * factor)
        return mended, [found_at(samples, at, "error", what, remedy)]
    return samples, []


def _amperes_signs(samples: Samples, capacity_ah: float | None) -> list[str]:
    """What tells that a current in mA is a thousand times too small."""
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
    if samples.resistance_ohm > _MOST_OHM:
        signs.append(f"the cell's resistance would be {samples.resistance_ohm:.3g} ohm")
    return signs if len(signs) == _SIGNS or samples.resistance_ohm <= _MOST_OHM else []


def _milliamperes_signs(samples: Samples, capacity_ah: float | None) -> list[str]:
    """What tells that currents are milliamperes under an ampere's name."""
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

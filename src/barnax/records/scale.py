"""Whether the values of columns have the unit and quantity that their names say.

There is one judgement of scale for time, current, charge and voltage in the named units.

A reading in another unit is judged by the witnesses that it reconciles, less those that it
contradicts; a voltage is judged by its values. A unit given by the user is not in doubt.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from ..notices import Notice, Severity
from .cell_values import DAY_S, is_clock
from .columns import Column
from .quantities import CELL_RANGE_V, QUANTITY_OF
from .samples import COUNTERS, Samples
from .witnesses import CERTAIN, CHARGE, LEAST_A, UnitReading, Witness, witnesses_of

Channel = Float[np.ndarray, "samples"]

# A reading is reported as doubtful from this weight on.
_DOUBTFUL = 1.0


def examine_scale(samples: Samples, capacity_ah: float | None = None) -> Samples:
    """The samples in s, A and Ah, with notices of units other than those named or assumed.

    A time whose name has no unit, and a charge, are read in the unit that the witnesses agree on;
    if several remain, the user is asked. `capacity_ah` is a witness too.
    """
    if samples.peak_a < LEAST_A:
        samples = samples.telling(0, "unit.zero", column=samples.header("current"))
    asked = None
    # One unit is wrong, and may have hidden another.
    for _ in range(2):
        best = _best(samples, list(witnesses_of(samples, capacity_ah)))
        if not best:
            break
        samples = _settled(samples, best)
        if samples.findings[-1].values["case"] in ("doubtful", "open", "asked"):
            asked = best[0].quantity
            break
    witnesses = witnesses_of(samples, capacity_ah)
    left = [one for one in witnesses if asked not in one.powers and not one.holds(one.value)]
    if left and samples.columns["time"].is_unit_assumed:
        # No other unit explains it, and none is named.
        reason = "; ".join(dict.fromkeys(one.says for one in left))
        samples = samples.noting(bare_units(samples.columns, reason))
    return _with_unusual(samples)


# Not one in a hundred measured records is this long, or this short with so large a swing of the
# voltage, or has so low a rate; only coin cells have so large a resistance.
_LONG_S, _SHORT_S, _SWUNG_V, _RATE, _COIN_OHM = 50 * DAY_S, 2500.0, 0.6, 1 / 300, 1.0


def _with_unusual(samples: Samples) -> Samples:
    """The samples, with notes of units that are not in doubt but make an unusual record."""
    said = {one.values["quantity"] for one in samples.findings if one.code == "unit.reading"}
    time, current = samples.columns["time"], samples.columns["current"]
    span_ah, ohm, length_s = samples.span_ah, abs(samples.answered_ohm), samples.length_s
    is_slow = length_s > _LONG_S or samples.peak_a < _RATE * span_ah
    is_fast = length_s < _SHORT_S and samples.bulk_time[1] > _SWUNG_V
    is_named = is_clock(samples.table.columns[time.index]) or samples.table.has_fixed_units
    is_named |= time.quantity.name == "date"
    is_small = current.unit.factor < 1 and ohm > _COIN_OHM and not samples.counters.written
    speed = {"length_h": length_s / 3600, "rate": samples.peak_a / max(span_ah, LEAST_A)}
    cell = {"peak_a": samples.peak_a, "ohm": ohm, "span_ah": span_ah}
    for name, is_unusual, shown in (
        ("time", (is_slow or is_fast) and not is_named, speed),
        ("current", is_small, cell),
    ):
        column = samples.columns[name]
        if is_unusual and not column.is_unit_given and name not in said:
            unit = {"quantity": name, "column": column.header, "unit": column.unit.symbol}
            samples = samples.telling(0, "columns.unit-unusual", **unit, **shown)
    return samples


def _best(samples: Samples, witnesses: Sequence[Witness]) -> list[UnitReading]:
    """The readings with the largest weight; none if the units as they are agree best."""
    readings = []
    for reading in _readings(samples):
        votes = [(witness.vote(reading), witness.says) for witness in witnesses]
        weight = sum(vote for vote, _ in votes)
        reasons = dict.fromkeys(says for vote, says in votes if vote > 0)
        readings.append(replace(reading, weight=weight, reasons=tuple(reasons)))
    most = max((reading.weight for reading in readings), default=0.0)
    best = [reading for reading in readings if reading.weight == most >= _DOUBTFUL]
    # Of two equally good units of the current, the usual one.
    currents = [reading for reading in best if reading.quantity == "current"]
    return [reading for reading in best if reading not in currents[1:]]


def _readings(samples: Samples) -> Iterator[UnitReading]:
    """The other possible units of a quantity, unless the user has given one."""
    time, current = samples.columns["time"], samples.columns["current"]
    # Clock times have no unit, and dates have their own.
    is_number = not is_clock(samples.table.columns[time.index])
    is_number &= time.unit in time.quantity.units.values()
    if is_number and not (time.is_unit_given or samples.table.has_fixed_units):
        for unit in dict.fromkeys(QUANTITY_OF["time"].units.values()):
            if unit != time.unit:
                factor = unit.factor / time.unit.factor
                yield UnitReading("time", ("time",), unit, factor, unit.words)
        if time.unit.factor == 1 and not time.is_unit_assumed:
            twice = "converted to seconds twice"
            yield UnitReading("time", ("time",), None, 1 / 60, f"minutes, {twice}")
            yield UnitReading("time", ("time",), None, 1 / 3600, f"hours, {twice}")
    # By factors, because a current may be given as the charge of every interval.
    units = {unit.factor: unit for unit in QUANTITY_OF["current"].units.values()}
    named = units.pop(current.unit.factor)
    for unit in () if current.is_unit_given else units.values():
        words = f"{unit.words}, not {named.words}"
        yield UnitReading("current", ("current",), unit, unit.factor / named.factor, words)
    names = tuple(name for name in COUNTERS if name in samples.columns)
    counters = [samples.columns[name] for name in names]
    if counters and not any(column.is_unit_given or column.unit.factor != 1 for column in counters):
        unit = QUANTITY_OF["net capacity"].units["mah"]
        yield UnitReading(CHARGE, names, unit, unit.factor, unit.words)


def _settled(samples: Samples, best: list[UnitReading]) -> Samples:
    """The samples in the unit decided on, and the notice of it."""
    reading, kind = best[0], best[0].quantity
    column = samples.columns[reading.names[0]]
    is_free = column.is_unit_assumed and kind != "current"
    symbol = reading.unit.symbol if reading.unit else ""
    values = {
        "column": column.header,
        "quantity": reading.names[0],
        "unit": symbol,
        "reading": reading.words,
        "reason": "; ".join(reading.reasons),
        "rename": column.quantity.name_in(symbol),
        "option": reading.option(samples),
    }
    if not reading.unit:
        values |= {"rename": "divided", "divisor": 1 / reading.factor}
    at = int(np.argmax(np.abs(samples.current_a))) if kind == "current" else 0
    if len(best) > 1 or (reading.weight < CERTAIN and is_free and kind == "time"):
        as_it_is = UnitReading(kind, reading.names, column.unit, 1.0)
        choices = []
        for one in (one for one in (as_it_is, *best) if one.unit is not None):
            apart = f" (samples {samples.apart_s * one.factor:.3g} s apart)"
            is_time = one.quantity == "time"
            choices.append(f"`columns='{one.option(samples)}'`{apart if is_time else ''}")
        values["choices"] = " or ".join(choices)
        return samples.telling(at, "unit.reading", **values, case="asked" if is_free else "open")
    # If only the counters are in another unit, the current determines which.
    if reading.weight < CERTAIN and kind != CHARGE:
        return samples.telling(at, "unit.reading", **values, case="doubtful")
    mended = samples.having(**{n: samples.values[n] * reading.factor for n in reading.names})
    if reading.unit is None or (kind != CHARGE and not is_free):
        return mended.telling(at, "unit.reading", **values, case="wrong")
    columns = dict(samples.columns)
    for name in reading.names:
        columns[name] = replace(columns[name], unit=reading.unit, is_unit_assumed=False)
    mended = replace(mended, columns=columns)
    case = "counted" if kind == CHARGE else "taken"
    return mended.telling(at, "unit.reading", **values, case=case)


# Above 10 V it is a module, above 1000 V a cell in millivolts, above 10,000 V not even a pack; 100
# V is not a single cell.
_MODULE_V, _MILLIVOLT_V, _IMPOSSIBLE_V = 10.0, 1000.0, 100.0
# Volts that were divided by a thousand once too often.
_KILOVOLT_V = 0.01
_NEARLY_ALL = 0.95
# Every reading of a cell in use lies within this range.
_LEAST_V, _FULL_V = 1.5, 5.0
# The voltage by which cells in series are counted.
_NOMINAL_V = 3.6
# A voltage that moves by no more than this is stuck, apart from one digit of noise.
STILL_V = 2e-4


def examine_voltage_unit(samples: Samples) -> Samples:
    """The samples with the voltage of one cell in volts, and notices of what was wrong."""
    middle_v = samples.middle_v

    def mended(code: str, factor: float, **values: Any) -> Samples:
        given = {"column": samples.header("voltage"), "middle_v": middle_v, **values}
        return samples.telling(0, code, **given).having(voltage=samples.voltage_v * factor)

    current_a, voltage_v = samples.current_a, samples.voltage_v
    low_v, high_v = CELL_RANGE_V
    # With its sign reversed, nearly all of it has to be a cell's voltage.
    is_swapped = np.mean((-voltage_v >= low_v) & (-voltage_v <= high_v)) > _NEARLY_ALL
    is_cells = _LEAST_V < current_a.min() < current_a.max() < _FULL_V
    is_none = middle_v < _LEAST_V or np.mean(voltage_v < 0) > 1 - _NEARLY_ALL
    if is_cells and is_none and not is_swapped:
        held = {"low_v": current_a.min(), "high_v": current_a.max()}
        samples = mended("voltage-unit.exchanged", 1.0, current=samples.header("current"), **held)
        return samples.having(current=voltage_v, voltage=current_a)
    if middle_v < 0:
        leads = "swapped" if is_swapped else None
        samples = mended("voltage-unit.negative", -1.0 if is_swapped else 1.0, leads=leads)
        middle_v = abs(middle_v)
    is_given = samples.columns["voltage"].is_unit_given
    if middle_v > _MILLIVOLT_V and not is_given:
        # With a current in milliamperes, the tester was set to such units.
        is_one = middle_v < 1e3 * _MODULE_V
        is_set = samples.columns["current"].unit.symbol == "mA" and is_one
        rename = samples.columns["voltage"].quantity.name_in("mV")
        naming = {"quantity": "voltage", "unit": "mV", "rename": rename, "case": "milli"}
        naming |= {"several": None if is_one else "true", "current": None}
        naming |= {"case": "converted", "current": samples.header("current")} if is_set else {}
        samples = mended("voltage-unit.scaled", 1e-3, **naming)
    elif middle_v > _MODULE_V:
        cells = max(2, round(middle_v / _NOMINAL_V))
        samples = mended("voltage-unit.pack", 1 / cells, series=cells)
    elif 0 < middle_v < _KILOVOLT_V and 1e3 * middle_v < CELL_RANGE_V[0]:
        samples = mended("voltage-unit.open", 1.0)
    elif 0 < middle_v < _KILOVOLT_V and not is_given:
        samples = mended("voltage-unit.scaled", 1e3, case="kilo")
    elif (moved_v := float(np.ptp(voltage_v))) <= STILL_V:
        samples = mended("voltage-unit.constant", 1.0, moved_v=moved_v or None)
    return samples


# A cell of LTO is full below the first voltage, one of LFP rests above the second except near
# empty, and no cell exceeds the third; most are full at the fourth.
_LTO_V, _LFP_V, _HIGHEST_V, _CHARGED_V = 2.95, 3.0, 4.65, 4.2
# Below this, the voltage is already that of one cell.
_LEAST_CELL_V = 1.0
_ENDS = (1e-3, 0.5, 0.999)


def of_one_cell(voltage_v: Channel, series: int) -> Channel:
    """The voltage of one of the cells in series; unchanged if it is already one cell's."""
    finite_v = np.abs(voltage_v[np.isfinite(voltage_v)])
    middle_v = np.median(finite_v) if len(finite_v) else 0.0
    is_one = middle_v <= CELL_RANGE_V[1] and middle_v / series < _LEAST_CELL_V
    return voltage_v if is_one or series == 1 else voltage_v / series


def examine_series(samples: Samples, series: int) -> Samples:
    """The samples with the voltage of one of the cells in series, with a note, and a warning if no
    known lithium-ion cell has it."""
    voltage_v = of_one_cell(samples.voltage_v, series)
    if voltage_v is samples.voltage_v:
        return samples
    values = {"column": samples.header("voltage"), "series": series}
    samples = samples.having(voltage=voltage_v).noting(Notice("series.divided", values))
    low_v, middle_v, high_v = np.quantile(samples.voltage_v, _ENDS)
    # Half of a cell's voltage may also be that of an LTO cell.
    is_lto = middle_v >= _LEAST_V and high_v <= _LTO_V and series * high_v > _HIGHEST_V
    if is_lto or (middle_v >= _LFP_V and high_v <= _HIGHEST_V):
        return samples
    numbers = {"fits": "one", "low_v": low_v, "high_v": high_v, **values}
    if series * high_v > _HIGHEST_V:
        fewest = int(np.ceil(series * high_v / _CHARGED_V))
        most = max(fewest, int(series * middle_v / _NOMINAL_V))
        numbers |= {"fits": "several", "fewest": fewest, "most": most, "full_v": _CHARGED_V}
    return samples.telling(0, "series.unlikely", **numbers)


def examine_voltage_range(samples: Samples) -> Samples:
    """The samples with a voltage that is possible for one cell, and notices of the others."""
    name, (low_v, high_v) = samples.header("voltage"), CELL_RANGE_V
    voltage_v = samples.voltage_v
    outside = (voltage_v < low_v) | (voltage_v > high_v)
    if not outside.any():
        return samples
    impossible = np.abs(voltage_v) > _IMPOSSIBLE_V
    first = int(np.argmax(impossible if impossible.any() else outside))
    step_v = np.abs(samples.step_v)
    beside_v = np.maximum(np.append(0.0, step_v), np.append(step_v, 0.0))[outside]
    if voltage_v.min() >= 0 and voltage_v.max() <= high_v and beside_v.max() < low_v / 2:
        # A cell that loses or regains its contact jumps there.
        at, least_v = int(np.argmin(voltage_v)), voltage_v.min()
        # A voltage that never comes near a half cell's is in another unit.
        rating: Severity = "warning" if voltage_v.max() < low_v / 10 else "note"
        return samples.telling(at, "voltage-unit.half-cell", rating, column=name, least_v=least_v)
    given = {"voltage_v": voltage_v[first], "column": name, "samples": outside.sum()}
    is_most = outside.mean() > 0.5
    given |= {"low_v": low_v, "high_v": high_v, "most": "true" if is_most else None}
    rating = "error" if impossible.any() else "warning"
    samples = samples.telling(first, "voltage-unit.outside", rating, **given)
    # If nearly all is outside, the rest says nothing either.
    return samples if is_most else samples.keep(~outside)


def ask_once(findings: Sequence[Notice], columns: Mapping[str, Column]) -> list[Notice]:
    """The findings, with one error that asks for all missing units if one is asked for and another
    column is in doubt too; with bare millivolts, all are."""
    bare = {column.header for column in columns.values() if column.is_unit_assumed}
    asked, open_too = [], [one for one in findings if one.code == "columns.units"]
    for one in findings:
        case = one.values.get("case")
        is_asked = case == "milli" or (one.code == "unit.reading" and case != "counted")
        if is_asked and one.values["column"] in bare:
            asked.append(one)
    errors = [one for one in asked if one.severity == "error"]
    doubts = {one.values["column"] for one in asked}
    is_milli = any(one.code == "voltage-unit.scaled" for one in errors) and len(bare) > 1
    if not errors or not (is_milli or open_too or len(doubts) > 1):
        return [*findings]
    others = [one for one in findings if one not in (*asked, *open_too)]
    return [bare_units(columns, errors[0].what).rated("error"), *others]


def describe_units(columns: Mapping[str, Column]) -> Iterator[Notice]:
    """Notes of units that were assumed or converted."""
    if any(column.is_unit_assumed for column in columns.values()):
        yield bare_units(columns)
    converted = [
        f"'{column.header}' from {column.unit.symbol} to {column.quantity.base_unit.symbol}"
        for column in columns.values()
        if not column.is_unit_assumed and column.unit != column.quantity.base_unit
    ]
    if converted:
        yield Notice("columns.converted", {"columns": ", ".join(converted)})


def bare_units(columns: Mapping[str, Column], reason: str | None = None) -> Notice:
    """All columns without a unit, with the option that settles them; a warning if there is a reason
    to doubt them."""
    bare = {name: column for name, column in columns.items() if column.is_unit_assumed}
    units = ", ".join(f"{one.unit.symbol} for '{one.header.strip()}'" for one in bare.values())
    option = ",".join(f"{name}={column.header}:UNIT" for name, column in bare.items())
    return Notice("columns.units", {"units": units, "reason": reason, "option": option})

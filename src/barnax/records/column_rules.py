"""The columns of a table that are read, and notices about them.

Finally, columns that measure one quantity twice and may disagree: two voltages, or currents that
differ by a factor.
"""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float

from ..errors import InputError, listed
from ..notices import Notice, raise_first_error
from .cell_values import CLOCKS, DAY_S, epoch_unit, is_clock, numbers
from .columns import Column, Header, normal
from .counters import cosine
from .quantities import NEEDED, QUANTITIES, QUANTITY_OF, Quantity
from .samples import Samples
from .source import Source
from .table import FEWEST_CELLS, Table, is_of_cell, notice_at

Columns = Mapping[str, Column]
Channel = Float[np.ndarray, "samples"]
Apart = dict[str, str | float]

REQUIRED = tuple(quantity for quantity in QUANTITIES if quantity.name in NEEDED)
# Dates that do not change in a larger share of the intervals have too coarse a resolution for a
# clock.
_COARSE_DATES = 0.05
# Number of dates that are examined.
_DATES = 50


def examine_columns(table: Table, file: str) -> tuple[dict[str, Column], list[Notice]]:
    """The columns to use, and notices about them.

    If a required column has no accepted name but one likely candidate, that one is used so that its
    values are checked too. A column that is still missing appears only in the findings. Raises
    InputError if no name resembles that of a record's column.
    """
    header = table.header
    is_mostly = 2 * table.is_impedance.sum() > len(table.row)
    if header.other_table and (is_mostly or not header.is_record):
        raise Notice("columns.no-record", {"table": header.other_table}, file).error(".")
    columns = dict(header.columns)
    wrong = list(_not_there(header, table.names_row, file))
    if table.one_row_a:
        rows = {"table": f"a table of one row a {table.one_row_a}"}
        wrong.insert(0, Notice("columns.no-record", rows))
    is_like = any(one.name in columns or header.likely(one) for one in REQUIRED)
    is_any = is_like or header.is_ocv_table
    is_nameless = not columns.keys() & NEEDED and _is_nameless(table, is_any)
    if not is_like and not is_nameless:
        raise_first_error([*wrong, _no_record(header)], file)
    findings = [*table.notes, *wrong, *_settle_clock(table, columns)]
    charge = columns.pop("charge of the interval", None)
    if charge is not None and "current" not in columns:
        columns["current"] = charge
        findings.append(Notice("columns.interval-charge", {"column": charge.header}))
    findings.extend(_repeated_names(header, table.names_row, columns))
    soc = header.ocv_columns.get("SOC")
    if soc is not None and soc.header not in _headers(columns):
        findings.append(Notice("columns.soc-unused", {"column": soc.header}))
    missing: dict[str, list[str]] = {}
    options = []
    for quantity in [one for one in REQUIRED if one.name not in columns]:
        # A column that another quantity uses is not a candidate.
        taken, option = _headers(columns), f"{quantity.name}=NAME:UNIT"
        likely = [column for column in header.likely(quantity) if column.header not in taken]
        if len(likely) == 1:
            guess = likely[0]
            if quantity.name == "time" and is_clock(table.columns[guess.index]):
                # A date has no unit.
                guess = replace(guess, quantity=QUANTITY_OF["date"], is_unit_assumed=False)
            columns[quantity.name] = guess
            unit = ":UNIT" if guess.is_unit_assumed else ""
            option = f"{quantity.name}={guess.header}{unit}"
        # For a given name, the error is that the table does not have it.
        if quantity.name not in header.given:
            missing[quantity.name] = [column.header for column in likely]
            options.append(option)
    if missing:
        findings.append(_missing_columns(table, missing, is_nameless, ",".join(options)))
    return columns, findings


def _missing_columns(
    table: Table, missing: Mapping[str, Sequence[str]], is_nameless: bool, option: str
) -> Notice:
    """The error for required quantities without a column, with the candidates for each and the
    option that names them."""
    cells = next(map(list, table.cell_voltages), [])
    values: dict[str, Any] = {"quantities": ", ".join(missing), "count": len(missing)}
    values |= {"columns": _quoted(table.header.names)}
    # Two of them may be measurements of the same cell.
    if len(cells) > FEWEST_CELLS and "voltage" in missing and not is_nameless:
        values |= {"cells": _quoted(cells), "first": cells[0]}
        return Notice("columns.pack", values, row=table.names_row)
    are_out = ["discharge" in name.lower() for name in missing.get("current", ())]
    is_pair = len(missing) == 1 and len(are_out) == 2 and sum(are_out) == 1
    values |= {
        "case": "no-names" if is_nameless else "pair" if is_pair else None,
        "likely": "".join(f"; the {one} may be {_quoted(n)}" for one, n in missing.items() if n),
        "option": option,
        "names": ", ".join(f"'{QUANTITY_OF[name].examples[0]}'" for name in missing),
    }
    return Notice("columns.missing", values, row=table.names_row)


def _is_nameless(table: Table, is_like: bool) -> bool:
    """True if half of the first row's cells are numbers, or if no name resembles that of a known
    table, one of them is a number, or the row above the numbers is empty."""
    names = table.header.names
    spelled = pl.Series("names", [name.strip() for name in names] or [""])
    share = spelled.cast(pl.Float64, strict=False).is_not_null().to_numpy().mean()
    cells = zip(names, table.columns, strict=True)
    is_bare = any(not name and column.dtype.is_numeric() for name, column in cells)
    return bool(share >= 0.5 or (not is_like and (share > 0 or is_bare)))


def _not_there(header: Header, row: int, file: str) -> Iterator[Notice]:
    """Warnings about given names that the table does not have, or has in several spellings. Raises
    InputError for a name that is given for several of the required quantities."""
    needed = {name: one.header for name, one in header.given_columns.items() if name in NEEDED}
    for column, times in Counter(needed.values()).items():
        if times > 1:
            names = listed(name for name, one in needed.items() if one == column)
            raise InputError(
                f"{file}: `columns`: '{column}' is given for {names}; name a column for each."
            )
    for name, wanted in header.given.items():
        if name in header.given_columns:
            fitting = header.fitting(wanted) or header.fitting(wanted.rpartition(":")[0])
            if len({header.names[index] for index in fitting}) > 1:
                taken = header.given_columns[name].header
                values = {"columns": len(fitting), "name": wanted, "taken": taken}
                yield Notice("columns.fits-several", values, row=row)
            continue
        quantity, (column, _, unit) = QUANTITY_OF[name], wanted.rpartition(":")
        taken = header.columns.get(name)
        is_missing = name in NEEDED and taken is None
        named = column if column and unit in quantity.units else wanted
        values = {"wanted": named, "columns": _quoted(header.names)}
        if column and header.named(quantity, column):
            values = {"unit": unit, "column": column, "symbols": _symbols(quantity)}
        needed = "true" if is_missing else None
        values |= {"quantity": name, "taken": taken and taken.header, "needed": needed}
        severity = "error" if is_missing else "warning"
        yield Notice("columns.not-there", values, row=row, rating=severity)


def _settle_clock(table: Table, columns: dict[str, Column]) -> Iterator[Notice]:
    """Choose the time column, and leave out other clocks except for the date of a time of day.

    Clock times are in s, and numbers that are dates show their unit by their size. Without a clock
    of the test, the dates or the clock of the steps are used.
    """
    dates = QUANTITY_OF["date"]
    for name in columns.keys() & CLOCKS:
        column, cells = columns[name], table.columns[columns[name].index]
        if not column.is_unit_assumed:
            continue
        if is_clock(cells):
            columns[name] = replace(column, is_unit_assumed=False)
            continue
        plain = numbers(cells, replace(column, quantity=QUANTITY_OF["time"]))
        if name != "step time" and (unit := epoch_unit(plain)):
            columns[name] = replace(column, quantity=dates, unit=unit, is_unit_assumed=False)
            if name == "time":
                yield Notice("columns.clock", {"clock": unit.symbol, "column": column.header})
    clocks = {name: columns[name] for name in ("date", "step time") if name in columns}
    date = clocks.get("date")
    if "time" not in columns and clocks:
        clock = next(iter(clocks))
        if date and len(clocks) == 2:
            stands = np.diff(numbers(table.columns[date.index], date)) == 0
            clock = "step time" if np.mean(stands) > _COARSE_DATES else "date"
        columns["time"] = clocks[clock]
        yield Notice("columns.clock", {"clock": clock, "column": columns["time"].header})
    columns.pop("step time", None)
    if date and _is_time_of_day(table, columns["time"], date):
        days = {"day": date.header, "column": columns["time"].header}
        yield Notice("columns.clock", {"clock": "time of day", **days})
    else:
        columns.pop("date", None)


def _is_time_of_day(table: Table, time: Column, date: Column) -> bool:
    """True if the dates are whole days, and the clock is the time of day.

    The clock then falls exactly where the date changes. If it never falls, it may be a clock of the
    test, which passes midnight where the date changes, whenever it began.
    """
    is_time = time.quantity.name == "time" and is_clock(table.columns[time.index])
    if not is_time or len(table.row) < 2:
        return False
    # A few cells rule out most columns of dates, which are slow to read.
    lines = np.linspace(0, len(table.row) - 1, _DATES).astype(int)
    if np.any(numbers(table.columns[date.index].gather(lines), date) % DAY_S != 0):
        return False
    days_s, clock_s = (numbers(table.columns[column.index], column) for column in (date, time))
    # The date is unknown where its cell is blank.
    if np.any(days_s % DAY_S != 0):
        return False
    falls, is_new = np.diff(clock_s % DAY_S) < 0, np.diff(days_s) != 0
    if falls.any() or not is_new.any():
        return bool(is_new.any() and not np.any(falls & ~is_new))
    began_s = days_s - days_s[0] - clock_s
    return not began_s.max() < began_s.min() + DAY_S


def _no_record(header: Header) -> Notice:
    values = {"columns": listed(filter(None, header.names)) or "none", "advice": "names"}
    if header.is_ocv_table:
        values["advice"] = "ocv"
    elif any(normal(name).startswith(("dod", "depth of discharge")) for name in header.names):
        values["advice"] = "dod"
    else:
        accepted = []
        for quantity in REQUIRED:
            examples = " or ".join(f"'{name}'" for name in quantity.examples[:2])
            accepted.append(f"for the {quantity.name} {examples} (units {_symbols(quantity)})")
        values["accepted"] = "; ".join(accepted)
    return Notice("columns.none", values)


def _symbols(quantity: Quantity) -> str:
    return ", ".join(dict.fromkeys(unit.symbol for unit in quantity.units.values()))


def _quoted(names: Sequence[str]) -> str:
    shown = [f"'{name[:40]}'" for name in names if name][:8]
    return ", ".join(shown) + (" ..." if len(names) > 8 else "") if shown else "no names"


def _headers(columns: Columns) -> set[str]:
    return {column.header for column in columns.values()}


def _repeated_names(header: Header, row: int, columns: Columns) -> Iterator[Notice]:
    for name, times in Counter(header.names).items():
        if times > 1 or not name:
            others = "others" if times > 2 else "other"
            others = others if name and name in _headers(columns) else None
            values = {"columns": times, "name": name or None, "others": others}
            yield Notice("columns.repeated", values, row=row)


# Makes without a rule for which of two voltage columns comes first.
_ANYBODYS = ("plain", "Battery Data Format", "PyBaMM")
_TINY = 1e-30
# Set points and statistics of measured values are not second measurements.
_NOT_MEASURED = re.compile(r"\b(set|max|min|limit|target|end|start|cut|mean|avg|average)")
# Two voltages differ by a lead's resistance if the current explains this share of their difference
# and moves it by this many volts; currents differ by a factor if they are proportional within one
# percent, but not equal within one percent.
_BY_LEADS, _SWING_V = 0.8, 3e-3
_PROPORTIONAL, _EQUAL = 0.999, 0.01
# Two voltages of one cell agree within this; if they differ more and look unlike, one is of another
# cell.
_SAME_V, _OTHER_V, _ALIKE = 5e-3, 0.2, 0.9
_MAX_NAMES = 200


def examine_twins(source: Source, samples: Samples) -> Iterator[Notice]:
    """Other columns of voltage and current that differ as only a wrong column does.

    What the user has named is right, and a pack has the voltages of other cells.
    """
    table = source.table
    if len(table.sheets) > 1:
        return
    yield from _electrode(source, samples)
    for name, judge in (("voltage", _apart_voltages), ("current", _apart_currents)):
        if name in table.header.given or (name == "voltage" and source.series > 1):
            continue
        used = samples.values[name]
        for column in _others(table.header, name, samples.columns[name]):
            other = numbers(table.columns[column.index], column)[samples.at]
            if not np.isfinite(other).all() or not np.ptp(other):
                continue
            if apart := judge(samples, used, other, column.header):
                both = {"own": samples.header(name), "other": column.header, "quantity": name}
                at = int(np.argmax(np.abs(other - used)))
                yield notice_at(samples, at, "twin-columns.differ", **both, **apart)


def _electrode(source: Source, samples: Samples) -> Iterator[Notice]:
    """A note if the voltage is that of a working electrode and another column has the cell's."""
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


def _others(header: Header, quantity: str, used: Column) -> Iterator[Column]:
    """Further columns whose names fit the quantity."""
    for index, name in enumerate(header.names[:_MAX_NAMES]):
        if index == used.index or name == used.header or _NOT_MEASURED.search(normal(name)):
            continue
        alone = Header((name,))
        columns = alone.find(QUANTITIES)
        likely = [] if columns else alone.likely(QUANTITY_OF[quantity])
        for column in [columns[quantity]] if quantity in columns else likely:
            yield replace(column, index=index)


def _apart_voltages(samples: Samples, used: Channel, other: Channel, name: str) -> Apart:
    """How a voltage differs: by the current times a resistance, or otherwise."""
    if not is_of_cell(other):
        return {}
    apart_v = other - used
    current_a = samples.current_a - samples.current_a.mean()
    slope = float(current_a @ apart_v / max(current_a @ current_a, _TINY))
    swing_v = abs(slope) * float(np.ptp(current_a))
    left_v = apart_v - apart_v.mean() - slope * current_a
    if swing_v > _SWING_V and left_v.var() < (1 - _BY_LEADS) * apart_v.var():
        return {"by": "leads", "leads_ohm": abs(slope), "apart_v": swing_v}
    usual_v = float(np.median(np.abs(apart_v)))
    if usual_v <= _SAME_V:
        return {}
    if samples.dialect.name in _ANYBODYS and "voltage" in Header((name,)).find(QUANTITIES):
        return {"by": "undecided", "apart_v": usual_v}
    is_alike = cosine(used - used.mean(), other - other.mean()) > _ALIKE
    return {"by": "volts", "apart_v": usual_v} if usual_v < _OTHER_V and is_alike else {}


def _apart_currents(_: Samples, used: Channel, other: Channel, name: str) -> Apart:
    """The factor between two currents."""
    ratio = float(used @ other) / max(float(used @ used), _TINY)
    is_apart = abs(cosine(used, other)) > _PROPORTIONAL and abs(ratio - 1) > _EQUAL
    return {"by": "factor", "ratio": ratio} if is_apart else {}

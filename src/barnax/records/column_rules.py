"""The columns of a table that are read, and what there is to say about them."""

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
import polars as pl
from jaxtyping import Float

from ..errors import InputError, listed
from ..notices import Notice
from .cell_values import CLOCKS, DAY_S, epoch_unit, is_clock, numbers
from .columns import (
    NOTHING,
    Column,
    columns_of,
    find_columns,
    is_ocv_table,
    likely_column,
    likely_names,
    named_column,
    names_cell_voltage,
    names_record,
    normal,
    other_table,
)
from .quantities import CELL_RANGE_V, NEEDED, OCV_QUANTITIES, QUANTITIES, QUANTITY_OF, Quantity
from .table import Table, impedance_rows, one_row_a

Columns = Mapping[str, Column]

REQUIRED = tuple(quantity for quantity in QUANTITIES if quantity.is_required)
# What a record may have, and is not taken from it.
SOC = next(quantity for quantity in OCV_QUANTITIES if quantity.name == "SOC")
# What `columns` may name.
NAMES = tuple(name for name in QUANTITY_OF if name not in ("date", "charge of the interval"))
# Dates that stand still in a larger share of the intervals are printed too coarsely to be a clock.
_COARSE_DATES = 0.05
# A voltage without a unit that is so large is in mV; so many cells are a pack.
_MILLIVOLTS, FEWEST_CELLS = 500.0, 2
# The number of dates that are looked at.
_DATES = 50


def read_columns(given: Mapping[str, str] | str) -> dict[str, str]:
    """The user's names by quantity, from a mapping or from text such as "current=I[mA]:mA,...".

    A name may hold commas and equality signs, for only a quantity begins the next. Raises
    InputError for what is no quantity of a record.

    >>> read_columns("time=Zeit:min,current=Strom, gemessen:mA")
    {'time': 'Zeit:min', 'current': 'Strom, gemessen:mA'}
    """
    if not given:
        return {}
    if isinstance(given, str):
        known = "|".join(map(re.escape, NAMES))
        parts = re.split(rf"(?:^|,)\s*({known})\s*=", given)
        unknown = parts[0].strip() or ("" if len(parts) > 1 else "nothing")
        given = dict(zip(parts[1::2], map(str.strip, parts[2::2]), strict=True))
    else:
        unknown = next((name for name in given if name not in NAMES), "")
    if unknown or not all(given.values()):
        words = f"{unknown!r} is no quantity" if unknown else "a quantity has no name"
        raise InputError(
            f"`columns`: {words}; write them as 'time=NAME:s,current=NAME:mA,voltage=NAME', with "
            f"a unit after a colon if the name has none; there are {', '.join(NAMES)}."
        )
    return dict(given)


def examine_columns(
    table: Table, file: str, given: Mapping[str, str] = NOTHING
) -> tuple[dict[str, Column], list[Notice]]:
    """The columns to go on with, and what is to be said of them.

    `given` are the user's own names. Where a required column has no accepted name but one likely
    one, that is taken, so that its values are looked at too. A column still missing is in the
    findings alone. Raises InputError where no name is like any that a record has.
    """
    what = other_table(table.header)
    is_mostly = 2 * impedance_rows(table).sum() > len(table.row)
    if what and (is_mostly or not names_record(table.header, given)):
        raise Notice("columns.no-record", {"table": what}, file).error(".")
    found = columns_of(table.header, given)
    wrong = list(_not_there(table, found, given))
    if counted := one_row_a(table, found):
        wrong.insert(0, Notice("columns.no-record", {"table": f"a table of one row a {counted}"}))
    is_like = any(q.name in found or likely_names(q, table.header) for q in REQUIRED)
    is_known = is_like or is_ocv_table(table.header, given)
    is_nameless = not found.keys() & NEEDED and _is_nameless(table, is_known)
    if not is_like and not is_nameless:
        raise [*wrong, _no_record(table, given)][0].about(file).error(".")
    findings = [*table.notes, *wrong]
    findings.extend(_dated(table, found))
    findings.extend(_other_clock(table, found))
    is_time_of_day = _is_time_of_day(table, found)
    if is_time_of_day:
        day, time = found["date"].header, found["time"].header
        findings.append(Notice("columns.time-of-day", {"day": day, "time": time}))
    if "current" not in found and "charge of the interval" in found:
        found["current"] = found["charge of the interval"]
        findings.append(Notice("columns.interval-charge", {"column": found["current"].header}))
    for unused in ("step time", "date", "charge of the interval"):
        if unused != "date" or not is_time_of_day:
            found.pop(unused, None)
    findings.extend(_repeated_names(table, found))
    taken = _headers(found)
    for column in find_columns(table.header, (SOC,)).values():
        if column.header not in taken:
            findings.append(Notice("columns.soc-unused", {"column": column.header}))
    missing = []
    for quantity in REQUIRED:
        if quantity.name in found:
            continue
        # A column that another quantity has taken is no candidate.
        free = ["" if name in _headers(found) else name for name in table.header]
        guess = likely_column(quantity, free)
        if guess is not None and quantity.name == "time" and is_clock(table.columns[guess.index]):
            # A date has no unit, and a name of its own.
            dates = QUANTITY_OF["date"]
            guess = replace(guess, quantity=dates, is_unit_assumed=False)
        missing.append((quantity, guess, free))
        if guess is not None:
            found[quantity.name] = guess
    if missing:
        code, values = _missing(*missing[0]) if len(missing) == 1 else _all_missing(missing)
        is_silent = all(quantity.name != "voltage" for quantity, _, _ in missing)
        cells = [] if is_silent else next(map(list, cell_voltages(table, given)), [])
        # Two may be one cell's, measured twice.
        if len(cells) > FEWEST_CELLS:
            code, values = "columns.pack", {"cells": _quoted(cells), "first": cells[0]}
        if is_nameless:
            values["examples"] = ", ".join(_examples(quantity) for quantity, _, _ in missing)
            code = "columns.no-names"
        names = {"quantities": ", ".join(quantity.name for quantity, _, _ in missing)}
        there = {**names, "columns": _quoted(list(table.header)), "count": len(missing)}
        findings.append(Notice(code, {**there, **values}, row=table.names_row))
    return found, findings


def _is_nameless(table: Table, is_like: bool) -> bool:
    """True if half of the first row's cells are numbers, or where no name is like one of a table
    that is known, one of it is, or nothing stands there above numbers."""
    names = pl.Series("names", [name.strip() for name in table.header] or [""])
    share = names.cast(pl.Float64, strict=False).is_not_null().to_numpy().mean()
    cells = zip(table.header, table.columns, strict=True)
    is_bare = any(not name and column.dtype.is_numeric() for name, column in cells)
    return bool(share >= 0.5 or (not is_like and (share > 0 or is_bare)))


def cell_voltages(
    table: Table, given: Mapping[str, str] = NOTHING
) -> list[dict[str, Float[np.ndarray, "lines"]]]:
    """The sets of columns that may be the voltages of a pack's cells, in V by name: numbered alike,
    named so, with at least two within what a cell has. `given` are the user's own names."""
    taken = {
        own.header for name, own in columns_of(table.header, given).items() if name != "voltage"
    }
    alike: dict[str, dict[str, np.ndarray]] = {}
    for name in table.header:
        if name not in taken and re.search(r"\d", name) and names_cell_voltage(name):
            kind = re.sub(r"\d+", "#", normal(name))
            alike.setdefault(kind, {})[name] = in_volts(table, name)

    def is_cell(values_v: np.ndarray) -> bool:
        known_v = values_v[np.isfinite(values_v)]
        return bool(len(known_v) and CELL_RANGE_V[0] < np.median(known_v) < CELL_RANGE_V[1])

    # A sensor that has failed is one of its kind.
    return [own for own in alike.values() if sum(map(is_cell, own.values())) >= FEWEST_CELLS]


def in_volts(table: Table, name: str) -> Float[np.ndarray, "lines"]:
    """The voltages of a column, in V or mV by their size where its name has no unit."""
    column = named_column(table.header, QUANTITY_OF["voltage"], name)
    if column is None:
        return np.full(len(table.row), np.nan)
    values_v = numbers(table.columns[column.index], column)
    known = values_v[np.isfinite(values_v)]
    if column.is_unit_assumed and len(known) and np.median(np.abs(known)) > _MILLIVOLTS:
        values_v = values_v / 1000
    return values_v


def _not_there(table: Table, found: Columns, given: Mapping[str, str]) -> Iterator[Notice]:
    """Warnings of given names that the table does not have."""
    for name, wanted in given.items():
        column = named_column(table.header, QUANTITY_OF[name], wanted)
        if column is None:
            own, _, unit = wanted.rpartition(":")
            is_missing = QUANTITY_OF[name].is_required and name not in found
            given_so = {
                "quantity": name,
                "taken": found[name].header if name in found else None,
                "needed": "true" if is_missing else None,
            }
            severity, row = "error" if is_missing else "warning", table.names_row
            if own and named_column(table.header, QUANTITY_OF[name], own):
                known = {"unit": unit, "column": own, "known": _symbols(QUANTITY_OF[name])}
                yield Notice("columns.unknown-unit", {**known, **given_so}, row=row).rated(severity)
            else:
                names = {"wanted": wanted, "columns": _quoted(list(table.header))}
                yield Notice("columns.not-there", {**names, **given_so}, row=row).rated(severity)


def _dated(table: Table, found: dict[str, Column]) -> Iterator[Notice]:
    """Settle the unit of clocks without one: clock times are in s, and numbers that are dates tell
    their unit by their size."""
    for name in found.keys() & CLOCKS:
        column, cells = found[name], table.columns[found[name].index]
        if not column.is_unit_assumed:
            continue
        if is_clock(cells):
            found[name] = replace(column, is_unit_assumed=False)
            continue
        plain = numbers(cells, replace(column, quantity=QUANTITY_OF["time"]))
        if name != "step time" and (unit := epoch_unit(plain)):
            dates = QUANTITY_OF["date"]
            found[name] = replace(column, quantity=dates, unit=unit, is_unit_assumed=False)
            if name == "time":
                yield Notice("columns.dates", {"column": column.header, "dates": unit.symbol})


def _other_clock(table: Table, found: dict[str, Column]) -> Iterator[Notice]:
    """Take the dates, or the clock of the steps, where there is no clock of the test."""
    if "time" in found or not found.keys() & {"date", "step time"}:
        return
    clock = "date" if "date" in found else "step time"
    if {"date", "step time"} <= found.keys():
        dates = found["date"]
        stands = np.diff(numbers(table.columns[dates.index], dates)) == 0
        clock = "step time" if np.mean(stands) > _COARSE_DATES else "date"
    found["time"] = found[clock]
    yield Notice("columns.other-clock", {"clock": clock, "column": found[clock].header})


def _is_time_of_day(table: Table, found: Columns) -> bool:
    """True if the dates are whole days, and the clock is the time on them.

    Then it falls where the date changes and nowhere else. Where it never falls, it may be a clock
    of the test; that runs over midnight where the dates change, whenever it began.
    """
    time, date = found.get("time"), found.get("date")
    if time is None or date is None or not is_clock(table.columns[time.index]):
        return False
    if time.quantity.name != "time" or len(table.row) < 2:
        return False
    # A few cells rule out most columns of dates, which take long to read.
    lines = np.linspace(0, len(table.row) - 1, _DATES).astype(int)
    if np.any(numbers(table.columns[date.index].gather(lines), date) % DAY_S != 0):
        return False
    days_s, clock_s = (numbers(table.columns[column.index], column) for column in (date, time))
    # A day is not known where its cell is blank.
    if np.any(days_s % DAY_S != 0):
        return False
    falls, is_new = np.diff(clock_s % DAY_S) < 0, np.diff(days_s) != 0
    if falls.any() or not is_new.any():
        return bool(is_new.any() and not np.any(falls & ~is_new))
    began_s = days_s - days_s[0] - clock_s
    return not began_s.max() < began_s.min() + DAY_S


def _no_record(table: Table, given: Mapping[str, str]) -> Notice:
    names = listed(name for name in table.header if name) or "none"
    if is_ocv_table(table.header, given):
        return Notice("columns.none", {"columns": names, "advice": "ocv"})
    if any(normal(name).startswith(("dod", "depth of discharge")) for name in table.header):
        return Notice("columns.none", {"columns": names, "advice": "dod"})
    accepted = "; ".join(
        f"for the {quantity.name} {_examples(quantity)} (units {_symbols(quantity)})"
        for quantity in REQUIRED
    )
    return Notice("columns.none", {"columns": names, "advice": "names", "accepted": accepted})


def _missing(
    quantity: Quantity, guess: Column | None, free: list[str]
) -> tuple[str, dict[str, str | None]]:
    """The notice of what is missing: its code and values."""
    names = f"{_examples(quantity)}, with its unit ({_symbols(quantity)})"
    if guess is not None:
        option = f"{quantity.name}={guess.header}" + (":UNIT" if guess.is_unit_assumed else "")
        names = names if guess.quantity is quantity else f"'{guess.quantity.examples[-1]}'"
        return "columns.missing-likely", {"likely": guess.header, "option": option, "names": names}
    likely = likely_names(quantity, free)
    is_out = ["discharge" in name.lower() for name in likely]
    is_pair = quantity.name == "current" and len(likely) == 2 and any(is_out) and not all(is_out)
    code = "columns.missing-ambiguous" if likely else "columns.missing"
    given = {
        "likely": _quoted(likely) if likely else None,
        "pair": "true" if is_pair else None,
        "names": names,
    }
    return code, given


def _all_missing(
    missing: list[tuple[Quantity, Column | None, list[str]]],
) -> tuple[str, dict[str, str | None]]:
    """The notice of several missing quantities, with the one option that names them all."""
    guesses = {quantity.name: guess for quantity, guess, _ in missing}
    likely = [f"'{guess.header}' is likely the {name}" for name, guess in guesses.items() if guess]
    option = ",".join(
        f"{name}={guess.header if guess else 'NAME'}"
        + ("" if guess and not guess.is_unit_assumed else ":UNIT")
        for name, guess in guesses.items()
    )
    names = ", ".join(f"'{quantity.examples[0]}'" for quantity, _, _ in missing)
    given = {"likely": "; ".join(likely) or None, "option": option, "names": names}
    return "columns.missing-several", given


def _examples(quantity: Quantity) -> str:
    return " or ".join(f"'{name}'" for name in quantity.examples[:2])


def _symbols(quantity: Quantity) -> str:
    return ", ".join(dict.fromkeys(unit.symbol for unit in quantity.units.values()))


def _quoted(names: Sequence[str]) -> str:
    shown = [f"'{name[:40]}'" for name in names if name][:8]
    return ", ".join(shown) + (" ..." if len(names) > 8 else "") if shown else "no names"


def _headers(found: Columns) -> set[str]:
    return {column.header for column in found.values()}


def _repeated_names(table: Table, found: Columns) -> Iterator[Notice]:
    row = table.names_row
    for name, times in Counter(table.header).items():
        if not name:
            yield Notice("columns.nameless", {"columns": times}, row=row)
        elif times > 1 and name in _headers(found):
            others = "several" if times > 2 else None
            yield Notice(
                "columns.first-taken", {"columns": times, "name": name, "others": others}, row=row
            )
        elif times > 1:
            yield Notice("columns.repeated", {"columns": times, "name": name}, row=row)


def describe_units(found: Columns) -> Iterator[Notice]:
    """Notes of the units that were assumed, and of those that were converted."""
    bare = [column for column in found.values() if column.is_unit_assumed]
    if bare:
        units = [f"{column.unit.symbol} for '{column.header.strip()}'" for column in bare]
        needed = [column for column in bare if column.quantity.is_required] or bare
        names = ", ".join(f"'{column.quantity.examples[0]}'" for column in needed)
        yield Notice("columns.units-assumed", {"units": ", ".join(units), "names": names})
    converted = [
        f"'{column.header}' from {column.unit.symbol} to {column.quantity.base_unit.symbol}"
        for column in found.values()
        if not column.is_unit_assumed and column.unit != column.quantity.base_unit
    ]
    if converted:
        yield Notice("columns.converted", {"columns": ", ".join(converted)})


def bare_units(found: Columns, reason: str) -> Notice:
    """A warning that names all columns without a unit, with the one option that settles them."""
    judged = (name for name in NAMES if name in NEEDED or name.endswith("capacity"))
    bare = [found[name] for name in judged if name in found and found[name].is_unit_assumed]
    units = ", ".join(f"{column.unit.symbol} for '{column.header}'" for column in bare)
    option = ",".join(f"{column.quantity.name}={column.header}:UNIT" for column in bare)
    return Notice("columns.units-open", {"units": units, "reason": reason, "option": option})

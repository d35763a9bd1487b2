"""The rules on a table's columns and cells: names, units, and numbers where they are needed."""

from collections import Counter
from collections.abc import Iterator, Mapping

import numpy as np

from ..errors import InputError, counted, listed
from .columns import (
    NEEDED,
    QUANTITIES,
    Column,
    Quantity,
    find_columns,
    is_ocv_table,
    likely_column,
    likely_names,
)
from .findings import Finding, found_at
from .table import LARGEST_NUMBER, Lines, Table

Columns = Mapping[str, Column]

REQUIRED = tuple(quantity for quantity in QUANTITIES if quantity.is_required)
_LARGEST_STEP = 2**31


def examine_columns(table: Table, file: str) -> tuple[dict[str, Column], list[Finding]]:
    """The columns to go on with, and what is to be said of them.

    Where a required column has no accepted name but one likely one, that is taken, so that its
    values are looked at too. A column still missing is in the findings alone. Raises InputError
    where no name is like any that a record has.
    """
    found = find_columns(table.header)
    is_nameless = any(map(_is_number, table.header[:1]))
    is_like = any(q.name in found or likely_names(q, table.header) for q in REQUIRED)
    if not is_like and not is_nameless:
        raise InputError(_no_record(table, file))
    findings = [Finding("note", note, is_told=True) for note in table.notes]
    findings.extend(_repeated_names(table, found))
    findings.extend(_units(found))
    for quantity in REQUIRED:
        if quantity.name in found:
            continue
        # What another quantity has taken is no candidate.
        free = ["" if name in _headers(found) else name for name in table.header]
        guess = likely_column(quantity, free)
        if guess is not None:
            found[quantity.name] = guess
        what, remedy = _missing(quantity, guess, free, table)
        if is_nameless:
            what += "; the first row holds numbers, not names"
        findings.append(Finding("error", what, remedy, row=table.names_row))
    return found, findings


def _no_record(table: Table, file: str) -> str:
    names = listed(name for name in table.header if name) or "none"
    message = f"{file}: no column for time, current, voltage; columns found: {names}. "
    if is_ocv_table(table.header):
        return f"{message}It is a table of OCV over SOC; give it as the OCV test."
    accepted = "; ".join(
        f"for the {quantity.name} {_examples(quantity)} (units {_symbols(quantity)})"
        for quantity in REQUIRED
    )
    return f"{message}Accepted names: {accepted}. Rename the columns so, in the file's first row."


def _missing(
    quantity: Quantity, guess: Column | None, free: list[str], table: Table
) -> tuple[str, str]:
    """What is missing, and what to do about it."""
    what = f"no column for the {quantity.name}"
    names = f"{_examples(quantity)}, with its unit ({_symbols(quantity)})"
    if guess is not None:
        what += f"; '{guess.header}' is likely it"
        return what, f"rename '{guess.header}' to {names}"
    likely = likely_names(quantity, free)
    if likely:
        return f"{what}; likely: {_quoted(likely)}", f"rename the right one to {names}"
    return f"{what} among {_quoted(list(table.header))}", f"export it, or name it {names}"


def _examples(quantity: Quantity) -> str:
    return " or ".join(f"'{name}'" for name in quantity.examples[:2])


def _symbols(quantity: Quantity) -> str:
    return ", ".join(dict.fromkeys(unit.symbol for unit in quantity.units.values()))


def _quoted(names: list[str]) -> str:
    shown = [f"'{name[:40]}'" for name in names if name][:8]
    return ", ".join(shown) + (" ..." if len(names) > 8 else "") if shown else "no names"


def _headers(found: Columns) -> set[str]:
    return {column.header for column in found.values()}


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _repeated_names(table: Table, found: Columns) -> Iterator[Finding]:
    row = table.names_row
    for name, times in Counter(table.header).items():
        what = f"{times} columns are called '{name}'"
        if not name:
            yield Finding("note", f"{counted(times, 'column')} without a name; not used", "", row)
        elif times > 1 and name in _headers(found):
            remedy = f"rename or delete the other{'s' if times > 2 else ''}"
            yield Finding("warning", f"{what}; the first of them is taken", remedy, row)
        elif times > 1:
            yield Finding("note", f"{what}; none is used", "", row)


def _units(found: Columns) -> Iterator[Finding]:
    """Notes of the units that were assumed, and of those that were converted."""
    bare = [column for column in found.values() if column.is_unit_assumed]
    if bare:
        units = [f"{column.unit.symbol} for '{column.header.strip()}'" for column in bare]
        needed = [column for column in bare if column.quantity.is_required] or bare
        names = ", ".join(f"'{column.quantity.examples[0]}'" for column in needed)
        what = f"no units in the names; assumed {', '.join(units)}"
        yield Finding("note", what, f"name the columns {names} to be sure", is_told=True)
    converted = [
        f"'{column.header}' from {column.unit.symbol} to {column.quantity.base_unit.symbol}"
        for column in found.values()
        if not column.is_unit_assumed and column.unit != column.quantity.base_unit
    ]
    if converted:
        yield Finding("note", f"converted {', '.join(converted)}", is_told=True)


def examine_cells(lines: Lines) -> tuple[Lines, list[Finding]]:
    """The lines whose time, current and voltage are finite, and what stands in the others.

    An optional column with such cells is left out.
    """
    findings = []
    is_good = np.ones(len(lines.row), bool)
    units = _units_row(lines)
    if units:
        what = f"the row below the names holds no numbers but {units}, as units"
        remedy = "write the units into the names, as in 'Current / mA', and delete the row"
        findings.append(found_at(lines, 0, "error", what, remedy))
        is_good[0] = False
    for name, column in lines.columns.items():
        bad = lines.bad(name) & is_good
        if not bad.any():
            continue
        first = int(np.argmax(bad))
        cell = lines.cell(name, first)
        stands = "nothing" if cell is None else repr(cell)
        is_large = np.abs(lines.values[name][first]) > LARGEST_NUMBER
        number = f"a number below {LARGEST_NUMBER:g}" if is_large else "a number"
        cells = counted(int(bad.sum()), "cell")
        what = f"{stands} stands under '{column.header}', where {number} is needed ({cells})"
        if not column.quantity.is_required:
            lines = lines.without(name)
            what += "; the column is left out"
            findings.append(found_at(lines, first, "note", what, is_told=True))
            continue
        remedy = "delete the row, or fill it from the tester's own file"
        if bad.sum() == is_good.sum():
            remedy = f"export the column as plain numbers in {column.unit.symbol}"
        findings.append(found_at(lines, first, "error", what, remedy))
    for name in set(lines.columns) & NEEDED:
        is_good &= ~lines.bad(name)
    lines = lines.keep(is_good)
    step = lines.values.get("step")
    if step is not None and np.any((step != np.round(step)) | (np.abs(step) > _LARGEST_STEP)):
        what = f"the numbers under '{lines.columns['step'].header}' are not whole: left out"
        findings.append(Finding("note", what, is_told=True))
        lines = lines.without("step")
    return lines, findings


def _units_row(lines: Lines) -> str:
    """The units that the first line spells under time, current and voltage, or nothing."""
    spelled = []
    for name, column in lines.columns.items():
        if not column.quantity.is_required:
            continue
        cell = lines.cell(name, 0) if len(lines.row) else None
        word = cell.strip().strip("[]()").lower() if isinstance(cell, str) else ""
        if word not in column.quantity.units:
            return ""
        spelled.append(repr(cell))
    return ", ".join(spelled)

"""Which columns a file has, and cells that hold no number where one is needed."""

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import PurePath

import numpy as np
from jaxtyping import Bool

from ..records.columns import (
    NEEDED,
    QUANTITIES,
    Column,
    find_columns,
    likely_column,
    likely_names,
    require_columns,
)
from ..records.samples import Lines, Table, required
from .finding import Finding, Severity, counted

Columns = Mapping[str, Column]

REQUIRED = tuple(quantity for quantity in QUANTITIES if quantity.is_required)

_ZIP, _OLE, _PARQUET = b"PK\x03\x04", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", b"PAR1"
_CONTENT = {
    _ZIP: ("an OOXML workbook", (".xlsx", ".xlsm")),
    _OLE: ("a workbook of the kind before OOXML", (".xls",)),
    _PARQUET: ("a Parquet table", (".parquet", ".pq")),
}


def examine_suffix(file: str, content: bytes) -> list[Finding]:
    """A note where a file's suffix promises another format than its content is."""
    suffix = PurePath(file).suffix.lower()
    known = {own for _, suffixes in _CONTENT.values() for own in suffixes}
    kind, suffixes = next(
        (own for start, own in _CONTENT.items() if content.startswith(start)), ("text", ())
    )
    if suffix in suffixes or (suffix not in known and kind == "text"):
        return []
    return [
        Finding(
            "note",
            f"the content is {kind}, although the name ends in '{suffix}'",
            "barnax goes by the content; other programs may not",
        )
    ]


def examine_columns(table: Table, file: str) -> tuple[dict[str, Column], list[Finding]]:
    """The columns to go on with, and what is to be said of them.

    Where a required column has no accepted name but one likely one, that is taken, so that its
    values are looked at too. A column still missing is in the findings alone. Raises InputError
    where no name is like any that a record has.
    """
    found = find_columns(table.header)
    is_like = found.keys() & NEEDED or any(
        likely_names(quantity, table.header) for quantity in REQUIRED
    )
    is_nameless = any(map(_is_number, table.header[:1]))
    if not is_like and not is_nameless:
        require_columns(table.header, file)
    findings = [Finding("note", note) for note in table.notes]
    findings.extend(_repeated_names(table, found))
    findings.extend(_assumed_units(found))
    for quantity in REQUIRED:
        if quantity.name in found:
            continue
        # What another quantity has taken is no candidate.
        free = ["" if name in _headers(found) else name for name in table.header]
        guess = likely_column(quantity, free)
        examples = " or ".join(f"'{name}'" for name in quantity.examples[:2])
        likely = likely_names(quantity, free)
        what = f"no column for the {quantity.name}"
        if guess is not None:
            found[quantity.name] = guess
            what += f"; '{guess.header}' is likely it and is taken for it here"
            remedy = f"rename '{guess.header}' to {examples}, with its unit"
        elif likely:
            what += f"; likely: {_quoted(likely)}"
            remedy = f"rename the right one to {examples}, with its unit"
        else:
            what += f" among {_quoted(list(table.header))}"
            remedy = f"export it, or name it {examples}"
        if is_nameless:
            what += "; the first row holds numbers, not names"
        findings.append(Finding("error", what, remedy, row=_names_row(table)))
    return found, findings


def examine_units(found: Columns) -> list[Finding]:
    """A note of the units that were converted."""
    converted = [
        f"'{column.header}' from {column.unit.symbol} to {column.quantity.base_unit.symbol}"
        for column in found.values()
        if not column.is_unit_assumed and column.unit != column.quantity.base_unit
    ]
    return [Finding("note", f"converted {', '.join(converted)}")] if converted else []


def _headers(found: Columns) -> set[str]:
    return {column.header for column in found.values()}


def _names_row(table: Table) -> int:
    return int(table.row[0]) - 1 if len(table.row) else 1


def _quoted(names: list[str]) -> str:
    shown = [f"'{name[:40]}'" for name in names if name][:8]
    return ", ".join(shown) + (" ..." if len(names) > 8 else "") if shown else "no names"


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _repeated_names(table: Table, found: Columns) -> Iterator[Finding]:
    row = _names_row(table)
    nameless = sum(not name for name in table.header)
    for name, times in Counter(table.header).items():
        if not name or times == 1:
            continue
        if name in _headers(found):
            yield Finding(
                "warning",
                f"{times} columns are called '{name}'; the first of them is taken",
                f"rename or delete the other{'s' if times > 2 else ''}",
                row,
            )
        else:
            yield Finding("note", f"{times} columns are called '{name}'; none is used", "", row)
    if nameless:
        yield Finding("note", f"{counted(nameless, 'column')} without a name; not used", "", row)


def _assumed_units(found: Columns) -> Iterator[Finding]:
    bare = [column for column in found.values() if column.is_unit_assumed]
    if bare:
        units = [f"{column.unit.symbol} for '{column.header.strip()}'" for column in bare]
        needed = [column for column in bare if column.quantity.is_required] or bare
        names = ", ".join(f"'{column.quantity.examples[0]}'" for column in needed)
        yield Finding(
            "note",
            f"no units in the names; assumed {', '.join(units)}",
            f"name the columns {names} to be sure",
        )


# Even nanoseconds since 1970 are less.
_LARGEST = 1e20


def examine_cells(lines: Lines) -> tuple[Lines, list[Finding]]:
    """The lines whose time, current and voltage are finite, and what stands in the others."""
    findings = []
    is_good = np.ones(len(lines.row), bool)
    units = _units_row(lines)
    if units:
        findings.append(
            _at(
                lines,
                0,
                "error",
                f"the row below the names holds no numbers but {units}, as units",
                "write the units into the names, as in 'Current / mA', and delete the row",
            )
        )
        is_good[0] = False
    for name, column in lines.columns.items():
        bad = _is_bad(lines, name) & is_good
        if not bad.any():
            continue
        first = int(np.argmax(bad))
        cell = lines.cell(name, first)
        stands = "nothing" if cell is None else repr(cell)
        cells = counted(int(bad.sum()), "cell")
        what = f"{stands} stands under '{column.header}', where a number is needed ({cells})"
        if not column.quantity.is_required:
            findings.append(_at(lines, first, "note", f"{what}; the column is left out"))
        elif bad.sum() == is_good.sum():
            remedy = f"export the column as plain numbers in {column.unit.symbol}"
            findings.append(_at(lines, first, "error", what, remedy))
        else:
            remedy = "delete these rows, or fill them from the tester's own file"
            findings.append(_at(lines, first, "error", what, remedy))
    for name in required(lines):
        is_good &= ~_is_bad(lines, name)
    return lines.keep(is_good), findings


def _is_bad(lines: Lines, name: str) -> Bool[np.ndarray, "lines"]:
    """Where no number stands, or one that no tester reads."""
    bad = lines.bad(name)
    return bad | (np.abs(np.where(bad, 0.0, lines.values[name])) > _LARGEST)


def _units_row(lines: Lines) -> str:
    """The units that the first line spells under time, current and voltage, or nothing."""
    spelled = []
    for name in required(lines):
        cell = lines.cell(name, 0) if len(lines.row) else None
        word = cell.strip().strip("[]()").lower() if isinstance(cell, str) else ""
        if word not in lines.columns[name].quantity.units:
            return ""
        spelled.append(repr(cell))
    return ", ".join(spelled)


def _at(lines: Lines, line: int, severity: Severity, what: str, remedy: str = "") -> Finding:
    sheet = lines.sheets[int(lines.sheet[line])] if len(lines.sheets) > 1 else None
    return Finding(severity, what, remedy, int(lines.row[line]), sheet)

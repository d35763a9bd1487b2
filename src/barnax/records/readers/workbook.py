"""Spreadsheet workbooks of Arbin, Neware, Landt and other testers.

An Arbin workbook has `Info`, `Channel_<chassis>-<channel>` and, beyond the old sheet limit of
65,536 rows, `Channel_<chassis>-<channel>_2` and so on; Neware's `Detail_` sheets continue likewise.
Users add sheets of their own. CALCE publishes OOXML workbooks with the suffix `.xls`, so the suffix
says nothing.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import fastexcel
import numpy as np
import polars as pl

from ...errors import InputError, cut, listed
from ..cell_values import numbers
from ..columns import Header
from ..quantities import NEEDED
from ..table import Reader, Table
from .binary import quieted
from .content import refusing, require_trial

_OLE = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
# Sheets of one channel: "Channel_1-001", "Channel_1-001_2"; "Detail_14_1_3"; "record", "record_2".
_CHANNEL = re.compile(
    r"^(?:channel[ _]*(\d+(?:-\d+)?)?|detail[a-z]*_(\d+_\d+_\d+)|record(?:[ _(]*\d+\)?)?$)",
    re.IGNORECASE,
)
# The names are in one of this many rows.
_ABOVE = 100
# A sheet takes memory for all cells between its outermost ones, even empty ones.
_READS = """
import fastexcel
workbook = fastexcel.read_excel(content)
for name in workbook.sheet_names:
    workbook.load_sheet(name, header_row=None, n_rows=1, dtypes="string")
"""


@dataclass(frozen=True)
class _Names:
    """A sheet's names, with the units below them, and the number of rows above them and above its
    numbers."""

    above: int
    header: Header
    body: int = 1
    height: int = field(default=0, compare=False)


def _recognizes(content: bytes) -> bool:
    """An OOXML workbook is a zip archive with a folder xl; the older kind is an OLE file."""
    return content.startswith(_OLE) or (content.startswith(b"PK") and b"xl/" in content)


def _read(content: bytes, given: Mapping[str, str]) -> Table:
    require_trial(_READS, content)
    damaged = "the workbook is damaged or cut short; copy or export it again."
    with refusing(damaged), quieted("fastexcel"):
        workbook = fastexcel.read_excel(content)
        sheets = {name: _names(workbook, name, given) for name in workbook.sheet_names}
        headers = {name: sheet.header for name, sheet in sheets.items()}
        chosen = _chosen_sheets(headers)
        bodies = {name: _body(workbook, name, sheets[name]) for name in chosen}
    names = sheets[chosen[0]]
    for name in chosen:
        if sheets[name] != names:
            raise InputError(
                f"sheets {listed([chosen[0]])} and {listed([name])} have different columns "
                "and cannot be joined; give them the same first row."
            )
    return _joined(bodies, names, [name for name in sheets if name not in chosen])


def _names(workbook: fastexcel.ExcelReader, name: str, given: Mapping[str, str]) -> _Names:
    """The first row with the names of a record or an OCV table, else the sheet's first."""
    sheet = workbook.load_sheet(name, header_row=None, n_rows=_ABOVE, dtypes="string")
    rows, height = sheet.to_polars().rows(), sheet.total_height
    headers = [Header(tuple("" if cell is None else cell for cell in row), given) for row in rows]
    for above, header in enumerate(headers):
        if header.is_record or header.is_ocv_table:
            below = headers[above + 1].names if above + 1 < len(headers) else ()
            named = header.with_units(below)
            return _Names(above, named, above + (1 if named is header else 2), height)
    return _Names(0, headers[0] if headers else Header((), given), height=height)


def _body(workbook: fastexcel.ExcelReader, name: str, names: _Names) -> pl.DataFrame:
    """The rows of a sheet below its names."""
    if names.height <= names.body:
        return pl.DataFrame()
    # The types of cells in all rows may not fit into one column.
    how = {"skip_rows": names.body, "schema_sample_rows": None}
    return workbook.load_sheet(name, header_row=None, **how).to_polars()


def _chosen_sheets(headers: dict[str, Header]) -> list[str]:
    """The sheets of the record: those of a channel, else the only one with the columns.

    Failing that, the only one with some of them, or with names at all.
    """
    whole = [name for name, header in headers.items() if header.is_record]
    ours = {name: match.groups() for name in whole if (match := _CHANNEL.match(name))}
    if len(set(ours.values())) > 1:
        raise InputError(
            f"the workbook has {len(set(ours.values()))} channels (sheets "
            f"{listed(ours)}), but a record is of one cell; save each channel as its own workbook."
        )
    if ours:
        return list(ours)
    whole = whole or [name for name, header in headers.items() if header.is_ocv_table]
    if len(whole) == 1:
        return whole
    if whole:
        raise InputError(
            f"several sheets could be the record ({listed(whole)}); keep only one of them."
        )
    partial = [name for name, header in headers.items() if header.columns.keys() & NEEDED]
    partial = partial or [
        name
        for name, header in headers.items()
        if header.other_table or (len(header.names) > 1 and len(headers) == 1)
    ]
    if len(partial) == 1:
        # The rules for columns report which of them is missing, or what table it is.
        return partial
    listing = "; ".join(
        f"{name}: {listed(header.names) or 'empty'}" for name, header in headers.items()
    )
    raise InputError(
        f"no sheet has columns for time, current and voltage in its first row. "
        f"Sheets found: {cut(listing, 1000)}. Name the columns, for example, 'Test Time / s', "
        "'Current / A' and 'Voltage / V'."
    )


def _joined(bodies: dict[str, pl.DataFrame], names: _Names, ignored: list[str]) -> Table:
    """The sheets one after another, in the order of their first times.

    The order of sheets in a workbook is arbitrary.
    """
    header = names.header
    filled = [(name, body) for name, body in bodies.items() if body.height]
    clock = header.columns.get("time") or header.columns.get("date")
    if len(filled) > 1 and clock is not None:
        cells = (body.to_series(clock.index).head(1) for _, body in filled)
        starts = [float(numbers(first, clock)[0]) for first in cells]
        filled = [filled[index] for index in np.argsort(starts, kind="stable")]
    tables = [Table(header, (pl.Series([], dtype=pl.String),) * len(header.names), np.arange(0))]
    for name, body in filled:
        columns = tuple(body.to_series(k) for k in range(len(header.names)))
        rows = np.arange(body.height) + names.body + 1
        tables.append(Table(header, columns, rows, ((name, body.height),)))
    table = Table.stacked(tables[1:] or tables)
    if ignored:
        sheets = f"sheet{'s' if len(ignored) > 1 else ''} {listed(ignored)}"
        table = table.leaving_out("sheets", sheets=sheets)
    return table.leaving_out("above", names_row=names.above + 1) if names.above else table


WORKBOOK = Reader("spreadsheet workbook", _recognizes, _read)

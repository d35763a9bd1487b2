"""Spreadsheet workbooks, above all the ones Arbin testers write.

An Arbin workbook holds `Info`, `Channel_<chassis>-<channel>` and, past the old sheet limit of
65,536 rows, `Channel_<chassis>-<channel>_2` and so on; users add sheets of their own. CALCE
publishes OOXML workbooks under the suffix `.xls`, so the suffix says nothing.
"""

import re

import fastexcel
import numpy as np
import polars as pl

from ...errors import InputError, cut, listed
from ..columns import NEEDED, find_columns, has_arbin_header, is_ocv_table, names_record
from ..table import Reader, Table

_OLE = b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
_CHANNEL = re.compile(r"^channel[ _]*(?P<channel>\d+(?:-\d+)?)?", re.IGNORECASE)


def _recognizes(content: bytes) -> bool:
    """An OOXML workbook is a zip archive with a folder xl; the kind before it is an OLE file."""
    return content.startswith(_OLE) or (content.startswith(b"PK") and b"xl/" in content)


def _read(content: bytes, file: str) -> Table:
    try:
        workbook = fastexcel.read_excel(content)
        headers = {name: _header(workbook, name) for name in workbook.sheet_names}
        chosen = _chosen_sheets(headers, file)
        bodies = {name: _body(workbook, name) for name in chosen}
    except InputError:
        raise
    except BaseException as error:
        # What a damaged workbook makes the library's Rust code do is outside Exception.
        if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
            raise
        raise InputError(
            f"{file}: the workbook is damaged or cut short; copy or export it again."
        ) from error
    header = headers[chosen[0]]
    for name in chosen:
        if headers[name] != header:
            raise InputError(
                f"{file}: sheets {listed([chosen[0]])} and {listed([name])} have different columns "
                "and cannot be joined; give them the same first row."
            )
    return _joined(bodies, header, ignored=[name for name in headers if name not in chosen])


def _header(workbook: fastexcel.ExcelReader, name: str) -> tuple[str, ...]:
    """A sheet's first row."""
    first = workbook.load_sheet(name, header_row=None, n_rows=1, dtypes="string").to_polars()
    return tuple(str(cell) for cell in first.row(0)) if first.height else ()


def _body(workbook: fastexcel.ExcelReader, name: str) -> pl.DataFrame:
    """The rows below a sheet's first."""
    if workbook.load_sheet(name, header_row=None).height < 2:
        return pl.DataFrame()
    sheet = workbook.load_sheet(name, header_row=None, skip_rows=1, schema_sample_rows=None)
    return sheet.to_polars()


def _chosen_sheets(headers: dict[str, tuple[str, ...]], file: str) -> list[str]:
    """The sheets that hold the record: Arbin's channel, else the only one with the columns.

    Failing that, the only one with some of them.
    """
    arbin = [
        name for name, cells in headers.items() if _CHANNEL.match(name) and has_arbin_header(cells)
    ]
    channels = {match["channel"] for name in arbin if (match := _CHANNEL.match(name))}
    if len(channels) > 1:
        raise InputError(
            f"{file}: the workbook holds {len(channels)} channels (sheets {listed(arbin)}), "
            "and a record is of one cell; save each channel as a workbook of its own."
        )
    if arbin:
        return arbin
    whole = [name for name, cells in headers.items() if names_record(cells)]
    whole = whole or [name for name, cells in headers.items() if is_ocv_table(cells)]
    if len(whole) == 1:
        return whole
    if whole:
        raise InputError(
            f"{file}: several sheets could be the record ({listed(whole)}); keep one of them."
        )
    partial = [name for name, cells in headers.items() if find_columns(cells).keys() & NEEDED]
    if len(partial) == 1:
        # Which of its columns is missing is for the reader of columns to say.
        return partial
    found = "; ".join(f"{name}: {listed(cells) or 'empty'}" for name, cells in headers.items())
    raise InputError(
        f"{file}: no sheet has columns for time, current and voltage in its first row. "
        f"Sheets found: {cut(found, 1000)}. Name the columns, for example, 'Test Time / s', "
        "'Current / A' and 'Voltage / V'."
    )


def _joined(bodies: dict[str, pl.DataFrame], header: tuple[str, ...], ignored: list[str]) -> Table:
    """The sheets one after another, in the order of their first lines' clock.

    Workbooks do not promise the order of their sheets; the clock does.
    """
    filled = {name: body for name, body in bodies.items() if body.height}
    names = list(filled)
    if len(names) > 1:
        clock = find_columns(header)["time"].index
        names.sort(key=lambda name: _first_number(filled[name].to_series(clock)))
    word = "sheets" if len(ignored) > 1 else "sheet"
    notes = (f"ignored the {word} {listed(ignored)}",) if ignored else ()
    return Table(
        header=header,
        columns=tuple(
            _stacked([filled[name].to_series(k) for name in names]) for k in range(len(header))
        ),
        row=np.concatenate([np.arange(0), *(np.arange(filled[name].height) + 2 for name in names)]),
        sheets=tuple((name, filled[name].height) for name in names),
        notes=notes,
    )


def _first_number(column: pl.Series) -> float:
    number = column.head(1).cast(pl.Float64, strict=False).item()
    return float("inf") if number is None else number


def _stacked(parts: list[pl.Series]) -> pl.Series:
    """One series; text as soon as one part is text, so that a stray word can be quoted."""
    if not parts:
        return pl.Series([], dtype=pl.String)
    if len({part.dtype for part in parts}) > 1:
        parts = [part.cast(pl.String) for part in parts]
    return pl.concat([part.alias("") for part in parts])


WORKBOOK = Reader("spreadsheet workbook", _recognizes, _read)

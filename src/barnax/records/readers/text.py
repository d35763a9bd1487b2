"""Delimited text: comma, semicolon, tab or bar between the cells, point or comma in numbers."""

import codecs
import csv
import io
import re

import numpy as np
import polars as pl

from ...errors import InputError, reason_of
from ..columns import is_ocv_table, names_record
from ..table import Reader, Table

_DELIMITERS = ",;\t|"
_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
# The longest preambles known have some 80 lines, the widest headers some 3,000 characters.
_PREAMBLE_LINES, _PREAMBLE_LETTERS, _LONGEST_HEADER = 200, 200_000, 20_000
_DECIMAL_COMMA = re.compile(r"^\s*-?\d+,\d+(?:[eE][+-]?\d+)?\s*$")


def _recognizes(content: bytes) -> bool:
    """Text has no zero byte, but for UTF-16, which says so in its first two."""
    return content.startswith(_UTF16) or b"\0" not in content[:65536]


def _decoded(content: bytes, file: str) -> str:
    """The text; testers write UTF-8, UTF-16 or, for their degree signs, Latin-1."""
    if content.startswith(_UTF16):
        try:
            return content.decode("utf-16")
        except UnicodeDecodeError as error:
            raise InputError(
                f"{file}: starts as UTF-16 text but does not go on so; save it as UTF-8."
            ) from error
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _cells(line: str, delimiter: str) -> list[str]:
    """The cells of one line; none where the standard library finds a cell too long."""
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error:
        return []


def _read(content: bytes, file: str) -> Table:
    text = _decoded(content, file).replace("\r\n", "\n").replace("\r", "\n")
    # The row in the file is kept, so blank lines above the header count.
    lead = len(text) - len(text.lstrip("\n"))
    head = text[lead:].partition("\n")[0]
    if not head.replace("\t", "").isprintable():
        raise InputError(
            f"{file}: the first line is not text, so this is no table of samples, whatever the "
            "file's suffix says; export the record as CSV, Parquet or a workbook."
        )
    above = _lines_above_names(text[lead:])
    head, _, body = text[lead:].split("\n", above)[-1].partition("\n")
    delimiter = max(_DELIMITERS, key=head.count)
    header = _cells(head, delimiter)
    if not header:
        raise InputError(
            f"{file}: a cell of the first line has {len(head)} letters, so this is no table of "
            "samples; export the record as plain CSV."
        )
    columns = _string_columns(body, len(header), delimiter, file)
    first_line = _cells(body.partition("\n")[0], delimiter)
    if delimiter != "," and any(_DECIMAL_COMMA.match(cell) for cell in first_line):
        columns = [column.str.replace_all(",", ".", literal=True) for column in columns]
    rows = len(columns[0])
    first = lead + above + 2
    note = f"ignored the rows above the column names in row {first - 1}"
    return Table(
        header=tuple(header),
        columns=tuple(columns),
        row=np.arange(first, first + rows),
        notes=(note,) if above else (),
    )


def _lines_above_names(text: str) -> int:
    """How many lines stand above the one that names the columns; 0 where none does.

    Some testers write what was tested, by whom and when above their table.
    """
    start = text[:_PREAMBLE_LETTERS]
    for number, line in enumerate(start.split("\n", _PREAMBLE_LINES)[:_PREAMBLE_LINES]):
        if len(line) > _LONGEST_HEADER:
            continue
        cells = _cells(line, max(_DELIMITERS, key=line.count))
        if names_record(cells) or is_ocv_table(cells):
            return number
    return 0


def _string_columns(body: str, width: int, delimiter: str, file: str) -> list[pl.Series]:
    """The cells below the header as text, so that a message can quote what stands there."""
    if not body.strip():
        return [pl.Series(str(k), [], dtype=pl.String) for k in range(width)]
    # The first line tells Polars the width, and testers end the names or the cells with one more
    # delimiter: a line of our own is as wide as the header.
    wide = delimiter * (width - 1) if width > 1 else '""'
    try:
        frame = pl.read_csv(
            io.BytesIO(f"{wide}\n{body}".encode()),
            has_header=False,
            schema={str(k): pl.String for k in range(width)},
            separator=delimiter,
            truncate_ragged_lines=True,
        )
    except pl.exceptions.PolarsError as error:
        raise InputError(
            f"{file}: cannot be split into columns at {delimiter!r} ({reason_of(error)});"
            " export it as plain CSV without quotes inside cells."
        ) from error
    return [column[1:].str.strip_chars().replace("", None) for column in frame.get_columns()]


TEXT = Reader("delimited text", _recognizes, _read)

"""Delimited text: cells separated by comma, semicolon, tab, bar or blanks, with any decimal mark.

The lines above the names are skipped, units below them are joined to them, and rows of another
layer, such as cycles and steps in Neware's reports, are left out. Polars reads the cells.
"""

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Bool

from ...errors import InputError, counted
from ..cell_values import numbers
from ..columns import Column, Header
from ..quantities import CELL_RANGE_V, NEEDED
from ..table import Reader, Table
from .content import NUMBER_BYTES, as_utf8, head_lines, is_text, require_room

Schema = Mapping[str, type[pl.DataType]]

_DELIMITERS = ",;\t|"
_BLANK = " "  # Cells in columns, as printed to be read by people.
# The widest headers have about 3,000 characters.
_LONGEST_HEADER = 20_000
# From this many rows Polars guesses the types of columns.
_GUESSED_LINES = 1000
# This many lines show whether numbers are cut in two.
_SPLIT_LINES = 200
_WORD = "[A-Za-z]{3}"


def _cells(line: str, delimiter: str) -> list[str]:
    """The cells of one line; none if the standard library finds a cell too long."""
    if delimiter == _BLANK:
        return re.sub(r"[ \t]{2,}", "\t", line.strip()).split("\t")
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error:
        return []


def _read(content: bytes, given: Mapping[str, str]) -> Table:
    content = as_utf8(content)
    # Blank lines above the names count, so that each row keeps its number in the file.
    lines = head_lines(content)
    above, names, delimiter = _layout(lines, given)
    lead = above + 1
    content, breaks = _without_repeats(content, above)
    # Below the names, the first line that is not blank may have the units.
    blank = next((k for k, line in enumerate(lines[lead:]) if line.strip()), 0)
    below = "".join(lines[lead + blank : lead + blank + 1])
    header = names.with_units(_cells(below, delimiter))
    _refuse_decimal_commas(lines[lead:], above, len(header.names), delimiter)
    names_row = above + 1
    lead += blank + 1 if header is not names else 0
    above = lead
    if delimiter == _BLANK:
        content = re.sub(rb"(?m)^[ \t]+|[ \t]+(?=\r?$)", b"", content[_offset(content, lead) :])
        # A date and its time are one cell.
        content = re.sub(rb"(\d[-./]\d+)[ \t]+(\d+:\d)", rb"\1T\2", content)
        content, above, delimiter = re.sub(rb"[ \t]+", b"\t", content), 0, "\t"
    rows = content.count(b"\n", _offset(content, above))
    require_room(NUMBER_BYTES * rows * len(header.names), content)
    header = Header((*header.names, ""), given)
    columns = _columns(content, _offset(content, above), header.names, delimiter)
    row = np.arange(lead + 1, lead + 1 + len(columns[0]))
    for begin, dropped in reversed(breaks):
        row[row >= begin] += dropped
    table = Table(header, columns, row)
    if names_row > 1:
        table = table.leaving_out("above", names_row=names_row)
    if breaks:
        again = ", ".join(str(begin + dropped) for begin, dropped in breaks[:5])
        table = table.leaving_out("names", rows=again)
    return _without_headings(_within_the_names(_records_of_layers(table)))


def _within_the_names(table: Table) -> Table:
    """The table without its last column, for cells beyond the names, if that is empty.

    Raises InputError if rows have more cells than there are names: it is then unknown which cell
    belongs to which name.
    """
    *columns, beyond = table.columns
    header = Header(table.header.names[:-1], table.header.given)
    table = replace(table, header=header, columns=tuple(columns))
    if columns[-1].dtype != pl.String:
        # A remark after the numbers does not displace them.
        beyond = beyond.cast(pl.Float64, strict=False)
    if beyond.null_count() == len(beyond):
        return table
    wide = np.flatnonzero(beyond.is_not_null())
    named = header.columns
    if not any(column.dtype.is_numeric() for column in columns) and not named:
        raise InputError(
            "no row of names with numbers below, so this is no table of measurements; "
            "export the record as CSV, Parquet or a workbook."
        )
    where, names = f"row {table.row[wide[0]]}", len(header.names)
    if len(wide) > 0.5 * len(table.row):
        if _fits(named, columns) and not _fits(named, [*columns[1:], beyond]):
            return table.leaving_out("cells", names=names)
        raise InputError(
            f"{where}: the rows have more cells than the {names} names in row {table.names_row}, "
            "and it is not clear which cell has no name; add the missing name there."
        )
    raise InputError(
        f"{where}: this row ({counted(len(wide), 'such row')}) has more than {names} cells, "
        "perhaps because of a thousands separator or a comma within a cell; export it with "
        "another delimiter, or with quotes around such cells."
    )


def _fits(named: Mapping[str, Column], columns: Sequence[pl.Series]) -> bool:
    """True if the columns fit the names: a clock that runs, and the voltage of a cell."""
    clock = named.get("time") or named.get("date") or named.get("step time")
    if clock is None or "voltage" not in named:
        return True
    time, voltage = (
        numbers(columns[column.index].head(_GUESSED_LINES), column)
        for column in (clock, named["voltage"])
    )
    is_cell = bool(np.isfinite(voltage).all() and 0 < np.median(voltage) < CELL_RANGE_V[1])
    rises = np.diff(time) > 0
    return is_cell and bool(np.isfinite(time).all() and rises.sum() > 0.5 * len(rises))


def _layout(lines: list[str], given: Mapping[str, str]) -> tuple[int, Header, str]:
    """The number of lines above the names, the names, and the delimiter: of the first line with the
    names of a record or an OCV table, else the first that is not blank.

    Some testers describe the test above their table.
    """
    fallback, most = None, 1
    for above, line in enumerate(lines):
        # Numbers are not names, unless the user has given them as such.
        is_of_numbers = fallback is not None and not given and not any(map(str.isalpha, line))
        if is_of_numbers or len(line) > _LONGEST_HEADER or not line.strip():
            continue
        delimiter, header = _names(line, given)
        if header.is_record or header.is_ocv_table:
            return above, header, delimiter
        # The names of a record may come further below.
        named = len(NEEDED) if header.other_table else len(header.columns.keys() & NEEDED)
        if fallback is None or named > most:
            fallback, most = (above, header, delimiter), max(named, most)
    first = next((line for line in lines if line.strip()), "")
    if not first.replace("\t", "").isprintable():
        raise InputError(
            "the first line is not text, so this is not a table of samples, whatever the "
            "file's suffix; export the record as CSV, Parquet or a workbook."
        )
    if fallback is None or not fallback[1].names:
        raise InputError(
            f"a cell of the first line has {len(first)} letters, so this is not a table of "
            "samples; export the record as plain CSV."
        )
    return fallback


def _names(line: str, given: Mapping[str, str]) -> tuple[str, Header]:
    """The delimiter of a line and its names: the delimiter that gives the names of a record, else
    the commonest.

    Without a delimiter, names are separated by several blanks, else by single ones.
    """
    commonest = sorted(_DELIMITERS, key=line.count, reverse=True)
    split = [(mark, Header(tuple(_cells(line, mark)), given)) for mark in commonest if mark in line]
    of_record = (candidate for candidate in split if candidate[1].is_record)
    best = next(of_record, split[0] if split else None)
    if best is not None and len(best[1].names) != 1:
        return best
    apart, close = (Header(tuple(cells), given) for cells in (_cells(line, _BLANK), line.split()))
    return _BLANK, close if close.is_record and not apart.is_record else apart


def _offset(content: bytes, lines: int, at: int = 0) -> int:
    """The offset of the line after this many, counted from the one at `at`."""
    for _ in range(lines):
        at = content.find(b"\n", at) + 1
        if at == 0:
            return len(content)
    return at


def _without_repeats(content: bytes, above: int) -> tuple[bytes, list[tuple[int, int]]]:
    """The content without the repeated names of joined files and the lines above them.

    Also each row from which lines are left out, and their number.
    """
    start, end = _offset(content, above), _offset(content, above + 1)
    names, first = content[start:end], content[: _offset(content, 1)]
    breaks, at = [], end
    while len(names) > 20 and (at := content.find(b"\n" + names, at)) >= 0:
        begins = content.rfind(b"\n" + first, end, at) if first.strip() else -1
        begins = begins if begins >= 0 else at
        ends = at + len(names)
        row = above + 3 + content.count(b"\n", end, begins)
        breaks.append((row, content.count(b"\n", begins, ends)))
        content = content[:begins] + content[ends:]
        at = begins
    return content, breaks


def _refuse_decimal_commas(lines: Sequence[str], above: int, names: int, delimiter: str) -> None:
    """Raise InputError if commas between cells cut numbers with decimal commas in two: there are
    more numbers than names, and none has a point."""
    lines = [line for line in lines[:_SPLIT_LINES] if line.strip(", ")]
    beyond = [cell for line in lines for cell in _cells(line.rstrip(", "), ",")[names:]]
    are_whole = beyond and all(re.fullmatch(r"\d+([eE][+-]?\d+)?", cell) for cell in beyond)
    if delimiter == "," and are_whole and not any(re.search(r"\d\.\d", line) for line in lines):
        raise InputError(
            f"row {above + 2}: the rows have more cells than the {names} names: commas separate "
            "cells and also decimals; export it with semicolons, or with decimal points."
        )


def _columns(
    text: bytes, start: int, header: Sequence[str], delimiter: str
) -> tuple[pl.Series, ...]:
    """The cells from `start` on: numbers if a column has nothing else, else text."""
    texts = {str(k): pl.String for k in range(len(header))}
    # Polars takes the width from the first line, and testers end the names or the cells with one
    # more delimiter: our own first line is as wide as the header.
    wide = f"{delimiter * (len(header) - 1)}\n".encode() if len(header) > 1 else b'""\n'
    encoding = "utf8" if text.isascii() else "utf8-lossy"
    how: dict[str, Any] = {"separator": delimiter, "encoding": encoding, "has_header": False}

    def parsed(end: int | None, schema: Mapping[str, type[pl.DataType]]) -> pl.DataFrame:
        content = b"".join([wide, memoryview(text)[start:end]])
        return pl.read_csv(content, schema=schema, truncate_ragged_lines=True, **how)[1:]

    try:
        first = _plain(parsed(_offset(text, _GUESSED_LINES, start), texts))
        try:
            frame = parsed(None, {**texts, **dict.fromkeys(first, pl.Float64)})
        except pl.exceptions.PolarsError:
            frame = parsed(None, texts)
    except pl.exceptions.PolarsError as error:
        raise InputError(
            f"cannot be split into columns at {delimiter!r}; export it as plain CSV without"
            " quotes inside cells."
        ) from error
    plain = _plain(frame)
    words = frame.drop(*plain).select(pl.all().str.strip_chars().replace("", None))
    return tuple(plain[name] if name in plain else words[name] for name in frame.columns)


def _plain(frame: pl.DataFrame) -> dict[str, pl.Series]:
    """The columns of plain numbers, by name."""
    read = zip(frame, frame.select(pl.all().cast(pl.Float64, strict=False)), strict=True)
    return {
        plain.name: plain
        for cells, plain in read
        if plain.null_count() == cells.null_count() < len(cells)
    }


def _kept(table: Table, is_left_out: Bool[np.ndarray, "lines"], part: str) -> Table:
    """The table without some lines, and a note of them."""
    kept = pl.Series(~is_left_out)
    columns = tuple(column.filter(kept) for column in table.columns)
    left = replace(table, columns=columns, row=table.row[~is_left_out])
    return left.leaving_out(part, rows=is_left_out.sum())


def _records_of_layers(table: Table) -> Table:
    """The table without the rows that have something in the first columns where those are otherwise
    blank.

    Neware's reports write cycles, steps and records below one another, each indented further.
    """
    names = table.header.names
    blank = next((k for k, name in enumerate(names) if name), 0)
    if not blank or not table.header.is_record:
        return table
    front = np.any([column.is_not_null().to_numpy() for column in table.columns[:blank]], axis=0)
    header, columns = Header(names[blank:], table.header.given), table.columns[blank:]
    # If all rows have it, it is a column without a name, such as an index of pandas.
    if front.all() or not front.any():
        return replace(table, header=header, columns=columns)
    if "step" not in header.columns:
        # Every other row begins a step; the row of a cycle is on one line with its first step.
        header = Header(("Step Count", *header.names), header.given)
        columns = (pl.Series(np.cumsum(front)), *columns)
    records = replace(table, header=header, columns=columns)
    return _kept(records, front, "layers")


def _without_headings(table: Table) -> Table:
    """The table without the lines between its rows that have words in the first cell only."""
    first, *others = table.columns
    if first.dtype != pl.String or not all(column.null_count() for column in others):
        return table
    are_bare = np.all([column.is_null().to_numpy() for column in others], axis=0)
    are_headings = are_bare & first.str.contains(_WORD).fill_null(False).to_numpy()
    if not are_headings.any() or not table.header.is_record:
        return table
    return _kept(table, are_headings, "words")


TEXT = Reader("delimited text", is_text, _read)

"""Workbooks of the kind before OOXML: small records in a small file system (MS-XLS, MS-CFB).

Only what a reader needs: one sheet of numbers and texts.
"""

import struct

import polars as pl

SECTOR = 512
FREE, END, TABLE = 0xFFFFFFFF, 0xFFFFFFFE, 0xFFFFFFFD


def old_workbook(frame: pl.DataFrame, name: str = "data") -> bytes:
    """A table as such a workbook, its names in the first row."""
    rows = [tuple(frame.columns), *frame.rows()]
    start = _record(0x0809, struct.pack("<HHHHII", 0x0600, 5, 0, 0, 0, 6))
    # Where the sheet begins is known once the records before it are.
    before = len(start) + 4 + 8 + len(name) + 4
    sheet = struct.pack("<IHBB", before, 0, len(name), 0) + name.encode("latin-1")
    cells = b"".join(
        _cell(row, column, value)
        for row, values in enumerate(rows)
        for column, value in enumerate(values)
    )
    size = struct.pack("<IIHHH", 0, len(rows), 0, len(rows[0]), 0)
    stream = (
        start
        + _record(0x0085, sheet)
        + _record(0x000A)
        + _record(0x0809, struct.pack("<HHHHII", 0x0600, 0x0010, 0, 0, 0, 6))
        + _record(0x0200, size)
        + cells
        + _record(0x000A)
    )
    return _file_system("Workbook", stream)


def _record(kind: int, content: bytes = b"") -> bytes:
    return struct.pack("<HH", kind, len(content)) + content


def _cell(row: int, column: int, value: str | float) -> bytes:
    place = struct.pack("<HHH", row, column, 0)
    if isinstance(value, str):
        text = struct.pack("<HB", len(value), 0) + value.encode("latin-1")
        return _record(0x0204, place + text)
    return _record(0x0203, place + struct.pack("<d", value))


def _file_system(name: str, stream: bytes) -> bytes:
    """A stream in a compound file: header, allocation table, directory, then the stream."""
    # Shorter streams would go to another table.
    stream = stream.ljust(4096, b"\0")
    sectors = -(-len(stream) // SECTOR)
    table = [TABLE, END, *range(3, 2 + sectors), END]
    header = (
        b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1"
        + bytes(16)
        + struct.pack("<HHHHH", 0x3E, 3, 0xFFFE, 9, 6)
        + bytes(6)
        + struct.pack("<IIIIIIIII", 0, 1, 1, 0, 4096, END, 0, END, 0)
        + struct.pack("<I", 0)
        + struct.pack("<I", FREE) * 108
    )
    directory = _entry("Root Entry", 5, 1, END, 0) + _entry(name, 2, FREE, 2, len(stream))
    return (
        header
        + b"".join(struct.pack("<I", each) for each in table).ljust(SECTOR, b"\xff")
        + directory.ljust(SECTOR, b"\0")
        + stream.ljust(sectors * SECTOR, b"\0")
    )


def _entry(name: str, kind: int, child: int, sector: int, size: int) -> bytes:
    letters = name.encode("utf-16-le") + b"\0\0"
    return (
        letters.ljust(64, b"\0")
        + struct.pack("<HBBIII", len(letters), kind, 1, FREE, FREE, child)
        + bytes(36)
        + struct.pack("<IQ", sector, size)
    )

"""Parquet files of a few hundred bytes that claim whatever a test wants them to.

Each column is one value repeated: a dictionary of one, and a run of its index.
"""

import struct
from dataclasses import dataclass
from typing import Any

NAMES = (b"Test Time / s", b"Current / A", b"Voltage / V")


class Short(int):
    """An integer that the format announces as one of 32 bits."""


# The format's own numbers.
DOUBLE, REQUIRED, UNCOMPRESSED = Short(5), Short(0), Short(0)
PLAIN, RLE, RLE_DICTIONARY = Short(0), Short(3), Short(8)
DATA_PAGE, DICTIONARY_PAGE = Short(0), Short(2)


@dataclass(frozen=True)
class Claims:
    """What the footer and the pages say, where it is not the truth."""

    rows: int = 20
    columns: int = 3
    group_rows: int | None = None
    chunk_values: int | None = None
    page_values: int | None = None
    page_bytes: int | None = None
    page_kind: int = DATA_PAGE
    page_offset: int | None = None
    chunk_bytes: int | None = None
    type_length: int | None = None
    nesting: int = 0


def varint(value: int) -> bytes:
    """Seven bits a byte, the lowest first."""
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def compact(value: Any) -> tuple[int, bytes]:
    """Thrift's kind and bytes of an integer, a text, a list, or a structure by field number."""
    if isinstance(value, int):
        return 5 if isinstance(value, Short) else 6, varint((value << 1 ^ value >> 63) % 2**64)
    if isinstance(value, bytes):
        return 8, varint(len(value)) + value
    if isinstance(value, list):
        items = [compact(item) for item in value]
        head = bytes([0xF0 | (items[0][0] if items else 12)]) + varint(len(items))
        return 9, head + b"".join(content for _, content in items)
    content, last = b"", 0
    for number, field in value.items():
        if field is not None:
            kind, field_content = compact(field)
            content += bytes([number - last << 4 | kind]) + field_content
            last = number
    return 12, content + b"\0"


def tiny_parquet(claims: Claims = Claims()) -> bytes:
    """The file. With claims that are true it is a good one: column k holds the number k."""
    body, chunks = b"PAR1", []
    for column in range(claims.columns):
        begin = len(body)
        body += _page({1: DICTIONARY_PAGE}, {7: {1: Short(1), 2: PLAIN}}, struct.pack("<d", column))
        data = len(body)
        body += _data_page(claims)
        place = {
            7: _or(claims.chunk_bytes, len(body) - begin),
            9: _or(claims.page_offset, data),
            11: begin,
        }
        values = {5: _or(claims.chunk_values, claims.rows), 6: len(body) - begin}
        kinds = {1: DOUBLE, 2: [PLAIN, RLE, RLE_DICTIONARY], 3: [_name(column)], 4: UNCOMPRESSED}
        chunks.append({2: begin, 3: kinds | values | place})
    group = {1: chunks, 2: len(body), 3: _or(claims.group_rows, claims.rows)}
    footer = compact({1: Short(1), 2: _schema(claims), 3: claims.rows, 4: [group]})[1]
    return body + footer + struct.pack("<i", len(footer)) + b"PAR1"


def _schema(claims: Claims) -> list[dict[int, Any]]:
    groups = [{3: REQUIRED, 4: b"nest", 5: Short(1)}] * claims.nesting
    width = None if claims.type_length is None else Short(claims.type_length)
    leaves = [
        {1: DOUBLE, 2: width, 3: REQUIRED, 4: _name(column)} for column in range(claims.columns)
    ]
    return [{4: b"schema", 5: Short(claims.columns)}, *groups, *leaves]


def _data_page(claims: Claims) -> bytes:
    values = Short(_or(claims.page_values, claims.rows))
    head = {5: {1: values, 2: RLE_DICTIONARY, 3: RLE, 4: RLE}}
    # One bit an index, and one run of zeros.
    run = b"\1" + varint(claims.rows << 1) + b"\0"
    return _page({1: Short(claims.page_kind)}, head, run, claims.page_bytes)


def _page(
    kind: dict[int, Any], head: dict[int, Any], content: bytes, size: int | None = None
) -> bytes:
    sizes = {2: Short(_or(size, len(content))), 3: Short(len(content))}
    return compact(kind | sizes | head)[1] + content


def _name(column: int) -> bytes:
    return NAMES[column] if column < len(NAMES) else b"column %d" % column


def _or(claim: int | None, truth: int) -> int:
    return truth if claim is None else claim

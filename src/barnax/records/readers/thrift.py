"""Structures in Thrift's compact protocol, in which a Parquet file says what it holds.

Written after the protocol's public specification (thrift-compact-protocol.md of Apache Thrift).
"""

import struct
from typing import Any

_TRUE, _FALSE, _BYTE, _INTEGERS, _DOUBLE, _BINARY = 1, 2, 3, (4, 5, 6), 7, 8
_LISTS, _MAP, _STRUCT = (9, 10), 11, 12
# Parquet's own structures are eight deep.
_DEEPEST = 16
_LONGEST_INTEGER = 10

Fields = dict[int, Any]


class Broken(ValueError):
    """The bytes are no such structure."""


def read_struct(content: bytes, start: int, end: int) -> tuple[Fields, int]:
    """The fields by number of the structure at `start`, and where it ends.

    Structures in it are such fields again, lists are lists, texts are bytes. Raises `Broken`
    where it does not end before `end`.

    >>> read_struct(bytes([0x15, 0x02, 0x18, 0x01, 0x41, 0x00]), 0, 6)
    ({1: 1, 2: b'A'}, 6)
    """
    reader = _Reader(content, start, end)
    return reader.struct(_DEEPEST), reader.at


class _Reader:
    """A place in some bytes that moves on as they are read."""

    def __init__(self, content: bytes, at: int, end: int):
        self.content, self.at, self.end = content, at, end

    def struct(self, deepest: int) -> Fields:
        if not deepest:
            raise Broken("nested too deep")
        fields, number = {}, 0
        while head := self.byte():
            step, kind = head >> 4, head & 15
            number = number + step if step else self.integer()
            fields[number] = kind == _TRUE if kind <= _FALSE else self.value(kind, deepest - 1)
        return fields

    def value(self, kind: int, deepest: int) -> Any:
        if kind in (_TRUE, _FALSE):
            return self.byte() == _TRUE
        if kind == _BYTE:
            return self.byte()
        if kind in _INTEGERS:
            return self.integer()
        if kind == _DOUBLE:
            return struct.unpack("<d", self.take(8))[0]
        if kind == _BINARY:
            return self.take(self.unsigned())
        if kind in _LISTS:
            return self.items(deepest)
        if kind == _STRUCT:
            return self.struct(deepest)
        if kind == _MAP and not self.unsigned():
            return {}
        raise Broken(f"holds a value of kind {kind}")

    def items(self, deepest: int) -> list[Any]:
        if not deepest:
            raise Broken("nested too deep")
        head = self.byte()
        count, kind = head >> 4, head & 15
        if count == 15:
            count = self.unsigned()
        # Every item is a byte at least.
        if count > self.end - self.at:
            raise Broken(f"claims a list of {count}")
        return [self.value(kind, deepest - 1) for _ in range(count)]

    def integer(self) -> int:
        """A signed integer: zigzag, so that small ones are short."""
        value = self.unsigned()
        return (value >> 1) ^ -(value & 1)

    def unsigned(self) -> int:
        value = 0
        for place in range(_LONGEST_INTEGER):
            byte = self.byte()
            value |= (byte & 127) << 7 * place
            if byte < 128:
                return value
        raise Broken("an integer does not end")

    def byte(self) -> int:
        if self.at >= self.end:
            raise Broken("ends within a structure")
        self.at += 1
        return self.content[self.at - 1]

    def take(self, count: int) -> bytes:
        if count > self.end - self.at:
            raise Broken(f"claims a text of {count} bytes")
        self.at += count
        return self.content[self.at - count : self.at]

"""What a Parquet file claims to hold, checked before memory is taken for it.

A footer of a hundred bytes can claim a billion rows, and Polars ends the process, which no
`except` survives, where a page claims a number of values that no memory has. Field numbers are
those of the Parquet format's parquet.thrift. What stands inside a page, behind its compression, is
not looked at: a damaged page of texts in the encoding DELTA_BYTE_ARRAY can still end the process.
"""

from collections.abc import Iterator

from ...errors import InputError
from ..limits import MOST_CELLS, require_size
from .thrift import Broken, Fields, read_struct

_MAGIC = b"PAR1"
_ANY = 2**63
# A thousand row groups of twenty columns need some 4 MB.
_LARGEST_FOOTER, _MOST_PAGES = 8_000_000, 500_000
_LARGEST_UNPACKED = 4_000_000_000
# The kinds of page, and which field of a page's header says what such a one holds.
_DATA, _INDEX, _DICTIONARY, _DATA_2 = 0, 1, 2, 3
_HEADS = {_DATA: 5, _DICTIONARY: 7, _DATA_2: 8}
_DEEPEST_COLUMN, _WIDEST_VALUE = 20, 65_536


def check_claims(content: bytes, file: str) -> None:
    """Raise `Broken` where the file contradicts itself, InputError where it is too large."""
    footer_bytes = int.from_bytes(content[-8:-4], "little")
    start = len(content) - 8 - footer_bytes
    if not content.endswith(_MAGIC) or start < len(_MAGIC) or footer_bytes > _LARGEST_FOOTER:
        raise Broken("the file's end is not that of a Parquet file")
    footer, _ = read_struct(content, start, len(content) - 8)
    widths = _leaf_widths(footer.get(2))
    rows = _count(footer, 3, _ANY)
    require_size(rows, len(widths), file)
    claims = _Claims(content, start, file)
    for group in _structs(footer.get(4)):
        group_rows = _count(group, 3, rows)
        rows -= group_rows
        chunks = _structs(group.get(1))
        if len(chunks) != len(widths):
            raise Broken(f"{len(chunks)} columns are there of {len(widths)}")
        for chunk, width in zip(chunks, widths, strict=True):
            if not isinstance(chunk.get(3), dict):
                raise Broken("a column does not say where it is")
            claims.check_chunk(chunk[3], group_rows, width)
    if rows:
        raise Broken("its row groups do not have the rows that it claims")


class _Claims:
    """The columns' pages, and how much they claim together."""

    def __init__(self, content: bytes, end: int, file: str):
        self.content, self.end, self.file = content, end, file
        self.values = self.unpacked = self.pages = 0

    def check_chunk(self, chunk: Fields, rows: int, width: int) -> None:
        """One column of one row group: its pages must be there and hold what it claims.

        `width` is the bytes of each value where that is fixed by the schema, else 0.
        """
        values = _count(chunk, 5, _ANY)
        # The dictionary comes first; some writers say 0 where there is none.
        places = [_count(chunk, place, self.end) for place in (9, 11) if chunk.get(place)]
        start = min(places, default=self.end)
        end = start + _count(chunk, 7, self.end - start)
        self.values += values
        require_size(self.values, 1, self.file)
        self._unpack(values * width)
        held = sum(self._page_values(page) for page in self._pages(start, end))
        if held != values or values < rows:
            raise Broken(f"a column's pages hold {held} values, not {values}")

    def _pages(self, start: int, end: int) -> Iterator[Fields]:
        """The page headers between two places, each page within them."""
        while start < end:
            page, start = read_struct(self.content, start, end)
            start += _count(page, 3, end - start)
            self.pages += 1
            self._unpack(_count(page, 2, _LARGEST_UNPACKED))
            yield page

    def _unpack(self, size: int) -> None:
        """Count bytes that would be taken from the memory, and pages."""
        self.unpacked += size
        if self.pages > _MOST_PAGES or self.unpacked > _LARGEST_UNPACKED:
            raise InputError(
                f"{self.file}: would unpack to {self.unpacked / 1e9:.1f} GB in {self.pages} "
                "pages, more than is read; give a part of the record, or fewer columns."
            )

    def _page_values(self, page: Fields) -> int:
        """How many of the column's values a page holds; a dictionary or an index holds none."""
        kind = _count(page, 1, _DATA_2)
        if kind == _INDEX:
            return 0
        head = page.get(_HEADS[kind])
        if not isinstance(head, dict):
            raise Broken("a page does not say what it holds")
        values = _count(head, 1, MOST_CELLS)
        if kind == _DATA_2:
            _count(head, 2, values)
            _count(head, 6, page[3] - _count(head, 5, page[3]))
        return 0 if kind == _DICTIONARY else values


def _leaf_widths(schema: object) -> list[int]:
    """The bytes of a value of each column, 0 where it is not fixed in the schema.

    A schema's elements come depth first.
    """
    elements = _structs(schema)
    open_groups: list[int] = []
    widths = []
    for element in elements:
        children = _count({5: 0} | element, 5, len(elements))
        width = _count({2: 0} | element, 2, _WIDEST_VALUE)
        if not children:
            widths.append(width)
        if open_groups:
            open_groups[-1] -= 1
        open_groups.append(children)
        while open_groups and not open_groups[-1]:
            open_groups.pop()
        if len(open_groups) > _DEEPEST_COLUMN:
            raise Broken("its columns are nested too deep")
    return widths


def _structs(value: object) -> list[Fields]:
    if not isinstance(value, list) or not all(isinstance(each, dict) for each in value):
        raise Broken("a list of what it holds is missing")
    return value


def _count(fields: Fields, number: int, most: int) -> int:
    """A number from zero to `most`. Raises `Broken` for anything else."""
    value = fields.get(number)
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= most:
        raise Broken(f"it claims {value!r} where 0 to {most} are possible")
    return value

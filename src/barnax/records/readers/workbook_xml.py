"""What the XML parts of a workbook hold, found without believing what they declare."""

from typing import NamedTuple
from xml.parsers import expat
from xml.sax.saxutils import escape

_SHARED = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<sst xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main">{}</sst>'
)
_DIGITS = "0123456789"


class Damaged(ValueError):
    """The content is no workbook, or no longer."""


class Extent(NamedTuple):
    """How far the values in a part reach, from 1, and how many of them are shared texts.

    `is_texts` says that the part is the list of the shared texts itself.
    """

    rows: int
    columns: int
    text_cells: int
    is_texts: bool


def extent_of(part: bytes) -> Extent:
    """Where the last row and the last column with a value stand in an XML part.

    Cells without a value, which spreadsheets leave behind by the million, do not count. Raises
    `Damaged` where the part is no XML.

    >>> extent_of(b'<row r="7"><c r="AB7"><v>1</v></c><c r="ZZ7"/></row>')
    Extent(rows=7, columns=28, text_cells=0, is_texts=False)
    """
    row = rows = text_cells = 0
    column: int | str = 0
    names: set[str] = set()
    widest = 0
    is_texts = is_text = False

    def start(name: str, attributes: list[str]) -> None:
        nonlocal row, rows, text_cells, column, widest, is_texts, is_text
        kind = name.rpartition(":")[2]
        if kind == "c":
            place = _attribute(attributes, "r")
            is_text = _attribute(attributes, "t") == "s"
            if place is None:
                column = column_number(column) + 1
            else:
                column = place.rstrip(_DIGITS)
                row = _whole(place[len(column) :])
        elif kind in ("v", "is"):
            rows = max(rows, row)
            text_cells += is_text
            if isinstance(column, str):
                names.add(column)
            else:
                widest = max(widest, column)
        elif kind == "row":
            place = _attribute(attributes, "r")
            row, column = row + 1 if place is None else _whole(place), 0
        elif kind == "si":
            is_texts = True

    _parse(part, start)
    return Extent(rows, max([widest, *map(column_number, names)]), text_cells, is_texts)


def column_number(name: int | str) -> int:
    """The number of a column by its letters, from 1; a number is given back."""
    if isinstance(name, int):
        return name
    number = 0
    for letter in name.upper():
        if not "A" <= letter <= "Z" or len(name) > 6:
            raise Damaged(f"a cell stands in column {name[:20]!r}")
        number = 26 * number + ord(letter) - ord("A") + 1
    return number


def with_cut_texts(part: bytes, longest: int) -> tuple[bytes, int]:
    """The list of shared texts, none longer than `longest`, without counts; the longest's length.

    Raises `Damaged` where the part is no XML.
    """
    texts: list[str] = []
    pieces: list[str] = []
    within: list[str] = []

    def start(name: str, _: list[str]) -> None:
        kind = name.rpartition(":")[2]
        if kind == "si":
            pieces.clear()
        within.append(kind)

    def end(_: str) -> None:
        if within.pop() == "si":
            texts.append("".join(pieces)[:longest])

    def text(piece: str) -> None:
        # What is in rPh says how a text is pronounced.
        if within[-1] == "t" and "rPh" not in within:
            pieces.append(piece)

    _parse(part, start, end, text)
    items = (f'<si><t xml:space="preserve">{escape(each)}</t></si>' for each in texts)
    return _SHARED.format("".join(items)).encode(), max(map(len, texts), default=0)


def _parse(part: bytes, start, end=None, text=None) -> None:
    # Whatever a part declares: the library that reads it after this splits its bytes as UTF-8.
    parser = expat.ParserCreate("utf-8")
    parser.ordered_attributes = True
    parser.buffer_text = True
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = text
    parser.StartDoctypeDeclHandler = _refuse_document_type
    try:
        parser.Parse(part, True)
    except expat.ExpatError as error:
        raise Damaged(f"a part is no XML: {error}") from error


def _refuse_document_type(*_: object) -> None:
    raise Damaged("a part declares a document type, which no workbook has")


def _attribute(attributes: list[str], name: str) -> str | None:
    """An attribute's value in a list of names and values in turn."""
    for place in range(0, len(attributes), 2):
        if attributes[place] == name:
            return attributes[place + 1]
    return None


def _whole(digits: str) -> int:
    if not (digits.isascii() and digits.isdigit() and len(digits) < 12):
        raise Damaged(f"a row has the number {digits[:20]!r}")
    return int(digits)

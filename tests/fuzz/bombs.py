"""Small files that ask for much: for time, for memory, or for a library's end."""

import gzip
import io
import zipfile
from collections.abc import Callable

from records.synthetic_records import workbook

from .hostile import FRAME, repacked, sheet
from .tiny_parquet import Claims, tiny_parquet

NAMES = b"time,current,voltage"
SHEET, TEXTS = "xl/worksheets/sheet1.xml", "xl/sharedStrings.xml"
MAIN = b"http://schemas.openxmlformats.org/spreadsheetml/2006/main"


def with_rows(rows: bytes) -> bytes:
    """A good workbook with these rows at its end."""

    def change(name: str, part: bytes) -> bytes:
        return part.replace(b"</sheetData>", rows + b"</sheetData>") if name == SHEET else part

    return repacked(sheet(FRAME), change)


def with_texts(cells: int, letters: int, claimed: int) -> bytes:
    """A workbook of so many cells that all show one text of so many letters."""
    content = io.BytesIO(with_rows(b'<row><c t="s"><v>0</v></c></row>' * cells))
    with zipfile.ZipFile(content, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(
            TEXTS,
            b'<sst xmlns="%s" count="%d" uniqueCount="%d"><si><t>%s</t></si></sst>'
            % (MAIN, claimed, claimed, b"x" * letters),
        )
    return content.getvalue()


def with_document_type() -> bytes:
    """A workbook whose sheet declares an entity."""
    declared = b'?><!DOCTYPE a [<!ENTITY a "aaaa">]>'
    return repacked(sheet(FRAME), lambda _, part: part.replace(b"?>", declared, 1))


BOMBS: dict[str, Callable[[], bytes]] = {
    "a million columns": lambda: b",".join([b"name"] * 10**6) + b"\n1,2\n",
    "a million columns behind three": lambda: NAMES + b",x" * 10**6 + (b"\n" + b"1," * 10**6) * 2,
    "columns by lines": lambda: NAMES + b"," * 9000 + b"\n" * 30_000,
    "commas alone": lambda: b"," * 3_000_000,
    "one long line": lambda: b"x" * 3_000_000,
    "one long cell": lambda: NAMES + b"\n1,2," + b"9" * 3_000_000,
    "a long name": lambda: NAMES + b" " * 3_000_000 + b"[V]\n1,2,3",
    "numbers of many digits": lambda: NAMES + (b"\n" + b"1" * 100_000 + b",2,3") * 20,
    "blank lines": lambda: NAMES + b"\n" * 3_000_000,
    "quotes left open": lambda: NAMES + b'\n1,2,"3' * 100_000,
    "wide lines above the names": lambda: (b"a," * 9000 + b"\n") * 200 + NAMES + b"\n1,2,3",
    "nothing but zeros in gzip": lambda: gzip.compress(bytes(3_000_000)),
    "billions of rows": lambda: tiny_parquet(Claims(rows=2_000_000_000)),
    "columns in thousands": lambda: tiny_parquet(Claims(columns=10_001)),
    "a page with less than no values": lambda: tiny_parquet(Claims(page_values=-3)),
    "pages of gigabytes": lambda: tiny_parquet(Claims(page_bytes=2**31 - 1)),
    "values of gigabytes": lambda: tiny_parquet(Claims(type_length=2**31 - 1)),
    "groups in groups": lambda: tiny_parquet(Claims(nesting=10_000)),
    "a value in the last cell": lambda: with_rows(
        b'<row r="1048576"><c r="XFD1048576"><v>1</v></c></row>'
    ),
    "a row past the last": lambda: with_rows(b'<row r="4294967295"><c><v>1</v></c></row>'),
    "a column past the last": lambda: with_rows(b'<row><c r="ZZZZZZ9"><v>1</v></c></row>'),
    "parts in parts": lambda: with_rows(b"<a>" * 100_000),
    "a part of blanks": lambda: with_rows(b" " * 10_000_000 + b"<"),
    "an entity": with_document_type,
    "billions of texts claimed": lambda: with_texts(1, 3, claimed=4_000_000_000),
    "a long text shown often": lambda: with_texts(10_000, 1_000_000, claimed=1),
    "sheets in hundreds": lambda: workbook({f"data {k}": [["x"]] for k in range(101)}),
}

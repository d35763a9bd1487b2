"""An OOXML workbook, unpacked within limits and packed again plainly, before it is read.

A workbook is an archive of XML parts. A kilobyte of it can unpack to gigabytes, or hold a single
value in the last row and column, for which the library that reads workbooks takes memory for all
cells before it, or claim more texts than there are. Where that memory is not there, the library
ends the process. What is packed again here is what was looked at, and claims nothing.
"""

import io
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager

from ...errors import InputError
from .workbook_xml import Damaged, extent_of, with_cut_texts

LARGEST_UNPACKED = 1_000_000_000
# Excel's own million rows of some fifty columns.
MOST_SHEET_CELLS = 50_000_000
# Every cell with a shared text gets its own copy.
LONGEST_TEXT, MOST_TEXT = 1000, 1_000_000_000
LARGEST_DIRECTORY = 10_000_000
_END, _END_64 = b"PK\5\6", b"PK\6\7"
# The archive's module raises a plain RuntimeError where a password is needed, ValueError for places
# before the archive's begin.
_DAMAGE = (
    zipfile.BadZipFile, zlib.error, struct.error, EOFError, OSError, RuntimeError, ValueError,
)  # fmt: skip


def plain_workbook(content: bytes, file: str) -> bytes:
    """The workbook with its XML parts alone, not compressed, and with long shared texts cut.

    Raises `Damaged` where it cannot be unpacked or read as XML, InputError where it is too large.
    """
    if _directory_bytes(content) > LARGEST_DIRECTORY:
        raise InputError(f"{file}: has too many parts for a workbook; export the record as CSV.")
    with _named_damage():
        packed = zipfile.ZipFile(io.BytesIO(content))
    plain = io.BytesIO()
    with packed, zipfile.ZipFile(plain, "w", zipfile.ZIP_STORED) as unpacked:
        _copy(packed, unpacked, file)
    return plain.getvalue()


def _copy(packed: zipfile.ZipFile, unpacked: zipfile.ZipFile, file: str) -> None:
    names = packed.namelist()
    if len(set(names)) < len(names):
        raise Damaged("two parts have one name")
    if "xl/workbook.bin" in names:
        raise InputError(
            f"{file}: is a binary workbook (.xlsb), which is not read; save it as .xlsx or CSV."
        )
    left, text_cells, longest = LARGEST_UNPACKED, 0, 0
    for info in packed.infolist():
        if not info.filename.endswith((".xml", ".rels")):
            continue
        content = _unpacked(packed, info, left, file)
        left -= len(content)
        extent = extent_of(content)
        if extent.rows * extent.columns > MOST_SHEET_CELLS:
            raise InputError(
                f"{file}: a sheet has values down to row {extent.rows} and over to column "
                f"{extent.columns}, and at most {MOST_SHEET_CELLS} cells are read; delete what "
                "stands far from the record."
            )
        text_cells += extent.text_cells
        if extent.is_texts:
            content, length = with_cut_texts(content, LONGEST_TEXT)
            longest = max(longest, length)
        unpacked.writestr(info.filename, content)
    if text_cells * longest > MOST_TEXT:
        raise InputError(
            f"{file}: has {text_cells} cells of text and texts of {longest} letters, more than is "
            "read; shorten or delete the texts."
        )


def _unpacked(packed: zipfile.ZipFile, info: zipfile.ZipInfo, most: int, file: str) -> bytes:
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise Damaged("a part is compressed as no workbook is")
    with _named_damage(), packed.open(info) as part:
        content = part.read(most + 1)
    if len(content) > most:
        raise InputError(
            f"{file}: unpacks to more than {LARGEST_UNPACKED / 1e9:g} GB; give a part of the "
            "record, or export it as CSV."
        )
    return content


@contextmanager
def _named_damage() -> Iterator[None]:
    try:
        yield
    except _DAMAGE as error:
        raise Damaged(str(error) or type(error).__name__) from error


def _directory_bytes(content: bytes) -> int:
    """How long the archive's directory claims to be; zero where there is none."""
    end = content.rfind(_END, max(0, len(content) - 65_557), len(content) - 18)
    if end < 0:
        return 0
    if content[max(0, end - 20) : end].startswith(_END_64):
        return int.from_bytes(content[end - 36 : end - 28], "little")
    return int.from_bytes(content[end + 12 : end + 16], "little")

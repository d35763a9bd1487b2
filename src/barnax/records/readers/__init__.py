"""The registry of file formats, identified by a file's content and never by its suffix.

A new format is one module with a `Reader` and one line here. Order matters: the delimited text
comes last because almost anything without a signature could be text.
"""

import gzip
import io
import re
import zipfile
from collections.abc import Mapping

from ...errors import InputError, naming
from ..columns import NOTHING
from ..table import Reader, Table
from .binary import ARBIN_RES, BIOLOGIC_MPR, NEWARE, PARQUET, ZIP
from .content import refusing, unpack, unpacked
from .matlab import MATLAB
from .text import TEXT
from .workbook import WORKBOOK

READERS: tuple[Reader, ...] = (PARQUET, NEWARE, BIOLOGIC_MPR, ARBIN_RES, MATLAB, WORKBOOK, TEXT)


_MARKUP = re.compile(
    rb"\s*(<(!doctype|html|table|\?xml|head|meta)\b|[\[{]\s*[\[{\"])", re.IGNORECASE
)


def unzipped(content: bytes) -> bytes:
    """The content, decompressed if it is gzipped, or a zip archive of one file."""
    if content.startswith(ZIP):
        return _only_file(content)
    if not content.startswith(b"\x1f\x8b"):
        return content
    damaged = "the gzipped file is damaged or cut short; copy it again."
    with refusing(damaged), gzip.GzipFile(fileobj=io.BytesIO(content)) as packed:
        return unpack(packed, content)


def _only_file(content: bytes) -> bytes:
    """The file in a zip archive of one; the archive if it has more, as workbooks do."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as packed:
            # Finder adds files of its own.
            files = [entry for entry in packed.infolist() if "__MACOSX/" not in entry.filename]
            for part in unpacked(packed, files) if len(files) == 1 else ():
                return unpack(part, content)
    except InputError:
        raise
    except Exception:
        # Damaged and encrypted archives fail in many ways; each reader explains its own format.
        return content
    return content


def read_table(content: bytes, file: str, given: Mapping[str, str] = NOTHING) -> Table:
    """The table in a file's bytes; `file` is the name that messages use.

    `given` has the user's names of columns, by quantity. A gzipped file, or a zip of one file, is
    unpacked first.

    Raises InputError if the file is empty, if no reader recognizes its content, or if it is
    damaged.
    """
    with naming(file):
        if file.startswith("~$"):
            raise InputError(
                f"Excel's lock file of an open workbook, not the workbook; give {file[2:]}."
            )
        content = unzipped(content)
        if content.isspace() or not content:
            raise InputError("the file is empty; give a file with measured samples.")
        if _MARKUP.match(content):
            raise InputError(
                "the content is HTML, XML or JSON, not a table of cells, whatever the file's "
                "suffix; open it in a spreadsheet program or a script, and save it as CSV."
            )
        for reader in READERS:
            if reader.recognizes(content):
                return reader.read(content, given)
        if content.startswith(ZIP):
            raise InputError(
                "a zip archive, and not of one readable file; unpack it and give one of its files."
            )
        formats = ", ".join(reader.name for reader in READERS)
        raise InputError(
            "the content is binary and not in a known format, whatever the file's suffix. "
            f"Known formats: {formats}. Export the record as one of them."
        )


__all__ = ["READERS", "Reader", "read_table", "unzipped"]

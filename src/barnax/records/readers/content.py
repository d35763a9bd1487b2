"""A file's bytes before its format is read: memory for its content, and text as UTF-8.

A compressed file of a few kilobytes may hold more than any memory, so memory is checked before it
is used: compressed data are counted while they are unpacked; where only a library knows, it runs in
a separate process, which may die.
"""

import codecs
import gzip
import io
import os
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from copy import copy
from shutil import copyfileobj
from typing import IO
from zipfile import ZipFile, ZipInfo

from ...errors import InputError, counted
from ..table import LARGEST_FILE

# Bytes of a number while it is read, and after.
NUMBER_BYTES = 16
_PIECE = 1 << 20
_LIMITED = """
import sys
content = sys.stdin.buffer.read()
try:
    import resource
    most = resource.getrlimit(resource.RLIMIT_DATA)[1]
    resource.setrlimit(resource.RLIMIT_DATA, (int(sys.argv[1]) + 2 * len(content), most))
except (ImportError, OSError, ValueError):
    pass
"""
# For a while a library holds part of the content twice.
_FOR_A_WHILE = 1.5
# Threads need memory too, and there may be many cores with one each.
_ALONE = {"POLARS_MAX_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def require_room(size: float, content: bytes, doubt: str = "") -> None:
    """Raise InputError if a file's content takes this many bytes and that is too many."""
    if size > LARGEST_FILE:
        raise InputError(
            f"its {len(content):,} bytes need more than the limit of "
            f"{LARGEST_FILE / 1e9:g} GB of memory{doubt}; give a part of the record, or fewer "
            "columns, as CSV."
        )


def require_room_to_unpack(parts: Iterable[IO[bytes] | gzip.GzipFile], content: bytes) -> None:
    """Raise InputError if compressed files are too large together; nothing is kept."""
    size = 0
    for part in parts:
        while piece := part.read(_PIECE):
            size += len(piece)
            require_room(size, content)


def require_room_to_unzip(content: bytes) -> None:
    """Raise InputError if the files of a zip archive are too large together."""
    with ZipFile(io.BytesIO(content)) as packed:
        require_room_to_unpack(unpacked(packed, packed.infolist()), content)


def unpack(part: IO[bytes] | gzip.GzipFile, content: bytes) -> bytes:
    """Unpack a compressed file that can be read twice, without a second copy while it is
    assembled."""
    require_room_to_unpack([part], content)
    part.seek(0)
    whole = io.BytesIO()
    copyfileobj(part, whole, _PIECE)
    return whole.getvalue()


def require_trial(code: str, content: bytes) -> None:
    """Raise InputError if code that reads `content` takes more memory than the limit.

    Other errors, such as for a damaged file, are left to the actual reading.
    """
    if dies(code, content, LARGEST_FILE):
        require_room(float("inf"), content, ", or are damaged")


def dies(code: str, content: bytes, most_bytes: float) -> bool:
    """True if code that may read `content` dies, or takes more memory, in a separate process."""
    room = str(int(_FOR_A_WHILE * most_bytes))
    command = [sys.executable, "-P", "-c", _LIMITED + code, room]
    done = subprocess.run(command, input=content, capture_output=True, env=os.environ | _ALONE)
    return done.returncode not in (0, 1) or b"MemoryError" in done.stderr


@contextmanager
def refusing(damaged: str, missing: str = "") -> Iterator[None]:
    """Raise `InputError` in our words if a library fails: it is missing, or the file is damaged,
    for which libraries raise errors of many kinds."""
    try:
        yield
    except BaseException as error:
        # On a damaged file a library's Rust code raises something other than an Exception.
        is_other = isinstance(error, InputError) or not isinstance(error, Exception)
        if is_other and type(error).__name__ != "PanicException":
            raise
        words = missing if missing and isinstance(error, ImportError) else damaged
        raise InputError(words) from error


def unpacked(archive: ZipFile, files: Iterable[ZipInfo]) -> Iterator[IO[bytes]]:
    """Files of a zip archive, to be read to their ends, whatever size is stated."""
    for entry in files:
        whole = copy(entry)
        whole.file_size = 2 * LARGEST_FILE
        with archive.open(whole) as part:
            yield part


# No text above a table is longer; the longest known are a protocol of about a hundred lines, and
# one line of 13,000 letters.
PREAMBLE_BYTES, _PREAMBLE_LINES, _LONGEST_LINE = 400_000, 2000, 1_000_000
_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
# The number of stray zero bytes allowed in a text.
_STRAY_ZEROS = 4
# A block of zeros within a line; possessive, because a logger may fill megabytes with them.
_LOST = re.compile(rb"(?<![\r\n\0])\0{2,}+|(?<!\0)\0{2,}+(?!\Z|[\r\n])")
_NO_TEXT = re.compile(rb"[\x01-\x08\x0e-\x1f]")
# Words that identify text in the encodings of Chinese, Japanese and Korean computers: voltage,
# current, discharge.
_TELLTALES = {
    "gb18030": ("电压", "电流", "放电"),
    "cp932": ("電圧", "電流", "放電"),
    "euc_jp": ("電圧", "電流", "放電"),
    "cp949": ("전압", "전류", "방전"),
    "big5": ("電壓", "電流", "放電"),
}
# A line that is one quoted cell, and the text in it.
_QUOTED_LINE = re.compile(rb'(?m)^"((?:[^"\r\n]|"")*)"[,;\t ]*(?=\r?$)')


def is_text(content: bytes) -> bool:
    """Text has no zero bytes except stray ones, and those that a lost power supply left.

    UTF-16 has more, and usually begins with a mark.
    """
    head = content[:65536].rstrip(b"\0")
    is_plain = bool(head) and (head.count(0) <= _STRAY_ZEROS or not _NO_TEXT.search(head))
    return is_plain or _utf16(content) != ""


def _utf16(content: bytes) -> str:
    """The form of UTF-16 of the content, if any: most of every other byte is then zero."""
    if content.startswith(_UTF16):
        return "utf-16"
    head = content[:1000]
    zeros = head[0::2].count(0), head[1::2].count(0)
    if max(zeros) < 0.3 * len(head) or min(zeros) > 0.02 * len(head):
        return ""
    return "utf-16-le" if zeros[1] else "utf-16-be"


def as_utf8(content: bytes) -> bytes:
    """The text in UTF-8 with a plain newline; testers write UTF-8, UTF-16 or Latin-1.

    Raises InputError if the encoding changes within the file, or for a line that no table has.
    """
    if form := _utf16(content):
        try:
            content = content.decode(form).encode()
        except UnicodeDecodeError as error:
            raise InputError(
                "starts as UTF-16 text but does not continue as such; save it as UTF-8."
            ) from error
    # Joined files have more than one mark; a single byte is found faster.
    if codecs.BOM_UTF8[:1] in content:
        content = content.replace(codecs.BOM_UTF8, b"")
    for encoding, words in _TELLTALES.items():
        if any(word.encode(encoding) in content[:PREAMBLE_BYTES] for word in words):
            content = content.decode(encoding, "replace").encode()
            break
    if b"\0" in content:
        lost = _LOST.search(content)
        if lost and not _NO_TEXT.search(content[:PREAMBLE_BYTES]):
            raise InputError(
                f"row {content.count(10, 0, lost.start()) + 1} has "
                f"{counted(len(lost[0]), 'zero byte')} in place of what was written, as after a "
                "loss of power; delete the rows that are cut there."
            )
        content = content.replace(b"\0", b"")
    head = content[:PREAMBLE_BYTES]
    if head.count(b"\r") > 2 * head.count(b"\n"):
        # Lines end in CR alone, except some, such as the last.
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        head = content[:PREAMBLE_BYTES]
    quoted = [line for line in _QUOTED_LINE.findall(head) if re.search(rb"[,;\t]", line)]
    if len(quoted) > 0.5 * head.count(b"\n"):
        # Novonix, and spreadsheets that took a file for one column.
        content = _QUOTED_LINE.sub(lambda line: line[1].replace(b'""', b'"'), content)
    for start in range(0, len(content) - _LONGEST_LINE, _LONGEST_LINE):
        if content.find(b"\n", start, start + _LONGEST_LINE) < 0:
            row = content.count(b"\n", 0, start) + 1
            raise InputError(
                f"row {row} has more than {_LONGEST_LINE:,} letters, so this is no table "
                "of measurements; export the record as CSV, Parquet or a workbook."
            )
    return content


def head_lines(content: bytes) -> list[str]:
    """The first lines."""
    head = content[:PREAMBLE_BYTES]
    try:
        text = head.decode("utf-8")
    except UnicodeDecodeError as error:
        # The last letter may be incomplete.
        text = head[: error.start].decode() if error.start > len(head) - 4 else ""
        text = text or head.decode("latin-1")
    return [line.removesuffix("\r") for line in text.split("\n", _PREAMBLE_LINES)]

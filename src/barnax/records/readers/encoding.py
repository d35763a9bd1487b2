"""From a file's bytes to text in UTF-8, one line a row, whichever computer wrote it."""

import codecs
import re

from ...errors import InputError, counted

# No text above a table is longer; the longest known are a protocol of some hundred lines, or in one
# line of 13,000 letters.
PREAMBLE_BYTES, _PREAMBLE_LINES, _LONGEST_LINE = 400_000, 2000, 1_000_000
_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
# The number of stray zero bytes that text may have beside bytes that are none of its own.
_STRAY_ZEROS = 4
# A block of them within a line; possessive, for a logger may fill megabytes with zeros.
_LOST = re.compile(rb"(?<![\r\n\0])\0{2,}+|(?<!\0)\0{2,}+(?!\Z|[\r\n])")
_NO_TEXT = re.compile(rb"[\x01-\x08\x0e-\x1f]")
# Words that tell a text in the encodings of Chinese, Japanese and Korean computers: voltage,
# current, discharge.
_TELLTALES = {
    "gb18030": ("电压", "电流", "放电"),
    "cp932": ("電圧", "電流", "放電"),
    "euc_jp": ("電圧", "電流", "放電"),
    "cp949": ("전압", "전류", "방전"),
    "big5": ("電壓", "電流", "放電"),
}
# A line that is one quoted cell, and what stands in it.
_QUOTED_LINE = re.compile(rb'(?m)^"((?:[^"\r\n]|"")*)"[,;\t ]*(?=\r?$)')


def is_text(content: bytes) -> bool:
    """Text has no zero bytes but stray ones, and those that a lost power supply left.

    UTF-16 has more, and as a rule says so at its start.
    """
    head = content[:65536].rstrip(b"\0")
    is_plain = bool(head) and (head.count(0) <= _STRAY_ZEROS or not _NO_TEXT.search(head))
    return is_plain or _utf16(content) != ""


def _utf16(content: bytes) -> str:
    """The form of UTF-16 that the content has, if any: most of every other byte is then zero."""
    if content.startswith(_UTF16):
        return "utf-16"
    head = content[:1000]
    zeros = head[0::2].count(0), head[1::2].count(0)
    if max(zeros) < 0.3 * len(head) or min(zeros) > 0.02 * len(head):
        return ""
    return "utf-16-le" if zeros[1] else "utf-16-be"


def as_utf8(content: bytes, file: str) -> bytes:
    """The text in UTF-8 with a plain newline; testers write UTF-8, UTF-16 or Latin-1."""
    if form := _utf16(content):
        try:
            content = content.decode(form).encode()
        except UnicodeDecodeError as error:
            raise InputError(
                f"{file}: starts as UTF-16 text but does not continue as such; save it as UTF-8."
            ) from error
    # Joined files have more than one mark.
    content = content.replace(codecs.BOM_UTF8, b"")
    for encoding, words in _TELLTALES.items():
        if any(word.encode(encoding) in content[:PREAMBLE_BYTES] for word in words):
            content = content.decode(encoding, "replace").encode()
            break
    if b"\0" in content:
        lost = _LOST.search(content)
        if lost and not _NO_TEXT.search(content[:PREAMBLE_BYTES]):
            raise InputError(
                f"{file}: row {content.count(10, 0, lost.start()) + 1} has "
                f"{counted(len(lost[0]), 'zero byte')} in place of what was written, as after a "
                "loss of power; delete the rows that are cut there."
            )
        content = content.replace(b"\0", b"")
    head = content[:PREAMBLE_BYTES]
    if head.count(b"\r") > 2 * head.count(b"\n"):
        # Lines end in CR alone, but for some, such as the last.
        content = content.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
        head = content[:PREAMBLE_BYTES]
    quoted = [line for line in _QUOTED_LINE.findall(head) if re.search(rb"[,;\t]", line)]
    if len(quoted) > 0.5 * head.count(b"\n"):
        # Novonix, and spreadsheets that took a file for one column.
        content = _QUOTED_LINE.sub(lambda line: line[1].replace(b'""', b'"'), content)
    return content


def require_lines(content: bytes, file: str) -> None:
    """Raise InputError for a line that no table has."""
    for start in range(0, len(content) - _LONGEST_LINE, _LONGEST_LINE):
        if content.find(b"\n", start, start + _LONGEST_LINE) < 0:
            row = content.count(b"\n", 0, start) + 1
            raise InputError(
                f"{file}: row {row} has more than {_LONGEST_LINE:,} letters, so this is no table "
                "of measurements; export the record as CSV, Parquet or a workbook."
            )


def head_lines(content: bytes) -> list[str]:
    """The first lines."""
    head = content[:PREAMBLE_BYTES]
    try:
        text = head.decode("utf-8")
    except UnicodeDecodeError as error:
        # The last letter may be cut.
        text = head[: error.start].decode() if error.start > len(head) - 4 else ""
        text = text or head.decode("latin-1")
    return [line.removesuffix("\r") for line in text.split("\n", _PREAMBLE_LINES)]

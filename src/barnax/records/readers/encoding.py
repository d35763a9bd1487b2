"""From a file's bytes to text in UTF-8, one line a row, whichever computer wrote it."""

import codecs
import re

from ...errors import InputError

# No text above a table is longer.
PREAMBLE_BYTES = 400_000
_UTF16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
# The number of stray zero bytes that text may have.
_STRAY_ZEROS = 4
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
    """Text has no zero bytes but a stray one, and those that a lost power supply left at its end.

    UTF-16 has more, and as a rule says so at its start.
    """
    head = content[:65536].rstrip(b"\0")
    return _utf16(content) != "" or (bool(head) and head.count(0) <= _STRAY_ZEROS)


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
    content = content.replace(codecs.BOM_UTF8, b"").rstrip(b"\0")
    for encoding, words in _TELLTALES.items():
        if any(word.encode(encoding) in content[:PREAMBLE_BYTES] for word in words):
            content = content.decode(encoding, "replace").encode()
            break
    if b"\0" in content:
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

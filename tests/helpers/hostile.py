"""Contents that nobody meant well: damaged files, and values no reader expects."""

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

EXAMPLES = [pytest.param(6, id="few"), pytest.param(500, id="many", marks=pytest.mark.slow)]


def repeated(examples: int, test: Callable[[Any], None], strategy: st.SearchStrategy) -> None:
    """Run `test` on that many examples, the slow ones of which hypothesis may not give up on."""

    @settings(max_examples=examples, suppress_health_check=list(HealthCheck))
    @given(strategy)
    def test_one(example: Any) -> None:
        test(example)

    test_one()


@st.composite
def damaged(draw: st.DrawFn, good: list[bytes]) -> bytes:
    """A good file with some bytes changed, cut out, put in, or a part of another file."""
    content = bytearray(draw(st.sampled_from(good)))
    for _ in range(draw(st.integers(1, 6))):
        at = draw(st.integers(0, max(0, len(content) - 1)))
        if draw(st.booleans()):
            # What a format says of itself stands at the ends.
            at = draw(st.integers(0, min(800, len(content)))) * draw(st.sampled_from([1, -1]))
            at %= max(1, len(content))
        kind = draw(st.sampled_from(["flip", "byte", "many", "cut", "insert", "end", "splice"]))
        if kind == "flip" and content:
            content[at] ^= 1 << draw(st.integers(0, 7))
        elif kind == "byte" and content:
            content[at] = draw(st.integers(0, 255))
        elif kind == "many":
            run = draw(st.sampled_from([b"\xff" * 8, bytes(8), b"\x80" * 7 + b"\x01", b"\xfe" * 9]))
            content[at : at + len(run)] = run
        elif kind == "cut":
            del content[at : at + draw(st.integers(1, 16))]
        elif kind == "insert":
            content[at:at] = draw(st.binary(min_size=1, max_size=16))
        elif kind == "end":
            del content[at:]
        else:
            other = draw(st.sampled_from(good))
            begin = draw(st.integers(0, len(other)))
            content[at:] = other[begin:]
    return bytes(content)


# Written where a JSON reader may read it, but JSON has no such numbers.
NUMBER_TEXTS = [
    "NaN", "Infinity", "-Infinity", "1e400", "-1e400", "9" * 400, "9" * 5000, "-" + "9" * 400,
    "1e308", "5e-324", "0", "-0.0", "0.5", "-1", "1.5", "true", "null", '"0.5"',
]  # fmt: skip
STRINGS = [
    "", " ", "\0", "\n", "'''", '"""\nimport os\n"""', "*/ int x; /*", "../../../etc/passwd",
    "[bold]", "[/]", "<script>alert(1)</script>", "{0}", "%s", "\ud800", "\u202e", "x" * 10_000,
    "nan", "--out=/", "é", "\\", "\\u0000",
]  # fmt: skip

# Pieces of names that end a comment, a text, a cell or a line in some language, or begin code.
PIECES = [
    "coding=utf-7 +AAo-", "coding: latin-1", "vim: set fdm=expr:", "*/", "/*", "//", "*", "/",
    "??/", "%{", "%}", "%", "#", "\n", "\r", "\v", "\f", "\x1c", "\x85", "\u2028", "\u2029", "\\",
    '"', "'", '"""', "'''", "`", "{{7*7}}", "{% raw %}", "{#", "<script>", "</script>", "<!--",
    "]]>", "]](", "![a](b)", "=", "+", "-", "@", "=cmd|'/c calc'!A0", "\t", ",", ";", "\u202e",
    "\u2066", "\ufeff", "\0", "\x7f", "\x1b[2J", "\udcff", "$(id)", "é", "e\u0301", "中",
    "\U0001f600", "int x;", "import os", "[[files]]", "x" * 120, " ",
]  # fmt: skip
# From several scripts, of one to four bytes. To draw from all letters there are, hypothesis makes a
# table of them first, which takes seconds.
LETTERS = "".join(
    chr(number) for first in (0, 0x600, 0x2000, 0x4E00, 0xFF00, 0x1F600)
    for number in range(first, first + 256)
)  # fmt: skip


def names() -> st.SearchStrategy[str]:
    """Names of files that want to be more than a name."""
    pieces = st.one_of(st.sampled_from(PIECES), st.text(LETTERS, max_size=3))
    return st.lists(pieces, min_size=1, max_size=6).map("".join)

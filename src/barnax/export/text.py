"""Numbers and notes as source text. Nothing from a file's name can end a comment early."""

import textwrap
from collections.abc import Iterable

import numpy as np

WIDTH = 96


def numbers(values: Iterable[float], indent: str = "    ") -> str:
    """Numbers that read back exactly, wrapped, with a comma after each.

    >>> print(numbers([0.1, 2.0], indent="  "))
      0.1, 2.0,
    """
    words = " ".join(f"{float(value)!r}," for value in np.asarray(values))
    return textwrap.fill(words, WIDTH, initial_indent=indent, subsequent_indent=indent)


def note_lines(heading: str, caveats: Iterable[str], prefix: str = "") -> str:
    """A heading and caveats, wrapped, each line after `prefix`, without line breaks of their own.

    >>> print(note_lines("By hand.", ["No\\nhysteresis."], prefix="# "))
    # By hand.
    #
    # - No hysteresis.
    """
    lines = textwrap.wrap(_plain(heading), WIDTH - len(prefix))
    caveats = list(caveats)
    if caveats:
        lines.append("")
    for caveat in caveats:
        lines += textwrap.wrap(
            _plain(caveat), WIDTH - len(prefix), initial_indent="- ", subsequent_indent="  "
        )
    return "\n".join(f"{prefix}{line}".rstrip() for line in lines)


def _plain(text: str) -> str:
    """One line that ends no comment: neither C's nor Python's."""
    words = " ".join(text.split()).replace("*/", "* /").replace("/*", "/ *")
    return "".join(letter if letter.isprintable() else "?" for letter in words)

"""What is said where an input cannot be used, and how a message quotes what stands in it."""

import textwrap
from collections.abc import Iterable
from itertools import islice


class InputError(ValueError):
    """What was given cannot be used; the message names it and the remedy.

    Raised for files, options and values that come from outside. The command line prints the
    message without a traceback and exits with status 2.
    """


LARGEST_FILE = 2_000_000_000
MOST_COLUMNS = 10_000
MOST_CELLS = 200_000_000
# Even nanoseconds since 1970 are less; what is more overflows where it is squared.
LARGEST_NUMBER = 1e20
# Of names, and of what stands in a cell: longer text is cut before anybody quotes it.
LONGEST_NAME = 200
LONGEST_CELL = 80


def require_size(rows: int, columns: int, file: str) -> None:
    """Raise InputError where a table is larger than what is read."""
    if columns > MOST_COLUMNS:
        raise InputError(
            f"{file}: has {columns} columns, and at most {MOST_COLUMNS} are read; give a file with "
            "the time, current and voltage of one cell."
        )
    if rows * columns > MOST_CELLS:
        raise InputError(
            f"{file}: has {rows} rows of {columns} columns, more than the {MOST_CELLS} cells that "
            "are read; give a part of the record, or fewer columns."
        )


def cut(text: str, longest: int) -> str:
    """The text, or its beginning and an ellipsis where it is longer.

    >>> cut("Voltage / V", 80), cut("9" * 100_000, 10)
    ('Voltage / V', '999999 ...')
    """
    return text if len(text) <= longest else text[: longest - 4] + " ..."


def reason_of(error: BaseException) -> str:
    """What a library says went wrong, in one line."""
    return cut(next(iter(str(error).splitlines()), type(error).__name__), 200)


def listed(names: Iterable[str]) -> str:
    """As many of the names as fit into a message, with commas between them."""
    # Four hundred letters hold no more names than this.
    return textwrap.shorten(", ".join(islice(names, 200)), 400, placeholder=" ...")

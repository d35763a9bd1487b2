"""The error for an input that cannot be used, and how messages quote its content."""

import math
import re
import textwrap
import unicodedata
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import islice
from typing import Any, Literal, TypeVar, get_args, get_origin

Value = TypeVar("Value")
# The code of a refusal without its own.
REFUSED = "input.refused"


class InputError(ValueError):
    """An input that cannot be used; the message names it and the remedy.

    Raised for files, options and values that come from outside. Options appear in it by their
    Python names between backticks, which are used for nothing else. The command line prints the
    message without a traceback and exits with status 2.

    `notice` is the `Notice` that a program may act on, or None.
    """

    # The refusal as a `barnax.notices.Notice`.
    notice: Any = None

    @property
    def code(self) -> str:
        """The code of its notice, `REFUSED` if it has none."""
        return self.notice.code if self.notice else REFUSED


@contextmanager
def naming(subject: str, spelled: Callable[[str], str] = str) -> Iterator[None]:
    """Prefix a refusal with its subject, such as a file, with words as they are `spelled` there."""
    try:
        yield
    except InputError as refusal:
        head = f"{subject}: " if subject else ""
        named = InputError(f"{head}{spelled(str(refusal))}")
        named.notice = refusal.notice
        raise named from refusal


def attempt(make: Callable[..., Value], *given: Any, **options: Any) -> Value | InputError:
    """The value of a function, or its refusal as a value: for rules that test whether a candidate
    is usable and otherwise try another.

    >>> attempt(require_choice, "chemistry", "nca", ("nmc", "lfp"))
    InputError("`chemistry` 'nca' is not known; there are nmc, lfp")
    """
    try:
        return make(*given, **options)
    except InputError as refusal:
        return refusal


def installing(extra: str) -> str:
    """The command that installs the packages of an extra, for an installed barnax or in a clone."""
    return f"pip install 'barnax[{extra}]' (in a clone: pip install '.[{extra}]')"


def require_number(name: str, value: Any, hint: Any) -> None:
    """Raise `InputError` if an option of the type `hint` takes a number, and the value is not
    one."""
    kinds = {*(get_args(hint) or (hint,))} - {type(None)}
    if value is None or not kinds or not kinds <= {int, float}:
        return
    method, kind, example = ("__float__", "number", "2.5")
    if float not in kinds:
        method, kind, example = ("__index__", "whole number", "3")
    if isinstance(value, float) and method == "__index__" and value.is_integer():
        raise InputError(f"`{name}` {value!r} has a decimal point; give {int(value)}")
    if isinstance(value, bool) or not hasattr(value, method) or getattr(value, "ndim", 0):
        raise InputError(
            f"`{name}` {value!r} is not a {kind}; give one without quotes or unit, as {example}"
        )


def require_positive(name: str, value: float | None, unit: str = "") -> None:
    """Raise `InputError` if an option's value, if it has one, is not positive and finite."""
    if value is not None and not 0 < value < math.inf:
        raise InputError(f"`{name}` {value:g} {unit}".rstrip() + " must be positive and finite")


def choices_in(hint: Any) -> tuple[str, ...]:
    """The values that a type names.

    >>> choices_in(Literal["nmc", "lfp"] | None), choices_in(int)
    (('nmc', 'lfp'), ())
    """
    named = (get_args(one) for one in (hint, *get_args(hint)) if get_origin(one) is Literal)
    return next(named, ())


def require_choice(option: str, value: object, choices: Iterable[str | None]) -> None:
    """Raise `InputError` if an option's value is not one of its choices.

    >>> require_choice("chemistry", "nmc", ("nmc", "lfp"))
    """
    allowed = tuple(choices)
    if value not in allowed:
        names = ", ".join(repr(one) if "," in one else one for one in allowed if one)
        raise InputError(f"`{option}` {value!r} is not known; there are {names}")


# An option in a message, with its value if it has one.
OPTION = re.compile(r"`([a-z][a-z_]*)(?:=([^`]*))?`")
# Longest name, or content of a cell: longer text is cut before it is quoted.
LONGEST_NAME = 200
LONGEST_CELL = 80


def cut(text: str, longest: int) -> str:
    """The text, or its beginning and an ellipsis if it is longer.

    >>> cut("Voltage / V", 80), cut("9" * 100_000, 10)
    ('Voltage / V', '999999 ...')
    """
    return text if len(text) <= longest else text[: longest - 4] + " ..."


def printable(text: str) -> str:
    """The text with U+FFFD for characters that a terminal executes rather than displays, and for
    broken UTF-8.

    >>> printable("us06\\x1b[2J.csv")
    'us06\\ufffd[2J.csv'
    """
    return "".join(
        "\ufffd" if unicodedata.category(letter) in _OBEYED else letter for letter in text
    )


# Controls, characters that reverse text, halves of letters, and ends of lines and paragraphs.
_OBEYED = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}
# Characters that a language, or a spreadsheet at the start of a cell, may interpret as more than
# text.
_SPECIAL = re.compile(r"[^\w .,()\[\]~+@-]|^[-+@ ]")


def escaped(name: str) -> str:
    """A name as written in comments and cells of generated files, in any language.

    Letters, digits and a few marks stay; all other characters are written as codes.

    >>> print(escaped("us06 (25 degC).csv"), escaped("=1*/2"))
    us06 (25 degC).csv \\u003d1\\u002a\\u002f2
    """
    return _SPECIAL.sub(lambda match: f"\\u{ord(match[0]):04x}", name)


def reason_of(error: BaseException) -> str:
    """The first line of a library's error message."""
    return printable(cut(next(iter(str(error).splitlines()), type(error).__name__), 200))


def toml_reason(error: BaseException) -> str:
    """The position where a text is not valid TOML; a library's words only if it gives none.

    >>> toml_reason(ValueError("Invalid value (at line 14, column 8)"))
    'error at line 14, column 8'
    """
    match = re.search(r"\(at (?:(line \d+, column \d+)|end of document)\)", str(error))
    return f"error at {match[1] or 'its end'}" if match else reason_of(error)


def as_keys(text: str) -> str:
    """A message that names options as keys of a plan or columns of a manifest.

    >>> as_keys("give `initial_soc=0.9` or `ocv_fit='interpolated'`, not `model`")
    'give initial_soc = 0.9 or ocv_fit = interpolated, not model'
    """
    return OPTION.sub(lambda f: f[1] if f[2] is None else f"{f[1]} = {f[2].strip(chr(39))}", text)


def listed(names: Iterable[str]) -> str:
    """As many of the names as fit into a message, separated by commas."""
    # Four hundred characters hold no more names than this.
    return textwrap.shorten(", ".join(islice(names, 200)), 400, placeholder=" ...")


def counted(count: int, noun: str) -> str:
    """A number and its noun, in the plural if needed.

    >>> counted(1, "row"), counted(3, "row")
    ('1 row', '3 rows')
    """
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"

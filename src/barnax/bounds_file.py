"""Bounds and fixed values as users write them: a TOML file, a mapping, or the command line."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple, Self

from .errors import LONGEST_NAME, InputError, cut, toml_reason
from .files import fetched
from .model.search_space import Range

# Parsing dotted names takes a time that grows with the square of their length.
LARGEST_FILE = 16_000


def read_bounds(path: Path) -> dict[str, Range]:
    """Ranges from the `[bounds]` table of a TOML file: `"R0 [Ohm]" = [0.001, 0.1]`.

    Raises `InputError` if the file cannot be read or contains anything else.
    """
    content = fetched(path, LARGEST_FILE, "; give `bounds` a TOML file")
    try:
        document = tomllib.loads(content.decode("utf-8"))
    except (ValueError, RecursionError) as problem:
        # No TOML, no text, or an integer with more digits than Python converts.
        raise InputError(f"{path}: is not a TOML file ({toml_reason(problem)})") from problem
    table = document.get("bounds")
    if not isinstance(table, dict) or len(document) != 1:
        raise InputError(
            f'{path}: must hold one table, [bounds], with lines like "R0 [Ohm]" = [0.001, 0.1]'
        )
    return {
        name: _range_of(value, f"{path}: {cut(name, LONGEST_NAME)!r}")
        for name, value in table.items()
    }


def _range_of(value: object, index: str) -> Range:
    ends = value if isinstance(value, list) else []
    is_pair = len(ends) == 2 and all(type(end) in (int, float) for end in ends)
    try:
        if is_pair:
            return float(ends[0]), float(ends[1])
        shown = cut(repr(value), LONGEST_NAME)
    except OverflowError as problem:
        raise InputError(f"{index} has a number that is too large") from problem
    # Nested tables are as deep as their names are long; there may be too many digits to print.
    except (ValueError, RecursionError):
        shown = f"a {type(value).__name__}"
    raise InputError(f"{index} must be two numbers, [lower, upper]; it is {shown}")


def parse_fixed(texts: list[str]) -> dict[str, float]:
    """Fixed values from options such as `C1 [F]=500`. Raises `InputError` if one has another
    form."""
    fixed = {}
    for text in texts:
        name, _, value = (part.strip() for part in text.partition("="))
        if name in fixed:
            raise InputError(f"`fix` {text!r}: {name!r} is fixed twice; give one value")
        try:
            fixed[name] = float(value)
        except ValueError as problem:
            raise InputError(
                f'`fix` {text!r}: write a name and a number, such as "C1 [F]=500"'
            ) from problem
    return fixed


class GivenRanges(NamedTuple):
    """Given ranges, and their origin for messages."""

    source: str
    by_name: Mapping[str, Range]

    @classmethod
    def of(cls, bounds: Mapping[str, Range] | str | Path | None) -> Self:
        """The ranges of an option. Raises `InputError` as `read_bounds` does."""
        if isinstance(bounds, str | Path):
            return cls(Path(bounds).name, read_bounds(Path(bounds)))
        return cls("`fix`" if bounds is None else "`bounds`", bounds or {})

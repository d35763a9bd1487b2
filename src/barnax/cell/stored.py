"""Reading stored mappings back: every value is checked before it is believed."""

import contextlib
import math
from collections.abc import Iterable, Mapping
from typing import Any

from ..errors import InputError

# No cell has more, between full and empty or beyond.
LARGEST_V, LARGEST_SOC, LARGEST_AH = 100.0, 10.0, 1e12


def stored_value(stored: Mapping[str, Any], key: str, what: str) -> Any:
    """`stored[key]`. Raises `InputError` that names `what` where it is absent."""
    if not isinstance(stored, Mapping) or key not in stored:
        raise InputError(f"the stored {what} has no {key!r}; was the file written by barnax?")
    return stored[key]


def stored_number(stored: Mapping[str, Any], key: str, what: str) -> float:
    """A finite number. Raises `InputError` for anything else."""
    return _number(stored_value(stored, key, what), f"{key!r} of the stored {what}")


def stored_numbers(
    stored: Mapping[str, Any], key: str, what: str, largest: float = math.inf
) -> tuple[float, ...]:
    """A list of finite numbers, none beyond `largest`. Raises `InputError` for anything else."""
    values = stored_value(stored, key, what)
    if not isinstance(values, Iterable) or isinstance(values, str | Mapping):
        raise InputError(f"{key!r} of the stored {what} must be a list of numbers, not {values!r}")
    numbers = tuple(_number(value, f"{key!r} of the stored {what}") for value in values)
    worst = max(map(abs, numbers), default=0.0)
    if worst > largest:
        raise InputError(f"{key!r} of the stored {what} reaches {worst:g}, beyond {largest:g}")
    return numbers


def stored_texts(stored: Mapping[str, Any], key: str, what: str) -> tuple[str, ...]:
    """A list of texts. Raises `InputError` for anything else."""
    values = stored_value(stored, key, what)
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        raise InputError(f"{key!r} of the stored {what} must be a list of texts")
    return tuple(values)


def _number(value: Any, where: str) -> float:
    # An integer too large for a float overflows where it is asked whether it is finite.
    with contextlib.suppress(OverflowError):
        if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
            return float(value)
    raise InputError(f"{where} must hold finite numbers; it holds {str(value)[:80]}")

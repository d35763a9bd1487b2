"""Reading stored mappings back: every value is checked before it is believed."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

from ..errors import InputError


def stored_value(stored: Mapping[str, Any], key: str, what: str) -> Any:
    """`stored[key]`. Raises `InputError` that names `what` where it is absent."""
    if not isinstance(stored, Mapping) or key not in stored:
        raise InputError(f"the stored {what} has no {key!r}; was the file written by barnax?")
    return stored[key]


def stored_number(stored: Mapping[str, Any], key: str, what: str) -> float:
    """A finite number. Raises `InputError` for anything else."""
    return _number(stored_value(stored, key, what), f"{key!r} of the stored {what}")


def stored_numbers(stored: Mapping[str, Any], key: str, what: str) -> tuple[float, ...]:
    """A list of finite numbers. Raises `InputError` for anything else."""
    values = stored_value(stored, key, what)
    if not isinstance(values, Iterable) or isinstance(values, str | Mapping):
        raise InputError(f"{key!r} of the stored {what} must be a list of numbers, not {values!r}")
    return tuple(_number(value, f"{key!r} of the stored {what}") for value in values)


def _number(value: Any, where: str) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not (is_number and math.isfinite(value)):
        raise InputError(f"{where} must hold finite numbers; it holds {value!r}")
    return float(value)

"""Short representations of objects in a console or a notebook, whose full content is pages.

Methods of a result include its figures and its report, which are made in layers above it. No module
imports from above: the package's `__init__`, over all layers, maps each method to its function in
`HOOKS`, and each is imported when it is first called.
"""

from collections.abc import Callable, Mapping
from dataclasses import fields
from numbers import Number
from pkgutil import resolve_name
from typing import Any, cast

LONGEST_TEXT = 60
LONGEST_PART = 120
FEW = 4
# Full names of functions, by method.
HOOKS: dict[str, str] = {}


def hook(method: str) -> Callable[..., Any]:
    """The function behind a method, such as "Result.report"."""
    return resolve_name(HOOKS[method])


class Shown(str):
    """Text that is its own repr."""

    __slots__ = ()
    __repr__ = str.__str__


class Brief:
    """A dataclass, made with `repr=False`, that shows its fields briefly."""

    __slots__ = ()

    def __repr__(self) -> str:
        names = [field.name for field in fields(cast(Any, self)) if field.repr]
        shown = ", ".join(f"{name}={brief(getattr(self, name))}" for name in names)
        return f"{type(self).__name__}({shown})"


def brief(value: object) -> Shown:
    """Numbers, names and short values in full; for all others the kind and size.

    >>> brief(("a", 0.5)), brief((1.0,) * 9), brief(ValueError(200 * "no"))
    (('a', 0.5), <9 items>, ValueError(...))
    """
    if value is None or isinstance(value, Number):
        return Shown(repr(value))
    if isinstance(value, str):
        cut = len(value) > LONGEST_TEXT
        return Shown(repr(f"{value[:LONGEST_TEXT]}…" if cut else value))
    shape = getattr(value, "shape", None)
    if shape:
        return Shown(f"<array {' x '.join(map(str, shape))}>")
    if isinstance(value, tuple | list | set | frozenset | Mapping):
        are_plain = all(isinstance(one, Number | str) for one in value)
        if are_plain and len(value) <= FEW and not isinstance(value, Mapping):
            return Shown(repr(value))
        return Shown(f"<{len(value)} item{'s' * (len(value) != 1)}>")
    text = repr(value)
    return Shown(text if len(text) <= LONGEST_PART else f"{type(value).__name__}(...)")

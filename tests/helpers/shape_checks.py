"""Arrays checked against their annotations, as `.ci/floors` does: dtype, and axes of one name."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import jaxtyping
from beartype import beartype


def checked(function: Callable) -> Any:
    """The function with its annotations of arrays enforced; other types are checked unrun.

    Not the fields of a class: `jax.tree.map` fills them with whatever it is told to.
    """
    hints = getattr(function, "__annotations__", {})
    arrays = {name: hint for name, hint in hints.items() if "jaxtyping" in repr(hint)}
    if not arrays or isinstance(function, type) or function.__name__ == "__init__":
        return function
    function.__annotations__ = arrays
    try:
        return beartype(function)
    finally:
        function.__annotations__ = hints


@contextmanager
def unchecked() -> Iterator[None]:
    """For what a function itself says of arrays that it cannot take."""
    jaxtyping.config.update("jaxtyping_disable", True)
    try:
        yield
    finally:
        jaxtyping.config.update("jaxtyping_disable", False)

"""What an exporter is: one tool's file, made from a result."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..result import Result


class Export(NamedTuple):
    """A file's content, and in sentences what it does not say as the result does.

    `caveats` name what the tool cannot hold, and what it asks for that a result does not have.
    """

    content: bytes
    caveats: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Profile:
    """A current to simulate, discharge positive, each held until the next time; cells at rest."""

    time_s: Float[np.ndarray, "samples"]
    current_a: Float[np.ndarray, "samples"]


@dataclass(frozen=True)
class Exporter:
    """One target of `barnax export`.

    `write` is pure: equal results give equal bytes. `simulate`, where the tool is a Python
    package, gives its voltage at every sample of a profile from the exported content; `package`
    is that package.
    """

    name: str
    description: str
    file_name: str
    write: Callable[[Result], Export]
    package: str | None = None
    simulate: Callable[[bytes, Profile], Float[np.ndarray, "samples"]] | None = None

"""Export targets, and their text from templates."""

import re
import textwrap
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from jinja2 import Environment, PackageLoader, StrictUndefined

from ..cell.dependence import CHARGE
from ..errors import escaped
from ..results import Result

WIDTH = 96
# The rate, per unit of SOC, that turns the hysteresis within 1e-5 of the capacity: nearly at once.
# A higher one turns with a tester's noise at rest: measured on the bundled trips, 1e5 has the
# lowest rms difference from a hysteresis that turns at once.
INSTANT_RATE = 1e5


class Export(NamedTuple):
    """An exported file.

    Attributes:
        content: The file's bytes.
        caveats: Sentences on what the tool cannot represent, and on inputs that it needs and a
            result does not have.
    """

    content: bytes
    caveats: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class HeldLoad:
    """A current to simulate, discharge positive, each value held until the next time; cells at
    rest, at one temperature."""

    time_s: Float[np.ndarray, "samples"]
    current_a: Float[np.ndarray, "samples"]
    temperature_degc: float = 25.0


# The voltage at every sample of a profile, from an exported content.
Simulate = Callable[[bytes, HeldLoad], Float[np.ndarray, "samples"]]


@dataclass(frozen=True)
class Exporter:
    """One target of `barnax export`.

    Attributes:
        name: The target, such as "pybamm".
        description: One-line description.
        file_name: The usual name of its file.
        write: Makes an export of a result. It is pure: equal results give equal bytes.
        package: The Python package that runs it, if there is one.
        simulate: Simulation in that package: the voltage at every sample of a profile, from the
            exported content.
        starts_within: True if that package starts no cell beyond full or empty.
    """

    name: str
    description: str
    file_name: str
    write: Callable[[Result], Export]
    package: str | None = None
    simulate: Simulate | None = None
    starts_within: bool = False


def from_template(name: str, heading: str, caveats: tuple[str, ...], **values: Any) -> Export:
    """An export from its template, with the heading and the caveats as a comment at its top."""
    notes = note_lines(heading, caveats, "# " if ".py" in name else " * ")
    text = _templates().get_template(name).render(notes=notes, **values)
    return Export(text.encode(), caveats)


def caveats_of(name: str, *facts: Any) -> tuple[str, ...]:
    """The sentences of a macro of `caveats.txt`."""
    text = getattr(_templates().get_template("caveats.txt").module, name)(*facts)
    parts = re.split("^- ", text, flags=re.M)[1:]
    return tuple(re.sub(r"\s*\n\s*", " ", part).strip() for part in parts)


@cache
def _templates() -> Environment:
    templates = Environment(
        loader=PackageLoader("barnax.export"), undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    templates.filters |= {"numbers": numbers, "array": python_array}
    templates.filters |= {"escaped": escaped, "listed": listed}
    constants: dict[str, Any] = {"CHARGE": CHARGE, "INSTANT_RATE": INSTANT_RATE}
    templates.globals.update(constants, asarray=np.asarray)  # pyrefly: ignore
    return templates


def listed(values: Iterable[float], form: str = "g") -> str:
    """Numbers separated by commas.

    >>> listed([0.1, 25.0])
    '0.1, 25'
    """
    return ", ".join(format(value, form) for value in values)


def numbers(values: Iterable[float], indent: int = 4) -> str:
    """Numbers that read back exactly, wrapped, with a comma after each.

    >>> print(numbers([0.1, 2.0], indent=2))
      0.1, 2.0,
    """
    words = " ".join(f"{float(value)!r}," for value in np.asarray(values))
    return textwrap.fill(words, WIDTH, initial_indent=" " * indent, subsequent_indent=" " * indent)


def python_array(values: Iterable) -> str:
    """A NumPy array of one row, or of several."""
    array = np.asarray(values)
    if array.ndim == 1:
        return f"np.array([\n{numbers(array)}\n])"
    rows = "\n".join(f"    [\n{numbers(row, 8)}\n    ]," for row in array)
    return f"np.array([\n{rows}\n])"


def note_lines(heading: str, caveats: Iterable[str], prefix: str = "") -> str:
    """A heading and caveats, wrapped, each line after `prefix`; names in them are `escaped`.

    >>> print(note_lines("By hand.", ["No hysteresis."], prefix="# "))
    # By hand.
    #
    # - No hysteresis.
    """
    width = WIDTH - len(prefix)
    lines = textwrap.wrap(heading, width)
    for index, caveat in enumerate(caveats):
        lines += [] if index else [""]
        lines += textwrap.wrap(caveat, width, initial_indent="- ", subsequent_indent="  ")
    return "\n".join(f"{prefix}{line}".rstrip() for line in lines)

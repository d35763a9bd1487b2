"""Export targets, and their text from templates."""

import textwrap
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from jinja2 import Environment, PackageLoader, StrictUndefined

from ..results import Result
from .tables import Tables

WIDTH = 96


class Export(NamedTuple):
    """An exported file.

    Attributes:
        content: The file's bytes.
        caveats: Sentences about what the tool cannot hold, and what it asks for that a result does
            not have.
    """

    content: bytes
    caveats: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Profile:
    """A current to simulate, discharge positive, each held until the next time; cells at rest, at
    one temperature."""

    time_s: Float[np.ndarray, "samples"]
    current_a: Float[np.ndarray, "samples"]
    temperature_degc: float = 25.0


# The voltage at every sample of a profile, from an exported content.
Simulate = Callable[[bytes, Profile], Float[np.ndarray, "samples"]]


@dataclass(frozen=True)
class Exporter:
    """One target of `barnax export`.

    Attributes:
        name: The target, such as "pybamm".
        description: One line about it.
        file_name: The usual name of its file.
        write: Makes an export of a result. It is pure: equal results give equal bytes.
        package: The Python package that runs it, if there is one.
        simulate: The voltage at every sample of a profile by that package, from the exported
            content.
    """

    name: str
    description: str
    file_name: str
    write: Callable[[Result], Export]
    package: str | None = None
    simulate: Simulate | None = None


def from_template(name: str, tables: Tables, caveats: tuple[str, ...], **values: Any) -> Export:
    """An export from its template, with the heading and the caveats as a comment at its top."""
    prefix = "# " if ".py" in name else " * "
    notes = note_lines(tables.heading, caveats, prefix)
    text = _templates().get_template(name).render(notes=notes, tables=tables, **values)
    return Export(text.encode(), caveats)


@cache
def _templates() -> Environment:
    found = Environment(
        loader=PackageLoader("barnax.export"), undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    found.filters |= {"numbers": numbers, "array": python_array}
    found.globals["asarray"] = np.asarray  # pyrefly: ignore
    return found


def numbers(values: Iterable[float], indent: int = 4) -> str:
    """Numbers that read back exactly, wrapped, with a comma after each.

    >>> print(numbers([0.1, 2.0], indent=2))
      0.1, 2.0,
    """
    words = " ".join(f"{float(value)!r}," for value in np.asarray(values))
    return textwrap.fill(words, WIDTH, initial_indent=" " * indent, subsequent_indent=" " * indent)


def python_array(values: Iterable) -> str:
    """NumPy's array of one row, or of several."""
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
    for place, caveat in enumerate(caveats):
        lines += [] if place else [""]
        lines += textwrap.wrap(caveat, width, initial_indent="- ", subsequent_indent="  ")
    return "\n".join(f"{prefix}{line}".rstrip() for line in lines)


def hysteresis_is_left_out(tool: str, tables: Tables) -> tuple[str, ...]:
    """The loss in a tool with a single OCV curve; empty for a circuit without hysteresis."""
    if tables.hysteresis is None:
        return ()
    is_slow = tables.kind == "dynamic"
    rate = f", and its rate gamma of {tables.gamma:.6g} per unit of SOC" if is_slow else ""
    largest_mv = 1e3 * np.abs(tables.hysteresis.voltage_v).max()
    return (
        f"{tool} has no hysteresis voltage: W(soc), up to {largest_mv:.3g} mV, of which the "
        f"circuit {tables.model} adds half after charging and takes half away after "
        f"discharging{rate}, is left out. What remains is the OCV averaged over charge and "
        "discharge.",
    )

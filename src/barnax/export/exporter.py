"""What an export target is, and the text that several of them write."""

import textwrap
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..results import Result
from .tables import Tables

WIDTH = 96
# Tools that ask for a capacitance divide by the resistance; this much is none.
LEAST_OHM = 1e-9


def numbers(values: Iterable[float], indent: str = "    ") -> str:
    """Numbers that read back exactly, wrapped, with a comma after each.

    >>> print(numbers([0.1, 2.0], indent="  "))
      0.1, 2.0,
    """
    words = " ".join(f"{float(value)!r}," for value in np.asarray(values))
    return textwrap.fill(words, WIDTH, initial_indent=indent, subsequent_indent=indent)


def note_lines(heading: str, caveats: Iterable[str], prefix: str = "") -> str:
    """A heading and caveats, wrapped, each line after `prefix`, without line breaks of their own.

    >>> print(note_lines("By hand.", ["No\\nhysteresis."], prefix="# "))
    # By hand.
    #
    # - No hysteresis.
    """
    lines = textwrap.wrap(_plain(heading), WIDTH - len(prefix))
    caveats = list(caveats)
    if caveats:
        lines.append("")
    for caveat in caveats:
        lines += textwrap.wrap(
            _plain(caveat), WIDTH - len(prefix), initial_indent="- ", subsequent_indent="  "
        )
    return "\n".join(f"{prefix}{line}".rstrip() for line in lines)


def python_tables(tables: Tables) -> str:
    """What is tabulated as NumPy arrays: nodes and every resistance over SOC, with a row for each
    temperature where there are several; nothing of a constant circuit."""
    if tables.over_soc is None:
        return ""
    axis = tables.over_temperature
    arrays = {"NODES": tables.over_soc.nodes}
    if axis is None:
        arrays |= {name: np.maximum(r, LEAST_OHM) for name, r in tables.resistances.items()}
    else:
        arrays["DEGC"] = axis.degc
        arrays |= {name: np.maximum(r, LEAST_OHM) for name, r in axis.resistances.items()}
    return "\n".join(f"{name} = {python_array(values)}" for name, values in arrays.items())


def python_array(values: Iterable) -> str:
    """NumPy's array of one row, or of several."""
    array = np.asarray(values)
    if array.ndim == 1:
        return f"np.array([\n{numbers(array)}\n])"
    rows = "\n".join(f"    [\n{numbers(row, indent='        ')}\n    ]," for row in array)
    return f"np.array([\n{rows}\n])"


def _plain(text: str) -> str:
    """One line that ends no comment: neither C's nor Python's."""
    words = " ".join(text.split()).replace("*/", "* /").replace("/*", "/ *")
    return "".join(letter if letter.isprintable() else "?" for letter in words)


def hysteresis_is_left_out(tool: str, tables: Tables) -> tuple[str, ...]:
    """What a tool with a single OCV curve loses; nothing for a circuit without hysteresis."""
    if tables.kind == "none":
        return ()
    rate = ""
    if tables.kind == "dynamic":
        rate = f", and its rate gamma of {tables.gamma:.6g} per unit of SOC"
    largest_mv = 1e3 * tables.largest_hysteresis_v
    return (
        f"{tool} has no hysteresis voltage: W(soc), up to {largest_mv:.3g} mV, of which the "
        f"circuit {tables.model} adds half after charging and takes half away after "
        f"discharging{rate}, is left out. What remains is the OCV averaged over charge and "
        "discharge.",
    )


class Export(NamedTuple):
    """A file's content, and in sentences what it does not say as the result does.

    `caveats` name what the tool cannot hold, and what it asks for that a result does not have.
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

    `write` is pure: equal results give equal bytes. `simulate`, where the tool is a Python
    package, gives its voltage at every sample of a profile from the exported content; `package`
    is that package.
    """

    name: str
    description: str
    file_name: str
    write: Callable[[Result], Export]
    package: str | None = None
    simulate: Simulate | None = None

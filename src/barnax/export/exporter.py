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
    """The nodes and every resistance on them as NumPy arrays; nothing of a constant circuit."""
    if tables.over_soc is None:
        return ""
    least = {name: np.maximum(values, LEAST_OHM) for name, values in tables.resistances.items()}
    arrays = {"NODES": tables.over_soc.nodes, **least}
    return "\n".join(
        f"{name} = np.array([\n{numbers(values)}\n])" for name, values in arrays.items()
    )


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

"""The elements in series that relax with one time constant: an RC pair, diffusion, or the user's
own.

Each responds to the current as a positive mixture of RC pairs whose time constants have fixed
ratios to the element's. So all share one recursion, one reduction of records and one proof: the
response at tau is the mixture of the responses at ratio x tau, and keeps every bound of a single
pair.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..errors import InputError

# The shares of a mixture add up to one within this.
ROUNDING = 1e-6
# Slow RC pairs that add up to a smaller share of R need not be visible in a record.
HARDLY_ANY = 0.1


@dataclass(frozen=True)
class Element:
    """An element with resistance R and time constant tau.

    After a step of 1 A its voltage approaches R as R (1 - sum of shares x exp(-t / (ratio tau))).

    Args:
        name: What circuits and results call it.
        symbol: What its parameters are called by, "D" for `R_D [Ohm]` and `tau_D [s]`; RC pairs
            have none, and are numbered.
        description: What it is, in words.
        shares: Of each RC pair in the resistance; positive, together one.
        ratios: Of each RC pair's time constant to tau; positive, falling.

    Raises `InputError` where shares or ratios are not so.

    >>> Element("two", "W", "two pairs, one ten times as fast", (0.5, 0.5), (1.0, 0.1)).names(1)
    ElementNames(resistance='R_W [Ohm]', tau='tau_W [s]', capacitance=None)
    """

    name: str
    symbol: str
    description: str
    shares: tuple[float, ...]
    ratios: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.shares) != len(self.ratios) or not self.shares:
            raise InputError(
                f"the element {self.name} has {len(self.shares)} shares and {len(self.ratios)} "
                "ratios; give one of each for every RC pair in it"
            )
        if not all(0 < number < math.inf for number in (*self.shares, *self.ratios)):
            raise InputError(f"the shares and ratios of the element {self.name} must be positive")
        if abs(sum(self.shares) - 1) > ROUNDING:
            raise InputError(
                f"the shares of the element {self.name} add up to {sum(self.shares):.7g}; divide "
                "them by that, so that R is its resistance"
            )
        if any(second >= first for first, second in pairwise(self.ratios)):
            raise InputError(f"the ratios of the element {self.name} must fall, from slow to fast")

    @property
    def slowest_ratio(self) -> float:
        """The ratio of the pair at which the slow ones add up to a tenth of R; a record has to be
        long enough to show it."""
        return self.ratios[int(np.argmax(np.cumsum(self.shares) >= HARDLY_ANY - ROUNDING))]

    def names(self, number: int) -> "ElementNames":
        """The names of its parameters; `number` counts the RC pairs up to this one."""
        return names_beside(f"R_{self.symbol} [Ohm]" if self.symbol else f"R{number} [Ohm]")


class ElementNames(NamedTuple):
    """PyBaMM's names of an element's parameters; only an RC pair has a capacitance."""

    resistance: str
    tau: str
    capacitance: str | None

    @property
    def stored(self) -> str:
        """The name of the parameter that a constant circuit stores in addition to the
        resistance."""
        return self.capacitance or self.tau


RC = Element("rc", "", "RC pair", (1.0,), (1.0,))
# Of tanh(sqrt(s tau)) / sqrt(s tau) = sum over n of 2 q / (1 + s tau q), q = 1 / ((n - 1/2) pi)^2
# (Boukamp, Solid State Ionics 20 (1986) 31): its slowest four pairs, and for the others a ladder
# down from the fifth, each pair a factor of four faster. With these shares the step response is
# nearest to that of the series: within 4.5e-5 of R at every time.
DIFFUSION = Element(
    "diffusion",
    "D",
    "finite-length diffusion (finite Warburg)",
    (
        *(0.810656116, 0.089261738, 0.036600178, 0.004378112, 0.027316410, 0.016565724),
        *(0.007079659, 0.004568769, 0.001306097, 0.001580866, 0.000001, 0.000445809),
        *(0.000168394, 0.000071128),
    ),
    (
        *(1 / ((n - 0.5) * math.pi) ** 2 for n in (1, 2, 3, 4)),
        *(1 / (4.5 * math.pi) ** 2 / 4.0**n for n in range(10)),
    ),
)

ELEMENTS: dict[str, Element] = {element.name: element for element in (RC, DIFFUSION)}


def add_element(element: Element) -> Element:
    """Register an element under its name, as circuits that have it do.

    Raises `InputError` if another one has this name or this symbol.
    """
    for other in ELEMENTS.values():
        if other != element and (other.name == element.name or other.symbol == element.symbol):
            raise InputError(
                f"there is another element called {other.name} with the symbol {other.symbol!r}; "
                "choose another name and symbol, or begin a new session if this is the same one "
                "with other numbers"
            )
    return ELEMENTS.setdefault(element.name, element)


def get_element(name: str) -> Element:
    """The element of this name. Raises `InputError` that lists the names."""
    if name not in ELEMENTS:
        raise InputError(
            f"no element is called {name!r}; there are {', '.join(ELEMENTS)}. One of your own is "
            "known once make_circuit was given it"
        )
    return ELEMENTS[name]


def suffix_of(name: str) -> str:
    """The suffix of the names of an element's parameters.

    >>> [suffix_of(name) for name in ("R0 [Ohm]", "C1 [F]", "tau_D [s]")]
    ['0', '1', '_D']
    """
    return re.sub("^(R|C|tau)", "", name.partition(" [")[0])


def is_resistance(name: str) -> bool:
    """True for the name of a resistance, or of a sum of some."""
    return name.endswith("[Ohm]")


def element_of(name: str) -> Element:
    """The element with a parameter of this name. Raises `InputError` if there is none.

    >>> element_of("tau2 [s]").name, element_of("tau_D [s]").name
    ('rc', 'diffusion')
    """
    symbol = suffix_of(name).removeprefix("_")
    for element in ELEMENTS.values():
        if element.symbol == symbol or (not element.symbol and symbol.isdecimal()):
            return element
    raise InputError(f"no element has a parameter called {name}")


def names_beside(name: str) -> ElementNames:
    """The names of the element that has a parameter of that name.

    >>> names_beside("C1 [F]").tau, names_beside("tau_D [s]").resistance
    ('tau1 [s]', 'R_D [Ohm]')
    """
    of = suffix_of(name)
    return ElementNames(f"R{of} [Ohm]", f"tau{of} [s]", f"C{of} [F]" if of.isdecimal() else None)


def names_of(elements: Sequence[str]) -> tuple[ElementNames, ...]:
    """The names of the parameters of elements, in their order.

    >>> [names.tau for names in names_of(("rc", "rc", "diffusion"))]
    ['tau1 [s]', 'tau2 [s]', 'tau_D [s]']
    """
    return tuple(get_element(name).names(number) for number, name in enumerate(elements, 1))


def require_order(elements: Sequence[str]) -> None:
    """Raise `InputError` unless there are elements, RC pairs come first, and no other one occurs
    twice."""
    others = [name for name in elements if name != RC.name]
    if not elements or list(elements) != [RC.name] * (len(elements) - len(others)) + others:
        raise InputError("a circuit needs elements, and its RC pairs come first")
    if len(set(others)) < len(others):
        raise InputError("a circuit has every element but RC pairs once")


def alike(elements: Sequence[str]) -> int:
    """Number of leading elements that are RC pairs, which are interchangeable."""
    return sum(name == RC.name for name in elements)


class Rung(NamedTuple):
    """One RC pair of a mixture: the index of its element, its share and its ratio."""

    element: int
    share: float
    ratio: float


def rungs_of(elements: Sequence[str]) -> tuple[Rung, ...]:
    """The RC pairs of all elements, element after element."""
    return tuple(
        Rung(index, share, ratio)
        for index, name in enumerate(elements)
        for of in [get_element(name)]
        for share, ratio in zip(of.shares, of.ratios, strict=True)
    )

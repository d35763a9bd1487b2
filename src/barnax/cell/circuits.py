"""The circuits: their elements, OCV and hysteresis.

A new circuit is a `Circuit` here and one line in `CIRCUITS`.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from .elements import ELEMENTS, RC, Element, add_element, get_element, names_of, require_order
from .model import CellModel
from .parameters import MAX_PAIRS, parameter_names

Samples = Float[np.ndarray, "samples"]
OverSoc = Callable[[CellModel, Samples], Samples]


# By name, so that a circuit can be pickled and compared.
def no_gap_v(_: CellModel, soc: Samples) -> Samples:
    return np.zeros_like(soc)


@dataclass(frozen=True)
class Hysteresis:
    """The gap between the branches of the OCV, and the state h that half of it is multiplied by: -1
    after discharging and +1 after charging.

    Args:
        kind: What moves the state: it follows the direction at once, turns along loops, or is
            dynamic, at a rate gamma that is one more parameter.
        gap_v: Called with the cell and SOC; gives charge minus discharge OCV in V, by default as
            measured.
    """

    kind: Literal["none", "instant", "loops", "dynamic"]
    gap_v: OverSoc = CellModel.branch_gap_v

    def half_v(self, cell: CellModel, soc: Samples) -> Samples:
        """Half the gap in V: from the average OCV to either branch."""
        return self.gap_v(cell, soc) / 2

    def state(self, soc: Samples, direction: Samples) -> Samples:
        """The state at every sample; for a dynamic hysteresis the one toward which it moves."""
        return loops(soc, direction) if self.kind == "loops" else direction


EVERYWHERE = np.linspace(0.0, 1.0, 101)
NO_HYSTERESIS = Hysteresis("none", no_gap_v)


@dataclass(frozen=True)
class Circuit:
    """Elements in series with a voltage source. `CIRCUITS.add` registers it under its name.

    Args:
        name: What problems, results and options call it.
        description: What it is, in words.
        elements: Names of `ELEMENTS`, RC pairs first.
        hysteresis: What the direction of the current makes of the source.
        ocv_v: Called with the cell and SOC; gives the OCV in V that the hysteresis is around.

    Raises `InputError` for elements that are unknown, not in order or too many.
    """

    name: str
    description: str
    elements: tuple[str, ...] = (RC.name,) * 2
    hysteresis: Hysteresis = NO_HYSTERESIS
    ocv_v: OverSoc = CellModel.average_ocv_v

    def __post_init__(self) -> None:
        require_order(self.elements)
        names_of(self.elements)
        if len(self.elements) > MAX_PAIRS:
            raise InputError(
                f"the circuit {self.name} has {len(self.elements)} elements; a search takes at "
                f"most {MAX_PAIRS}"
            )

    @property
    def pairs(self) -> int:
        """Number of elements, usually RC pairs."""
        return len(self.elements)

    def beside(self, *elements: str) -> "Circuit":
        """The circuit with further elements; `so-rc` with diffusion is `so-rc+diffusion`."""
        described = ", ".join(get_element(name).description for name in elements)
        name, words = "+".join((self.name, *elements)), f"{self.description}, and {described}"
        return replace(self, name=name, description=words, elements=(*self.elements, *elements))

    @property
    def has_hysteresis(self) -> bool:
        """True if the voltage depends on more of the OCV test than the OCV in the middle of the
        gap."""
        return self.hysteresis.kind != "none"

    @property
    def has_rate(self) -> bool:
        """True if the hysteresis is dynamic."""
        return self.hysteresis.kind == "dynamic"

    def hysteresis_on(self, cell: CellModel) -> Hysteresis:
        """The hysteresis on a cell; none on a cell without a gap, unless the fit of a dynamic one
        can find it."""
        has_gap = self.has_rate or np.any(self.hysteresis.half_v(cell, EVERYWHERE))
        return self.hysteresis if has_gap else NO_HYSTERESIS

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """PyBaMM's names of the identified parameters."""
        return parameter_names(self.elements, self.has_rate)


# The SOC that has to pass after a turn of the current until 95 % of the way to the other branch is
# covered. Measured cells take several percent to a fifth; `esc` identifies it.
TURN_SOC = 0.1
TURN_WIDTH = TURN_SOC / float(np.arctanh(0.95))


def loops(soc: Samples, direction: Samples) -> Samples:
    """The state between the branches, -1 discharged to +1 charged, at every sample.

    After Windarko and Choi (2010), who describe loops by an improved Takacs model: from the turn of
    the current, the hysteresis approaches the branch of the new direction as the hyperbolic tangent
    of the charge passed since, and a turn before it arrives starts a minor loop. Unlike the
    exponential of `esc`, it depends on where the current turned. Their paper could not be read, and
    their constants are for a NiMH cell: the width is `TURN_SOC`. At the first sample the cell is on
    the branch of its direction.

    >>> loops(np.array([0.5, 0.45, 0.4]), np.array([1.0, -1.0, -1.0])).round(2)
    array([ 1.  ,  1.  , -0.45])
    """
    turns = np.flatnonzero(np.diff(direction, prepend=direction[:1])).tolist()
    turned, value = np.empty(len(soc)), float(direction[0])
    for begin, end in itertools.pairwise([0, *turns, len(soc)]):
        # At the sample where the current turns the state has not changed yet; the next run begins
        # there too.
        passed = np.abs(soc[begin : end + 1] - soc[begin])
        toward = direction[begin]
        path = toward + (value - toward) * (1 - np.tanh(passed / TURN_WIDTH))
        turned[begin:end], value = path[: end - begin], float(path[-1])
    return turned


_AVERAGED = "OCV averaged over charge and discharge"
_WITH = "two RC pairs, average OCV and"
_PAIR = (RC.name,)
SEGMENTED = Hysteresis("instant", CellModel.hysteresis_v)
DYNAMIC, LOOPS = Hysteresis("dynamic"), Hysteresis("loops")
_TURNING = f"{_WITH} hysteresis that turns along hyperbolic tangents"
ISO_RC = Circuit("iso-rc", f"{_WITH} segmented hysteresis voltage", _PAIR * 2, SEGMENTED)
SO_RC = Circuit("so-rc", f"two RC pairs, {_AVERAGED}", _PAIR * 2)
ESC = Circuit("esc", f"{_WITH} dynamic hysteresis of rate gamma", _PAIR * 2, DYNAMIC)
TAKACS = Circuit("takacs", _TURNING, _PAIR * 2, LOOPS)
ONE_RC = Circuit("1rc", f"one RC pair, {_AVERAGED}", _PAIR)
THREE_RC = Circuit("3rc", f"three RC pairs, {_AVERAGED}", _PAIR * 3)
FOUR_RC = Circuit("4rc", f"four RC pairs, {_AVERAGED}", _PAIR * 4)


class Circuits(dict[str, Circuit]):
    """Circuits by name."""

    def add(self, circuit: Circuit) -> None:
        """Register a circuit. Raises `InputError` if another one has its name, or the name contains
        a +, as those of `Circuit.beside` do."""
        if "+" in circuit.name or self.setdefault(circuit.name, circuit) != circuit:
            raise InputError(
                f"{circuit.name!r} is another circuit, or reads as one with elements beside it; "
                "choose another name, without a +"
            )


CIRCUITS = Circuits()
for _circuit in (ISO_RC, SO_RC, ESC, TAKACS, ONE_RC, THREE_RC, FOUR_RC):
    CIRCUITS.add(_circuit)


def make_circuit(
    name: str, *elements: Element | str, like: str = "so-rc", description: str = ""
) -> Circuit:
    """A circuit with the user's elements, registered under its name.

    Args:
        name: What to call it.
        elements: Its elements, by name ("rc", "diffusion") or of one's own; RC pairs first.
        like: The circuit whose OCV and hysteresis it has.
        description: What it is, in words.

    Raises `InputError` where another circuit has that name, or the elements are not so.

    >>> make_circuit("rc-and-diffusion", "rc", "diffusion").parameter_names
    ('R0 [Ohm]', 'R1 [Ohm]', 'C1 [F]', 'R_D [Ohm]', 'tau_D [s]')
    """
    given = [
        element if isinstance(element, str) else add_element(element).name for element in elements
    ]
    words = description or f"{', '.join(given)}, otherwise as {like}"
    made = replace(get_circuit(like), name=name, description=words, elements=tuple(given))
    CIRCUITS.add(made)
    return made


def get_circuit(name: str, option: str = "model") -> Circuit:
    """The circuit registered as `name`, or one with added elements, such as "so-rc+diffusion".

    Raises `InputError` that lists the names.

    >>> get_circuit("so-rc").name
    'so-rc'
    """
    base, *added = (name,) if name in CIRCUITS else name.split("+")
    if base not in CIRCUITS or not all(element in ELEMENTS for element in added):
        beside = ", ".join(f"+{element}" for element in ELEMENTS if element != RC.name)
        raise InputError(
            f"`{option}` {name!r} is not known; there are {', '.join(CIRCUITS)} (so-rc has two RC "
            f"pairs), each also with {beside}"
        )
    return CIRCUITS[base].beside(*added) if added else CIRCUITS[base]

"""The circuits: how many RC pairs, and which hysteresis voltage.

A new circuit is a `Circuit` here and one line in `CIRCUITS`.
"""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from .model import CellModel
from .parameters import parameter_names

Samples = Float[np.ndarray, "samples"]


@dataclass(frozen=True)
class Circuit:
    """RC pairs in series with a voltage source.

    `source_voltage(cell, soc, direction)` is the source in V at each sample, `direction` being
    +1 after charging and -1 after discharging; it is computed once, outside the search.
    `hysteresis_amplitude(cell, soc)`, where given, is the voltage in V that a dynamic hysteresis
    state h in [-1, 1] multiplies; its rate gamma is then one more parameter of the search.
    `turning(soc, direction)`, where given, is where between the branches the source stands at
    every sample, -1 discharged to +1 charged, and depends on the samples before: no curve over
    SOC says that, so exports of curves refuse such a circuit.
    """

    name: str
    description: str
    source_voltage: Callable[[CellModel, Samples, Samples], Samples]
    pairs: int = 2
    hysteresis_amplitude: Callable[[CellModel, Samples], Samples] | None = None
    turning: Callable[[Samples, Samples], Samples] | None = None

    @property
    def has_rate(self) -> bool:
        return self.hysteresis_amplitude is not None

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """PyBaMM's names of what is identified."""
        return parameter_names(self.pairs, self.has_rate)


def average_ocv(cell: CellModel, soc: Samples, direction: Samples) -> Samples:
    """The average of both OCV branches in V, whatever the direction."""
    del direction
    return cell.average_ocv_v(soc)


def average_ocv_with_hysteresis(cell: CellModel, soc: Samples, direction: Samples) -> Samples:
    """The average OCV in V, raised by W/2 after charging and lowered by it after discharging."""
    return cell.average_ocv_v(soc) + direction * cell.hysteresis_v(soc) / 2


# The SOC that must pass after a turn of the current until 95 % of the way to the other branch is
# done. Real cells take some percent to a fifth; `esc` identifies it.
TURN_SOC = 0.1
TURN_WIDTH = TURN_SOC / float(np.arctanh(0.95))


def average_ocv_with_loops(cell: CellModel, soc: Samples, direction: Samples) -> Samples:
    """The average OCV in V with half the hysteresis voltage, which turns along hyperbolic tangents.

    In the manner of Windarko and Choi (2010), who describe loops by an improved Takacs model: from
    where the current turned, the hysteresis goes to the branch of the new direction as the tangent
    of the charge passed since, and a turn before it is there starts a minor loop. Unlike the
    exponential of `esc` that depends on where it turned. Their paper could not be read, and their
    constants are of a NiMH cell: the width is `TURN_SOC`. At the first sample the cell is on the
    branch of its direction.
    """
    return cell.average_ocv_v(soc) + loops(soc, direction) * cell.hysteresis_v(soc) / 2


def loops(soc: Samples, direction: Samples) -> Samples:
    """Where between the branches, -1 discharged to +1 charged, after every sample.

    >>> loops(np.array([0.5, 0.45, 0.4]), np.array([1.0, -1.0, -1.0])).round(2)
    array([ 1.  ,  1.  , -0.45])
    """
    turns = np.flatnonzero(np.diff(direction, prepend=direction[:1])).tolist()
    turned, value = np.empty(len(soc)), float(direction[0])
    for begin, end in itertools.pairwise([0, *turns, len(soc)]):
        # The sample at which the current turns has not moved yet; the next run begins there too.
        passed = np.abs(soc[begin : end + 1] - soc[begin])
        toward = direction[begin]
        path = toward + (value - toward) * (1 - np.tanh(passed / TURN_WIDTH))
        turned[begin:end], value = path[: end - begin], float(path[-1])
    return turned


def half_hysteresis(cell: CellModel, soc: Samples) -> Samples:
    """Half the hysteresis voltage in V: the way from the average OCV to either branch."""
    return cell.hysteresis_v(soc) / 2


_AVERAGED = "OCV averaged over charge and discharge"
ISO_RC = Circuit(
    "iso-rc",
    "two RC pairs, average OCV and segmented hysteresis voltage",
    average_ocv_with_hysteresis,
)
SO_RC = Circuit("so-rc", f"two RC pairs, {_AVERAGED}", average_ocv)
ESC = Circuit(
    "esc",
    "two RC pairs, average OCV and dynamic hysteresis of rate gamma",
    average_ocv,
    hysteresis_amplitude=half_hysteresis,
)
TAKACS = Circuit(
    "takacs",
    "two RC pairs, average OCV and hysteresis that turns along hyperbolic tangents",
    average_ocv_with_loops,
    turning=loops,
)
ONE_RC = Circuit("1rc", f"one RC pair, {_AVERAGED}", average_ocv, pairs=1)
THREE_RC = Circuit("3rc", f"three RC pairs, {_AVERAGED}", average_ocv, pairs=3)
FOUR_RC = Circuit("4rc", f"four RC pairs, {_AVERAGED}", average_ocv, pairs=4)

CIRCUITS: Mapping[str, Circuit] = MappingProxyType(
    {circuit.name: circuit for circuit in (ISO_RC, SO_RC, ESC, TAKACS, ONE_RC, THREE_RC, FOUR_RC)}
)


def get_circuit(name: str) -> Circuit:
    """The circuit registered as `name`. Raises `InputError` that lists the names.

    >>> get_circuit("so-rc").name
    'so-rc'
    """
    if name not in CIRCUITS:
        raise InputError(f"no circuit is called {name!r}; there are {', '.join(CIRCUITS)}")
    return CIRCUITS[name]

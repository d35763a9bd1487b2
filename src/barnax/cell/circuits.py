"""The circuits: how many RC pairs, which hysteresis voltage, and the numbers of one circuit.

A new circuit is a `Circuit` here and one line in `CIRCUITS`.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from .model import CellModel

if TYPE_CHECKING:
    from pydantic_core import CoreSchema

Samples = Float[np.ndarray, "samples"]

MOST_PAIRS = 4
RATE = "gamma"


def parameter_names(pairs: int, has_rate: bool = False) -> tuple[str, ...]:
    """PyBaMM's names of a circuit's parameters, with their units.

    >>> parameter_names(2)
    ('R0 [Ohm]', 'R1 [Ohm]', 'C1 [F]', 'R2 [Ohm]', 'C2 [F]')
    """
    of_pairs = [name for pair in range(1, pairs + 1) for name in _names_of(pair)]
    return ("R0 [Ohm]", *of_pairs, *([RATE] if has_rate else []))


def _names_of(pair: int) -> tuple[str, str]:
    return f"R{pair} [Ohm]", f"C{pair} [F]"


@dataclass(frozen=True)
class CircuitParameters:
    """Ohmic resistance and one to four RC pairs in series.

    For two pairs the paper's R, Rpa, Cpa, Rpb, Cpb (Li et al. 2023, Eq. 1-3).

    Args:
        r0: Ohmic resistance in ohm.
        r: Resistance of each pair in ohm.
        c: Capacitance of each pair in F.
        gamma: Rate of a dynamic hysteresis per unit of SOC, None for a circuit without.

    Raises `ValueError` for a value that is not positive and finite, and for pairs that are not one
    to four.

    >>> CircuitParameters(r0=0.05, r=(0.02, 0.03), c=(500.0, 2000.0)).tau_s
    (10.0, 60.0)
    """

    r0: float
    r: tuple[float, ...]
    c: tuple[float, ...]
    gamma: float | None = None

    def __post_init__(self) -> None:
        if len(self.r) != len(self.c) or not 1 <= len(self.r) <= MOST_PAIRS:
            raise ValueError(
                f"a circuit has one to {MOST_PAIRS} pairs of R and C; {len(self.r)} R and "
                f"{len(self.c)} C were given"
            )
        for name, value in self.to_dict().items():
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be positive and finite; {value} was given")
        for pair, tau_s in enumerate(self.tau_s, 1):
            if not (math.isfinite(tau_s) and tau_s > 0):
                raise ValueError(f"R{pair} C{pair} must be positive and finite; it is {tau_s} s")

    @classmethod
    def of_tau(
        cls,
        r0: float,
        r: Sequence[float] | np.ndarray,
        tau_s: Sequence[float] | np.ndarray,
        gamma: float | None = None,
    ) -> Self:
        """The circuit whose pairs have these resistances and time constants."""
        c = tuple(float(tau / each) for each, tau in zip(r, tau_s, strict=True))
        return cls(float(r0), tuple(float(each) for each in r), c, gamma)

    @property
    def pairs(self) -> int:
        return len(self.r)

    @property
    def tau_s(self) -> tuple[float, ...]:
        """The time constant R C of every pair, in s."""
        return tuple(r * c for r, c in zip(self.r, self.c, strict=True))

    def ordered(self) -> Self:
        """The same circuit with its pairs from fast to slow."""
        order = sorted(range(self.pairs), key=lambda pair: self.tau_s[pair])
        r, c = (tuple(values[pair] for pair in order) for values in (self.r, self.c))
        return type(self)(self.r0, r, c, self.gamma)

    def to_dict(self) -> dict[str, float]:
        """The values under PyBaMM's parameter names."""
        of_pairs = [value for pair in zip(self.r, self.c, strict=True) for value in pair]
        rate = [] if self.gamma is None else [self.gamma]
        names = parameter_names(self.pairs, has_rate=bool(rate))
        return dict(zip(names, [self.r0, *of_pairs, *rate], strict=True))

    @classmethod
    def from_dict(cls, values: Mapping[str, float]) -> Self:
        """The circuit that `to_dict` wrote. Raises `InputError` for a missing or unusable value."""
        named = (pair for pair in range(1, MOST_PAIRS + 1) if values.keys() & {*_names_of(pair)})
        names = parameter_names(max(named, default=1), has_rate=RATE in values)
        missing = [name for name in names if name not in values]
        if missing:
            raise InputError(f"circuit parameters are missing: {', '.join(missing)}")
        unknown = sorted(values.keys() - set(names))
        if unknown:
            raise InputError(f"these are not circuit parameters: {', '.join(unknown)}")
        try:
            r0, *rest = (float(values[name]) for name in names)
            gamma = rest.pop() if RATE in values else None
            return cls(r0, tuple(rest[::2]), tuple(rest[1::2]), gamma)
        except (TypeError, ValueError) as error:
            raise InputError(f"circuit parameters cannot be used: {error}") from error

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> "CoreSchema":
        """Stored as `to_dict` has it."""
        from pydantic_core import core_schema

        return core_schema.no_info_before_validator_function(
            lambda given: cls.from_dict(given) if isinstance(given, Mapping) else given,
            core_schema.is_instance_schema(cls),
            serialization=core_schema.plain_serializer_function_ser_schema(cls.to_dict),
        )

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: Any, handler: Any) -> dict[str, Any]:
        return {"type": "object", "additionalProperties": {"type": "number"}}


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

"""The circuits: which elements, which hysteresis voltage, and the numbers of one circuit.

A new circuit is a `Circuit` here and one line in `CIRCUITS`.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from .elements import (
    ELEMENTS,
    RC,
    Element,
    add_element,
    alike,
    get_element,
    names_of,
    require_order,
    rungs_of,
)
from .model import CellModel

if TYPE_CHECKING:
    from pydantic_core import CoreSchema

Samples = Float[np.ndarray, "samples"]

MOST_PAIRS = 4
OHMIC, RATE = "R0 [Ohm]", "gamma"


def parameter_names(elements: Sequence[str], has_rate: bool = False) -> tuple[str, ...]:
    """PyBaMM's names of a circuit's parameters, with their units.

    >>> parameter_names(("rc", "rc"))
    ('R0 [Ohm]', 'R1 [Ohm]', 'C1 [F]', 'R2 [Ohm]', 'C2 [F]')
    >>> parameter_names(("rc", "diffusion"))
    ('R0 [Ohm]', 'R1 [Ohm]', 'C1 [F]', 'R_D [Ohm]', 'tau_D [s]')
    """
    named = [
        name
        for each in names_of(elements)
        for name in (each.resistance, each.capacitance or each.tau)
    ]
    return (OHMIC, *named, *([RATE] if has_rate else []))


def elements_in(names: Iterable[str]) -> tuple[str, ...]:
    """The elements that parameters of these names are of.

    >>> elements_in(["R0 [Ohm]", "R1 [Ohm]", "C1 [F]", "R_D [Ohm]", "tau_D [s]"])
    ('rc', 'diffusion')
    """
    symbols = {name.partition(" [")[0].lstrip("RCtau") for name in names} - {"0", RATE}
    known = {str(number): number for number in range(1, MOST_PAIRS + 1)}
    pairs = max((known.get(each, 0) for each in symbols), default=0)
    others = [each.name for each in ELEMENTS.values() if f"_{each.symbol}" in symbols]
    return (*[RC.name] * pairs, *others)


@dataclass(frozen=True)
class CircuitParameters:
    """Ohmic resistance and RC pairs, or other elements, in series.

    For two pairs the paper's R, Rpa, Cpa, Rpb, Cpb (Li et al. 2023, Eq. 1-3).

    Args:
        r0: Ohmic resistance in ohm.
        r: Resistance of each element in ohm.
        c: Capacitance of each in F; of one that is no RC pair its time constant over R.
        gamma: Rate of a dynamic hysteresis per unit of SOC, None for a circuit without.
        elements: What each is, by name; RC pairs where nothing is said.

    Raises `ValueError` for a value that is not positive and finite.

    >>> CircuitParameters(r0=0.05, r=(0.02, 0.03), c=(500.0, 2000.0)).tau_s
    (10.0, 60.0)
    """

    r0: float
    r: tuple[float, ...]
    c: tuple[float, ...]
    gamma: float | None = None
    elements: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "elements", self.elements or (RC.name,) * len(self.r))
        if not len(self.r) == len(self.c) == len(self.elements):
            raise ValueError(
                f"a circuit has one R and one C for each of its {len(self.elements)} elements; "
                f"{len(self.r)} R and {len(self.c)} C were given"
            )
        require_order(self.elements)
        for name, value in self.to_dict().items():
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be positive and finite; {value} was given")
        for names, tau_s in zip(names_of(self.elements), self.tau_s, strict=True):
            if not (math.isfinite(tau_s) and tau_s > 0):
                raise ValueError(f"{names.tau} must be positive and finite; it is {tau_s} s")

    @classmethod
    def of_tau(
        cls,
        r0: float,
        r: Sequence[float] | np.ndarray,
        tau_s: Sequence[float] | np.ndarray,
        gamma: float | None = None,
        elements: tuple[str, ...] = (),
    ) -> Self:
        """The circuit whose elements have these resistances and time constants."""
        c = tuple(float(tau / each) for each, tau in zip(r, tau_s, strict=True))
        return cls(float(r0), tuple(float(each) for each in r), c, gamma, elements)

    @property
    def pairs(self) -> int:
        return len(self.r)

    @property
    def tau_s(self) -> tuple[float, ...]:
        """The time constant R C of every element, in s."""
        return tuple(r * c for r, c in zip(self.r, self.c, strict=True))

    def ordered(self) -> Self:
        """The same circuit with its pairs from fast to slow."""
        count = alike(self.elements)
        order = sorted(range(count), key=lambda pair: self.tau_s[pair])
        order += range(count, self.pairs)
        r, c = (tuple(values[pair] for pair in order) for values in (self.r, self.c))
        return replace(self, r=r, c=c)

    def laddered(self) -> Self:
        """The same circuit, each element as the RC pairs that it consists of."""
        rungs = rungs_of(self.elements)
        r = [self.r[each.element] * each.share for each in rungs]
        tau_s = [self.tau_s[each.element] * each.ratio for each in rungs]
        return self.of_tau(self.r0, r, tau_s, self.gamma) if len(rungs) > self.pairs else self

    @property
    def named_tau_s(self) -> dict[str, float]:
        """Every time constant by its name."""
        return {
            names.tau: tau_s
            for names, tau_s in zip(names_of(self.elements), self.tau_s, strict=True)
        }

    @property
    def named_ohm(self) -> dict[str, float]:
        """Every resistance by its name, R0 first."""
        names = (OHMIC, *(each.resistance for each in names_of(self.elements)))
        return dict(zip(names, (self.r0, *self.r), strict=True))

    def to_dict(self) -> dict[str, float]:
        """The values under PyBaMM's parameter names."""
        values, rate = [self.r0], [] if self.gamma is None else [self.gamma]
        for name, r, c in zip(self.elements, self.r, self.c, strict=True):
            values += [r, c if name == RC.name else r * c]
        names = parameter_names(self.elements, has_rate=bool(rate))
        return dict(zip(names, [*values, *rate], strict=True))

    @classmethod
    def from_dict(cls, values: Mapping[str, float]) -> Self:
        """The circuit that `to_dict` wrote. Raises `InputError` for a missing or unusable value."""
        elements = elements_in(values) or (RC.name,)
        names = parameter_names(elements, has_rate=RATE in values)
        missing = [name for name in names if name not in values]
        if missing:
            raise InputError(f"circuit parameters are missing: {', '.join(missing)}")
        unknown = sorted(values.keys() - set(names))
        if unknown:
            raise InputError(f"these are not circuit parameters: {', '.join(unknown)}")
        try:
            r0, *rest = (float(values[name]) for name in names)
            gamma = rest.pop() if RATE in values else None
            r, second = rest[::2], rest[1::2]
            c = [
                each if name == RC.name else each / ohm
                for name, ohm, each in zip(elements, r, second, strict=True)
            ]
            return cls(r0, tuple(r), tuple(c), gamma, elements)
        except (TypeError, ValueError, ZeroDivisionError) as error:
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
    """Elements in series with a voltage source; a circuit that is made is known by its name.

    `elements` are names of `ELEMENTS`, or elements of one's own; RC pairs come first.

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
    elements: tuple[str, ...] = (RC.name,) * 2
    hysteresis_amplitude: Callable[[CellModel, Samples], Samples] | None = None
    turning: Callable[[Samples, Samples], Samples] | None = None

    def __post_init__(self) -> None:
        require_order(self.elements)
        names_of(self.elements)
        if len(self.elements) > MOST_PAIRS:
            raise InputError(
                f"the circuit {self.name} has {len(self.elements)} elements; a search takes at "
                f"most {MOST_PAIRS}"
            )

    @property
    def pairs(self) -> int:
        """How many elements there are, RC pairs mostly."""
        return len(self.elements)

    def beside(self, *elements: str) -> "Circuit":
        """The same with further elements, `so-rc` with diffusion being `so-rc+diffusion`."""
        described = ", ".join(get_element(name).description for name in elements)
        return replace(
            self,
            name="+".join((self.name, *elements)),
            description=f"{self.description}, and {described}",
            elements=(*self.elements, *elements),
        )

    @property
    def has_rate(self) -> bool:
        return self.hysteresis_amplitude is not None

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """PyBaMM's names of what is identified."""
        return parameter_names(self.elements, self.has_rate)


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
ONE_RC = Circuit("1rc", f"one RC pair, {_AVERAGED}", average_ocv, (RC.name,))
THREE_RC = Circuit("3rc", f"three RC pairs, {_AVERAGED}", average_ocv, (RC.name,) * 3)
FOUR_RC = Circuit("4rc", f"four RC pairs, {_AVERAGED}", average_ocv, (RC.name,) * 4)


class Circuits(Mapping[str, Circuit]):
    """The known circuits by name, and any of them with elements beside: `esc+diffusion`."""

    def __init__(self, known: Iterable[Circuit]):
        self._known = {each.name: each for each in known}

    def __getitem__(self, name: str) -> Circuit:
        base, *added = name.split("+")
        if name in self._known or not added:
            return self._known[name]
        if not all(each in ELEMENTS for each in added):
            raise KeyError(name)
        return self._known[base].beside(*added)

    def __iter__(self) -> Iterator[str]:
        return iter(self._known)

    def __len__(self) -> int:
        return len(self._known)

    def add(self, circuit: Circuit) -> None:
        """Make a circuit known. Raises `InputError` where another one has its name."""
        if self.get(circuit.name, circuit) != circuit:
            raise InputError(
                f"there is another circuit called {circuit.name!r}; choose another name"
            )
        self._known[circuit.name] = circuit


CIRCUITS = Circuits((ISO_RC, SO_RC, ESC, TAKACS, ONE_RC, THREE_RC, FOUR_RC))


def make_circuit(
    name: str, *elements: Element | str, like: str = "so-rc", description: str = ""
) -> Circuit:
    """A circuit of one's own elements, known by its name from here on.

    Args:
        name: What to call it.
        elements: Its elements, by name ("rc", "diffusion") or of one's own; RC pairs first.
        like: The circuit whose source voltage and hysteresis it has.
        description: What it is, in words.

    Raises `InputError` where another circuit has that name, or the elements are not so.

    >>> make_circuit("rc-and-diffusion", "rc", "diffusion").parameter_names
    ('R0 [Ohm]', 'R1 [Ohm]', 'C1 [F]', 'R_D [Ohm]', 'tau_D [s]')
    """
    given = [each if isinstance(each, str) else add_element(each).name for each in elements]
    made = replace(get_circuit(like), name=name, elements=tuple(given))
    made = replace(made, description=description or f"{', '.join(given)}, otherwise as {like}")
    CIRCUITS.add(made)
    return made


def get_circuit(name: str) -> Circuit:
    """The circuit registered as `name`, or one with elements beside, such as "so-rc+diffusion".

    Raises `InputError` that lists the names.

    >>> get_circuit("so-rc").name
    'so-rc'
    """
    if name not in CIRCUITS:
        beside = ", ".join(f"+{each}" for each in ELEMENTS if each != RC.name)
        raise InputError(
            f"no circuit is called {name!r}; there are {', '.join(CIRCUITS)}, each also with "
            f"{beside}"
        )
    return CIRCUITS[name]

"""The numbers of one constant circuit, and what they are called."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ..errors import InputError
from .elements import ELEMENTS, RC, alike, names_of, require_order, rungs_of

if TYPE_CHECKING:
    from pydantic_core import CoreSchema

MAX_PAIRS = 4
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
    """The elements that parameters of these names are of, in their order.

    >>> elements_in(["R0 [Ohm]", "R1 [Ohm]", "C1 [F]", "R_D [Ohm]", "tau_D [s]"])
    ('rc', 'diffusion')
    """
    symbols = dict.fromkeys(name.partition(" [")[0].lstrip("RCtau") for name in names)
    known = {str(number): number for number in range(1, MAX_PAIRS + 1)}
    pairs = max((known.get(each, 0) for each in symbols), default=0)
    others = {f"_{each.symbol}": each.name for each in ELEMENTS.values() if each.symbol}
    return (*[RC.name] * pairs, *(others[each] for each in symbols if each in others))


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

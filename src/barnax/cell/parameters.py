"""The numbers of one circuit: resistances, capacitances and, with dynamic hysteresis, a rate."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

from ..errors import InputError

if TYPE_CHECKING:
    from pydantic_core import CoreSchema

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
    """Ohmic resistance and one to four RC pairs in series, in ohm and farad.

    For two pairs the paper's R, Rpa, Cpa, Rpb, Cpb (Li et al. 2023, Eq. 1-3). `gamma` is the rate
    of a dynamic hysteresis per unit of SOC, None for a circuit without. Raises `ValueError` for a
    value that is not positive and finite, and for pairs that are not one to four.

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

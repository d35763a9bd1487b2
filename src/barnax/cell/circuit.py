"""The five numbers of a two-RC circuit."""

import math
from collections.abc import Mapping
from dataclasses import astuple, dataclass
from typing import Self

from ..errors import InputError

PYBAMM_NAMES = ("R0 [Ohm]", "R1 [Ohm]", "C1 [F]", "R2 [Ohm]", "C2 [F]")


@dataclass(frozen=True)
class CircuitParameters:
    """Ohmic resistance and two RC pairs, in ohm and farad.

    The paper's R, Rpa, Cpa, Rpb, Cpb (Li et al. 2023, Eq. 1-3). Raises `ValueError` for a value
    that is not positive and finite.

    >>> CircuitParameters(r0=0.05, r1=0.02, c1=500.0, r2=0.03, c2=2000.0).tau1_s
    10.0
    """

    r0: float
    r1: float
    c1: float
    r2: float
    c2: float

    def __post_init__(self) -> None:
        for name, value in zip(PYBAMM_NAMES, astuple(self), strict=True):
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be positive and finite; {value} was given")

    @property
    def tau1_s(self) -> float:
        return self.r1 * self.c1

    @property
    def tau2_s(self) -> float:
        return self.r2 * self.c2

    def ordered(self) -> Self:
        """The same circuit with the faster pair first, tau1 <= tau2."""
        if self.tau1_s <= self.tau2_s:
            return self
        return type(self)(r0=self.r0, r1=self.r2, c1=self.c2, r2=self.r1, c2=self.c1)

    def to_dict(self) -> dict[str, float]:
        """The values under PyBaMM's parameter names."""
        return dict(zip(PYBAMM_NAMES, astuple(self), strict=True))

    @classmethod
    def from_dict(cls, values: Mapping[str, float]) -> Self:
        """The circuit that `to_dict` wrote. Raises `InputError` for a missing or unusable value."""
        missing = [name for name in PYBAMM_NAMES if name not in values]
        if missing:
            raise InputError(f"circuit parameters are missing: {', '.join(missing)}")
        try:
            return cls(*(float(values[name]) for name in PYBAMM_NAMES))
        except (TypeError, ValueError) as error:
            raise InputError(f"circuit parameters cannot be used: {error}") from error

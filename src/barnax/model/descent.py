"""Descents over the logarithms of the time constants, at each of which all else is solved."""

import math
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

ROUNDS = 200

# The logarithms of every time constant in s, then that of gamma where there is one.
LogScales = tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Solved:
    """J of the best values at some scales, and the bounds that they are at, where another solve
    starts."""

    log_scales: LogScales
    sides: Any
    objective_v2: float

    @property
    def rms_v(self) -> float:
        """sqrt(J), in V."""
        return math.sqrt(self.objective_v2)


Found = TypeVar("Found", bound=Solved)


class Descended(Protocol[Found]):
    """An objective to descend on. The first axes, so many as are `interchangeable`, are of RC pairs
    with one box; `slope` is the derivative of the least J by the scales."""

    @property
    def axes(self) -> Any: ...
    @property
    def interchangeable(self) -> int: ...
    def solve(self, log_scales: LogScales, sides: Any = None, exact: bool = False) -> Found: ...
    def slope(self, found: Found) -> Float[np.ndarray, "axes"]: ...


def polish(objective: Descended[Found], start: Found) -> Found:
    """The end of a descent from a solution (L-BFGS-B), with interchangeable pairs from fast to
    slow."""
    best = start

    def measure(log_scales: Float[np.ndarray, "axes"]) -> tuple[float, Float[np.ndarray, "axes"]]:
        nonlocal best
        found = objective.solve(tuple(log_scales.tolist()), best.sides)
        if found.objective_v2 < best.objective_v2:
            best = found
        unit = start.objective_v2 or 1.0
        return found.objective_v2 / unit, objective.slope(found) / unit

    minimize(
        measure,
        np.array(start.log_scales),
        jac=True,
        method="L-BFGS-B",
        bounds=[(axis.low, axis.high) for axis in objective.axes],
        options={"maxiter": ROUNDS, "ftol": 1e-15, "gtol": 1e-9},
    )
    taus = sorted(best.log_scales[: objective.interchangeable])
    log_scales = (*taus, *best.log_scales[len(taus) :])
    return best if log_scales == best.log_scales else objective.solve(log_scales)

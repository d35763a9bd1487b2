"""The search over the time constants, and at each of them the best tables: least squares in a box,
exactly, for a hundred unknowns.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from ..cell.parameters import RATE
from ..model.grid import GridSizes, minima_of, points_in_order
from .settings import TableSettings

# Grid points of a time constant by the number of pairs, alone and beside gamma, and of gamma.
GRID = GridSizes({1: 64, 2: 20, 3: 10, 4: 8}, {1: 32, 2: 12, 3: 8, 4: 7}, 8)
# Lowest points of the grid that are polished.
MAX_MINIMA = 4
ROUNDS = 200

# The logarithms of every time constant in s, then that of gamma where there is one.
LogScales = tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Solved:
    """J of the best tables at some scales, and the bounds that they are at, where another solve
    starts."""

    log_scales: LogScales
    sides: Any
    objective_v2: float

    @property
    def rms_v(self) -> float:
        """sqrt(J), in V."""
        return math.sqrt(self.objective_v2)


Found = TypeVar("Found", bound=Solved)


class Searchable(Protocol[Found]):
    """A searchable objective: a `TableObjective`, or a weighted sum of several with the same time
    constants: `parts_at` has the weight, objective and solution of each. The first axes, so many as
    are `interchangeable`, are of RC pairs with one box."""

    @property
    def settings(self) -> TableSettings: ...
    @property
    def axes(self) -> Any: ...
    @property
    def interchangeable(self) -> int: ...
    def parts_at(self, found: Found) -> Sequence[tuple[float, Any, Any]]: ...
    def solve(self, log_scales: LogScales, sides: Any = None, exact: bool = False) -> Found: ...
    def least_v2(
        self, log_scales: Float[np.ndarray, "axes points"]
    ) -> Float[np.ndarray, "points"]: ...
    def slope(self, found: Found) -> Float[np.ndarray, "axes"]: ...


def find_best(objective: Searchable[Found]) -> Found:
    """The best tables and time constants that a grid and descents from its minima find."""
    ends = [polish(objective, start) for start in _minima(objective)]
    best = min(ends, key=lambda end: end.objective_v2)
    return objective.solve(best.log_scales, best.sides, exact=True)


def polish(objective: Searchable[Found], start: Found) -> Found:
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


def _minima(objective: Searchable[Found]) -> list[Found]:
    """The lowest of the grid points that no neighbor is below."""
    elements = sum(axis.name != RATE for axis in objective.axes)
    places = GRID.places(((axis.low, axis.high) for axis in objective.axes), elements)
    lowest_v2 = np.full([len(axis) for axis in places], np.inf)
    # Two pairs with one time constant are one pair, and searched only where there is no other.
    points = points_in_order(lowest_v2.shape, objective.interchangeable, apart=True)
    log_scales = np.stack([axis[at] for axis, at in zip(places, points, strict=True)])
    lowest_v2[*points] = objective.least_v2(log_scales)
    minima = minima_of(lowest_v2)[:MAX_MINIMA]
    return [
        objective.solve(tuple(float(axis[at]) for axis, at in zip(places, point, strict=True)))
        for point in minima
    ]

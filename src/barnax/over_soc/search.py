"""The search over the time constants, and at each of them the best tables: least squares in a box,
exactly, for a hundred unknowns.
"""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float

from ..cell.parameters import RATE
from ..model.descent import Descended, Found, polish
from ..model.grid import GridSizes, minima_of, points_in_order
from .settings import TableSettings

# Grid points of a time constant by the number of pairs, alone and beside gamma, and of gamma.
GRID = GridSizes({1: 64, 2: 20, 3: 10, 4: 8}, {1: 32, 2: 12, 3: 8, 4: 7}, 8)
# Lowest points of the grid that are polished.
MAX_MINIMA = 4


class Searchable(Descended[Found], Protocol[Found]):
    """A searchable objective: a `TableObjective`, or a weighted sum of several with the same time
    constants: `parts_at` has the weight, objective and solution of each."""

    @property
    def settings(self) -> TableSettings: ...
    def parts_at(self, found: Found) -> Sequence[tuple[float, Any, Any]]: ...
    def least_v2(
        self, log_scales: Float[np.ndarray, "axes points"]
    ) -> Float[np.ndarray, "points"]: ...


def find_best(objective: Searchable[Found]) -> Found:
    """The best tables and time constants that a grid and descents from its minima find."""
    ends = [polish(objective, start) for start in _minima(objective)]
    best = min(ends, key=lambda end: end.objective_v2)
    return objective.solve(best.log_scales, best.sides, exact=True)


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

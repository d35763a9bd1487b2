"""The search over the time constants, and at each of them the best tables: least squares in a box,
exactly, for a hundred unknowns.
"""

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float

from ..model.descent import Descended, Found, polish
from ..model.grid import GridSizes, lowest_scales
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
    # Two pairs with one time constant are one pair, and searched only where there is no other.
    starts = lowest_scales(objective, GRID, apart=True)[:MAX_MINIMA]
    ends = [polish(objective, objective.solve(start)) for start in starts]
    best = min(ends, key=lambda end: end.objective_v2)
    return objective.solve(best.log_scales, best.sides, exact=True)

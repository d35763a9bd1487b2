"""The search over the time constants, and at each of them the best tables: least squares in a box,
exactly, for a hundred unknowns.
"""

import itertools
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import LinAlgError, get_lapack_funcs, lstsq
from scipy.ndimage import minimum_filter
from scipy.optimize import minimize

from ..cell.elements import RC
from ..cell.parameters import RATE

# Grid points of a time constant by the number of pairs, alone and beside gamma, and of gamma.
TAUS = {1: 64, 2: 20, 3: 10, 4: 8}
TAUS_BESIDE_GAMMA = {1: 32, 2: 12, 3: 8, 4: 7}
GAMMAS = 8
# Lowest points of the grid that are polished.
MOST_MINIMA = 4
ROUNDS = 200
# Slopes and distances this small, relative to what makes them up, are rounding.
ROUNDING = 1e-12
# Exchanges of all wrong unknowns at once that may leave as many wrong ones as there were.
PATIENCE = 3
MOST_ROUNDS = 400

Unknowns = Float[np.ndarray, "unknowns"]
Square = Float[np.ndarray, "unknowns unknowns"]
# At the lower bound -1, at the upper one 1, free 0.
Sides = Int[np.ndarray, "unknowns"]
# The logarithms of every time constant in s, then that of gamma where there is one.
Place = tuple[float, ...]


def least_in_box(
    normal: Square, gradient: Unknowns, low: Unknowns, high: Unknowns, sides: Sides | None = None
) -> tuple[Unknowns, Sides]:
    """The x in [low, high] with the least x.(normal x) / 2 + gradient.x, and which are at a bound.

    `normal` is positive definite. `sides` are a guess of which are, such as a neighbor's answer.
    Block principal pivoting (Portugal, Judice and Vicente, Math. Comp. 63 (1994) 625): all
    unknowns on the wrong side change it at once; where that does not help, only the last of them
    does, which always ends.

    >>> x, sides = least_in_box(np.eye(2), np.array([1.0, -1.0]), np.zeros(2), np.full(2, 9.0))
    >>> x.tolist(), sides.tolist()
    ([0.0, 1.0], [-1, 0])
    """
    is_held = low >= high
    sides = np.zeros(len(low), int) if sides is None else sides.copy()
    sides[is_held] = -1
    unit = np.sqrt(np.diag(normal))
    fewest, patience = len(low) + 1, PATIENCE
    x = low
    for _ in range(MOST_ROUNDS):
        free = np.flatnonzero(sides == 0)
        x = np.where(sides < 0, low, np.where(sides > 0, high, 0.0))
        x[free] = _solved(normal[np.ix_(free, free)], -(gradient[free] + normal[free] @ x))
        slope = gradient + normal @ x
        slack = ROUNDING * (np.abs(gradient) + unit * np.sqrt(max(x @ normal @ x, 0.0)))
        span = ROUNDING * np.abs(x)
        is_low, is_high = sides < 0, sides > 0
        wrong = np.flatnonzero(
            ~is_held
            & ~np.where(
                is_low,
                slope >= -slack,
                np.where(is_high, slope <= slack, (x >= low - span) & (x <= high + span)),
            )
        )
        if not len(wrong):
            break
        if len(wrong) < fewest:
            fewest, patience = len(wrong), PATIENCE
        elif patience:
            patience -= 1
        else:
            wrong = wrong[-1:]
        now = np.where(x[wrong] < low[wrong], -1, 1)
        sides[wrong] = np.where(sides[wrong] == 0, now, 0)
    return np.clip(x, low, high), sides


def least_squares_in_box(
    matrix: Float[np.ndarray, "rows unknowns"],
    base: Float[np.ndarray, "rows"],
    low: Unknowns,
    high: Unknowns,
    sides: Sides | None = None,
) -> tuple[Unknowns, Sides]:
    """The x in [low, high] with the least |base + matrix x|, and which are at a bound.

    Which are is found with the normal equations; their values, which those would give to fewer
    digits, by an orthogonal factorization.
    """
    x, sides = least_in_box(matrix.T @ matrix, matrix.T @ base, low, high, sides)
    free = sides == 0
    at_bound = np.where(free, 0.0, x)
    found = lstsq(matrix[:, free], -(base + matrix @ at_bound), lapack_driver="gelsy")
    x = at_bound.copy()
    x[free] = np.asarray(found[0] if found is not None else 0.0)
    return np.clip(x, low, high), sides


def _solved(normal: Square, target: Unknowns) -> Unknowns:
    """The solution of positive definite equations, by Cholesky."""
    if not len(target):
        return target
    # Without SciPy's checks, which take longer than the solution.
    posv: Any = get_lapack_funcs("posv", (normal,))
    _, solution, failed = posv(normal, target)
    if failed:
        raise LinAlgError("the equations of some tables have no definite solution")
    return solution


@dataclass(frozen=True, eq=False)
class Solved:
    """What J the best tables at a place have, and the bounds that they are at, where another solve
    starts."""

    place: Place
    sides: Any
    squared: float


Found = TypeVar("Found", bound=Solved)


class Searchable(Protocol[Found]):
    """What can be searched: an `Objective`, or several with the same time constants."""

    @property
    def axes(self) -> Any: ...
    def solve(self, place: Place, sides: Any = None, exact: bool = False) -> Found: ...
    def slope(self, found: Found) -> Float[np.ndarray, "axes"]: ...


def find_best(objective: Searchable[Found]) -> Found:
    """The best tables and time constants that a grid and descents from its minima find."""
    ends = [polish(objective, each) for each in _minima(objective)]
    best = min(ends, key=lambda end: end.squared)
    return objective.solve(best.place, best.sides, exact=True)


def polish(objective: Searchable[Found], start: Found) -> Found:
    """Where a descent from a solution ends (L-BFGS-B), with its pairs from fast to slow."""
    best = start

    def measure(place: Float[np.ndarray, "axes"]) -> tuple[float, Float[np.ndarray, "axes"]]:
        nonlocal best
        found = objective.solve(tuple(place.tolist()), best.sides)
        if found.squared < best.squared:
            best = found
        unit = start.squared or 1.0
        return found.squared / unit, objective.slope(found) / unit

    minimize(
        measure,
        np.array(start.place),
        jac=True,
        method="L-BFGS-B",
        bounds=[(axis.low, axis.high) for axis in objective.axes],
        options={"maxiter": ROUNDS, "ftol": 1e-15, "gtol": 1e-9},
    )
    place = in_order(objective, best.place)
    return best if place == best.place else objective.solve(place)


def in_order(objective: Searchable, place: Place) -> Place:
    """The same place with its pairs from fast to slow, where all have one box."""
    alike = alike_pairs(objective)
    return (*sorted(place[:alike]), *place[alike:])


def alike_pairs(objective: Searchable) -> int:
    """How many pairs can change places: all RC pairs, where they have one box, else none."""
    boxes = [
        (axis.low, axis.high) for axis in objective.axes if axis.name != RATE and axis.element == RC
    ]
    return len(boxes) if len(set(boxes)) == 1 else 0


def _minima(objective: Searchable[Found]) -> list[Found]:
    """The lowest of the grid points that no neighbor is below."""
    has_rate = objective.axes[-1].name == RATE
    pairs, alike = len(objective.axes) - has_rate, alike_pairs(objective)
    sizes = [(TAUS_BESIDE_GAMMA if has_rate else TAUS)[pairs]] * pairs + [GAMMAS] * has_rate
    places = [
        np.linspace(axis.low, axis.high, size if axis.high > axis.low else 1).tolist()
        for axis, size in zip(objective.axes, sizes, strict=True)
    ]
    squared = np.full([len(axis) for axis in places], np.inf)
    found: dict[tuple[int, ...], Found] = {}
    sides = None
    for point in itertools.product(*(range(len(axis)) for axis in places)):
        # Two pairs with one time constant are one pair, and searched only where there is no other.
        if len(places[0]) > 1 and list(point[:alike]) != sorted(set(point[:alike])):
            continue
        place = tuple(axis[index] for axis, index in zip(places, point, strict=True))
        found[point] = solution = objective.solve(place, sides)
        squared[point], sides = solution.squared, solution.sides
    is_minimum = (squared == minimum_filter(squared, 3, mode="nearest")) & np.isfinite(squared)
    points = sorted(map(tuple, np.argwhere(is_minimum).tolist()), key=lambda at: squared[at])
    return [found[point] for point in points[:MOST_MINIMA]]

"""The search over the time constants, every table being the best one at each of them."""

import itertools
from typing import Any, Protocol, TypeVar

import numpy as np
from jaxtyping import Float
from scipy.ndimage import minimum_filter
from scipy.optimize import minimize

from ..model.search_space import Range
from .objective import Place

# Grid points of a time constant by the number of pairs, alone and beside gamma, and of gamma.
TAUS = {1: 64, 2: 20, 3: 10, 4: 8}
TAUS_BESIDE_GAMMA = {1: 32, 2: 12, 3: 8, 4: 7}
GAMMAS = 8
# Lowest points of the grid that are polished.
MOST_MINIMA = 4
ROUNDS = 200


class Solved(Protocol):
    """The best tables at a place, and the bounds that they are at, where another solve starts."""

    @property
    def place(self) -> Place: ...
    @property
    def sides(self) -> Any: ...
    @property
    def squared(self) -> float: ...


Found = TypeVar("Found", bound=Solved)


class Searchable(Protocol[Found]):
    """What can be searched: an `Objective`, or several with the same time constants."""

    @property
    def tau_ranges_s(self) -> tuple[Range, ...]: ...
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
    pairs = len(objective.tau_ranges_s)
    if len(set(objective.tau_ranges_s)) > 1:
        return place
    return (*sorted(place[:pairs]), *place[pairs:])


def _minima(objective: Searchable[Found]) -> list[Found]:
    """The lowest of the grid points that no neighbor is below."""
    pairs = len(objective.tau_ranges_s)
    has_rate = len(objective.axes) > pairs
    sizes = [(TAUS_BESIDE_GAMMA if has_rate else TAUS)[pairs]] * pairs + [GAMMAS] * has_rate
    places = [
        np.linspace(axis.low, axis.high, size if axis.high > axis.low else 1).tolist()
        for axis, size in zip(objective.axes, sizes, strict=True)
    ]
    is_alike = len(set(objective.tau_ranges_s)) == 1
    squared = np.full([len(axis) for axis in places], np.inf)
    found: dict[tuple[int, ...], Found] = {}
    sides = None
    for point in itertools.product(*(range(len(axis)) for axis in places)):
        # Two pairs with one time constant are one pair, and searched only where there is no other.
        if is_alike and len(places[0]) > 1 and list(point[:pairs]) != sorted(set(point[:pairs])):
            continue
        place = tuple(axis[index] for axis, index in zip(places, point, strict=True))
        found[point] = solution = objective.solve(place, sides)
        squared[point], sides = solution.squared, solution.sides
    is_minimum = (squared == minimum_filter(squared, 3, mode="nearest")) & np.isfinite(squared)
    points = sorted(map(tuple, np.argwhere(is_minimum).tolist()), key=lambda at: squared[at])
    return [found[point] for point in points[:MOST_MINIMA]]

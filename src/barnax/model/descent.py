"""Searches over the logarithms of time constants, at each of which all else is solved: the minima
of a grid, and descents from them."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import label, minimum_filter
from scipy.optimize import minimize

from ..cell.parameters import RATE
from .search_space import Range

# Steps of a descent.
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
    def least_v2(
        self, log_scales: Float[np.ndarray, "axes points"]
    ) -> Float[np.ndarray, "points"]: ...


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


# Points that are solved at a time.
CHUNK = 8192


@dataclass(frozen=True)
class GridSizes:
    """Number of places on every axis: of a time constant by the number of elements, alone and
    beside a rate, and of the rate."""

    alone: Mapping[int, int]
    beside_rate: Mapping[int, int]
    rates: int

    def places(self, ranges: Iterable[Range], elements: int) -> list[Float[np.ndarray, "places"]]:
        """Evenly spaced places between the ends of every axis, the elements' first; one where there
        is nothing to choose.

        >>> GridSizes({1: 3}, {1: 2}, 2).places([(0.0, 1.0)], 1)
        [array([0. , 0.5, 1. ])]
        """
        ends = list(ranges)
        has_rate = len(ends) > elements
        size = (self.beside_rate if has_rate else self.alone)[elements]
        sizes = [size] * elements + [self.rates] * has_rate
        return [
            np.linspace(low, high, size if high > low else 1)
            for (low, high), size in zip(ends, sizes, strict=True)
        ]


def points_in_order(
    shape: tuple[int, ...], interchangeable: int, *, apart: bool
) -> Int[np.ndarray, "axes points"]:
    """The indices of all points whose first ones, so many as are interchangeable, rise; they may be
    equal unless they are to be `apart`, which one place allows none to be.

    >>> points_in_order((2, 2), 2, apart=False).T.tolist()
    [[0, 0], [0, 1], [1, 1]]
    """
    points = np.indices(shape).reshape(len(shape), -1)
    least = 1 if apart and shape[0] > 1 else 0
    return points[:, np.all(np.diff(points[:interchangeable], axis=0) >= least, axis=0)]


def minima_of(values: Float[np.ndarray, "*grid"], factor: float = np.inf) -> list[tuple[int, ...]]:
    """The points no neighbor of which is lower, best first; level ground counts once.

    Only those with at most `factor` times the lowest value; none where there is no number.

    >>> minima_of(np.array([3.0, 1.0, np.nan, 0.5, 0.5, 0.7]))
    [(3,), (1,)]
    """
    known = np.where(np.isnan(values), np.inf, values)
    is_minimum = (known == minimum_filter(known, 3, mode="nearest")) & np.isfinite(known)
    is_minimum &= known <= factor * np.min(known)
    grounds = np.empty(known.shape, int)
    label(is_minimum, np.ones((3,) * known.ndim), output=grounds)
    _, first = np.unique(grounds[is_minimum], return_index=True)
    points = np.argwhere(is_minimum)[first].tolist()
    return sorted(map(tuple, points), key=lambda point: values[point])


def lowest_scales(
    objective: Descended[Any], sizes: GridSizes, *, apart: bool, factor: float = np.inf
) -> list[LogScales]:
    """The minima of an objective on a grid over its axes, as `minima_of` has them.

    Args:
        objective: Its axes, how many are `interchangeable`, and its `least_v2` at many scales.
        sizes: Places on every axis.
        apart: Whether interchangeable pairs have time constants that differ.
        factor: How many times the lowest sqrt(J) one may have.
    """
    elements = sum(axis.name != RATE for axis in objective.axes)
    places = sizes.places(((axis.low, axis.high) for axis in objective.axes), elements)
    lowest_v2 = np.full([len(axis) for axis in places], np.inf)
    points = points_in_order(lowest_v2.shape, objective.interchangeable, apart=apart)
    for first in range(0, points.shape[1], CHUNK):
        here = points[:, first : first + CHUNK]
        log_scales = np.stack([axis[at] for axis, at in zip(places, here, strict=True)])
        lowest_v2[*here] = objective.least_v2(log_scales)
    return [
        tuple(float(axis[at]) for axis, at in zip(places, point, strict=True))
        for point in minima_of(lowest_v2, factor**2)
    ]

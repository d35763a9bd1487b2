"""A grid over the logarithms of time constants, and of a rate where there is one; its minima."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import label, minimum_filter

from ..cell.parameters import RATE
from .search_space import Range

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
    objective: Any, sizes: GridSizes, *, apart: bool, factor: float = np.inf
) -> list[tuple[float, ...]]:
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

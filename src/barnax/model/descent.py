"""Searches over the logarithms of time constants, with all other parameters solved at each: axes,
the minima of a grid, and descents from them."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

import numpy as np
from jaxtyping import Float
from scipy.ndimage import label, minimum_filter
from scipy.optimize import minimize

from ..cell.elements import Element
from ..cell.parameters import RATE
from .exponentials import Span
from .search_space import Range

# Number of scales of an axis whose results are cached.
KEPT = 4096
# An RC pair within this of the fastest of a span, in the logarithm, is no faster.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Axis:
    """One of the coordinates in which the error is not linear: log of a tau in s, or of gamma.

    Its columns multiply the table of that number; `table` is None if there is one column with a
    fixed factor, the dynamic hysteresis of the measured gap. `answers` are those of the span's
    skeleton, from which `to_nodes` gives all nodes, or of the nodes themselves. `sign` is -1 if a
    time constant is the inverse of the searched number.
    """

    name: str
    low: float
    high: float
    table: int | None
    answers: Float[np.ndarray, "few rows width"]
    to_nodes: Float[np.ndarray, "few nodes"] | None
    span: Span
    sign: int
    element: Element
    _columns: dict[float, Float[np.ndarray, "rows width"]] = field(default_factory=dict)

    def columns(
        self, scales: Float[np.ndarray, "points"]
    ) -> Float[np.ndarray, "points rows width"]:
        """The columns at some scales."""
        rungs = self._rungs(scales)
        return self._product(sum(share * self.span.counts(at) for share, at, _ in rungs))

    def columns_at(self, scale: float) -> Float[np.ndarray, "rows width"]:
        """The columns at one scale, cached."""
        if scale not in self._columns:
            while len(self._columns) >= KEPT:
                del self._columns[next(iter(self._columns))]
            self._columns[scale] = self.columns(np.array([scale]))[0]
        return self._columns[scale]

    def slopes_at(self, scale: float) -> Float[np.ndarray, "rows width"]:
        """The derivatives of the columns by the scale."""
        rungs = self._rungs(np.array([scale]))
        slopes = sum(
            share * moves * (self.span.counts(at) @ self.span.slope) for share, at, moves in rungs
        )
        return self._product(self.sign * slopes / self.span.half_width)[0]

    def _rungs(
        self, scales: Float[np.ndarray, "points"]
    ) -> Iterator[tuple[float, Float[np.ndarray, "points"], Float[np.ndarray, "points 1"]]]:
        """For each of the element's RC pairs: its share, its log of tau, and whether that moves."""
        lowest = self.span.center - self.span.half_width
        for share, ratio in zip(self.element.shares, self.element.ratios, strict=True):
            each = self.sign * scales + math.log(ratio)
            # A faster pair has settled within every interval too.
            yield share, np.maximum(each, lowest), (each > lowest - ROUNDING)[:, None]

    def _product(self, counts) -> Float[np.ndarray, "points rows width"]:
        if self.to_nodes is not None:
            counts = counts @ self.to_nodes.T
        flat = self.answers.reshape(len(self.answers), -1)
        return (counts @ flat).reshape(-1, *self.answers.shape[1:])


# Maximum number of steps of a descent.
ROUNDS = 200

# The logarithms of every time constant in s, then that of gamma if there is one.
LogScales = tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Solved:
    """J of the best values at some scales, and the bounds they are at, from which another solve
    starts."""

    log_scales: LogScales
    active_set: Any
    objective_v2: float

    @property
    def rms_v(self) -> float:
        """sqrt(J), in V."""
        return math.sqrt(self.objective_v2)


Polished = TypeVar("Polished", bound=Solved)


class Descended(Protocol[Polished]):
    """An objective to descend on. The first `interchangeable` axes are RC pairs with the same box;
    `slope` is the derivative of the least J by the scales."""

    @property
    def axes(self) -> Any: ...
    @property
    def interchangeable(self) -> int: ...
    def solve(
        self, log_scales: LogScales, active_set: Any = None, exact: bool = False
    ) -> Polished: ...
    def slope(self, solution: Polished, /) -> Float[np.ndarray, "axes"]: ...
    def least_v2(
        self, log_scales: Float[np.ndarray, "axes points"]
    ) -> Float[np.ndarray, "points"]: ...


def polish(objective: Descended[Polished], start: Polished) -> Polished:
    """The end of a descent from a solution (L-BFGS-B), with interchangeable pairs from fast to
    slow."""
    best = start

    def measure(log_scales: Float[np.ndarray, "axes"]) -> tuple[float, Float[np.ndarray, "axes"]]:
        nonlocal best
        measured = objective.solve(tuple(log_scales.tolist()), best.active_set)
        if measured.objective_v2 < best.objective_v2:
            best = measured
        unit = start.objective_v2 or 1.0
        return measured.objective_v2 / unit, objective.slope(measured) / unit

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


# Points solved at a time.
CHUNK = 8192


@dataclass(frozen=True)
class GridSizes:
    """Number of values on every axis: of a time constant by the number of elements, alone and with
    a rate, and of the rate."""

    alone: Mapping[int, int]
    beside_rate: Mapping[int, int]
    rates: int

    def values(self, ranges: Iterable[Range], elements: int) -> list[Float[np.ndarray, "values"]]:
        """Evenly spaced values between the ends of every axis, the elements' first; a single value
        if the ends coincide.

        >>> GridSizes({1: 3}, {1: 2}, 2).values([(0.0, 1.0)], 1)
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


def minima_of(values: Float[np.ndarray, "*grid"], factor: float = np.inf) -> list[tuple[int, ...]]:
    """The points without a lower neighbor, best first; a plateau counts once.

    Only those with at most `factor` times the lowest value; empty if there is no number.

    >>> minima_of(np.array([3.0, 1.0, np.nan, 0.5, 0.5, 0.7]))
    [(3,), (1,)]
    """
    values = np.where(np.isnan(values), np.inf, values)
    is_minimum = (values == minimum_filter(values, 3, mode="nearest")) & np.isfinite(values)
    is_minimum &= values <= factor * np.min(values)
    grounds = np.empty(values.shape, int)
    label(is_minimum, np.ones((3,) * values.ndim), output=grounds)
    _, first = np.unique(grounds[is_minimum], return_index=True)
    points = np.argwhere(is_minimum)[first].tolist()
    return sorted(map(tuple, points), key=lambda point: values[point])


def lowest_scales(
    objective: Descended[Any], sizes: GridSizes, *, apart: bool, factor: float = np.inf
) -> list[LogScales]:
    """The minima of an objective on a grid over its axes, as in `minima_of`.

    Args:
        objective: Its axes, the number of `interchangeable` ones, and its `least_v2` at many
            scales.
        sizes: Values on every axis.
        apart: Whether interchangeable pairs must have different time constants, if there are
            several values to choose from.
        factor: Largest accepted sqrt(J) as a multiple of the lowest.
    """
    elements = sum(axis.name != RATE for axis in objective.axes)
    values = sizes.values(((axis.low, axis.high) for axis in objective.axes), elements)
    lowest_v2 = np.full([len(axis) for axis in values], np.inf)
    points = np.indices(lowest_v2.shape).reshape(lowest_v2.ndim, -1)
    least = 1 if apart and len(values[0]) > 1 else 0
    rises = np.diff(points[: objective.interchangeable], axis=0) >= least
    points = points[:, np.all(rises, axis=0)]
    for first in range(0, points.shape[1], CHUNK):
        here = points[:, first : first + CHUNK]
        log_scales = np.stack([axis[at] for axis, at in zip(values, here, strict=True)])
        lowest_v2[*here] = objective.least_v2(log_scales)
    return [
        tuple(float(axis[at]) for axis, at in zip(values, point, strict=True))
        for point in minima_of(lowest_v2, factor**2)
    ]

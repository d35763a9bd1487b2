"""A problem's error in a few numbers: columns that resistances multiply, over log time constants.

With the compressed objective (`compressed`) the error of a circuit is base + R0 current + the sum
of R_i times the answer of a pair of 1 ohm, less what a dynamic hysteresis turns: vectors of about
a hundred entries. Here they are plain NumPy, for methods that want thousands of columns of ever
other number, which compiled programs of fixed shapes do not serve.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .compressed import TOLERANCE
from .exponentials import Lagrange, span_of
from .problem import Problem
from .split_box import SplitBox

Columns = Float[np.ndarray, "points rows"]


@dataclass(frozen=True, eq=False)
class Axis:
    """One of the coordinates in which the error is not linear: log of a tau in s, or of gamma.

    `columns` gives the answers at some places on it. `largest` bounds the input they answer to, so
    that no answer, and no sample of it, exceeds it; `error` bounds how wrong any of them is, in
    the unit of the columns.
    """

    low: float
    high: float
    columns: Callable[[Float[np.ndarray, "points"]], Columns]
    largest: float
    error: float

    @classmethod
    def between(cls, low: float, high: float, columns: Callable, largest: float, error: float):
        """The axis of values from low to high; `error` is relative to `largest`."""
        return cls(math.log(low), math.log(high), columns, largest, error * largest)


@dataclass(frozen=True, eq=False)
class Reduced:
    """The columns of one problem, scaled so that sums of squares are mean squares.

    The first `box.bounds.pairs` axes are the pairs', then gamma's where there is one. `is_ordered`
    says that the pairs are alike, so that only circuits with tau1 <= tau2 and so on count.
    """

    base: Float[np.ndarray, "rows"]
    current: Float[np.ndarray, "rows"]
    axes: tuple[Axis, ...]
    box: SplitBox
    is_ordered: bool

    @classmethod
    def of(cls, problem: Problem) -> "Reduced":
        """The columns. Raises `InputError` where the box is too wide to compress."""
        short, box = problem.compressed, SplitBox(problem.bounds)
        unit = np.sqrt(float(short.scored))
        limits = problem.coordinates
        largest_a = max(float(np.max(np.abs(drive.held_a))) for drive in problem.drives)
        answers = _Interpolated(np.asarray(short.pairs) / unit, short.in_tau, 1)
        error = span_of(limits.shortest_tau_s, limits.longest_tau_s, TOLERANCE).error
        axes = [
            Axis.between(*box.tau_range_s(pair), answers, largest_a, error)
            for pair in range(problem.bounds.pairs)
        ]
        if short.turns is not None and short.in_rate is not None and box.gamma_range is not None:
            low, high = box.gamma_range
            turned = _Interpolated(np.asarray(short.turns) / unit, short.in_rate, -1)
            largest_v = max(
                float(np.max(np.abs(moved.amplitude_v)) * np.max(np.abs(moved.push)))
                for moved in (drive.hysteresis for drive in problem.drives)
                if moved is not None
            )
            error = span_of(1 / high, 1 / low, TOLERANCE).error
            axes.append(Axis.between(low, high, turned, largest_v, error))
        return cls(
            base=np.asarray(short.base) / unit,
            current=np.asarray(short.current) / unit,
            axes=tuple(axes),
            box=box,
            is_ordered=problem.bounds.pairs_are_alike,
        )

    def coefficient_box(
        self, places: Float[np.ndarray, "axes points"]
    ) -> tuple[Float[np.ndarray, "unknowns points"], Float[np.ndarray, "unknowns points"]]:
        """Least and greatest of what multiplies current and the axes' columns: R0, R1, ...

        Gamma's column counts once.
        """
        pairs = self.box.bounds.pairs
        ends = self.box.resistance_box(np.exp(places[:pairs]))
        once = np.ones((len(places) - pairs, places.shape[1]))
        low, high = (np.concatenate([end, once]) for end in ends)
        return low, high


@dataclass(frozen=True, eq=False)
class _Interpolated:
    """The product of the nodes' answers with Lagrange polynomials at exp(direction * place)."""

    nodes: Float[np.ndarray, "rows nodes"]
    basis: Lagrange
    direction: int

    def __call__(self, places: Float[np.ndarray, "points"]) -> Columns:
        basis = self.basis
        x = (self.direction * places - float(basis.center)) / float(basis.half_width)
        gaps = x[:, None] - np.asarray(basis.nodes)
        terms = np.asarray(basis.weights) / np.where(gaps == 0, np.finfo(float).tiny, gaps)
        return (terms / np.sum(terms, axis=1, keepdims=True)) @ self.nodes.T


def normal_equations(
    columns: Sequence[Columns], base: Columns
) -> tuple[Float[np.ndarray, "unknowns unknowns points"], Float[np.ndarray, "unknowns points"]]:
    """A'A and A'b of every point's least squares of b + A x."""
    normal = np.empty((len(columns), len(columns), len(base)))
    for i, left in enumerate(columns):
        for j, right in enumerate(columns[: i + 1]):
            normal[i, j] = normal[j, i] = dot(left, right)
    return normal, np.stack([dot(column, base) for column in columns])


def errors_of(
    columns: Sequence[Columns], base: Columns, coefficients: Float[np.ndarray, "unknowns points"]
) -> Columns:
    """b + A x of every point."""
    total = base.copy()
    for column, each in zip(columns, coefficients, strict=True):
        total += each[:, None] * column
    return total


def dot(left: Columns, right: Columns) -> Float[np.ndarray, "points"]:
    """The scalar product of every point's vectors."""
    return np.einsum("pr,pr->p", left, right)

"""The problem for given time constants: linear in the resistances, solved exactly in their box."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..cell import CircuitParameters
from ..cell.elements import RC, Element, get_element
from ..model.compressed import BLOCK, TOLERANCE, span_of_pairs
from ..model.exponentials import Lagrange, span_of
from ..model.prepared import PreparedRecord
from ..model.problem import Problem
from ..model.search_space import Bounds

Columns = Float[np.ndarray, "points rows"]


@dataclass(frozen=True, eq=False)
class Axis:
    """One of the coordinates in which the error is not linear: log of a tau in s, or of gamma.

    `columns` gives the unit responses at some places on it. `input_rms` bounds the RMS over all
    scored samples of what they respond to, a fixed time earlier, whichever that time; `error`
    bounds how wrong they are, in the unit of the columns.
    """

    low: float
    high: float
    columns: Callable[[Float[np.ndarray, "points"]], Columns]
    input_rms: float
    error: float


@dataclass(frozen=True, eq=False)
class Reduced:
    """The columns of one problem, scaled so that sums of squares are mean squares.

    The first `bounds.pairs` axes are the pairs', then gamma's where there is one.
    """

    base: Float[np.ndarray, "rows"]
    current: Float[np.ndarray, "rows"]
    axes: tuple[Axis, ...]
    bounds: Bounds

    @property
    def ordered(self) -> int:
        """How many of the first axes are of pairs with one box: only circuits with tau1 <= tau2
        and so on are in it."""
        return self.bounds.alike_pairs

    @classmethod
    def of(cls, problem: Problem) -> "Reduced":
        """The columns. Raises `InputError` where the box is too wide to compress."""
        short, bounds = problem.compressed, problem.bounds
        # In NumPy: JAX would compile a program for every slice of every shape.
        factor = np.asarray(short.factor) / np.sqrt(float(short.scored))
        count = len(short.in_tau.nodes)
        largest_a = max(float(np.max(np.abs(inputs.held_a))) for inputs in problem.all_inputs)
        nodes = factor[:, :count]
        held_a = earlier_rms(problem.prepared_records, lambda part: part.held_a[:, None])
        current_a = min(largest_a, float(held_a[0]))
        limits = problem.coordinates
        error = span_of_pairs(problem.all_inputs, limits).error
        axes = []
        for pair in range(bounds.pairs):
            low, high = map(math.log, bounds.tau_range_s(pair))
            responses = _Interpolated(nodes, short.in_tau, 1, get_element(bounds.elements[pair]))
            axes.append(Axis(low, high, responses, current_a, error * largest_a))
        if short.in_rate is not None and bounds.gamma_range is not None:
            low, high = bounds.gamma_range
            hysteresis = _Interpolated(factor[:, count:-2], short.in_rate, -1, RC)
            largest_v = max(
                float(np.max(np.abs(moved.amplitude_v)) * np.max(np.abs(moved.hysteresis_input)))
                for moved in (inputs.hysteresis for inputs in problem.all_inputs)
                if moved is not None
            )
            error = span_of(1 / high, 1 / low, TOLERANCE).error
            low, high = map(math.log, bounds.gamma_range)
            axes.append(Axis(low, high, hysteresis, largest_v, error * largest_v))
        return cls(factor[:, -1], factor[:, -2], tuple(axes), bounds)

    def coefficient_box(
        self, places: Float[np.ndarray, "axes points"]
    ) -> tuple[Float[np.ndarray, "unknowns points"], Float[np.ndarray, "unknowns points"]]:
        """Least and greatest of what multiplies current and the axes' columns: R0, R1, ...

        Gamma's column counts once.
        """
        pairs = self.bounds.pairs
        ends = self.bounds.resistance_box(np.exp(places[:pairs]))
        once = np.ones((len(places) - pairs, places.shape[1]))
        low, high = (np.concatenate([end, once]) for end in ends)
        return low, high

    def circuit(
        self, place: Float[np.ndarray, "axes"], coefficients: Float[np.ndarray, "unknowns"]
    ) -> CircuitParameters:
        """The circuit of a place on all axes and what multiplies the columns there."""
        pairs = self.bounds.pairs
        tau_s, gamma = np.exp(place[:pairs]).tolist(), np.exp(place[pairs:]).tolist()
        r0, *r = coefficients[: pairs + 1].tolist()
        rate = gamma[0] if gamma else None
        return CircuitParameters.of_tau(r0, r, tau_s, rate, self.bounds.elements)


@dataclass(frozen=True, eq=False)
class _Interpolated:
    """The product of the nodes' responses with Lagrange polynomials at exp(direction * place), for
    every RC pair of an element."""

    nodes: Float[np.ndarray, "rows nodes"]
    basis: Lagrange
    direction: int
    element: Element

    def __call__(self, places: Float[np.ndarray, "points"]) -> Columns:
        if self.element == RC:
            return self._pair(places)
        lowest = float(self.basis.center) - float(self.basis.half_width)
        pairs = zip(self.element.shares, self.element.ratios, strict=True)
        found = [
            share * self._pair(np.maximum(places + math.log(ratio), lowest))
            for share, ratio in pairs
        ]
        return sum(found[1:], found[0])

    def _pair(self, places: Float[np.ndarray, "points"]) -> Columns:
        basis = self.basis
        x = (self.direction * places - float(basis.center)) / float(basis.half_width)
        gaps = x[:, None] - np.asarray(basis.nodes)
        terms = np.asarray(basis.weights) / np.where(gaps == 0, np.finfo(float).tiny, gaps)
        return (terms / np.sum(terms, axis=1, keepdims=True)) @ self.nodes.T


def earlier_rms(
    prepared_records: Sequence[PreparedRecord],
    signals: Callable[[PreparedRecord], Float[np.ndarray, "samples signals"]],
) -> Float[np.ndarray, "signals"]:
    """Bounds on the RMS of signals, such as the current, some time before the scored samples.

    A signal is held from a sample to the next. An interval counts as often as samples can be that
    time after it: as many as any run of its length holds.
    """
    squares, scored = np.zeros(1), 0
    for prepared in prepared_records:
        scored_s = prepared.time_s if np.all(prepared.scored) else prepared.time_s[prepared.scored]
        most: dict[float, int] = {}
        for part in prepared.parts(BLOCK):
            # Few distinct lengths, none of them shortened.
            length_s = np.exp2(np.ceil(8 * np.log2(np.diff(part.time_s))) / 8)
            lengths_s, kind = np.unique(length_s, return_inverse=True)
            for each in lengths_s.tolist():
                if each not in most:
                    most[each] = _most_within(scored_s, each)
            counts = np.array([most[each] for each in lengths_s.tolist()])[kind]
            squares = squares + counts @ signals(part)[:-1] ** 2
        scored += len(scored_s)
    return np.sqrt(squares / scored)


def _most_within(time_s: Float[np.ndarray, "samples"], length_s: float) -> int:
    """How many samples a half-open run of that length holds at most."""
    return max(
        int(np.max(np.searchsorted(time_s, here + length_s) - first - np.arange(len(here))))
        for first in range(0, len(time_s), BLOCK)
        for here in [time_s[first : first + BLOCK]]
    )


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

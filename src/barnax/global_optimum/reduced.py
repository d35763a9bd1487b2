"""The problem for given time constants: linear in the resistances, solved exactly in their box."""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from ..cell import CircuitParameters
from ..cell.elements import RC, Element, get_element
from ..model.compressed import BLOCK, TOLERANCE, span_of_pairs
from ..model.exponentials import Lagrange, span_of
from ..model.prepared import PreparedRecord
from ..model.problem import Problem
from ..model.search_space import Bounds

# A column this dependent on those before it, relative to its own square, moves nothing.
RIDGE = 1e-13
# Guesses of which unknowns are at a bound; those few problems that still change are enumerated.
GUESSES = 10
# Active sets, over all problems, that are tried at once.
SETS_AT_ONCE = 4096

Unknowns = Float[np.ndarray, "unknowns problems"]


def least_in_box(
    normal: Float[np.ndarray, "unknowns unknowns problems"],
    gradient: Unknowns,
    low: Unknowns,
    high: Unknowns,
) -> Unknowns:
    """Each problem's x in [low, high] with the least x.(normal x) / 2 + gradient.x.

    `normal` is A'A and `gradient` A'b for the least squares of b + A x. Where low and high are
    one value, that is it. Active sets are guessed for all problems together, each from the signs
    of the last guess's multipliers (Hintermüller, Ito and Kunisch, SIAM J. Optim. 13 (2002)
    865); where that runs in circles all sets are tried. Columns that depend on others cost
    nothing but which of the equally good x is found.
    """
    scale = np.sqrt(np.einsum("iin->in", normal))
    scale = np.where(scale > 0, scale, 1.0)
    normal = normal / scale[:, None] / scale
    gradient, box = gradient / scale, (low, high)
    low, high = low * scale, high * scale
    given = [normal, gradient, low, high, low >= high]
    at_low = at_high = np.zeros(low.shape, bool)
    found, open_problems = low.copy(), np.arange(low.shape[1])
    for _ in range(GUESSES):
        h, g, least, most, pinned = given
        is_free = ~(at_low | at_high | pinned)
        x = _free_minimum(h, g, np.where(at_high, most, least), is_free)
        slope = g + _times(h, x)
        now_low = ((is_free & (x < least)) | (at_low & (slope >= 0))) & ~pinned
        now_high = ((is_free & (x > most)) | (at_high & (slope <= 0))) & ~pinned
        settled = np.all((now_low == at_low) & (now_high == at_high), axis=0)
        found[:, open_problems[settled]] = np.clip(x, least, most)[:, settled]
        if np.all(settled):
            break
        at_low, at_high = now_low[:, ~settled], now_high[:, ~settled]
        open_problems, *given = (each[..., ~settled] for each in (open_problems, *given))
    else:
        found[:, open_problems] = _enumerated(*given[:-1])
    return np.clip(found / scale, *box)


def _enumerated(normal, gradient: Unknowns, low: Unknowns, high: Unknowns) -> Unknowns:
    """The best of all active sets, each moved into the box."""
    sides = np.array([*itertools.product((-1, 0, 1), repeat=len(low))]).T[..., None]
    step, best = max(1, SETS_AT_ONCE // sides.shape[1]), low.copy()
    for first in range(0, low.shape[1], step):
        here = slice(first, first + step)
        h, g, least, most = (each[..., None, here] for each in (normal, gradient, low, high))
        x = _free_minimum(h, g, np.where(sides > 0, most, least), (sides == 0) & (least < most))
        x = np.clip(x, least, most)
        value = np.sum(x * (2 * g + _times(h, x)), axis=0)
        lowest = np.argmin(np.where(np.isnan(value), np.inf, value), axis=0)
        best[:, here] = np.take_along_axis(x, lowest[None, None], axis=1)[:, 0]
    return best


def _free_minimum(
    normal,
    gradient: Float[np.ndarray, "unknowns *problems"],
    x: Float[np.ndarray, "unknowns *sets"],
    is_free: Bool[np.ndarray, "unknowns *sets"],
) -> Float[np.ndarray, "unknowns *sets"]:
    """x with its free entries where the slope vanishes, by an L D L' factorization.

    The diagonal of `normal` is one.
    """
    count = len(x)
    target = -(gradient + _times(normal, np.where(is_free, 0.0, x)))
    coupled = np.where(is_free[:, None] & is_free, normal, 0.0)
    factor = {}
    pivots, forward = [], []
    for i in range(count):
        for j in range(i):
            value = coupled[i, j]
            for k in range(j):
                value = value - factor[i, k] * factor[j, k] * pivots[k]
            factor[i, j] = value / pivots[j]
        # Of an unknown that is not free, nothing here reaches the others.
        pivot = 1.0 + RIDGE - sum(factor[i, k] ** 2 * pivots[k] for k in range(i))
        pivots.append(np.maximum(pivot, RIDGE))
        forward.append(target[i] - sum(factor[i, k] * forward[k] for k in range(i)))
    solved = [np.empty(0)] * count
    for i in reversed(range(count)):
        below = sum(factor[k, i] * solved[k] for k in range(i + 1, count))
        solved[i] = forward[i] / pivots[i] - below
    return np.where(is_free, np.stack(solved), x)


def _times(normal, x: Float[np.ndarray, "unknowns *sets"]) -> Float[np.ndarray, "unknowns *sets"]:
    # In a fixed order of summation, however many problems there are.
    total: Any = sum(normal[:, j] * x[j] for j in range(len(x)))
    return total


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

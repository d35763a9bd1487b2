"""Variable projection: an outer search over time constants, an exact one over resistances."""

import itertools

import numpy as np
from jaxtyping import Float
from scipy.ndimage import minimum_filter
from scipy.optimize import least_squares

from ..cell import CircuitParameters
from ..evaluate import evaluate_course
from ..problem import Problem
from .answer import Answer
from .method import Budget, Method, Progress
from .separable import Separable, bounded_least_squares, triangular_factor

# Grid points a time constant, by the number of pairs, and grid points of the hysteresis' rate.
TAUS = {1: 48, 2: 24, 3: 14, 4: 11}
GAMMAS = 8
# Of the grid points that are better than all around them, this many are polished.
POLISHED = 4
TOLERANCE = 1e-12

Point = Float[np.ndarray, "outer"]


def variable_projection(problem: Problem, budget: Budget, progress: Progress) -> list[Answer]:
    """The best circuit of a search over ln tau alone (Golub and Pereyra, SIAM J. Numer. Anal. 10
    (1973) 413).

    At each set of time constants the resistances are the exact optimum of a bounded linear
    least-squares problem. The outer search is a grid over the ordered time constants, evenly
    spaced in ln tau, whose best local minima SciPy's trust-region least squares then polishes
    with finite differences; a dynamic hysteresis adds ln gamma to the search. It draws nothing.
    One evaluation is one pair's answer on the grid, and one residual in the polish.
    """
    del budget
    search = OuterSearch(problem)
    ends = [search.polish(start) for start in search.grid_minima()]
    best = min(ends, key=lambda point: np.linalg.norm(search.residual(point)))
    parameters = search.circuit(best)
    progress(1)
    return [
        Answer(
            parameters=parameters,
            rmse_v=evaluate_course(problem.course, parameters).metrics.rmse_v,
            evaluations=search.evaluations,
        )
    ]


class OuterSearch:
    """The search over points (ln tau1, ln tau2, ..., ln gamma); counts its evaluations."""

    def __init__(self, problem: Problem):
        self.separable = Separable.of(problem)
        self.pairs = problem.bounds.pairs
        self.is_ordered = problem.bounds.pairs_are_alike
        ranges = [self.separable.box.tau_range_s(pair) for pair in range(self.pairs)]
        if self.separable.box.gamma_range is not None:
            ranges.append(self.separable.box.gamma_range)
        self.low, self.high = np.log(ranges).T
        self.evaluations = 0

    def residual(self, point: Point) -> Float[np.ndarray, "samples"]:
        """The error with the best resistances there; its sum of squares is the RMSE squared."""
        columns, base, values = self._solve(point)
        return base + columns @ values

    def circuit(self, point: Point) -> CircuitParameters:
        """The circuit of a point and the best resistances there."""
        _, _, (r0, *r) = self._solve(point)
        tau_s = np.exp(point[: self.pairs])
        gamma = float(np.exp(point[-1])) if len(point) > self.pairs else None
        c = tuple(float(tau / each) for each, tau in zip(r, tau_s, strict=True))
        found = CircuitParameters(float(r0), tuple(float(each) for each in r), c, gamma)
        return found.ordered() if self.is_ordered else found

    def grid_minima(self) -> list[Point]:
        """The best grid points that are better than all around them."""
        axes = [self._axis(index) for index in range(len(self.low))]
        taus, gammas = axes[: self.pairs], axes[self.pairs :]
        columns, bases, starts = self._signals(taus, gammas)
        # All grid points share one triangular factor, a few hundred numbers.
        factor = triangular_factor(np.concatenate([columns, bases], axis=1))
        errors = np.full([len(axis) for axis in axes], np.inf)
        for place in itertools.product(*(range(len(axis)) for axis in taus)):
            # Two pairs of one time constant are one pair.
            if self.is_ordered and any(b <= a for a, b in itertools.pairwise(place)):
                continue
            chosen = [0, *(start + index for start, index in zip(starts, place, strict=True))]
            box = self.separable.box.resistance_box(
                np.exp([axis[index] for axis, index in zip(taus, place, strict=True)])
            )
            for number in range(bases.shape[1]):
                base = factor[:, columns.shape[1] + number]
                values = bounded_least_squares(factor[:, chosen], base, *box)
                error = np.linalg.norm(base + factor[:, chosen] @ values)
                errors[(*place, *([number] * len(gammas)))] = error
        is_minimum = np.isfinite(errors) & (minimum_filter(errors, 3) == errors)
        places = sorted(np.argwhere(is_minimum).tolist(), key=lambda place: errors[tuple(place)])
        return [
            np.array([axis[index] for axis, index in zip(axes, place, strict=True)])
            for place in places[:POLISHED]
        ]

    def polish(self, start: Point) -> Point:
        """The local minimum near a point, inside the box."""
        is_free = self.high > self.low
        if not np.any(is_free):
            return start

        def at(free: np.ndarray) -> Point:
            point = start.copy()
            point[is_free] = free
            return point

        unit_v = max(float(np.linalg.norm(self.residual(start))), TOLERANCE)
        low, high = self.low[is_free], self.high[is_free]
        end = least_squares(
            lambda free: self.residual(at(free)) / unit_v,
            np.clip(start[is_free], low, high),
            bounds=(low, high),
            xtol=TOLERANCE,
            ftol=TOLERANCE,
            gtol=TOLERANCE,
            max_nfev=100,
        )
        return at(end.x)

    def _axis(self, index: int) -> np.ndarray:
        size = TAUS[self.pairs] if index < self.pairs else GAMMAS
        low, high = self.low[index], self.high[index]
        return np.linspace(low, high, size) if high > low else np.array([low])

    def _signals(self, taus: list[np.ndarray], gammas: list[np.ndarray]):
        """Columns (current, then all pairs' answers), bases, and where each pair's answers begin.

        Pairs that are alike share their answers.
        """
        own = taus[:1] if self.is_ordered else taus
        begin = np.cumsum([1, *(len(axis) for axis in own)])
        starts = [1] * self.pairs if self.is_ordered else begin[:-1].tolist()
        answers = self.separable.answers(np.exp(np.concatenate(own)))
        bases = self.separable.bases(np.exp(gammas[0]) if gammas else None)
        self.evaluations += answers.shape[1] + (bases.shape[1] if gammas else 0)
        columns = np.concatenate([self.separable.current[:, None], answers], axis=1)
        return columns, bases, starts

    def _solve(self, point: Point) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Columns, base and the best resistances at a point."""
        self.evaluations += 1
        tau_s, gamma = np.exp(point[: self.pairs]), np.exp(point[self.pairs :])
        answers = self.separable.answers(tau_s)
        columns = np.concatenate([self.separable.current[:, None], answers], axis=1)
        base = self.separable.bases(gamma if len(gamma) else None)[:, 0]
        box = self.separable.box.resistance_box(tau_s)
        return columns, base, bounded_least_squares(columns, base, *box)


VARPRO = Method(
    "varpro",
    "Variable projection (Golub and Pereyra, 1973), bounded resistances, polished grid in tau",
    is_deterministic=True,
    run=variable_projection,
)

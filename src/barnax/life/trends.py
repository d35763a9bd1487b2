"""Smooth trends of many cells over age, pooled over the fleet, and the cells that depart from them.

The estimates y of a quantity of cell c at ages t, with stated variances v, are

    y = X beta + z_c(t) + e,    z_c = a_c + b_c t + w_c(t),    e ~ N(0, k^2 v + s^2),

X beta is the fleet's shape: a line, an integrated Wiener process, the effect of a covariate, and
that of common errors of the estimates; a cell's own level, slope and integrated Wiener process have
variances shared by all cells. Any of these alone is a cubic smoothing spline (Wahba 1978). The
standard deviations maximize the restricted likelihood (Patterson and Thompson 1971), in which beta
is integrated out in closed form: with V_c the covariance of a cell and A = sum X'V^-1 X + P,

    -2 log L = sum log|V_c| + log|A| - log|P| + y'V^-1 y - b'A^-1 b,    b = sum X'V^-1 y.

A shape h that a fault would add to a cell is judged by its score z = h'Q y / sqrt(h'Q h) with Q =
V^-1 - V^-1 X A^-1 X'V^-1, which is normal without a fault.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize
from scipy.special import ndtr, stdtrit

# Knots of the fleet's shape, spread over all ages.
KNOTS = 8
# Ages at a hinge or step need this many others on either side.
ASIDE = 2
# Estimates scatter by at least this share of their stated errors, which are conservative, for
# example because charges end full more evenly than assumed.
LEAST_SHARE = 0.5
# The size of a fault has a prior of this many times its estimate.
FREE = 3.0
DRAWS, MOST_SIMULATED = 4000, 300
ROUNDS = 8
# The share of cells with the smallest departures, from which the spread is first estimated.
KEPT = 0.7

Cells = Float[np.ndarray, "cells n"]


@dataclass(frozen=True)
class Series:
    """A quantity of many cells: ages as shares of the longest, estimates, their variances and a
    covariate, padded to one length, with estimates where `is_estimate`. In addition to the error
    with that variance, an estimate has errors shared with all cells, and errors shared within its
    cell: the effect of one standard deviation of each."""

    age: Cells
    value: Cells
    variance: Cells
    is_estimate: Bool[np.ndarray, "cells n"]
    covariate: Cells
    of_fleet: Float[np.ndarray, "cells n errors"]
    of_cell: Float[np.ndarray, "cells n cell_errors"]

    def only(self, cells: Bool[np.ndarray, "cells"]) -> "Series":
        """A subset of the cells."""
        return Series(*(values[cells] for values in vars(self).values()))


@dataclass(frozen=True)
class Spread:
    """Standard deviations: of cells' levels, slopes and bends, of the fleet's bend, and of an
    additional error of each estimate; and the share of its stated error that applies."""

    level: float
    slope: float
    bend: float
    fleet_bend: float
    scatter: float
    share: float = 1.0


@dataclass(frozen=True)
class Shape:
    """The addition of a fault to a cell from an age on, a `level`, `slope`, `knee` or `step`: its
    estimated size, and that size in standard deviations."""

    kind: str
    age: float
    size: float
    deviations: float

    def at(self, age: np.ndarray) -> np.ndarray:
        """The shape for a size of one."""
        return _shape(self.kind, self.age, age)


def _shape(kind: str, start: float, age: np.ndarray) -> np.ndarray:
    later = np.maximum(age - start, 0.0)
    columns = {"level": np.ones_like(age), "slope": age, "knee": later}
    return columns[kind] if kind in columns else (age > start) * 1.0


def wiener(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """The covariance of an integrated Wiener process, at rest at zero, between ages.

    >>> float(wiener(np.array([1.0]), np.array([2.0]))[0, 0].round(4))
    0.8333
    """
    one, other = one[..., None], other[..., None, :]
    low, high = np.minimum(one, other), np.maximum(one, other)
    return low**2 * (3 * high - low) / 6


@dataclass(frozen=True)
class Fit:
    """A fleet's model at given standard deviations: its shape is that of the cells that are `good`;
    `added` are shapes of single cells."""

    series: Series
    spread: Spread
    good: Bool[np.ndarray, "cells"]
    added: tuple[tuple[int, Shape], ...] = ()

    def cell_covariance(self, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """The covariance of a cell's own part, between its ages."""
        its = self.spread
        line = its.level**2 + its.slope**2 * one[..., None] * other[..., None, :]
        return line + its.bend**2 * wiener(one, other)

    def _covariance_of(self, cell: int, one: np.ndarray, other: np.ndarray) -> np.ndarray:
        """The covariance for one cell, with its own added shape."""
        covariance = self.cell_covariance(one, other)
        if (shape := dict(self.added).get(cell)) is not None:
            here = np.multiply.outer(shape.at(one), shape.at(other))
            # A departure from the fleet bends like no good cell does.
            covariance += shape.size**2 * (FREE**2 * here + wiener(one, other))
        return covariance

    def columns(self, age: np.ndarray, covariate: np.ndarray, shared: np.ndarray) -> np.ndarray:
        """X, whose first columns are free, while the others have unit priors."""
        knots = np.linspace(0.0, 1.0, KNOTS + 1)[1:]
        bent = np.linalg.solve(np.linalg.cholesky(wiener(knots, knots)), wiener(knots, age.ravel()))
        bent = self.spread.fleet_bend * np.moveaxis(bent.reshape(KNOTS, *age.shape), 0, -1)
        free = [np.ones_like(age), age]
        if self.has_covariate:
            free.append(covariate)
        return np.concatenate([np.stack(free, axis=-1), shared, bent], axis=-1)

    @cached_property
    def has_covariate(self) -> bool:
        covariate = self.series.covariate[self.series.is_estimate]
        return bool(np.ptp(covariate) > 0) if covariate.size else False

    @cached_property
    def root(self) -> np.ndarray:
        """The Cholesky factor of every cell's covariance; padding is separate."""
        its = self.series
        both = its.is_estimate[:, :, None] & its.is_estimate[:, None, :]
        covariance = self.cell_covariance(its.age, its.age)
        for cell, _ in self.added:
            covariance[cell] = self._covariance_of(cell, its.age[cell], its.age[cell])
        masked = np.where(both, covariance + its.of_cell @ its.of_cell.mT, 0.0)
        variance = self.spread.share**2 * its.variance + self.spread.scatter**2
        noise = np.where(its.is_estimate, variance, 1.0)
        return np.linalg.cholesky(masked + noise[:, :, None] * np.eye(its.age.shape[1]))

    @cached_property
    def white(self) -> tuple[np.ndarray, np.ndarray]:
        """X and y in units of the noise."""
        its = self.series
        columns = self.columns(its.age, its.covariate, its.of_fleet) * its.is_estimate[:, :, None]
        value = np.where(its.is_estimate, its.value, 0.0)[:, :, None]
        return np.linalg.solve(self.root, columns), np.linalg.solve(self.root, value)[:, :, 0]

    @cached_property
    def sums(self) -> tuple[np.ndarray, np.ndarray]:
        """A and b of the fleet."""
        columns, value = (part[self.good] for part in self.white)
        is_free = np.arange(columns.shape[2]) < 2 + self.has_covariate
        normal = np.einsum("cni,cnj->ij", columns, columns) + np.diag(~is_free * 1.0)
        return normal, np.einsum("cni,cn->i", columns, value)

    def fleet_with(self, cell: int) -> tuple[np.ndarray, np.ndarray]:
        """A^-1 and beta, from the other cells and a cell's own estimates."""
        normal, right = self.sums
        if not self.good[cell]:
            columns, value = (part[cell] for part in self.white)
            normal, right = normal + columns.T @ columns, right + columns.T @ value
        inverse = np.linalg.inv(normal)
        return inverse, inverse @ right

    @property
    def minus_two_log_likelihood(self) -> float:
        """The restricted likelihood, up to a constant."""
        normal, right = self.sums
        logarithms = 2 * np.sum(np.log(np.diagonal(self.root, axis1=1, axis2=2)))
        constant = np.linalg.slogdet(normal)[1] + logarithms + np.sum(self.white[1] ** 2)
        return float(constant - right @ np.linalg.solve(normal, right))

    def covariate_part(self, cell: int) -> np.ndarray:
        """The covariate's part of each of a cell's estimates."""
        is_estimate = self.series.is_estimate[cell]
        if not self.has_covariate:
            return np.zeros(np.count_nonzero(is_estimate))
        return self.fleet_with(cell)[1][2] * self.series.covariate[cell][is_estimate]

    def trend(self, cell: int, age: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A cell's trend at some ages, without the effects of the covariate and of common errors,
        and its standard errors."""
        its, is_estimate = self.series, self.series.is_estimate[cell]
        root = self.root[cell][np.ix_(is_estimate, is_estimate)]
        columns, value = (part[cell][is_estimate] for part in self.white)
        link = np.linalg.solve(root, self._covariance_of(cell, its.age[cell][is_estimate], age))
        here = self.columns(age, np.zeros_like(age), np.zeros((len(age), its.of_fleet.shape[2])))
        rest = here - link.T @ columns
        inverse, beta = self.fleet_with(cell)
        mean = here @ beta + link.T @ (value - columns @ beta)
        prior = np.diagonal(self._covariance_of(cell, age, age))
        variance = prior - np.sum(link**2, axis=0)
        variance = variance + np.einsum("ai,ij,aj->a", rest, inverse, rest)
        return mean, np.sqrt(np.maximum(variance, 0.0))

    def scores(self, cell: int) -> tuple[list[Shape], np.ndarray]:
        """The addition of every possible fault to a cell, and the correlation of their scores."""
        its, is_estimate = self.series, self.series.is_estimate[cell]
        age = its.age[cell][is_estimate]
        inner = range(ASIDE, len(age) - ASIDE)
        asked = [("level", 0.0), ("slope", 0.0)] if len(age) > 1 else []
        asked += [("knee", float(age[index])) for index in inner]
        between = range(ASIDE, len(age) - ASIDE + 1)
        asked += [("step", float(age[index - 1 : index + 1].mean())) for index in between]
        if not asked:
            return [], np.empty((0, 0))
        root = self.root[cell][np.ix_(is_estimate, is_estimate)]
        columns, value = (part[cell][is_estimate] for part in self.white)
        shapes = np.linalg.solve(root, np.stack([_shape(*fault, age) for fault in asked], axis=1))
        seen = shapes.T @ columns
        inverse, beta = self.fleet_with(cell)
        information = shapes.T @ shapes - seen @ inverse @ seen.T
        pushes = shapes.T @ (value - columns @ beta)
        strength = np.sqrt(np.maximum(np.diag(information), 1e-12))
        additions = [
            Shape(*fault, float(push / by**2), float(push / by))
            for fault, push, by in zip(asked, pushes, strength, strict=True)
        ]
        return additions, information / np.outer(strength, strength)


def fit(series: Series) -> Fit:
    """The model that maximizes the restricted likelihood."""
    is_estimate = series.is_estimate
    scale = float(np.std(series.value[is_estimate])) or 1.0
    typical = float(np.sqrt(np.median(series.variance[is_estimate])))
    lowest = np.log(1e-3 * min(scale, typical) if typical else 1e-6 * scale)

    def at(logarithms: np.ndarray) -> Fit:
        return Fit(series, Spread(*np.exp(logarithms).tolist()), np.ones(len(is_estimate), bool))

    start = [0.5 * scale, 0.3 * scale, 0.1 * scale, scale, max(0.5 * typical, 1e-3 * scale), 0.9]
    best = minimize(
        lambda logarithms: at(logarithms).minus_two_log_likelihood,
        np.log(start),
        method="L-BFGS-B",
        bounds=[*[(lowest, np.log(100 * scale))] * 5, (np.log(LEAST_SHARE), 0.0)],
    )
    return at(best.x)


@dataclass(frozen=True)
class Judged:
    """A fleet's model without its faults, the worst shape of every cell, and the threshold above
    which a cell is flagged."""

    fit: Fit
    worst: tuple[Shape | None, ...]
    threshold: float

    @property
    def faults(self) -> dict[int, Shape]:
        """The faults by cell."""
        return {
            cell: shape for cell, shape in enumerate(self.worst)
            if shape is not None and _deviations(shape) > self.threshold
        }  # fmt: skip


def judge(series: Series, expected: float, rng: np.random.Generator) -> Judged:
    """The fleet without the cells that depart from it, which are identified iteratively.

    Args:
        series: The estimates.
        expected: Expected number of flagged cells in a fleet without faults.
        rng: Generator for such fleets.
    """
    everyone, of_all = np.ones(len(series.age), bool), fit(series)
    model = of_all
    judged = Judged(of_all, (), np.inf)
    # Many faults hide each other by inflating the variances.
    scores = map(of_all.scores, range(len(everyone)))
    odds = [max(map(_deviations, shapes), default=0.0) for shapes, _ in scores]
    good = np.array(odds) <= np.quantile(odds, KEPT) if expected > 0 else everyone
    for _ in range(ROUNDS):
        model = of_all if good.all() else Fit(series, fit(series.only(good)).spread, good)
        scores = [model.scores(cell) for cell in range(len(good))]
        correlations = [correlation for _, correlation in scores]
        threshold = _threshold(correlations, int(good.sum()), expected, rng)
        worst = [max(shapes, key=_deviations, default=None) for shapes, _ in scores]
        judged = Judged(model, tuple(worst), threshold)
        now = np.array([cell not in judged.faults for cell in range(len(good))])
        if np.array_equal(now, good) or np.count_nonzero(now) < len(good) / 2:
            break
        good = now
    return replace(judged, fit=replace(model, added=tuple(judged.faults.items())))


def _deviations(shape: Shape) -> float:
    return abs(shape.deviations)


def _threshold(
    correlations: Sequence[np.ndarray], fitted: int, expected: float, rng: np.random.Generator
) -> float:
    """The score that `expected` cells of such a fleet exceed on average without any fault, with
    variances estimated from the `fitted` cells."""
    judged = [matrix for matrix in correlations if len(matrix)]
    if not judged or expected <= 0:
        return np.inf
    drawn = judged
    if len(judged) > MOST_SIMULATED:
        drawn = [judged[index] for index in rng.choice(len(judged), MOST_SIMULATED, replace=False)]
    largest = []
    for matrix in drawn:
        values, vectors = np.linalg.eigh(matrix)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        largest.append(np.max(np.abs(rng.standard_normal((DRAWS, len(matrix))) @ root.T), axis=1))
    normal = np.quantile(np.concatenate(largest), 1 - min(1.0, expected / len(judged)))
    # The number of cells limits the accuracy of their spread.
    return float(-stdtrit(max(fitted - 1, 1), ndtr(-normal)))

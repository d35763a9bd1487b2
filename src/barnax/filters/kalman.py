"""Extended and unscented Kalman filters over a whole record as one `lax.scan`, and their tests.

Parameters are known, joint (further states of the one filter) or dual (a filter of their own
beside that of the states). All of it is written for one cell; callers vmap it over cells or
tunings. `cuthbert` (0.1.1) has both filters as scans, but takes Numba and LLVM along, has no dual
form, and wants the model as log densities; what a filter of one measured voltage needs is shorter
than its use would be.

Sources: Plett, J. Power Sources 134 (2004) 262-292 (extended, joint and dual) and 161 (2006)
1369-1384 (sigma points); Julier and Uhlmann (1997) for the unscented transform, with kappa = 1,
which keeps all weights positive.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Scalar
from scipy.special import chdtrc
from scipy.stats import chi2

from .model import Drive, Estimate, FilterModel

Kind = Literal["ekf", "ukf"]
Form = Literal["joint", "dual"]
Vector = Float[Array, "states"]
Matrix = Float[Array, "states states"]
KAPPA = 1.0


class Gaussian(NamedTuple):
    """Mean and covariance."""

    mean: Vector
    covariance: Matrix


class Observation(NamedTuple):
    """A predicted voltage, its variance without that of the measurement, and its covariances."""

    voltage_v: Scalar
    variance_v2: Scalar
    with_state: Vector


def run_filter(
    model: FilterModel,
    start: tuple[Vector, Vector],
    drive: Drive,
    kind: Kind = "ekf",
    form: Form = "joint",
    adapting: float = 0.0,
) -> Estimate:
    """A filter's estimates along a record, from a state and its variances (`FilterModel.start`).

    In the dual form the measurement noise may adapt: `adapting` is the share of it that a sample
    renews, from its residual (Mohamed and Schwarz, J. Geodesy 73 (1999) 193).
    """
    mean, variance = start
    slow = jnp.zeros_like(model.slow_sd)
    if form == "dual" and model.slow:
        beliefs = (
            Gaussian(mean, jnp.diag(variance)),
            Gaussian(slow, jnp.diag(model.slow_sd**2)),
        )
        sensitivity = jnp.zeros((len(mean), len(slow)))
        step = _dual_step(model, kind, adapting)
        rows = lax.scan(step, (beliefs, sensitivity, jnp.ones_like(mean[0])), drive)[1]
        return _estimate(rows, len(slow))
    return _joint(model, start, drive, kind)


def _estimate(rows: Float[Array, "samples kept"], count: int) -> Estimate:
    deviations = jnp.sqrt(rows[:, 2 + count :])
    return Estimate(
        *(rows[:, 0], deviations[:, 0], rows[:, 2 : 2 + count], deviations[:, 1:-1]),
        *(rows[:, 1], deviations[:, -1]),
    )


def _row(belief: Gaussian, slow: Gaussian, innovation_v: Scalar, variance_v2: Scalar) -> Vector:
    """All that is kept of a sample in one array: each further one costs as much as a product."""
    return jnp.concatenate(
        [
            *(belief.mean[:1], innovation_v[None], slow.mean),
            *(belief.covariance[0, :1], jnp.diag(slow.covariance), variance_v2[None]),
        ]
    )


def _joint(model: FilterModel, start: tuple[Vector, Vector], drive: Drive, kind: Kind) -> Estimate:
    mean, variance = start
    belief = Gaussian(
        jnp.concatenate([mean, jnp.zeros_like(model.slow_sd)]),
        jnp.diag(jnp.concatenate([variance, model.slow_sd**2])),
    )
    return _estimate(lax.scan(_joint_step(model, kind), belief, drive)[1], len(model.slow_sd))


def _joint_step(model: FilterModel, kind: Kind):
    """One sample of a filter whose state holds the slow parameters too."""
    count = model.states
    is_extended = kind == "ekf"
    predict = _predict_extended if is_extended else _predict_unscented
    observe = _observe_extended if is_extended else _observe_unscented

    def step(belief: Gaussian, drive: Drive) -> tuple[Gaussian, Vector]:
        def advance(both):
            moved = model.advance(both[:count], both[count:], drive)
            return jnp.concatenate([moved, both[count:]])

        def voltage(both):
            return model.voltage(both[:count], both[count:], drive)

        walk = jnp.concatenate(model.walk(belief.mean[count:], drive.interval_s))
        belief = predict(advance, belief, walk)
        observed = observe(voltage, belief)
        innovation_v = drive.voltage_v - observed.voltage_v
        variance_v2 = observed.variance_v2 + model.noise_v2(belief.mean[0])
        belief = _correct(belief, observed.with_state, innovation_v, variance_v2)
        slow = Gaussian(belief.mean[count:], belief.covariance[count:, count:])
        return belief, _row(belief, slow, innovation_v, variance_v2)

    return step


def _dual_step(model: FilterModel, kind: Kind, adapting: float):
    """One sample of two filters, each taking the other's mean for known.

    The innovation's variance is that of the state filter for both. The extended parameter filter
    follows how the state's estimate depends on the parameters (Plett 2004, part 3); the unscented
    one looks one interval ahead, and so hardly sees what moves SOC over hours: an offset, a
    capacity.
    """

    def step(carry, drive: Drive):
        (belief, slow), sensitivity, scale = carry
        before = belief.mean
        state_walk, slow_walk = model.walk(slow.mean, drive.interval_s)
        slow = slow._replace(covariance=slow.covariance + jnp.diag(slow_walk))

        def advance(state):
            return model.advance(state, slow.mean, drive)

        def voltage(state):
            return model.voltage(state, slow.mean, drive)

        if kind == "ekf":
            belief = _predict_extended(advance, belief, state_walk)
            observed = _observe_extended(voltage, belief)
            by_slow = jax.jacfwd(model.advance, 1)(before, slow.mean, drive)
            sensitivity = by_slow + jax.jacfwd(advance)(before) @ sensitivity
            total = jax.grad(model.voltage, 1)(belief.mean, slow.mean, drive)
            total = total + jax.grad(voltage)(belief.mean) @ sensitivity
            covaried = slow.covariance @ total
            slow_observed = Observation(observed.voltage_v, total @ covaried, covaried)
        else:
            belief = _predict_unscented(advance, belief, state_walk)
            observed = _observe_unscented(voltage, belief)
            total = jnp.zeros_like(slow.mean)
            slow_observed = _observe_unscented(
                lambda other: model.voltage(model.advance(before, other, drive), other, drive), slow
            )
        innovation_v = drive.voltage_v - observed.voltage_v
        fitted_v2 = model.noise_v2(belief.mean[0])
        noise_v2 = scale * fitted_v2
        variance_v2 = observed.variance_v2 + noise_v2
        gain = observed.with_state / variance_v2
        belief = _correct(belief, observed.with_state, innovation_v, variance_v2)
        sensitivity = sensitivity - jnp.outer(gain, total)
        slow = _correct(
            slow,
            slow_observed.with_state,
            drive.voltage_v - slow_observed.voltage_v,
            slow_observed.variance_v2 + variance_v2,
        )
        row = _row(belief, slow, innovation_v, variance_v2)
        if adapting:
            residual_v = drive.voltage_v - voltage(belief.mean)
            left_v2 = observed.variance_v2 * noise_v2 / variance_v2
            scale = scale + adapting * ((residual_v**2 + left_v2) / fitted_v2 - scale)
        return ((belief, slow), sensitivity, scale), row

    return step


def _correct(
    belief: Gaussian, with_state: Vector, innovation_v: Scalar, variance_v2: Scalar
) -> Gaussian:
    """The belief after a measurement; equal factors keep the covariance symmetric."""
    gain = with_state / variance_v2
    return Gaussian(
        belief.mean + gain * innovation_v,
        belief.covariance - with_state[:, None] * with_state[None, :] / variance_v2,
    )


def _predict_extended(
    advance: Callable[[Vector], Vector], belief: Gaussian, walk: Vector
) -> Gaussian:
    slope, mean = jax.jacfwd(lambda state: (advance(state),) * 2, has_aux=True)(belief.mean)
    # Sums of products compile into one kernel with what is around them; products of such small
    # matrices are a kernel each, and the filter takes half as long again.
    half = jnp.sum(slope[:, :, None] * belief.covariance, axis=1)
    moved = jnp.sum(half[:, None, :] * slope, axis=2)
    return Gaussian(mean, moved + jnp.diag(walk))


def _observe_extended(voltage: Callable[[Vector], Scalar], belief: Gaussian) -> Observation:
    voltage_v, slope = jax.value_and_grad(voltage)(belief.mean)
    with_state = jnp.sum(belief.covariance * slope, axis=1)
    return Observation(voltage_v, jnp.sum(slope * with_state), with_state)


def _predict_unscented(
    advance: Callable[[Vector], Vector], belief: Gaussian, walk: Vector
) -> Gaussian:
    points, weights = _sigma_points(belief)
    moved = jax.vmap(advance)(points)
    mean = jnp.sum(weights[:, None] * moved, axis=0)
    away = moved - mean
    spread = jnp.sum((weights[:, None] * away)[:, :, None] * away[:, None, :], axis=0)
    return Gaussian(mean, spread + jnp.diag(walk))


def _observe_unscented(voltage: Callable[[Vector], Scalar], belief: Gaussian) -> Observation:
    points, weights = _sigma_points(belief)
    voltages_v = jax.vmap(voltage)(points)
    voltage_v = jnp.sum(weights * voltages_v)
    away_v = weights * (voltages_v - voltage_v)
    with_state = jnp.sum(away_v[:, None] * (points - belief.mean), axis=0)
    return Observation(voltage_v, jnp.sum(away_v * (voltages_v - voltage_v)), with_state)


def _sigma_points(belief: Gaussian) -> tuple[Float[Array, "points states"], Float[Array, "points"]]:
    """The mean, and points a scaled deviation to either side along every axis of the covariance."""
    count = len(belief.mean)
    steps = jnp.sqrt(count + KAPPA) * _root(belief.covariance).T
    points = jnp.concatenate([belief.mean[None], belief.mean + steps, belief.mean - steps])
    weights = jnp.full(2 * count + 1, 0.5 / (count + KAPPA)).at[0].set(KAPPA / (count + KAPPA))
    return points, weights


def _root(covariance: Matrix) -> Matrix:
    """The Cholesky factor, column by column: LAPACK's refuses what is known exactly (variance 0)
    and, called for every sample, takes longer than the filter."""
    columns: list[Vector] = []
    left = covariance
    for index in range(len(covariance)):
        pivot = left[index, index]
        is_known = pivot <= 0
        safe = jnp.where(is_known, 1.0, pivot)
        column = jnp.where(is_known, 0.0, left[:, index] / jnp.sqrt(safe))
        columns.append(column)
        left = left - column[:, None] * column[None, :]
    return jnp.stack(columns, axis=1)


LAGS = 20
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Innovations:
    """Innovations over their expected deviation, against white noise of variance one.

    `first_lag` is their autocorrelation from one sample to the next; that of white noise stays
    within `bound`. `p_value` is that of Ljung and Box's statistic (1978) over `lags` lags: below
    0.05 they are not white. `mean_square` is the mean normalised innovation squared, whose 95 %
    interval is `mean_square_bounds` where the filter's deviations are right.
    """

    samples: int
    first_lag: float
    bound: float
    lags: int
    p_value: float
    mean_square: float
    mean_square_bounds: tuple[float, float]

    @property
    def are_white(self) -> bool:
        return self.p_value >= 1 - CONFIDENCE


def examine_innovations(normalised: Float[np.ndarray, "samples"]) -> Innovations:
    """Both tests on innovations divided by their expected deviations.

    Over `LAGS` lags, or as many as half of a shorter record has.

    >>> found = examine_innovations(np.random.default_rng(0).normal(size=1000))
    >>> found.are_white, found.mean_square_bounds[0] < found.mean_square
    (True, True)
    """
    count = len(normalised)
    around = normalised - normalised.mean()
    power = float(around @ around)
    lags = np.arange(1, min(LAGS, count // 2) + 1)
    correlation = np.array([around[lag:] @ around[:-lag] for lag in lags]) / (power or 1.0)
    statistic = count * (count + 2) * float(np.sum(correlation**2 / (count - lags)))
    low, high = mean_bounds(count)
    return Innovations(
        samples=count,
        first_lag=float(correlation[0]),
        bound=float(np.sqrt(chi2.ppf(CONFIDENCE, 1) / count)),
        lags=len(lags),
        p_value=float(chdtrc(len(lags), statistic)),
        mean_square=float(np.mean(normalised**2)),
        mean_square_bounds=(low, high),
    )


def mean_bounds(count: int, degrees: int = 1) -> tuple[float, float]:
    """The 95 % interval of the mean of so many chi-square values of so many degrees of freedom.

    Bar-Shalom, Li and Kirubarajan (2001), section 5.4: the test of estimation errors over
    Monte-Carlo runs, and of innovations over time.

    >>> [round(bound, 2) for bound in mean_bounds(100)]
    [0.74, 1.3]
    """
    low, high = chi2.ppf([(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], degrees * count) / count
    return float(low), float(high)

"""Kalman filters over a whole record as one `lax.scan`.

A Gaussian sum (Alspach and Sorenson, IEEE Trans. Automatic Control 17 (1972) 439) is the default:
extended filters side by side from SOC around the initial estimate, each weighted by the probability
of the voltages under it. Where the OCV is flat, many of them stay probable, and their spread shows
that the SOC is uncertain; a single filter takes the first slope it meets for that at all SOC and is
soon certain of a wrong one.

Parameters are known, joint (further states of the one filter) or dual (a separate unscented filter
beside that of the states). All of it is written for one cell; callers vmap it over cells or
tunings. `cuthbert` (0.1.1) has extended and unscented filters as scans, but requires Numba and
LLVM, has no dual form, and needs the model as log densities; the code for a single measured voltage
is shorter than its use would be.

Sources: Plett, J. Power Sources 134 (2004) 262-292 (extended, joint and dual) and 161 (2006)
1369-1384 (sigma points); Julier and Uhlmann (1997) for the unscented transform, with kappa = 1,
which keeps all weights positive.
"""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Scalar

from ..execution import in_one_function
from .model import Drive, Filtered, FilterModel

Kind = Literal["sum", "ekf", "ukf"]
Vector = Float[Array, "states"]
Matrix = Float[Array, "states states"]
# The variance that an interval adds to every state and to every slow parameter.
Walk = tuple[Vector, Float[Array, "slow"]]
KAPPA = 1.0
# Filters of a Gaussian sum, over this many standard deviations of the start to either side, each
# with this share of the distance between two as its own deviation. Five are enough for a sloping
# OCV; a flat one needs all, and more change little.
PARTS, SIDES, OVERLAP = 9, 2.25, 0.8
# A start beyond full or empty by more than this is improbable.
OUTSIDE_SD = 0.02
# A voltage further than this many standard deviations from its prediction is a measurement fault,
# and corrects nothing; if it lasts longer than this it is a wrong start, and corrects again.
GATE_SD, GATE_S = 10.0, 60.0


class Gaussian(NamedTuple):
    """Mean and covariance."""

    mean: Vector
    covariance: Matrix


# Gaussians, the logarithms of their weights, and the weights.
Parts = tuple[Gaussian, Float[Array, "parts"], Float[Array, "parts"]]
Moments = Float[Array, "parts n"]
# Gaussians with weights, and the time for which measurements have been rejected.
Carry = tuple[Parts, Scalar]


class Observation(NamedTuple):
    """A predicted voltage, its variance without that of the measurement, and its covariances."""

    voltage_v: Scalar
    variance_v2: Scalar
    with_state: Vector


def run_filter(
    model: FilterModel,
    start: tuple[Vector, Vector],
    drive: Drive,
    kind: Kind | Literal["dual"] = "sum",
    adapting: float = 0.0,
) -> Filtered:
    """A filter's estimates along a record, from a state and its variances (`FilterModel.start`).

    The measurement noise of the dual filter may adapt: `adapting` is the share of it that a sample
    renews, from its residual (Mohamed and Schwarz, J. Geodesy 73 (1999) 193).
    """
    mean, variance = start
    # The last current is held while one is not a number.
    last = lax.cummax(jnp.where(jnp.isfinite(drive.held_a), jnp.arange(len(drive.held_a)), -1))
    held_a = jnp.where(last >= 0, drive.held_a[jnp.maximum(last, 0)], 0.0)
    drive = drive._replace(held_a=held_a)
    slow = jnp.zeros_like(model.slow_sd)
    if not any(name.startswith("tau") for name in model.slow):
        drive = drive._replace(gains=jax.vmap(model.gains, (None, 0))(slow, drive))
    walks = jax.vmap(model.walk)(drive)
    if kind == "dual" and model.slow:
        beliefs = Gaussian(mean, jnp.diag(variance)), Gaussian(slow, jnp.diag(model.slow_sd**2))
        carry = (*beliefs, jnp.ones_like(mean[0])), jnp.zeros_like(mean[0])
        rows = _along(_dual_step(model, adapting), carry, (drive, walks))
    else:
        both = jnp.concatenate([mean, slow]), jnp.concatenate([variance, model.slow_sd**2])
        parts = _parts(*both, PARTS if kind == "sum" else 1)
        step = _joint_step(model, "ukf" if kind == "dual" else kind)
        rows = _along(step, (parts, jnp.zeros_like(mean[0])), (drive, walks))
    count = len(model.slow)
    deviations = jnp.sqrt(rows[:, 2 + count :])
    return Filtered(
        *(rows[:, 0], jnp.hypot(deviations[:, 0], model.axis_sd), rows[:, 2 : 2 + count]),
        *(deviations[:, 1:-1], rows[:, 1], deviations[:, -1]),
    )


def _gated(
    before: Any, after: Any, rejected_s: Scalar, expected: tuple[Scalar, Scalar], drive: Drive
) -> tuple[Any, Scalar]:
    """The estimates after a measurement, or those before it if it is judged a fault; and the time
    for which measurements have been rejected."""
    innovation_v, variance_v2 = expected
    apart_sd = jnp.abs(innovation_v) / jnp.sqrt(variance_v2)
    is_near = apart_sd <= GATE_SD
    is_kept = is_near | ((rejected_s > GATE_S) & jnp.isfinite(apart_sd))
    kept = jax.tree.map(lambda one, other: jnp.where(is_kept, other, one), before, after)
    return kept, jnp.where(is_near, 0.0, rejected_s + jnp.where(is_kept, 0.0, drive.interval_s))


def _along(step: Callable[[Any, Any], Any], carry: Any, given: Any) -> Any:
    """The stacked outputs of a scan."""
    return in_one_function(lambda carry, given: lax.scan(step, carry, given)[1])(carry, given)


def _parts(mean: Vector, variance: Vector, count: int) -> Parts:
    """Gaussians around a start.

    Together they have the mean and the variance of the start, except beyond full or empty.
    """
    step = 2 * SIDES / max(count - 1, 1)
    sd = OVERLAP * step if count > 1 else 1.0
    away = jnp.linspace(-SIDES, SIDES, count) if count > 1 else jnp.zeros(1)
    soc = mean[0] + jnp.sqrt(variance[0]) * away
    log_weights = -(away**2) / (2 * (1 - sd**2)) if count > 1 else away
    if count > 1:
        outside = jnp.maximum(jnp.maximum(-soc, soc - 1), 0.0)
        log_weights = log_weights - (outside / OUTSIDE_SD) ** 2 / 2
    covariance = jnp.diag(variance.at[0].multiply(sd**2))
    means = jnp.tile(mean, (count, 1)).at[:, 0].set(soc)
    log_weights = log_weights - jnp.max(log_weights)
    weights = jnp.exp(log_weights)
    parts = Gaussian(means, jnp.tile(covariance, (count, 1, 1)))
    return parts, log_weights, weights / jnp.sum(weights)


def _joint_step(model: FilterModel, kind: Kind):
    """One sample of filters whose states include the slow parameters."""
    count = model.states
    is_unscented = kind == "ukf"

    def step(carry: Carry, given: tuple[Drive, Walk]) -> tuple[Carry, Vector]:
        ((parts, log_weights, weights), rejected_s), (drive, walks) = carry, given
        walk = jnp.concatenate(walks)

        def predict(belief: Gaussian, near: Scalar) -> Gaussian:
            if not is_unscented:
                return _predict_extended(model, belief, drive, near, walk)

            def advance(both):
                moved = model.advance(both[:count], both[count:], drive, near)
                return jnp.concatenate([moved, both[count:]])

            return _predict_unscented(advance, belief, walk)

        def correct(belief: Gaussian, near: Scalar) -> tuple[Gaussian, Scalar, Scalar]:
            def voltage(both):
                return model.voltage(both[:count], both[count:], drive, near)

            if is_unscented:
                observed = _observe_unscented(voltage, belief)
            else:
                slope = model.slopes(belief.mean[:count], belief.mean[count:], drive, near)
                with_state = jnp.sum(belief.covariance * slope, axis=1)
                variance_v2 = jnp.sum(slope * with_state)
                observed = Observation(voltage(belief.mean), variance_v2, with_state)
            innovation_v = drive.voltage_v - observed.voltage_v
            variance_v2 = observed.variance_v2 + model.noise_v2(near, drive.interval_s)
            belief = _correct(belief, observed.with_state, innovation_v, variance_v2)
            return belief, innovation_v, variance_v2

        # Sums of products, here and below, compile into one kernel with the code around them;
        # products of such small matrices need a kernel each.
        near = jnp.sum(weights * parts.mean[:, 0])
        parts = jax.vmap(predict, (0, None))(parts, near)
        near = jnp.sum(weights * parts.mean[:, 0])
        before = parts, log_weights
        parts, innovation_v, variance_v2 = jax.vmap(correct, (0, None))(parts, near)
        expected = _moments(weights[:, None], innovation_v[:, None], variance_v2[:, None])
        log_weights = log_weights - (innovation_v**2 / variance_v2 + jnp.log(variance_v2)) / 2
        log_weights = log_weights - jnp.max(log_weights)
        after, of_voltage = (parts, log_weights), (expected[0][0], expected[1][0])
        (parts, log_weights), rejected_s = _gated(before, after, rejected_s, of_voltage, drive)
        weights = jnp.exp(log_weights)
        weights = weights / jnp.sum(weights)
        spread = jnp.diagonal(parts.covariance, axis1=1, axis2=2)
        mean, variance = _moments(weights[:, None], parts.mean, spread)
        row = (mean[:1], expected[0], mean[count:], variance[:1], variance[count:], expected[1])
        return ((parts, log_weights, weights), rejected_s), jnp.concatenate(row)

    return step


def _moments(
    weights: Float[Array, "parts 1"], mean: Moments, variance: Moments
) -> tuple[Float[Array, "n"], Float[Array, "n"]]:
    """Mean and variance of mixtures."""
    middle = jnp.sum(weights * mean, axis=0)
    return middle, jnp.sum(weights * (variance + (mean - middle) ** 2), axis=0)


def _dual_step(model: FilterModel, adapting: float):
    """One sample of two unscented filters, each taking the other's mean as known.

    The innovation's variance is that of the state filter for both. The parameter filter looks one
    interval ahead, so it is hardly sensitive to effects on SOC over hours: an offset, a capacity.
    """

    def step(carry, given: tuple[Drive, Walk]):
        ((belief, slow, scale), rejected_s), (drive, (state_walk, slow_walk)) = carry, given
        before = belief.mean
        slow = slow._replace(covariance=slow.covariance + jnp.diag(slow_walk))

        def advance(state, other):
            return model.advance(state, other, drive, before[0])

        belief = _predict_unscented(lambda state: advance(state, slow.mean), belief, state_walk)
        near = belief.mean[0]

        def voltage(state, other):
            return model.voltage(state, other, drive, near)

        observed = _observe_unscented(lambda state: voltage(state, slow.mean), belief)
        slow_observed = _observe_unscented(
            lambda other: voltage(advance(before, other), other), slow
        )
        innovation_v = drive.voltage_v - observed.voltage_v
        fitted_v2 = model.noise_v2(near, drive.interval_s)
        noise_v2 = scale * fitted_v2
        variance_v2 = observed.variance_v2 + noise_v2
        predicted = belief, slow, scale
        belief = _correct(belief, observed.with_state, innovation_v, variance_v2)
        apart_v = drive.voltage_v - slow_observed.voltage_v
        apart_v2 = slow_observed.variance_v2 + variance_v2
        slow = _correct(slow, slow_observed.with_state, apart_v, apart_v2)
        residual_v = drive.voltage_v - voltage(belief.mean, slow.mean)
        left_v2 = observed.variance_v2 * noise_v2 / variance_v2
        adapted = scale + adapting * ((residual_v**2 + left_v2) / fitted_v2 - scale)
        corrected, of_voltage = (belief, slow, adapted), (innovation_v, variance_v2)
        kept, rejected_s = _gated(predicted, corrected, rejected_s, of_voltage, drive)
        belief, slow, scale = kept
        # All outputs of a sample in one array: each further one costs as much as a product.
        means = belief.mean[:1], innovation_v[None], slow.mean
        variances = belief.covariance[0, :1], jnp.diag(slow.covariance), variance_v2[None]
        return (kept, rejected_s), jnp.concatenate([*means, *variances])

    return step


def _correct(
    belief: Gaussian, with_state: Vector, innovation_v: Scalar, variance_v2: Scalar
) -> Gaussian:
    """The estimate after a measurement; equal factors keep the covariance symmetric."""
    scaled = with_state / jnp.sqrt(variance_v2)
    return Gaussian(
        belief.mean + with_state * (innovation_v / variance_v2),
        belief.covariance - scaled[:, None] * scaled[None, :],
    )


def _predict_extended(
    model: FilterModel, belief: Gaussian, drive: Drive, near: Scalar, walk: Vector
) -> Gaussian:
    count = model.states
    state, slow = belief.mean[:count], belief.mean[count:]
    # The share of every state's deviation left after an interval: only `slow` affects other states.
    kept = jnp.concatenate([jnp.ones(1), 1 - model.gains(slow, drive), jnp.ones_like(slow)])
    mean = jnp.concatenate([model.advance(state, slow, drive, near), slow])
    moved = kept[:, None] * belief.covariance
    columns = []
    if len(slow):
        by_slow = jax.jacfwd(model.advance, 1)(state, slow, drive, near).T
        columns = [jnp.append(column, jnp.zeros_like(slow)) for column in by_slow]
    # Products are added one by one: a sum over two of them would be a separate loop.
    for column, row in zip(columns, belief.covariance[count:], strict=True):
        moved = moved + column[:, None] * row
    # Computed once: otherwise it would be recomputed for every column.
    moved = lax.optimization_barrier(moved)
    covariance = moved * kept + jnp.diag(walk)
    for column, row in zip(columns, moved.T[count:], strict=True):
        covariance = covariance + row[:, None] * column
    return Gaussian(mean, covariance)


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
    """The Cholesky factor, column by column: LAPACK's rejects exactly known states (variance 0)
    and, called for every sample, takes longer than the filter."""
    columns: list[Vector] = []
    left = covariance
    for index in range(len(covariance)):
        pivot = left[index, index]
        is_exact = pivot <= 0
        safe = jnp.where(is_exact, 1.0, pivot)
        column = jnp.where(is_exact, 0.0, left[:, index] / jnp.sqrt(safe))
        columns.append(column)
        left = left - column[:, None] * column[None, :]
    return jnp.stack(columns, axis=1)

"""Intervals by fitting again, as a check: the moving-block bootstrap and profile likelihood.

Bootstrap: runs of the residuals, long enough to keep their correlation, are drawn at random, added
to the fitted voltage, and the circuit is fitted again (Kuensch, Annals of Statistics 17 (1989)
1217). The record is closed to a circle (Politis and Romano, 1992): else its two ends, where models
err most, are drawn least. It reads somewhat low, for residuals lack what the fit has followed and
blocks break correlations at their ends. Profile: how the best error rises as one parameter is moved
away from its value.
"""

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
from jaxtyping import Array, Float, Key
from scipy.special import stdtrit

from ..cell import CircuitParameters
from ..errors import InputError
from ..execution import in_float64
from ..model.problem import Problem
from ..model.search_space import Coordinates
from .covariance import CONFIDENCE, Covariance, Linearization, linearize, named_values
from .refit import Refit, holding

REPLICATES = 200
# Fewer blocks in a record tell no spread.
FEWEST_BLOCKS = 8


@dataclass(frozen=True)
class Resampled:
    """One parameter over the replicates: its spread, and its basic bootstrap interval."""

    value: float
    relative_error: float
    low: float
    high: float


@dataclass(frozen=True)
class Bootstrap:
    """What refits to resampled records gave. `is_cut` says that blocks are shorter than the rule
    asks for, because the record is."""

    block_s: float
    is_cut: bool
    replicates: int
    converged: int
    parameters: dict[str, Resampled]


@in_float64
def bootstrap(
    problem: Problem,
    parameters: CircuitParameters,
    *,
    key: Key[Array, ""],
    replicates: int = REPLICATES,
    covariance: Covariance | None = None,
    refit: Refit | None = None,
) -> Bootstrap:
    """Refits to `replicates` records with resampled residuals; held parameters stay held.

    Intervals are the basic bootstrap's in logarithms; `key` decides which blocks are drawn.
    """
    covariance = covariance or Covariance.of(linearize(problem, parameters))
    linearization = covariance.linearization
    refit = refit or Refit(problem)
    length, is_cut = block_length(covariance)
    blocks = math.ceil(linearization.samples / length)
    first = np.asarray(jr.randint(key, (replicates, blocks), 0, linearization.samples))
    drawn = (first[:, :, None] + np.arange(length)).reshape(replicates, -1)[
        :, : linearization.samples
    ]
    drawn %= linearization.samples
    centered_v = linearization.error_v - np.mean(linearization.error_v)
    fitted_v = refit.voltages.own_v - linearization.error_v
    base_v = np.concatenate(
        # A few at a time: a replicate is as long as the record.
        [refit.voltages.project(fitted_v + centered_v[few]) for few in np.array_split(drawn, 10)]
    )
    matrix, shift = holding(linearization)
    starts = np.broadcast_to(linearization.point, (replicates, len(linearization.point)))
    ends = refit(starts, base_v=base_v, matrix=matrix, shift=np.broadcast_to(shift, starts.shape))
    moved = ends.points[:, list(linearization.free)] - linearization.logarithms
    directions = {
        name: direction
        for name in named_values(parameters)
        if np.any(direction := linearization.direction_of(name)[0])
    }
    return Bootstrap(
        block_s=length * linearization.interval_s,
        is_cut=is_cut,
        replicates=replicates,
        converged=int(np.count_nonzero(ends.has_converged)),
        parameters={
            name: _resampled(named_values(parameters)[name], moved @ direction)
            for name, direction in directions.items()
        },
    )


def block_length(covariance: Covariance) -> tuple[int, bool]:
    """Samples a block, and whether the record was too short for as many as the rule asks.

    (2 G^2 / D)^(1/3) n^(1/3) with G the sum of |lag| times autocovariance and D = 4/3 of the
    squared sum of autocovariances (Politis and White, Econometric Reviews 23 (2004) 53, corrected
    by Patton, Politis and White, 28 (2009) 372), both from the fitted noise instead of from
    autocovariances up to some lag, which break off where correlations are long.
    """
    linearization, noise = covariance.linearization, covariance.noise
    decay = np.zeros(len(noise.correlation_s))
    decay[1:] = np.exp(-linearization.interval_s / noise.correlation_s[1:])
    slope = 2 * float(noise.variance_v2 @ (decay / (1 - decay) ** 2))
    level = float(noise.variance_v2 @ ((1 + decay) / (1 - decay)))
    if level == 0:
        return 1, False
    wanted = math.ceil((1.5 * (slope / level) ** 2 * linearization.samples) ** (1 / 3))
    longest = max(linearization.samples // FEWEST_BLOCKS, 1)
    return min(max(wanted, 1), longest), wanted > longest


def _resampled(value: float, moved: Float[np.ndarray, "replicates"]) -> Resampled:
    tail = (1 - CONFIDENCE) / 2
    below, above = np.quantile(moved, [tail, 1 - tail])
    low, high = value * np.exp([-above, -below])
    return Resampled(value, float(np.std(moved)), float(low), float(high))


POINTS = 15
# The grid first reaches this many half-widths of the linear interval, then to the end of the box.
REACH = 2.0


@dataclass(frozen=True)
class Profile:
    """The smallest RMSE for every one of some values of one parameter, the others refitted.

    The interval holds the values whose RMSE is not above `threshold_v`; an end is None where the
    profile does not rise to it inside the box.
    """

    name: str
    value: float
    values: tuple[float, ...]
    rmse_v: tuple[float, ...]
    threshold_v: float
    low: float | None
    high: float | None


def profile(
    problem: Problem,
    parameters: CircuitParameters,
    name: str,
    *,
    covariance: Covariance | None = None,
    refit: Refit | None = None,
) -> Profile:
    """The profile of a parameter under PyBaMM's name or of a time constant, `tau1 [s]`.

    With independent residuals the interval would end where the squared error has risen by t^2 s^2;
    with correlated ones that rise is scaled by the square of the inflation factor (Kent, Biometrika
    69 (1982) 19). `covariance` and `refit` may be given where they exist already. Raises
    `InputError` for a name the circuit does not have or that is held.
    """
    values = named_values(parameters)
    if name not in values:
        raise InputError(
            f"{name!r} is not a parameter of this circuit; there are {', '.join(values)}"
        )
    covariance = covariance or Covariance.of(linearize(problem, parameters))
    if name in covariance.linearization.held:
        # At a bound: the profile is what tells how far inside the box it may lie.
        covariance = Covariance.of(linearize(problem, parameters, freed=(name,)))
    linearization = covariance.linearization
    direction, held = linearization.direction_of(name)
    if not np.any(direction):
        raise InputError(f"{name!r} has no profile because it is held: {held}")
    refit = refit or Refit(problem)
    linear = covariance.estimate(name, values[name], direction)
    freedom = max(linearization.samples - len(linearization.names), 1)
    quantile = stdtrit(linear.degrees_of_freedom, (1 + CONFIDENCE) / 2)
    rise = (quantile * (linear.inflation or 1.0)) ** 2 / freedom
    best_v = float(np.sqrt(np.mean(linearization.error_v**2)))
    threshold_v = best_v * math.sqrt(1 + rise)

    is_ordered = problem.bounds.pairs_are_alike
    full = np.zeros(len(linearization.point))
    full[list(linearization.free)] = direction
    # How the others follow to first order: along the white-noise covariance, by which fits move.
    follow = np.zeros(len(linearization.point))
    follow[list(linearization.free)] = covariance.white_noise_matrix @ direction
    # Rounding can leave no variance at all where pairs coincide; the others then start in place.
    follow = follow / (full @ follow) if full @ follow > 0 else full / (full @ full)
    reach = np.array(_reach(full, linearization.point, refit))
    half_width = REACH * quantile * (linear.relative_error or 0.0)
    steps = np.clip(np.linspace(-half_width, half_width, POINTS), *reach)
    steps, rmse_v = _walk(np.unique(steps), full, follow, linearization, refit, is_ordered)
    for side, end in zip((-1, 1), reach, strict=True):
        is_there = (steps * side >= 0) & (rmse_v > threshold_v)
        outermost = np.max(steps * side, initial=0.0)
        if not np.any(is_there) and outermost < end * side * (1 - 1e-9):
            further = np.linspace(side * outermost, end, POINTS // 2 + 1)[1:]
            more, more_v = _walk(further, full, follow, linearization, refit, is_ordered)
            steps, rmse_v = np.append(steps, more), np.append(rmse_v, more_v)
    order = np.argsort(steps)
    steps, rmse_v = steps[order], rmse_v[order]
    low, high = (_crossing(side, steps, rmse_v, best_v, threshold_v) for side in (-1, 1))
    return Profile(
        name=name,
        value=values[name],
        values=tuple((values[name] * np.exp(steps)).tolist()),
        rmse_v=tuple(rmse_v.tolist()),
        threshold_v=threshold_v,
        low=None if low is None else values[name] * math.exp(low),
        high=None if high is None else values[name] * math.exp(high),
    )


def _reach(full, point, refit: Refit) -> tuple[float, float]:
    """How far the quantity's logarithm can go down and up inside the box.

    What it is made of may all move: C is largest where its tau is and its R is smallest.
    """
    box = refit.box
    lower, upper = np.asarray(box.lower) - point, np.asarray(box.upper) - point
    downward = np.where(full > 0, full * lower, full * upper)
    upward = np.where(full > 0, full * upper, full * lower)
    return float(downward.sum()), float(upward.sum())


def _walk(steps, full, follow, linearization: Linearization, refit: Refit, is_ordered: bool):
    """The refitted RMSE where the quantity's logarithm has moved by each of `steps`.

    Steps whose fit has its pairs in another order are left out: there the name belongs to another
    pair.
    """
    matrix, shift = holding(linearization)
    slot = int(np.argmax(np.abs(full)))
    others = np.where(np.arange(len(full)) == slot, 0.0, full) / full[slot]
    row = np.eye(len(full))[slot]
    constrained = matrix - np.outer(row, row @ matrix) - np.outer(row, others @ matrix)
    targets = (full @ linearization.point + steps) / full[slot]
    shifts = shift + np.outer(targets - others @ shift - shift[slot], row)
    box = refit.box
    starts = np.clip(linearization.point + np.outer(steps, follow), box.lower, box.upper)
    ends = refit(starts, matrix=constrained, shift=shifts)
    is_kept = np.isfinite(ends.rmse_v)
    if is_ordered:
        tau = np.stack([np.asarray(each) for each in _taus(ends.points, box)])
        is_kept &= np.all(np.diff(tau, axis=0) >= 0, axis=0)
    return steps[is_kept], ends.rmse_v[is_kept]


@in_float64
def _taus(points: Float[np.ndarray, "points coordinates"], box: Coordinates):
    return jax.vmap(box.decode)(jnp.asarray(points)).tau


def _crossing(side, steps, rmse_v, best_v, threshold_v) -> float | None:
    """Where the profile rises to the threshold on one side, None where it does not.

    The root of the rise is all but linear in the step, and is what is interpolated.
    """
    here = steps * side > 0
    distance = np.append(0.0, np.sort(steps[here] * side))
    height = rmse_v[here][np.argsort(steps[here] * side)]
    root = np.append(0.0, np.sqrt(np.maximum(height**2 - best_v**2, 0.0)))
    wanted = math.sqrt(threshold_v**2 - best_v**2)
    above = np.flatnonzero(root > wanted)
    if not len(above):
        return None
    first = int(above[0])
    share = (wanted - root[first - 1]) / (root[first] - root[first - 1])
    return side * float(distance[first - 1] + share * (distance[first] - distance[first - 1]))

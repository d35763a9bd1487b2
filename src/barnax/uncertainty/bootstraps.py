"""Intervals by the moving-block bootstrap, as a check.

Runs of the residuals, long enough to keep their correlation, are drawn at random, added to the
fitted voltage, and the circuit is fitted again (Kuensch, Annals of Statistics 17 (1989) 1217). The
record is closed to a circle (Politis and Romano, 1992): else its two ends, where models err most,
are drawn least. It reads somewhat low, for residuals lack what the fit has followed and blocks
break correlations at their ends.
"""

import math
from dataclasses import dataclass

import jax.random as jr
import numpy as np
from jaxtyping import Array, Float, Key

from ..cell import CircuitParameters
from ..execution import in_float64
from ..model.problem import Problem
from .batch_fit import Refit, holding
from .covariance import CONFIDENCE, Covariance, linearize, named_values

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
    """Refits to resampled records. `is_cut` says that blocks are shorter than the rule
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

"""Profile likelihood: how the best error rises as one parameter is moved away from its value."""

import math
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.special import stdtrit

from ..cell import CircuitParameters
from ..errors import InputError
from ..execution import in_float64
from ..model.coordinates import Coordinates
from ..model.problem import Problem
from .batch_fit import Refit, holding
from .covariance import CONFIDENCE, Covariance, Linearization, linearize, named_values

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

    ordered = problem.bounds.interchangeable_pairs
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
    steps, rmse_v = _walk(np.unique(steps), full, follow, linearization, refit, ordered)
    for side, end in zip((-1, 1), reach, strict=True):
        is_there = (steps * side >= 0) & (rmse_v > threshold_v)
        outermost = np.max(steps * side, initial=0.0)
        if not np.any(is_there) and outermost < end * side * (1 - 1e-9):
            further = np.linspace(side * outermost, end, POINTS // 2 + 1)[1:]
            more, more_v = _walk(further, full, follow, linearization, refit, ordered)
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
    """The reach of the quantity's logarithm down and up inside the box.

    What it is made of may all move: C is largest where its tau is and its R is smallest.
    """
    box = refit.box
    lower, upper = np.asarray(box.lower) - point, np.asarray(box.upper) - point
    downward = np.where(full > 0, full * lower, full * upper)
    upward = np.where(full > 0, full * upper, full * lower)
    return float(downward.sum()), float(upward.sum())


def _walk(steps, full, follow, linearization: Linearization, refit: Refit, ordered: int):
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
    if ordered:
        tau = np.stack([np.asarray(tau_s) for tau_s in _taus(ends.points, box)[:ordered]])
        is_kept &= np.all(np.diff(tau, axis=0) >= 0, axis=0)
    return steps[is_kept], ends.rmse_v[is_kept]


@in_float64
def _taus(points: Float[np.ndarray, "points coordinates"], box: Coordinates):
    return jax.vmap(box.decode)(jnp.asarray(points)).tau


def _crossing(side, steps, rmse_v, best_v, threshold_v) -> float | None:
    """The step at which the profile rises to the threshold on one side, None where it does not.

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

"""Profile likelihood: how the best error rises as one parameter is moved away from its value."""

import math
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.special import stdtrit

from ..errors import InputError
from ..execution import in_float64
from ..model.search_space import Coordinates
from ..search.refine import Refinement
from .assessment import Assessment, assess
from .covariance import CONFIDENCE, direction_of, estimate_uncertainty, named_values
from .identifiability import symbol, with_unit
from .linearization import Linearization, linearize
from .refit import Refit, holding

POINTS = 15
# The grid first reaches this many half-widths of the linear interval, then to the end of the box.
REACH = 2.0


@dataclass(frozen=True, eq=False)
class Profile:
    """The smallest RMSE for every value of one parameter, the others refitted.

    The interval holds the values whose RMSE is not above `threshold_rmse_v`; an end is None where
    the profile does not rise to it inside the box.
    """

    name: str
    best: float
    values: Float[np.ndarray, "points"]
    rmse_v: Float[np.ndarray, "points"]
    threshold_rmse_v: float
    low: float | None
    high: float | None

    @property
    def words(self) -> str:
        value = f"{symbol(self.name)} = {with_unit(self.name, self.best)}"
        if self.low is None and self.high is None:
            return f"{value}: no value in its box fits worse than chance would have it."
        if self.low is None or self.high is None:
            side, end = ("above", self.low) if self.high is None else ("below", self.high)
            return f"{value}: nothing but {side} {with_unit(self.name, end or 0.0)} is known."
        ends = f"{with_unit(self.name, self.low)} to {with_unit(self.name, self.high)}"
        return f"{value}, {100 * CONFIDENCE:.0f} % interval {ends} by its profile."

    def to_dict(self) -> dict[str, Any]:
        return {
            "value": self.best,
            "values": self.values.tolist(),
            "rmse [V]": self.rmse_v.tolist(),
            "threshold [V]": self.threshold_rmse_v,
            "low": self.low,
            "high": self.high,
        }


def profile(
    refinement: Refinement,
    name: str,
    *,
    assessment: Assessment | None = None,
    refit: Refit | None = None,
) -> Profile:
    """The profile of a parameter under PyBaMM's name or of a time constant, `tau1 [s]`.

    With independent errors the interval would end where the squared error has risen by
    t^2 s^2; with errors that stay alike that rise is scaled by the trusted variance over the plain
    one (Kent, Biometrika 69 (1982) 19). `assessment` and `refit` may be given where they exist
    already. Raises `InputError` for a name the circuit does not have or that is held.
    """
    assessment = assessment or assess(refinement)
    linearization, uncertainty = assessment.linearization, assessment.uncertainty
    values = named_values(refinement.parameters)
    if name not in values:
        raise InputError(f"{name!r} is no parameter of this circuit; there are {', '.join(values)}")
    if name in linearization.held:
        # At a bound: the profile is what tells how far inside the box it may lie.
        linearization = linearize(refinement.search.problem, refinement.parameters, freed=(name,))
        uncertainty = estimate_uncertainty(refinement.parameters, linearization)
    direction, held = direction_of(name, linearization)
    if not np.any(direction):
        raise InputError(f"{name!r} has no profile, for it is held: {held}")
    refit = refit or Refit(refinement.search.problem)
    linear = uncertainty[name]
    freedom = max(linearization.samples - len(linearization.names), 1)
    quantile = stdtrit(linear.degrees_of_freedom, (1 + CONFIDENCE) / 2)
    rise = (quantile * (linear.inflation or 1.0)) ** 2 / freedom
    best_v = float(np.sqrt(np.mean(linearization.error_v**2)))
    threshold_v = best_v * math.sqrt(1 + rise)

    is_ordered = refinement.search.problem.bounds.pairs_are_alike
    full = np.zeros(len(linearization.point))
    full[list(linearization.free)] = direction
    # How the others follow to first order: along the plain covariance, which is what fits move by.
    follow = np.zeros(len(linearization.point))
    follow[list(linearization.free)] = uncertainty.white_noise_covariance @ direction
    follow /= full @ follow
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
    best = values[name]
    low, high = (_crossing(side, steps, rmse_v, best_v, threshold_v) for side in (-1, 1))
    return Profile(
        name=name,
        best=best,
        values=best * np.exp(steps),
        rmse_v=rmse_v,
        threshold_rmse_v=threshold_v,
        low=None if low is None else best * math.exp(low),
        high=None if high is None else best * math.exp(high),
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

"""Profile likelihood: the rise of the best error as one parameter is moved away from its value."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..cell import CircuitParameters
from ..errors import InputError
from ..global_optimum.objective import ConstantObjective, Solution
from ..metrics import t_quantile
from ..model.descent import polish
from .covariance import Covariance, Linearization, linearize, named_values

if TYPE_CHECKING:
    from ..model.problem import Problem

# Number of values on either side of the parameter's own.
POINTS = 7
# They first reach this many half-widths of the linear interval, then the end of the box.
REACH = 2.0


@dataclass(frozen=True)
class ParameterProfile:
    """The smallest RMSE for each of several values of one parameter, the others refitted.

    The interval holds the values whose RMSE is not above `threshold_v`; an end is None if the
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
    problem: "Problem",
    parameters: CircuitParameters,
    name: str,
    *,
    covariance: Covariance | None = None,
    objective: ConstantObjective | None = None,
) -> ParameterProfile:
    """The profile of a parameter under PyBaMM's name or of a time constant, `tau1 [s]`.

    With independent residuals the interval would end where the squared error has risen by t^2 s^2;
    with correlated ones that rise is scaled by the square of the inflation factor (Kent, Biometrika
    69 (1982) 19). `covariance` and `objective` may be passed if they exist already. Raises
    `InputError` for a name the circuit does not have or that is held.
    """
    values = named_values(parameters)
    if name not in values:
        raise InputError(
            f"{name!r} is not a parameter of this circuit; there are {', '.join(values)}"
        )
    covariance = covariance or Covariance.of(linearize(problem, parameters))
    if name in covariance.linearization.held:
        # At a bound: the profile shows how far inside the box it may lie.
        covariance = Covariance.of(linearize(problem, parameters, freed=(name,)))
    linearization = covariance.linearization
    direction, held = linearization.direction_of(name)
    if not np.any(direction):
        raise InputError(f"{name!r} has no profile because it is held: {held}")
    linear = covariance.estimate(name, values[name], direction)
    freedom = max(linearization.samples - len(linearization.names), 1)
    quantile = t_quantile(linear.degrees_of_freedom or 1.0)
    rise = (quantile * (linear.inflation or 1.0)) ** 2 / freedom
    best_v = float(np.sqrt(np.mean(linearization.error_v**2)))
    threshold_v = best_v * math.sqrt(1 + rise)
    half_width = REACH * quantile * (linear.relative_error or 0.0)

    objective = objective or ConstantObjective.of(problem)
    for other, reason in linearization.held.items():
        if reason != "fixed":
            objective = objective.fixing(other, values[other])
    # A quantity that depends on one free parameter alone moves with it.
    moving = [one for one, share in zip(linearization.names, direction, strict=True) if share]
    moved, sign = (name, 1.0) if len(moving) > 1 else (moving[0], float(direction.sum()))
    rate = () if parameters.gamma is None else (parameters.gamma,)
    scales = tuple(np.log([*parameters.tau_s, *rate]).tolist())
    ordered = problem.bounds.interchangeable_pairs
    ends, least_v = {}, dict[float, float]()
    for side in (-1, 1):
        end = _reach(problem, linearization, direction, side)
        first = np.unique(np.minimum(np.linspace(0.0, half_width, POINTS + 1), end))
        further = np.linspace(first[-1], end, POINTS + 1)[1:]
        start, root = scales, {0.0: 0.0}
        for steps in (first, further if first[-1] < end * (1 - 1e-9) else first[:0]):
            if max(root.values()) ** 2 + best_v**2 > threshold_v**2:
                break
            there = values[moved] * np.exp(sign * side * steps)
            refits = _refits(objective, moved, there.tolist(), start)
            for step, met in zip(steps.tolist(), refits, strict=True):
                start = met.log_scales
                # In another order of the pairs the name belongs to another pair.
                if np.all(np.diff(start[:ordered]) >= 0):
                    least_v[side * step] = met.rms_v
                    root[step] = math.sqrt(max(met.objective_v2 - best_v**2, 0.0))
        ends[side] = _crossing(root, math.sqrt(threshold_v**2 - best_v**2))
    steps = sorted(least_v)
    low, high = (
        None if step is None else values[name] * math.exp(side * step)
        for side, step in ends.items()
    )
    return ParameterProfile(
        name=name,
        value=values[name],
        values=tuple((values[name] * np.exp(steps)).tolist()),
        rmse_v=tuple(least_v[step] for step in steps),
        threshold_v=threshold_v,
        low=low,
        high=high,
    )


def _reach(
    problem: "Problem", linearization: Linearization, direction: np.ndarray, side: int
) -> float:
    """How far the logarithm of a quantity can move to a side, until all parameters that it moves
    are at their bounds: C is largest at the largest tau and the smallest R."""
    box, free = problem.log_coordinates, list(linearization.free)
    lower, upper = (np.asarray(end)[free] for end in (box.lower, box.upper))
    corner = np.where(side * direction > 0, upper, lower)
    return side * float(direction @ (corner - linearization.point[free]))


def _refits(
    objective: ConstantObjective, name: str, values: Sequence[float], start: Sequence[float]
) -> Iterator[Solution]:
    """The best fits with a parameter held at each value, each descended to from the one before."""
    for value in values:
        fixed = objective.fixing(name, value)
        low, high = np.transpose([[axis.low, axis.high] for axis in fixed.axes])
        met = polish(fixed, fixed.solve(tuple(np.clip(start, low, high).tolist())))
        start = met.log_scales
        yield met


def _crossing(root: dict[float, float], wanted: float) -> float | None:
    """The step at which the profile rises to the threshold; None if it does not.

    The root of the rise is nearly linear in the step, so it is interpolated.
    """
    steps, roots = [*root], [*root.values()]
    above = next((index for index, height in enumerate(roots) if height > wanted), None)
    if above is None:
        return None
    share = (wanted - roots[above - 1]) / (roots[above] - roots[above - 1])
    return steps[above - 1] + share * (steps[above] - steps[above - 1])

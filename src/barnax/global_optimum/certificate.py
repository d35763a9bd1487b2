"""A proof that no circuit in a box fits much better: lower bounds of the errors of many boxes at
once.

With y any unit vector, |e| >= y.e for the error e of every circuit. Over a box of time constants
that is at least y.base plus, for R0 and for each axis, the least of r y.phi over the resistances
and the scales u of the box: numbers, because each phi varies along one axis only. Along it y.phi(u)
is the parabola through three scales up to a remainder that the third derivative bounds.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ..model.box_least_squares import Columns, dot, errors_of, least_in_boxes, normal_equations
from ..model.descent import Axis, LogScales
from ..search.answers import RefinedSeed
from .objective import ConstantObjective
from .proof import (
    ABSOLUTE_V,
    SMALLEST_RMSE_V,
    Boxes,
    Proof,
    beyond_parabola,
    first_boxes,
    lowest_of_parabola,
    prove,
)

# Initial boxes per axis, and the number of boxes examined at a time.
FIRST_BOXES = 8
AT_ONCE = 2048
# A proved gap up to the first is a certificate. It is narrowed to the second if that takes few
# boxes.
CERTIFIED_GAP = 1e-3
NARROW_GAP = 1e-5
FEW_BOXES = 4096


def certify(
    objective: ConstantObjective,
    best: RefinedSeed,
    polish: Callable[[LogScales], RefinedSeed],
    max_boxes: int,
) -> Proof[RefinedSeed]:
    """A bound on how far below the best known RMSE that of any circuit in the box could be.

    Boxes are split to a gap of `NARROW_GAP`, or of `CERTIFIED_GAP` if the former needs more than
    `FEW_BOXES` boxes, or until `max_boxes` have been examined. A better circuit met on the way is
    polished.
    """
    axes, alike = objective.axes, objective.interchangeable

    def gap_of(rmse_v: float, boxes: int) -> float:
        is_cheap = boxes < FEW_BOXES and rmse_v > SMALLEST_RMSE_V
        return NARROW_GAP if is_cheap else CERTIFIED_GAP

    def bound(boxes: Boxes, enough_v: float):
        nonlocal best
        del enough_v
        bounds_v, split, better = _bound(objective, boxes, best.rmse_v)
        best = best if better is None else polish(better)
        return bounds_v, split, best.rmse_v

    first = first_boxes(axes, [FIRST_BOXES] * len(axes), alike)
    proved = prove(first, bound, best.rmse_v, gap_of, alike, AT_ONCE, max_boxes)
    return Proof(*proved, best)


def _bound(
    objective: ConstantObjective, boxes: Boxes, best_v: float
) -> tuple[Float[np.ndarray, "boxes"], Int[np.ndarray, "boxes"], LogScales | None]:
    """A lower bound of the errors in a box, the axis to split it along, and scales of a better
    circuit if one is met.

    The first y is the direction of the error at the middle of the box, with the best resistances
    there. To first order that error has no slope in free resistances, but the loss of y.phi over
    the box would let them grow to their limits; so the second y is the direction of an error with
    just enough slope in them.
    """
    box_axes = [*map(_AxisEnds.of, objective.axes, np.moveaxis(boxes, 1, 0), objective.remainders)]
    low, middle, high = (
        np.stack([box_axis.log_scales[end] for box_axis in box_axes]) for end in range(3)
    )
    allowed = objective.coefficient_box(low)[0], objective.coefficient_box(high)[1]
    box = objective.coefficient_box(middle)
    responses = [box_axis.responses[1] for box_axis in box_axes]
    base = np.broadcast_to(objective.base, responses[0].shape)
    columns = [np.broadcast_to(objective.current, base.shape), *responses]
    normal, gradient = normal_equations(columns, base)

    resistances = least_in_boxes(normal, gradient, *box)
    errors_v = errors_of(columns, base, resistances)
    at_middle_v = np.linalg.norm(errors_v, axis=1)
    bounds_v, loss = _dual(errors_v, base, columns[0], box_axes, allowed)
    better = None
    best = int(np.argmin(at_middle_v))
    if at_middle_v[best] < best_v * (1 - NARROW_GAP) - ABSOLUTE_V:
        better = tuple(middle[:, best].tolist())

    # A little more slope than needed leaves free resistances at their lower limits, which cost far
    # less than the upper ones.
    tilted = least_in_boxes(normal, gradient - 1.05 * at_middle_v * loss, *box)
    errors_v = errors_of(columns, base, tilted)
    tilted_v, loss = _dual(errors_v, base, columns[0], box_axes, allowed)
    split = np.argmax((np.abs(tilted) * loss)[1:], axis=0)
    return np.maximum(bounds_v, tilted_v), split, better


@dataclass(frozen=True, eq=False)
class _AxisEnds:
    """One axis of many boxes: lower end, middle and upper end, and the responses there.

    `remainder` bounds how far y.phi can be below the parabola through the three, for any unit y.
    """

    log_scales: Float[np.ndarray, "three boxes"]
    responses: tuple[Columns, Columns, Columns]
    remainder: Float[np.ndarray, "boxes"]

    @classmethod
    def of(
        cls,
        axis: Axis,
        ends: Float[np.ndarray, "boxes ends"],
        derivatives: Float[np.ndarray, "2 1"],
    ) -> "_AxisEnds":
        three = np.stack([ends[:, 0], np.sum(ends, axis=1) / 2, ends[:, 1]])
        distinct, index = np.unique(three, return_inverse=True)
        index = index.reshape(three.shape)
        table = axis.columns(distinct)[..., 0]
        half_width = (three[2] - three[0]) / 2
        responses = table[index[0]], table[index[1]], table[index[2]]
        return cls(three, responses, beyond_parabola(derivatives, half_width))

    def least(
        self, direction: Columns
    ) -> tuple[Float[np.ndarray, "boxes"], Float[np.ndarray, "boxes"]]:
        """A lower bound of y.phi in a box, and its distance below the value at the middle."""
        below, middle, above = (dot(direction, responses) for responses in self.responses)
        least = lowest_of_parabola(below, middle, above) - self.remainder
        return least, middle - least


def _dual(errors_v: Columns, base: Columns, current: Columns, box_axes, allowed):
    """The bound from the direction of an error, and the loss of y.phi over each box."""
    size_v = np.linalg.norm(errors_v, axis=1)
    direction = errors_v / np.where(size_v > 0, size_v, 1.0)[:, None]
    ohmic = dot(direction, current)
    pairs = [box_axis.least(direction) for box_axis in box_axes]
    slopes = np.stack([ohmic, *(least for least, _ in pairs)])
    loss = np.stack([np.zeros_like(ohmic), *(lost for _, lost in pairs)])
    low, high = allowed
    bounds_v = dot(direction, base) + np.sum(np.minimum(low * slopes, high * slopes), axis=0)
    return bounds_v, loss

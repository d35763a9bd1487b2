"""Branch and bound over the logarithms of time constants: the queue of boxes.

A kernel bounds the error of every circuit of a box from below: `certificate.py` here that of
constants, thousands of boxes at once, and that of `over_soc` tables, box by box. Boxes whose bound
is too low are split, the lowest first.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int

from ..model.axes import Axis

# The compressed form agrees with the scan to the larger of these.
RELATIVE, ABSOLUTE_V = 1e-9, 1e-12
# Nothing measured comes near this: a smaller error counts as one of this size.
SMALLEST_RMSE_V = 1e-8

Boxes = Float[np.ndarray, "boxes axes ends"]
# Of some boxes, and how high a bound in V is enough: bounds, which axis to split each box along,
# and the error of the best known by then.
Kernel = Callable[[Boxes, float], tuple[np.ndarray, np.ndarray, float]]
Best = TypeVar("Best")


@dataclass(frozen=True, eq=False)
class Proof(Generic[Best]):
    """Nothing in the box has an error below `lower_bound_v`; so many `boxes` of time constants were
    needed to show it. `best` is the best known, or a better one met on the way."""

    lower_bound_v: float
    boxes: int
    best: Best


def prove(
    first: Boxes,
    bound: Kernel,
    best_v: float,
    gap_of: Callable[[float, int], float],
    interchangeable: int,
    at_once: int,
    max_boxes: int,
) -> tuple[float, int]:
    """A lower bound of the errors in the first boxes, and how many boxes that took.

    It goes on until that is within a share of the best error, `gap_of` it after so many boxes, or
    until `max_boxes` have been looked at, `at_once` at a time. The first axes, so many as are
    `interchangeable`, are of pairs with one range.
    """
    boxes, bounds_v, split = first[:0], np.zeros(0), np.zeros(0, int)
    taken, parents_v, seen = first, np.zeros(len(first)), 0

    def wanted() -> tuple[float, float]:
        """The slack of a bound, and how high one is wanted with that."""
        slack_v = max(RELATIVE * best_v, ABSOLUTE_V)
        return slack_v, best_v - gap_of(best_v, seen) * max(best_v, SMALLEST_RMSE_V) + slack_v

    slack_v, enough_v = wanted()
    while True:
        found_v, axes, best_v = bound(taken, enough_v)
        seen += len(taken)
        slack_v, enough_v = wanted()
        # What holds for a box holds for its halves.
        bounds_v = np.concatenate([bounds_v, np.maximum(found_v, parents_v)])
        order = np.argsort(bounds_v, kind="stable")
        boxes, split = np.concatenate([boxes, taken])[order], np.concatenate([split, axes])[order]
        bounds_v = bounds_v[order]
        low = int(np.searchsorted(bounds_v, enough_v))
        count = min(low, at_once, max_boxes - seen)
        if enough_v <= slack_v or count <= 0:
            return min(max(0.0, float(bounds_v[0]) - slack_v), best_v), seen
        taken, parents = _halves(boxes[:count], split[:count], interchangeable)
        parents_v = bounds_v[parents]
        boxes, bounds_v, split = boxes[count:], bounds_v[count:], split[count:]


def first_boxes(axes: Sequence[Axis], counts: Sequence[int], interchangeable: int) -> Boxes:
    """The whole box in so many parts an axis, one where nothing is to be chosen."""
    edges = [
        np.linspace(axis.low, axis.high, 1 + (count if axis.high > axis.low else 1))
        for axis, count in zip(axes, counts, strict=True)
    ]
    sides = map(itertools.pairwise, edges)
    boxes = np.array(list(itertools.product(*sides)))
    return boxes[_are_in_order(boxes, interchangeable)]


def _halves(
    boxes: Boxes, split: Int[np.ndarray, "boxes"], interchangeable: int
) -> tuple[Float[np.ndarray, "halves axes ends"], Int[np.ndarray, "halves"]]:
    """The halves that can be in order, and which box each is of."""
    rows = np.arange(len(boxes))
    middle = np.sum(boxes[rows, split], axis=1) / 2
    lower, upper = boxes.copy(), boxes.copy()
    lower[rows, split, 1] = middle
    upper[rows, split, 0] = middle
    halves = np.concatenate([lower, upper])
    in_order = _are_in_order(halves, interchangeable)
    return halves[in_order], np.tile(rows, 2)[in_order]


def _are_in_order(boxes: Boxes, interchangeable: int) -> Bool[np.ndarray, "boxes"]:
    """True for boxes with scales of interchangeable pairs that rise."""
    count = max(interchangeable, 1)
    first, second = boxes[:, : count - 1], boxes[:, 1:count]
    rises = (first[..., 0] < second[..., 1]) | np.all(first == second, axis=2)
    return np.all(rises, axis=1)

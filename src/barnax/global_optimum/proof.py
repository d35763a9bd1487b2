"""Branch and bound over the logarithms of time constants: the queue of boxes, and the remainder
between the points that a proof evaluates.

A kernel bounds the error of every circuit in a box from below: `certificate.py` here for constants,
thousands of boxes at once, and that of `fit` for tables, box by box. Boxes whose bound is too
low are split, the lowest first. Along one scale every column is the parabola through the ends and
the middle of a box, up to a remainder that its third derivative bounds.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int

from ..cell.tables import hats
from ..model.descent import Axis
from ..model.prepared import BLOCK, PreparedRecord

# The compressed form agrees with the scan to the larger of these.
RELATIVE, ABSOLUTE_V = 1e-9, 1e-12
# No measurement is this accurate: a smaller error counts as this.
SMALLEST_RMSE_V = 1e-8

Boxes = Float[np.ndarray, "boxes axes ends"]
# From boxes and a bound in V that is enough: their bounds, the axis to split each box along, and
# the error of the best circuit so far.
Kernel = Callable[[Boxes, float], tuple[np.ndarray, np.ndarray, float]]
Best = TypeVar("Best")


@dataclass(frozen=True, eq=False)
class Proof(Generic[Best]):
    """No circuit in the box has an error below `lower_bound_v`; the proof took `boxes` boxes of
    time constants. `best` is the best known circuit, or a better one met on the way."""

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
    """A lower bound of the errors in the first boxes, and the number of boxes examined.

    Boxes are split until the bound is within a share of the best error, `gap_of` it after that many
    boxes, or until `max_boxes` have been examined, `at_once` at a time. The first `interchangeable`
    axes are pairs with the same range.
    """
    boxes, bounds_v, split = first[:0], np.zeros(0), np.zeros(0, int)
    batch, parents_v, seen = first, np.zeros(len(first)), 0

    def bound_target() -> tuple[float, float]:
        """The slack of a bound, and the bound required with it."""
        slack_v = max(RELATIVE * best_v, ABSOLUTE_V)
        return slack_v, best_v - gap_of(best_v, seen) * max(best_v, SMALLEST_RMSE_V) + slack_v

    slack_v, enough_v = bound_target()
    while True:
        lower_v, axes, best_v = bound(batch, enough_v)
        seen += len(batch)
        slack_v, enough_v = bound_target()
        # A bound for a box holds for its halves.
        bounds_v = np.concatenate([bounds_v, np.maximum(lower_v, parents_v)])
        order = np.argsort(bounds_v, kind="stable")
        boxes, split = np.concatenate([boxes, batch])[order], np.concatenate([split, axes])[order]
        bounds_v = bounds_v[order]
        low = int(np.searchsorted(bounds_v, enough_v))
        count = min(low, at_once, max_boxes - seen)
        if enough_v <= slack_v or count <= 0:
            return min(max(0.0, float(bounds_v[0]) - slack_v), best_v), seen
        batch, parents = _halves(boxes[:count], split[:count], interchangeable)
        parents_v = bounds_v[parents]
        boxes, bounds_v, split = boxes[count:], bounds_v[count:], split[count:]


def first_boxes(axes: Sequence[Axis], counts: Sequence[int], interchangeable: int) -> Boxes:
    """The whole box split into `counts` parts per axis, one for an axis of zero width."""
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
    """The halves that can be in order, and the box each belongs to."""
    rows = np.arange(len(boxes))
    middle = np.sum(boxes[rows, split], axis=1) / 2
    lower, upper = boxes.copy(), boxes.copy()
    lower[rows, split, 1] = middle
    upper[rows, split, 0] = middle
    halves = np.concatenate([lower, upper])
    in_order = _are_in_order(halves, interchangeable)
    return halves[in_order], np.tile(rows, 2)[in_order]


def _are_in_order(boxes: Boxes, interchangeable: int) -> Bool[np.ndarray, "boxes"]:
    """True for boxes in which the scales of interchangeable pairs can be in rising order."""
    count = max(interchangeable, 1)
    first, second = boxes[:, : count - 1], boxes[:, 1:count]
    rises = (first[..., 0] < second[..., 1]) | np.all(first == second, axis=2)
    return np.all(rises, axis=1)


# In x = log(s / tau) a pair's kernel is exp(x - exp(x)); this is the integral of the absolute
# value of its third derivative, rounded up. The RMS of a response's third derivative in log(tau) is
# at most this times the current's at some time earlier.
THIRD_DERIVATIVE = 1.78302
# Error of the parabola through the ends and the middle of an interval, in (half width)^3 times the
# largest third derivative; and the largest factor by which it adds up errors of the three values.
PARABOLA = 1 / (9 * 3**0.5)
LEBESGUE = 1.25


def beyond_parabola(
    derivatives: Float[np.ndarray, "2 width"], half_width: Float[np.ndarray, "*boxes"] | float
) -> Float[np.ndarray, "_"]:
    """A bound on any unit y times the difference of a column from the parabola, given its
    `remainders`."""
    third, error = derivatives
    return PARABOLA * third * half_width**3 + LEBESGUE * error


def lowest_of_parabola(
    below: Float[np.ndarray, "_"], middle: Float[np.ndarray, "_"], above: Float[np.ndarray, "_"]
) -> Float[np.ndarray, "_"]:
    """The least value of the parabolas through the lower end, the middle and the upper end."""
    slope, bend = (above - below) / 2, (above + below) / 2 - middle
    # Lowest where the slope vanishes, or at an end.
    is_between = bend > np.abs(slope) / 2
    lowest = middle - slope**2 / np.where(is_between, 4 * bend, 1.0)
    return np.where(is_between, lowest, np.minimum(below, above))


def remainders(
    prepared_records: Sequence[PreparedRecord], axes: Sequence[Axis], nodes: Sequence[float]
) -> list[Float[np.ndarray, "2 _"]]:
    """For each axis's columns: bounds on the RMS of their third derivative by the scale, and on
    that of their own error."""

    def shares_of_current(part: PreparedRecord) -> Float[np.ndarray, "samples nodes"]:
        return hats(part.soc, nodes) * part.held_a[:, None]

    largest_a, _ = _largest_and_rms(prepared_records, shares_of_current)
    rms_a = np.minimum(largest_a, earlier_rms(prepared_records, shares_of_current))
    of_axes = []
    for axis in axes:
        largest, rms = largest_a, rms_a
        if axis.sign < 0:

            def amplitude(part: PreparedRecord, table: int | None = axis.table):
                measured_v = part.hysteresis_amplitude_v
                if table is None and measured_v is not None:
                    return part.scored[:, None] * measured_v[:, None]
                return part.scored[:, None] * hats(part.soc, nodes)

            # The input of the hysteresis is at most 2, from one direction to the other.
            largest, rms = (2 * bound for bound in _largest_and_rms(prepared_records, amplitude))
        of_axes.append(np.array([THIRD_DERIVATIVE * rms, axis.span.error * largest]))
    return of_axes


def _largest_and_rms(
    prepared_records: Sequence[PreparedRecord],
    signals: Callable[[PreparedRecord], Float[np.ndarray, "samples signals"]],
) -> tuple[Float[np.ndarray, "signals"], Float[np.ndarray, "signals"]]:
    """The largest magnitudes of signals, and their root mean squares over the scored samples."""
    largest, squares, scored = np.zeros(1), np.zeros(1), 0
    for prepared in prepared_records:
        for part in prepared.parts(BLOCK):
            values = signals(part)[:BLOCK]
            largest = np.maximum(largest, np.max(np.abs(values), axis=0))
            squares = squares + np.sum(values**2, axis=0)
        scored += int(np.count_nonzero(prepared.scored))
    return largest, np.sqrt(squares / scored)


def earlier_rms(
    prepared_records: Sequence[PreparedRecord],
    signals: Callable[[PreparedRecord], Float[np.ndarray, "samples signals"]],
) -> Float[np.ndarray, "signals"]:
    """Bounds on the RMS of signals, such as the current, at any fixed time before the scored
    samples.

    A signal is held from a sample to the next. An interval counts as often as samples can lie at
    that time after it: at most as many as any window of its length contains.
    """
    squares, scored = np.zeros(1), 0
    for prepared in prepared_records:
        scored_s = prepared.time_s if np.all(prepared.scored) else prepared.time_s[prepared.scored]
        most: dict[float, int] = {}
        for part in prepared.parts(BLOCK):
            # Few distinct lengths, none of them shortened.
            length_s = np.exp2(np.ceil(8 * np.log2(np.diff(part.time_s))) / 8)
            lengths_s, kind = np.unique(length_s, return_inverse=True)
            for run_s in lengths_s.tolist():
                if run_s not in most:
                    most[run_s] = _most_within(scored_s, run_s)
            counts = np.array([most[run_s] for run_s in lengths_s.tolist()])[kind]
            squares = squares + counts @ signals(part)[:-1] ** 2
        scored += len(scored_s)
    return np.sqrt(squares / scored)


def _most_within(time_s: Float[np.ndarray, "samples"], length_s: float) -> int:
    """The most samples that a half-open window of that length contains."""
    return max(
        int(np.max(np.searchsorted(time_s, here + length_s) - first - np.arange(len(here))))
        for first in range(0, len(time_s), BLOCK)
        for here in [time_s[first : first + BLOCK]]
    )

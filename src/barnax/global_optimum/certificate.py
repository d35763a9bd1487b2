"""A proof that no circuit of a box fits much better: branch and bound over the time constants.

With y any unit vector, |e| >= y.e for the error e of every circuit. Over a cell of time constants
that is at least y.base plus, for R0 and for each axis, the least of r y.phi over the resistances
and the places u of the cell: numbers, since each phi varies along one axis only. Along it y.phi(u)
is the parabola through three places up to a remainder that the third derivative bounds. Cells whose
bound is too low are split.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ..blas import one_blas_thread
from ..cell import CircuitParameters
from ..model.box_least_squares import least_in_boxes
from .reduced import Axis, Columns, Reduced, dot, errors_of, normal_equations

# In x = log(s / tau) a pair's kernel is exp(x - exp(x)); this is the integral of the absolute
# value of its third derivative, rounded up. The RMS of a response's third derivative in log(tau) is
# at most this times the current's at some time earlier.
THIRD_DERIVATIVE = 1.78302
# Error of the parabola through the ends and the middle of an interval, in (half width)^3 times the
# largest third derivative; and how it can add up errors of the three values.
PARABOLA = 1 / (9 * 3**0.5)
LEBESGUE = 1.25
# The compressed form agrees with the scan to the larger of these.
RELATIVE, ABSOLUTE_V = 1e-9, 1e-12

# Nothing measured comes near this: a smaller error counts as one of this size.
SMALLEST_RMSE_V = 1e-8

# Places are counted in 2^-40 of an axis, so that halves of halves are the same numbers.
UNITS = 2**40
# Cells an axis to begin with, and how many are split at a time.
FIRST_CELLS = 8
BATCH = 2048
# A proved gap up to the first is a certificate. It is made as narrow as the second where that
# takes few cells.
CERTIFIED_GAP = 1e-3
NARROW_GAP = 1e-5
FEW_CELLS = 4096

Cells = Int[np.ndarray, "cells axes ends"]


@dataclass(frozen=True)
class Certificate:
    """No circuit in the box has an RMSE below `lower_bound_v`; `cells` were needed to show it.

    `better` is a circuit that was met on the way and fits better than the one to be certified:
    the search for a proof ends there.
    """

    lower_bound_v: float
    cells: int
    better: CircuitParameters | None = None


def certify(reduced: Reduced, rmse_v: float, most_cells: int) -> Certificate:
    """How far below `rmse_v`, which some circuit in the box has, any circuit there could be.

    It goes on to a gap of `NARROW_GAP`, or of `CERTIFIED_GAP` where the former needs more than
    `FEW_CELLS` cells, or until `most_cells` have been looked at.
    """
    # One thread: what a library does with several would change the last bits.
    with one_blas_thread():
        return _branch(reduced, rmse_v, most_cells)


def _branch(reduced: Reduced, rmse_v: float, most_cells: int) -> Certificate:
    slack_v = max(RELATIVE * rmse_v, ABSOLUTE_V)
    cells = _first_cells(reduced)
    bounds_v, split, better = _bound(reduced, cells, rmse_v)
    seen = len(cells)
    while better is None:
        order = np.argsort(bounds_v, kind="stable")
        cells, bounds_v, split = cells[order], bounds_v[order], split[order]
        is_cheap = seen < FEW_CELLS and rmse_v > SMALLEST_RMSE_V
        gap = NARROW_GAP if is_cheap else CERTIFIED_GAP
        target_v = rmse_v - gap * max(rmse_v, SMALLEST_RMSE_V)
        low = int(np.searchsorted(bounds_v, target_v + slack_v))
        taken = min(low, BATCH, most_cells - seen)
        if target_v <= 0 or taken <= 0:
            break
        halves = _halves(cells[:taken], split[:taken], reduced)
        new_v, new_split, better = _bound(reduced, halves, rmse_v)
        seen += len(halves)
        cells = np.concatenate([cells[taken:], halves])
        bounds_v = np.concatenate([bounds_v[taken:], new_v])
        split = np.concatenate([split[taken:], new_split])
    return Certificate(max(0.0, float(np.min(bounds_v)) - slack_v), seen, better)


def _first_cells(reduced: Reduced) -> Cells:
    step = UNITS // FIRST_CELLS
    axes = [
        [(first, first + step) for first in range(0, UNITS, step)]
        if axis.high > axis.low
        else [(0, UNITS)]
        for axis in reduced.axes
    ]
    return _in_order(np.array(list(itertools.product(*axes)), np.int64), reduced)


def _halves(
    cells: Cells, split: Int[np.ndarray, "cells"], reduced: Reduced
) -> Int[np.ndarray, "halves axes ends"]:
    rows = np.arange(len(cells))
    middle = np.sum(cells[rows, split], axis=1) // 2
    lower, upper = cells.copy(), cells.copy()
    lower[rows, split, 1] = middle
    upper[rows, split, 0] = middle
    return _in_order(np.concatenate([lower, upper]), reduced)


def _in_order(cells: Cells, reduced: Reduced) -> Int[np.ndarray, "ordered axes ends"]:
    """Those cells that hold a circuit whose pairs, if of one box, are in order."""
    if not reduced.ordered:
        return cells
    taus = cells[:, : reduced.ordered]
    return cells[np.all(taus[:, :-1, 0] < taus[:, 1:, 1], axis=1)]


def _bound(
    reduced: Reduced, cells: Cells, rmse_v: float
) -> tuple[Float[np.ndarray, "cells"], Int[np.ndarray, "cells"], CircuitParameters | None]:
    """What no error in a cell is below, the axis to split it along, and a better circuit if met.

    The first y is the direction of the error at the middle of the cell, with the resistances best
    there. To first order that error has no slope in free resistances, but what y.phi loses over
    the cell would let them grow to their limits; so the second y is the direction of an error
    with just so much slope in them.
    """
    sides = [_Side.of(axis, cells[:, index]) for index, axis in enumerate(reduced.axes)]
    low, middle, high = (np.stack([side.places[end] for side in sides]) for end in range(3))
    allowed = reduced.coefficient_box(low)[0], reduced.coefficient_box(high)[1]
    box = reduced.coefficient_box(middle)
    base = np.broadcast_to(reduced.base, (len(cells), len(reduced.base)))
    columns = [np.broadcast_to(reduced.current, base.shape), *(side.responses[1] for side in sides)]
    normal, gradient = normal_equations(columns, base)

    found = least_in_boxes(normal, gradient, *box)
    errors_v = errors_of(columns, base, found)
    at_middle_v = np.linalg.norm(errors_v, axis=1)
    bounds_v, loss = _dual(errors_v, base, columns[0], sides, allowed)
    better = None
    best = int(np.argmin(at_middle_v))
    if at_middle_v[best] < rmse_v * (1 - NARROW_GAP) - ABSOLUTE_V:
        better = reduced.circuit(middle[:, best], found[:, best])

    # A little more slope than needed leaves free resistances at their lower limits, which cost
    # far less than the upper ones.
    tilted = least_in_boxes(normal, gradient - 1.05 * at_middle_v * loss, *box)
    errors_v = errors_of(columns, base, tilted)
    tilted_v, loss = _dual(errors_v, base, columns[0], sides, allowed)
    split = np.argmax((np.abs(tilted) * loss)[1:], axis=0)
    return np.maximum(bounds_v, tilted_v), split, better


@dataclass(frozen=True, eq=False)
class _Side:
    """One axis of many cells: lower end, middle and upper end, and the responses there.

    `remainder` bounds how far y.phi can be below the parabola through the three, for any unit y.
    """

    places: Float[np.ndarray, "three cells"]
    responses: tuple[Columns, Columns, Columns]
    remainder: Float[np.ndarray, "cells"]

    @classmethod
    def of(cls, axis: Axis, ends: Int[np.ndarray, "cells ends"]) -> "_Side":
        three = np.stack([ends[:, 0], np.sum(ends, axis=1) // 2, ends[:, 1]])
        distinct, index = np.unique(three, return_inverse=True)
        index = index.reshape(three.shape)
        places = axis.low + (axis.high - axis.low) * (distinct / UNITS)
        table = axis.columns(places)
        places = places[index]
        half_width = (places[2] - places[0]) / 2
        third = THIRD_DERIVATIVE * axis.input_rms
        remainder = PARABOLA * third * half_width**3 + LEBESGUE * axis.error
        return cls(places, (table[index[0]], table[index[1]], table[index[2]]), remainder)

    def least(
        self, direction: Columns
    ) -> tuple[Float[np.ndarray, "cells"], Float[np.ndarray, "cells"]]:
        """What y.phi is never below in a cell, and how far that is below its middle."""
        below, middle, above = (dot(direction, responses) for responses in self.responses)
        least = lowest_of_parabola(below, middle, above) - self.remainder
        return least, middle - least


def lowest_of_parabola(
    below: Float[np.ndarray, "_"], middle: Float[np.ndarray, "_"], above: Float[np.ndarray, "_"]
) -> Float[np.ndarray, "_"]:
    """The least value of the parabolas through the lower end, the middle and the upper end."""
    slope, bend = (above - below) / 2, (above + below) / 2 - middle
    # Lowest where the slope vanishes, or at an end.
    is_between = bend > np.abs(slope) / 2
    lowest = middle - slope**2 / np.where(is_between, 4 * bend, 1.0)
    return np.where(is_between, lowest, np.minimum(below, above))


def _dual(errors_v: Columns, base: Columns, current: Columns, sides, allowed):
    """The bound that the direction of an error gives, and what y.phi loses over each cell."""
    size_v = np.linalg.norm(errors_v, axis=1)
    direction = errors_v / np.where(size_v > 0, size_v, 1.0)[:, None]
    ohmic = dot(direction, current)
    pairs = [side.least(direction) for side in sides]
    slopes = np.stack([ohmic, *(least for least, _ in pairs)])
    loss = np.stack([np.zeros_like(ohmic), *(lost for _, lost in pairs)])
    low, high = allowed
    bounds_v = dot(direction, base) + np.sum(np.minimum(low * slopes, high * slopes), axis=0)
    return bounds_v, loss

"""A proof that no time constants in a box give tables that fit much better: branch and bound.

In a box of time constants around m the error is e = base + sum_p A_p(u_p) x_p with one u_p for all
nodes of a table. Two relaxations make that convex. First, each node may have its own u, so that its
column is any mixture of the box's. That alone lets sqrt(J) fall in proportion to the box's width;
so the nodes' freedom is taxed with multipliers mu: as (u_pj - u_p) x_pj is zero for every true
circuit, J = J + sum mu_pj (u_pj - m_p) x_pj - sum mu_pj (u_p - m_p) x_pj. The minimum of that over
the relaxed circuits is concave in (u_p - m_p), so the lowest of its values at the corners of the
box is a lower bound. With mu the slopes of J at the best circuit of m, nothing of first order is
lost. Without taxes all corners coincide; far from the best circuit that bound is mostly enough, so
it is tried first.

At a corner, any vectors y, z give J >= 2 (y.e + z.P x) - |y|^2 - |z|^2, linear in x: a bound where
no x has a negative coefficient, whatever the node's u. Along u that coefficient is the parabola
through three points up to a remainder that the third derivative bounds. y and z come from a convex
program with both ends' columns; a second one, tilted by what the first lacked, makes the
coefficients positive. Any negative part left is charged with the largest x that a better circuit
could have, which its penalty limits.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from ..global_optimum.proof import (
    Boxes,
    Proof,
    beyond_parabola,
    first_boxes,
    lowest_of_parabola,
    prove,
    remainders,
)
from ..model.box_least_squares import least_in_box
from ..model.descent import Axis, Polished, polish
from ..model.search_space import Range
from .objective import Solution, TableObjective

# Width of the first boxes in the logarithm of a time constant: wider ones seldom have a bound.
FIRST_WIDTH = 0.4
# A circuit met on the way counts as better if its sqrt(J) is lower by more than this share.
BETTER = 1e-9
# A little more tilt than was lacking, because the second program has an error of its own.
TILT = 1.05
# Added to the squared length of a table's columns: makes mixtures of equal columns unique.
RIDGE = 1e-12
# Convex programs per corner, each tilted by what the last one lacked.
PROGRAMS = 3


def certify(objective: Any, best: Polished, alone_v: Sequence[float] = (0.0,)) -> Proof[Polished]:
    """A bound on how far below the best known tables any others in the box could be.

    Boxes are split until the bound is within `settings.proved_share`, or until `settings.max_boxes`
    boxes have been examined; nothing is proved if the first boxes would already be half of those.
    `alone_v` are lower bounds of each part of the objective by itself; in every box each part has
    to reach its share of the required bound.
    """
    settings, alike = objective.settings, objective.interchangeable
    counts = [math.ceil((axis.high - axis.low) / FIRST_WIDTH) for axis in objective.axes]
    first = first_boxes(objective.axes, counts, alike)
    # A proof over more axes would take too long.
    if len(first) > settings.max_boxes / 2:
        return Proof(0.0, 0, best)
    relaxed = [_Relaxation(part) for _, part, _ in objective.parts_at(best)]

    def bound(box: Sequence[Range], enough: float) -> float:
        nonlocal best
        middle = objective.solve(tuple((low + high) / 2 for low, high in box))
        # A little more, or rounding could leave the sum short of what is enough.
        wanted, total = (1 + 1e-12) * enough, 0.0
        parts = zip(objective.parts_at(middle), relaxed, alone_v, strict=True)
        for (weight, _, solution), part, least_v in parts:
            lowest_v2 = least_v**2
            if wanted < middle.objective_v2:
                share = wanted * (solution.objective_v2 / middle.objective_v2)
                bound_v2 = part.bound(box, solution, best.objective_v2 / weight, share)
                lowest_v2 = max(lowest_v2, bound_v2)
            total += weight * lowest_v2
        if middle.rms_v < best.rms_v * (1 - BETTER):
            met = polish(objective, middle)
            exact = objective.solve(met.log_scales, met.active_set, exact=True)
            # Put in order of time constant, pairs whose resistances have different bounds may fit
            # less well.
            best = min(best, exact, key=lambda end: end.objective_v2)
        return math.sqrt(total)

    def kernel(boxes: Boxes, enough_v: float):
        bounds_v = [bound(box, max(enough_v, 0.0) ** 2) for box in boxes.tolist()]
        return np.array(bounds_v), np.argmax(boxes[..., 1] - boxes[..., 0], axis=1), best.rms_v

    share = settings.proved_share
    proved = prove(first, kernel, best.rms_v, lambda *_: share, alike, 1, settings.max_boxes)
    return Proof(*proved, best)


@dataclass(frozen=True, eq=False)
class _BoxAxis:
    """One axis of a box: its columns at the lower end, the middle and the upper end.

    `tax` are the multipliers of each node's scale, `remainder` bounds on the contribution of the
    third derivative to y.columns and on its error, for any unit y.
    """

    axis: Axis
    half_width: float
    three: Float[np.ndarray, "three rows width"]
    tax: Float[np.ndarray, "width"]
    remainder: Float[np.ndarray, "width"]

    @classmethod
    def of(cls, axis: Axis, ends: Range, middle: Solution, derivatives: np.ndarray, scale: float):
        half_width = (ends[1] - ends[0]) / 2
        three = np.stack([axis.columns_at(at) for at in (ends[0], scale, ends[1])])
        tax = -2 * (middle.error @ axis.slopes_at(scale))
        return cls(axis, half_width, three, tax, beyond_parabola(derivatives, half_width))

    def least(
        self, error: Float[np.ndarray, "rows"], tax: Float[np.ndarray, "width"]
    ) -> Float[np.ndarray, "width"]:
        """A lower bound of 2 y.columns(u) + tax (u - middle) / half width in the box."""
        below, middle, above = 2 * (error @ self.three) + np.array([[-1.0], [0.0], [1.0]]) * tax
        lowest = lowest_of_parabola(below, middle, above)
        return lowest - 2 * float(np.linalg.norm(error)) * self.remainder


@dataclass(frozen=True, eq=False)
class _Relaxation:
    """Lower bounds of J in boxes of an objective."""

    objective: TableObjective

    @cached_property
    def remainders(self) -> Sequence[Float[np.ndarray, "2 _"]]:
        objective = self.objective
        nodes = objective.reduced.layout.nodes
        return remainders(objective.prepared_records, objective.axes, nodes)

    def bound(
        self, box: Sequence[Range], middle: Solution, objective_v2: float, enough: float
    ) -> float:
        """A bound for tables with at most `objective_v2`; `middle` are the best tables at the
        middle of the box.

        Work stops as soon as the bound reaches `enough`; the bound is 0 if it cannot.
        """
        objective = self.objective
        box_axes = [
            _BoxAxis.of(axis, ends, middle, derivatives, scale)
            for axis, ends, derivatives, scale in zip(
                objective.axes, box, self.remainders, middle.log_scales, strict=True
            )
        ]
        fixed = objective.fixed_columns
        # The first block of a table with an axis is for the box's lower end; a second block, after
        # all tables, is for the upper end. The penalty is on their sum.
        lower, upper, upper_penalty, ends = dict(fixed), [], [], []
        base, low, high = objective.base, *(limit.copy() for limit in objective.box)
        # Both blocks of every axis that has a table.
        pairs: dict[int, tuple[slice, slice]] = {}
        for number, box_axis in enumerate(box_axes):
            table, start = box_axis.axis.table, len(low) + len(ends)
            if table is None:
                base = base + box_axis.three[0, :, 0]
                if not box_axis.half_width:
                    continue
                upper.append(box_axis.three[2] - box_axis.three[0])
                upper_penalty.append(np.zeros((len(objective.penalty), 1)))
                ends.append(1.0)
            else:
                lower[table] = fixed.get(table, 0.0) + box_axis.three[0]
                upper.append(fixed.get(table, 0.0) + box_axis.three[2])
                block = objective.block(table)
                upper_penalty.append(objective.penalty[:, block])
                low[block] = 0.0
                ends += [math.inf] * objective.nodes
                pairs[number] = block, slice(start, start + objective.nodes)
        columns = [lower[table] for table in range(objective.tables)]
        columns = np.concatenate(columns + upper, axis=1)
        penalty = np.concatenate([objective.penalty, *upper_penalty], axis=1)
        low = np.append(low, np.zeros(len(ends)))
        high = np.append(high, ends)
        normal = columns.T @ columns + penalty.T @ penalty
        normal[np.diag_indices_from(normal)] *= 1 + RIDGE
        gradient = columns.T @ base
        limits = self._limits(objective_v2)

        guess, size = None, float(np.linalg.norm(middle.error))

        def at_corner(box_axes: Sequence[_BoxAxis], signs: Sequence[float]) -> float:
            nonlocal guess
            cost = np.zeros(len(gradient))
            for number, (first, second) in pairs.items():
                box_axis = box_axes[number]
                tilt, tax = 2 * size * box_axis.remainder, box_axis.tax * box_axis.half_width
                cost[first] = -tax * (1 + signs[number]) - tilt
                cost[second] = tax * (1 - signs[number]) - tilt
            best = 0.0
            for _ in range(PROGRAMS):
                x, guess = least_in_box(normal, gradient + cost / 2, low, high, guess)
                value, lacking = self._dual(
                    base + columns @ x, penalty @ x, box_axes, signs, limits
                )
                best = max(best, value)
                if best >= enough:
                    break
                for number, both in pairs.items():
                    for block in both:
                        cost[block] -= TILT * lacking[number]
            return best

        untaxed = [replace(box_axis, tax=np.zeros_like(box_axis.tax)) for box_axis in box_axes]
        lowest = at_corner(untaxed, [0.0] * len(box_axes))
        if lowest >= enough:
            return lowest
        lowest = math.inf
        is_open = [
            box_axis.half_width > 0 and box_axis.axis.table is not None for box_axis in box_axes
        ]
        for signs in itertools.product(
            *((-1.0, 1.0) if can_tilt else (0.0,) for can_tilt in is_open)
        ):
            lowest = min(lowest, at_corner(box_axes, signs))
            if lowest < enough:
                return 0.0
        return lowest

    def _dual(self, error, bent, box_axes: Sequence[_BoxAxis], signs, limits):
        """The bound on J from an error and a penalty, and the shortfall of each axis's slopes."""
        objective = self.objective
        slope = 2 * (bent @ objective.penalty)
        value = float(2 * error @ objective.base - error @ error - bent @ bent)
        for table, columns in objective.fixed_columns.items():
            slope[objective.block(table)] += 2 * (error @ columns)
        lacking = {}
        for number, (box_axis, sign) in enumerate(zip(box_axes, signs, strict=True)):
            if box_axis.axis.table is None:
                value += float(box_axis.least(error, np.zeros(1))[0])
            else:
                tax = box_axis.tax * box_axis.half_width
                of_table = slope[objective.block(box_axis.axis.table)]
                of_table += box_axis.least(error, tax) - sign * tax
                lacking[number] = np.maximum(-of_table, 0.0)
        low, high = limits
        return value + float(np.sum(np.minimum(low * slope, high * slope))), lacking

    def _limits(self, objective_v2: float) -> tuple[np.ndarray, np.ndarray]:
        """The lowest and highest value of every unknown of tables with at most this J."""
        furthest, (low, high) = self.objective.furthest(objective_v2), self.objective.box
        return np.maximum(low, -furthest), np.minimum(high, furthest)

"""A proof that no time constants of a box give tables that fit much better: branch and bound.

In a cell of time constants around m the error is e = base + sum_p A_p(u_p) x_p with one u_p for
all nodes of a table. Two relaxations make that convex. First each node may have a u of its own, so
that its column is any mixture of the cell's. That alone lets sqrt(J) fall in proportion to the
cell's width; so the nodes' freedom is taxed with multipliers mu: as (u_pj - u_p) x_pj is zero for
every true circuit, J = J + sum mu_pj (u_pj - m_p) x_pj - sum mu_pj (u_p - m_p) x_pj. The least of
that over the relaxed circuits is concave in (u_p - m_p), so the lowest of its values at the corners
of the cell is a lower bound. With mu the slopes of J at the best circuit of m, nothing of first
order is lost.

At a corner, any vectors y, z give J >= 2 (y.e + z.P x) - |y|^2 - |z|^2, linear in x: a bound where
no x has a negative coefficient, whatever the node's u. Along u that coefficient is the parabola
through three places up to a remainder that the third derivative bounds. y and z come from a convex
program with both ends' columns; a second one, tilted by what the first lacked, makes the
coefficients positive. What is still negative is paid for with the largest x that any better circuit
could have, which its penalty limits.
"""

import heapq
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..cell.tables import hats
from ..global_optimum.certificate import (
    ABSOLUTE_V,
    LEBESGUE,
    PARABOLA,
    RELATIVE,
    SMALLEST_RMSE_V,
    THIRD_DERIVATIVE,
    lowest_of_parabola,
)
from ..global_optimum.reduced import earlier_rms
from ..model.box_least_squares import least_in_box
from ..model.compressed import BLOCK
from ..model.prepared import PreparedRecord
from ..model.search_space import Range
from .axes import Axis
from .objective import Objective, Solution
from .search import Found, Searchable, alike_pairs, polish
from .settings import TableSettings

# Width of the first cells in the logarithm of a time constant: few wider ones have a bound.
FIRST_WIDTH = 0.4
# A circuit met on the way counts as better from this share of sqrt(J) on.
BETTER = 1e-9
# A little more tilt than was lacking, for the second program's own error is another one.
TILT = 1.05
# Of the squared length of a table's columns: makes mixtures of equal columns unique.
RIDGE = 1e-12
# Convex programs a corner, each tilted by what the last one lacked.
PROGRAMS = 6

Cell = tuple[tuple[float, float], ...]
# Of a cell, the best square known and what would be enough: a bound, and what its middle gives.
Bound = Callable[[Cell, float, float], tuple[float, Found]]


@dataclass(frozen=True, eq=False)
class Proof:
    """No tables in the box have a sqrt(J) below `lower_bound_v`; `best` has the lowest met."""

    lower_bound_v: float
    cells: int
    best: Solution


def certify(objective: Objective, best: Solution) -> Proof:
    """How far below the best known tables any in the box could be.

    It goes on until that is within `settings.proved_share`, or until `settings.most_cells` cells
    have been looked at; nothing is proved where the first ones would be half of those.
    """

    def relax() -> "Bound[Solution]":
        return _Relaxation(objective, _remainders(objective)).bound

    return Proof(*_branch(objective, objective.settings, relax, best))


def certify_together(
    together: Searchable[Found],
    parts: Sequence[tuple[float, Objective, Proof]],
    best: Found,
    part_squares: Callable[[Found], Sequence[float]],
) -> tuple[float, int, Found]:
    """The same for the weighted sum of objectives in one box: a bound on its root in V, the cells
    looked at, and the best met.

    `parts` have each one's weight and what is proved of it alone; `part_squares` are their own
    squares at a solution. In every cell each is asked for its share of what is enough.
    """
    settings = parts[0][1].settings

    def relax() -> "Bound[Found]":
        relaxed = [
            (weight, proof.lower_bound_v**2, _Relaxation(objective, _remainders(objective)))
            for weight, objective, proof in parts
        ]

        def bound(cell: Cell, squared: float, enough: float) -> tuple[float, Found]:
            middle = together.solve(tuple((low + high) / 2 for low, high in cell))
            # A little more, or the sum would miss what is enough by its last bit.
            share = (1 + 1e-12) * enough / middle.squared
            total = 0.0
            for (weight, alone, each), own in zip(relaxed, part_squares(middle), strict=True):
                found = each.bound(cell, squared / weight, share * own)[0] if share < 1 else 0.0
                total += weight * max(found, alone)
            return total, middle

        return bound

    return _branch(together, settings, relax, best)


def _branch(
    objective: Searchable[Found],
    settings: TableSettings,
    relax: "Callable[[], Bound[Found]]",
    best: Found,
) -> tuple[float, int, Found]:
    """What the root of J is never below in V, how many cells that took, and the best met."""
    first = _first_cells(objective)
    # More axes than a proof has the time for.
    if len(first) > settings.most_cells / 2:
        return 0.0, 0, best
    bound = relax()
    waiting, cells, seen = [], [(0.0, cell) for cell in first], 0
    while True:
        root = math.sqrt(best.squared)
        slack_v = max(RELATIVE * root, ABSOLUTE_V)
        wanted_v = root - settings.proved_share * max(root, SMALLEST_RMSE_V)
        enough = max(wanted_v + slack_v, 0.0) ** 2
        for parent, cell in cells:
            squared, middle = bound(cell, best.squared, enough)
            # What holds for a cell holds for its parts.
            heapq.heappush(waiting, (max(squared, parent), cell))
            if math.sqrt(middle.squared) < root * (1 - BETTER):
                found = polish(objective, middle)
                best = objective.solve(found.place, found.sides, exact=True)
                root = math.sqrt(best.squared)
        seen += len(cells)
        lowest, cell = waiting[0]
        if lowest >= enough or wanted_v <= 0 or seen >= settings.most_cells:
            return max(0.0, min(math.sqrt(lowest) - slack_v, root)), seen, best
        heapq.heappop(waiting)
        cells = [(lowest, half) for half in _halves(cell, objective)]


def _first_cells(objective: Searchable) -> list[Cell]:
    sides = []
    for axis in objective.axes:
        count = max(1, math.ceil((axis.high - axis.low) / FIRST_WIDTH))
        edges = np.linspace(axis.low, axis.high, count + 1).tolist()
        sides.append(itertools.pairwise(edges))
    return [cell for cell in itertools.product(*sides) if _holds_one(cell, objective)]


def _halves(cell: Cell, objective: Searchable) -> list[Cell]:
    """The cell halved along its widest side."""
    widest = max(range(len(cell)), key=lambda index: cell[index][1] - cell[index][0])
    low, high = cell[widest]
    middle = (low + high) / 2
    halves = [
        (*cell[:widest], half, *cell[widest + 1 :]) for half in ((low, middle), (middle, high))
    ]
    return [half for half in halves if _holds_one(half, objective)]


def _holds_one(cell: Cell, objective: Searchable) -> bool:
    """Whether the cell holds time constants that are in order, where all pairs have one box."""
    taus = cell[: alike_pairs(objective)]
    return all(
        first[0] < second[1] or first == second for first, second in itertools.pairwise(taus)
    )


def _remainders(objective: Objective) -> list[Float[np.ndarray, "2 _"]]:
    """Of each axis's columns: bounds on the RMS of their third derivative by the place, and on
    that of their own error."""
    nodes, prepared_records = objective.reduced.layout.nodes, objective.prepared_records

    def shares_of_current(part: PreparedRecord) -> Float[np.ndarray, "samples nodes"]:
        return hats(part.soc, nodes) * part.held_a[:, None]

    largest_a, _ = _largest_and_rms(prepared_records, shares_of_current)
    rms_a = np.minimum(largest_a, earlier_rms(prepared_records, shares_of_current))
    found = []
    for axis in objective.axes:
        largest, rms = largest_a, rms_a
        if axis.direction < 0:

            def amplitude(part: PreparedRecord, table: int | None = axis.table):
                measured_v = part.hysteresis_amplitude_v
                if table is None and measured_v is not None:
                    return part.scored[:, None] * measured_v[:, None]
                return part.scored[:, None] * hats(part.soc, nodes)

            # What moves the hysteresis is at most 2, from one direction to the other.
            largest, rms = (2 * each for each in _largest_and_rms(prepared_records, amplitude))
        found.append(np.array([THIRD_DERIVATIVE * rms, axis.span.error * largest]))
    return found


def _largest_and_rms(
    prepared_records: Sequence[PreparedRecord],
    signals: Callable[[PreparedRecord], Float[np.ndarray, "samples signals"]],
) -> tuple[Float[np.ndarray, "signals"], Float[np.ndarray, "signals"]]:
    """The largest magnitudes of signals, and the roots of their squares for each scored sample."""
    largest, squares, scored = np.zeros(1), np.zeros(1), 0
    for prepared in prepared_records:
        for part in prepared.parts(BLOCK):
            values = signals(part)[:BLOCK]
            largest = np.maximum(largest, np.max(np.abs(values), axis=0))
            squares = squares + np.sum(values**2, axis=0)
        scored += int(np.count_nonzero(prepared.scored))
    return largest, np.sqrt(squares / scored)


@dataclass(frozen=True, eq=False)
class _Side:
    """One axis of a cell: its columns at the lower end, the middle and the upper end.

    `tax` are the multipliers of each node's place, `remainder` bounds on the third derivative's
    part of y.columns and on its error, for any unit y.
    """

    axis: Axis
    half_width: float
    three: Float[np.ndarray, "three rows width"]
    tax: Float[np.ndarray, "width"]
    remainder: Float[np.ndarray, "width"]

    @classmethod
    def of(cls, axis: Axis, ends: Range, middle: Solution, derivatives: np.ndarray, place: float):
        half_width = (ends[1] - ends[0]) / 2
        three = np.stack([axis.columns(each) for each in (ends[0], place, ends[1])])
        third, error = derivatives
        return cls(
            axis,
            half_width,
            three,
            -2 * (middle.error @ axis.slopes(place)),
            PARABOLA * third * half_width**3 + LEBESGUE * error,
        )

    def least(
        self,
        error: Float[np.ndarray, "rows"],
        tax: Float[np.ndarray, "width"],
    ) -> Float[np.ndarray, "width"]:
        """What 2 y.columns(u) + tax (u - middle) / half width is never below in the cell."""
        below, middle, above = 2 * (error @ self.three) + np.array([[-1.0], [0.0], [1.0]]) * tax
        lowest = lowest_of_parabola(below, middle, above)
        return lowest - 2 * float(np.linalg.norm(error)) * self.remainder


@dataclass(frozen=True, eq=False)
class _Relaxation:
    """What J is never below in the cells of an objective; `derivatives` are its `_remainders`."""

    objective: Objective
    derivatives: Sequence[np.ndarray]

    def bound(self, cell: Cell, squared: float, enough: float) -> tuple[float, Solution]:
        """A bound for tables with at most `squared`, and the best tables of the cell's middle.

        No more is done for a bound than it takes to be `enough`; without a chance of that it is 0.
        """
        objective = self.objective
        middle = objective.solve(tuple((low + high) / 2 for low, high in cell))
        sides = [
            _Side.of(axis, ends, middle, derivatives, place)
            for axis, ends, derivatives, place in zip(
                objective.axes, cell, self.derivatives, middle.place, strict=True
            )
        ]
        fixed = objective.fixed_columns
        # The first block of a table with an axis is for the cell's lower end, another one, after
        # all tables, for the upper one. The penalty is on their sum.
        lower, upper, upper_penalty, ends = dict(fixed), [], [], []
        base, low, high = objective.base, *(limit.copy() for limit in objective.box)
        # Both blocks of every axis that has a table.
        pairs: dict[int, tuple[slice, slice]] = {}
        for number, side in enumerate(sides):
            table, start = side.axis.table, len(low) + len(ends)
            if table is None:
                base = base + side.three[0, :, 0]
                if not side.half_width:
                    continue
                upper.append(side.three[2] - side.three[0])
                upper_penalty.append(np.zeros((len(objective.penalty), 1)))
                ends.append(1.0)
            else:
                lower[table] = fixed.get(table, 0.0) + side.three[0]
                upper.append(fixed.get(table, 0.0) + side.three[2])
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
        limits = self._limits(squared)

        lowest, guess = math.inf, None
        size = float(np.linalg.norm(middle.error))
        is_open = [side.half_width > 0 and side.axis.table is not None for side in sides]
        for signs in itertools.product(*((-1.0, 1.0) if each else (0.0,) for each in is_open)):
            cost = np.zeros(len(gradient))
            for number, (first, second) in pairs.items():
                side = sides[number]
                tilt, tax = 2 * size * side.remainder, side.tax * side.half_width
                cost[first] = -tax * (1 + signs[number]) - tilt
                cost[second] = tax * (1 - signs[number]) - tilt
            best = 0.0
            for _ in range(PROGRAMS):
                x, guess = least_in_box(normal, gradient + cost / 2, low, high, guess)
                value, lacking = self._dual(base + columns @ x, penalty @ x, sides, signs, limits)
                best = max(best, value)
                if best >= enough:
                    break
                for number, both in pairs.items():
                    for block in both:
                        cost[block] -= TILT * lacking[number]
            lowest = min(lowest, best)
            if lowest < enough:
                return 0.0, middle
        return lowest, middle

    def _dual(self, error, bent, sides: Sequence[_Side], signs, limits):
        """The bound on J that an error and a penalty give, and what each axis's slopes lacked."""
        objective = self.objective
        slope = 2 * (bent @ objective.penalty)
        value = float(2 * error @ objective.base - error @ error - bent @ bent)
        for table, columns in objective.fixed_columns.items():
            slope[objective.block(table)] += 2 * (error @ columns)
        lacking = {}
        for number, (side, sign) in enumerate(zip(sides, signs, strict=True)):
            if side.axis.table is None:
                value += float(side.least(error, np.zeros(1))[0])
            else:
                tax = side.tax * side.half_width
                own = slope[objective.block(side.axis.table)]
                own += side.least(error, tax) - sign * tax
                lacking[number] = np.maximum(-own, 0.0)
        low, high = limits
        return value + float(np.sum(np.minimum(low * slope, high * slope))), lacking

    def _limits(self, squared: float) -> tuple[np.ndarray, np.ndarray]:
        """How far every unknown of tables with at most this J can be from zero."""
        objective = self.objective
        furthest = [
            math.sqrt(squared / (ridge * objective.share)) / weight
            for weight, ridge in objective.weights
        ]
        # A step from node to node is at most the sum of both values.
        furthest = np.repeat(furthest, [len(each) for each in objective.nodes_of]) * (
            1 + (objective.to_tables.sum(axis=0) > 1)
        )
        low, high = objective.box
        return np.maximum(low, -furthest), np.minimum(high, furthest)

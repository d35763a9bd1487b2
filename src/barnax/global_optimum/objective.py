"""The problem for given time constants: linear in all other parameters, solved exactly in its
box."""

import abc
import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from ..cell import CircuitParameters
from ..cell.elements import RC, get_element, names_beside
from ..cell.parameters import RATE
from ..model.box_least_squares import (
    ActiveSet,
    Columns,
    least_in_box,
    least_in_boxes,
    with_free_values,
)
from ..model.descent import Axis, LogScales, Solved
from ..model.layout import ends_of, spans_between
from ..model.prepared import PreparedRecord
from ..model.search_space import Bounds
from .proof import remainders

if TYPE_CHECKING:
    from ..model.problem import Problem

# Step in a logarithm for the effect of a bound in F on that of a resistance.
MOVED = 1e-4
# A slope by the logarithm of a scale below this share of J counts as zero.
FLAT = 1e-5
# Relative addition that makes the equations of equal columns definite: two pairs with one time
# constant share their resistance.
SHARED = 1e-12

# Lowest and highest value of every unknown at every point.
Box = tuple[Float[np.ndarray, "unknowns points"], Float[np.ndarray, "unknowns points"]]


@dataclass(frozen=True, eq=False)
class Solution(Solved):
    """The best tables at some scales: rows of R0, every pair's R, then the other tables.

    `unknowns` are those of the problem in a box, `error` is the remaining error.
    """

    values: tuple[Float[np.ndarray, "nodes"], ...]
    unknowns: Float[np.ndarray, "unknowns"]
    error: Float[np.ndarray, "rows"]


class LinearObjective(abc.ABC):
    """J = |base + A x|^2 + |penalty x|^2 of circuits whose unknowns x are in a box at given scales.

    A has the columns of every table. Those of an axis change along it; `fixed_columns`, by table,
    are the others and any constant part of an axis's table. An axis without a table adds to the
    base error.
    """

    base: Any
    axes: Any
    fixed_columns: Any
    # The rows whose squares are added to the mean squared error.
    penalty: Any
    # Relative increase of the diagonal of the equations.
    shared = 0.0

    @property
    @abc.abstractmethod
    def tables(self) -> int:
        """Number of tables."""

    @abc.abstractmethod
    def box_at(self, log_scales: Float[np.ndarray, "axes points"]) -> Box:
        """Lowest and highest value of every unknown at some points."""

    @abc.abstractmethod
    def values_of(self, x: Float[np.ndarray, "unknowns"]) -> tuple[Float[np.ndarray, "nodes"], ...]:
        """Every table's values from the unknowns."""

    @cached_property
    def penalty_normal(self) -> Float[np.ndarray, "unknowns unknowns"]:
        return self.penalty.T @ self.penalty

    def columns(
        self, log_scales: LogScales
    ) -> tuple[Float[np.ndarray, "rows unknowns"], Float[np.ndarray, "rows"]]:
        """Columns of all unknowns at some scales, and the base error there."""
        blocks, base = dict(self.fixed_columns), self.base
        for axis, where in zip(self.axes, log_scales, strict=True):
            if axis.table is None:
                base = base + axis.columns_at(where)[:, 0]
            else:
                blocks[axis.table] = blocks.get(axis.table, 0.0) + axis.columns_at(where)
        return np.concatenate([blocks[table] for table in range(self.tables)], axis=1), base

    def solve(
        self, log_scales: LogScales, active_set: ActiveSet | None = None, exact: bool = False
    ) -> Solution:
        """The best tables at some scales; `exact` adds the digits of the orthogonal
        factorization."""
        columns, base = self.columns(log_scales)
        low, high = (end[:, 0] for end in self.box_at(np.array(log_scales)[:, None]))
        normal = columns.T @ columns + self.penalty_normal
        normal[np.diag_indices(len(normal))] *= 1 + self.shared
        x, active_set = least_in_box(normal, columns.T @ base, low, high, active_set)
        if exact:
            whole = np.concatenate([columns, self.penalty])
            longer = np.append(base, np.zeros(len(self.penalty)))
            x = np.clip(with_free_values(whole, longer, x, active_set == 0), low, high)
        error = base + columns @ x
        bent = self.penalty @ x
        objective_v2 = float(error @ error + bent @ bent)
        return Solution(log_scales, active_set, objective_v2, self.values_of(x), x, error)

    def least_v2(self, log_scales: Float[np.ndarray, "axes points"]) -> Float[np.ndarray, "points"]:
        """The least J at many scales: for a constant circuit all at once; for tables, whose
        problems are large, each from the active set of the one before."""
        if len(self.penalty_normal) > self.tables:
            objectives_v2, active_set = np.empty(log_scales.shape[1]), None
            for index, scales in enumerate(log_scales.T.tolist()):
                solution = self.solve(tuple(scales), active_set)
                objectives_v2[index], active_set = solution.objective_v2, solution.active_set
            return objectives_v2
        # The points share few scales per axis: products of their vectors are computed once.
        first = np.zeros(log_scales.shape[1], int)
        vectors = {
            table: (column[None, :, 0], first) for table, column in self.fixed_columns.items()
        }
        base = self.base[None], first
        for axis, where in zip(self.axes, log_scales, strict=True):
            scales, at = np.unique(where, return_inverse=True)
            answers = axis.columns(scales)[:, :, 0]
            if axis.table is None:
                base = self.base + answers, at
            else:
                fixed = self.fixed_columns.get(axis.table)
                vectors[axis.table] = answers if fixed is None else answers + fixed[:, 0], at
        every = [*(vectors[table] for table in range(self.tables)), base]
        gram = np.array([[(one @ other.T)[at, to] for other, to in every] for one, at in every])
        normal = gram[:-1, :-1] + self.penalty_normal[:, :, None]
        x = least_in_boxes(normal, gram[-1, :-1], *self.box_at(log_scales))
        # For a fit to nine digits only rounding is left, which may be negative.
        whole = np.append(x, np.ones_like(x[:1]), axis=0)
        squares_v2 = np.maximum(np.einsum("ip,ijp,jp->p", whole, gram, whole), 0.0)
        return squares_v2 + np.sum((self.penalty @ x) ** 2, axis=0)

    def slope(self, best: Solution) -> Float[np.ndarray, "axes"]:
        """The derivative of the least J by the scales: that at fixed unknowns, which are
        optimal."""
        slopes = [
            axis.slopes_at(where) @ (np.ones(1) if axis.table is None else best.values[axis.table])
            for axis, where in zip(self.axes, best.log_scales, strict=True)
        ]
        return np.array([2 * float(best.error @ slope) for slope in slopes])


@dataclass(frozen=True, eq=False)
class ConstantObjective(LinearObjective):
    """The columns of a circuit with constants, scaled so that sums of squares are mean squares.

    The first `bounds.pairs` axes are the pairs', then gamma's if there is one.
    """

    base: Float[np.ndarray, "rows"]  # pyrefly: ignore
    current: Float[np.ndarray, "rows"]
    axes: tuple[Axis, ...]  # pyrefly: ignore
    bounds: Bounds
    prepared_records: tuple[PreparedRecord, ...]
    # Number of the first axes that are pairs with the same box: only circuits with tau1 <= tau2 and
    # so on are in it.
    interchangeable: int
    shared = SHARED

    @classmethod
    def of(cls, problem: "Problem") -> "ConstantObjective":
        """The columns. Raises `InputError` if the box is too wide to compress."""
        short, bounds = problem.compressed, problem.bounds
        # In NumPy: JAX would compile a program for every slice of every shape.
        factor = np.asarray(short.factor) / np.sqrt(float(short.scored))
        count = len(short.in_tau.nodes)
        in_tau, in_rate = spans_between(
            ends_of(problem.prepared_records, *problem.coordinates.spans)
        )
        answers = factor.T[:-2, :, None]
        axes = [
            Axis(names.tau, math.log(low), math.log(high), 1 + at, answers[:count], None, in_tau, 1,
                 get_element(bounds.elements[at]))
            for at, names in enumerate(bounds.element_names)
            for low, high in [bounds.tau_range_s(at)]
        ]  # fmt: skip
        if in_rate is not None and bounds.gamma_range is not None:
            low, high = map(math.log, bounds.gamma_range)
            axes.append(Axis(RATE, low, high, None, answers[count:], None, in_rate, -1, RC))
        records, alike = problem.prepared_records, bounds.interchangeable_pairs
        return cls(factor[:, -1], factor[:, -2], tuple(axes), bounds, records, alike)

    @property
    def tables(self) -> int:
        return 1 + self.bounds.pairs

    @property
    def fixed_columns(self) -> dict[int, Columns]:  # pyrefly: ignore
        return {0: self.current[:, None]}

    @cached_property
    def penalty(self) -> Float[np.ndarray, "0 unknowns"]:
        return np.empty((0, self.tables))

    @cached_property
    def remainders(self) -> list[Float[np.ndarray, "2 _"]]:
        """The allowance of a proof between the scales that it evaluates."""
        return remainders(self.prepared_records, self.axes, (0.5,))

    def fixing(self, name: str, value: float) -> "ConstantObjective":
        """A copy with one resistance, time constant, capacitance or gamma held at a value."""
        end, bounds = math.log(value), self.bounds
        axes = tuple(
            replace(axis, low=end, high=end) if axis.name == name else axis for axis in self.axes
        )
        if axes == self.axes:
            # A capacitance bounds its resistance, in addition to its previous time constants.
            others = {name, names_beside(name).tau} if name.startswith("C") else {name}
            ranges = {each: ends for each, ends in bounds.ranges.items() if each not in others}
            fixed = {each: held for each, held in bounds.fixed.items() if each not in others}
            bounds = replace(bounds, ranges=ranges, fixed={**fixed, name: value})
        return replace(self, axes=axes, bounds=bounds, interchangeable=0)

    def box_at(self, log_scales: Float[np.ndarray, "axes points"]) -> Box:
        return self.bounds.resistance_box(np.exp(log_scales[: self.bounds.pairs]))

    def coefficient_box(self, log_scales: Float[np.ndarray, "axes points"]) -> Box:
        """Lowest and highest factor of the current and the axes' columns: R0, R1, ...

        Gamma's column has the factor one.
        """
        once = np.ones((len(log_scales) - self.bounds.pairs, log_scales.shape[1]))
        low, high = (np.concatenate([end, once]) for end in self.box_at(log_scales))
        return low, high

    def values_of(self, x: Float[np.ndarray, "unknowns"]) -> tuple[Float[np.ndarray, "1"], ...]:
        return tuple(x[:, None])

    def slope(self, best: Solution) -> Float[np.ndarray, "axes"]:
        """The derivative of the least J by the scales: that at fixed resistances, plus the effect
        of a bound in F on a resistance at it."""
        slopes, bounded = super().slope(best), np.flatnonzero(best.active_set[1:]).tolist()
        if not bounded:
            return slopes
        # A resistance's bound depends on its own time constant alone, so all are moved at once.
        low, high = self.box_at(np.array(best.log_scales)[:, None] + np.array([MOVED, -MOVED]))
        above, below = np.where(best.active_set < 0, low.T, high.T)
        for index in bounded:
            pull = best.error @ self.axes[index].columns_at(best.log_scales[index])[:, 0]
            slopes[index] += 2 * pull * (above - below)[index + 1] / (2 * MOVED)
        return slopes

    def is_flat(self, best: Solution) -> bool:
        """True at the end of a descent: no significant slope except into an end of an axis."""
        slopes = self.slope(best)
        into = [
            (scale <= axis.low and slope > 0) or (scale >= axis.high and slope < 0)
            for axis, scale, slope in zip(self.axes, best.log_scales, slopes, strict=True)
        ]
        return bool(np.all(into | (np.abs(slopes) <= FLAT * best.objective_v2)))

    def circuit(self, best: Solution) -> CircuitParameters:
        """The circuit of a solution."""
        (r0, *r), scales = best.unknowns.tolist(), np.exp(best.log_scales).tolist()
        pairs = self.bounds.pairs
        rate = scales[pairs] if len(scales) > pairs else None
        return CircuitParameters.of_tau(r0, r, scales[:pairs], rate, self.bounds.elements)

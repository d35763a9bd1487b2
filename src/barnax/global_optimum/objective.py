"""The problem for given time constants: linear in the resistances, solved exactly in their box."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ..cell import CircuitParameters
from ..cell.elements import RC, get_element, names_beside
from ..cell.parameters import RATE
from ..model.axes import Axis
from ..model.box_least_squares import (
    Columns,
    Sides,
    errors_of,
    least_in_box,
    least_in_boxes,
    normal_equations,
    with_free_values,
)
from ..model.descent import LogScales, Solved
from ..model.layout import Spans
from ..model.prepared import PreparedRecord
from ..model.problem import Problem
from ..model.search_space import Bounds, Range
from .remainders import remainders

# By how much a logarithm is moved to see how a bound in F moves that of a resistance.
MOVED = 1e-4
# A slope by the logarithm of a scale is of no account below this share of J.
FLAT = 1e-5
# What makes equations of columns that are equal definite, relative.
SHARED = 1e-12


@dataclass(frozen=True, eq=False)
class ConstantSolution(Solved):
    """The best resistances at some scales: R0, R1, ... with their columns, and the errors left."""

    ohm: Float[np.ndarray, "resistances"]
    columns: Float[np.ndarray, "rows resistances"]
    error: Float[np.ndarray, "rows"]


@dataclass(frozen=True, eq=False)
class ConstantObjective:
    """The columns of a circuit with constants, scaled so that sums of squares are mean squares.

    The first `bounds.pairs` axes are the pairs', then gamma's where there is one.
    """

    base: Float[np.ndarray, "rows"]
    current: Float[np.ndarray, "rows"]
    axes: tuple[Axis, ...]
    bounds: Bounds
    prepared_records: tuple[PreparedRecord, ...]
    # Number of the first axes that are of pairs with one box: only circuits with tau1 <= tau2 and
    # so on are in it.
    interchangeable: int

    @cached_property
    def remainders(self) -> list[Float[np.ndarray, "2 _"]]:
        """The allowance of a proof between the scales that it looks at."""
        return remainders(self.prepared_records, self.axes, (0.5,))

    @classmethod
    def of(cls, problem: Problem) -> "ConstantObjective":
        """The columns. Raises `InputError` where the box is too wide to compress."""
        short, bounds = problem.compressed, problem.bounds
        # In NumPy: JAX would compile a program for every slice of every shape.
        factor = np.asarray(short.factor) / np.sqrt(float(short.scored))
        count = len(short.in_tau.nodes)
        in_tau, in_rate = Spans.of(problem.prepared_records, problem.coordinates)
        answers = factor.T[:-2, :, None]

        def axis(name: str, ends: Range, *given) -> Axis:
            return Axis(name, math.log(ends[0]), math.log(ends[1]), None, *given)

        axes = [
            axis(names.tau, bounds.tau_range_s(at), answers[:count], None, in_tau, 1, element)
            for at, (names, element) in enumerate(
                zip(bounds.element_names, map(get_element, bounds.elements), strict=True)
            )
        ]
        if in_rate is not None and bounds.gamma_range is not None:
            axes.append(axis(RATE, bounds.gamma_range, answers[count:], None, in_rate, -1, RC))
        records, alike = problem.prepared_records, bounds.interchangeable_pairs
        return cls(factor[:, -1], factor[:, -2], tuple(axes), bounds, records, alike)

    def fixing(self, name: str, value: float) -> "ConstantObjective":
        """The same with one value of a resistance, a time constant, a capacitance or gamma."""
        end, bounds = math.log(value), self.bounds
        axes = tuple(
            replace(axis, low=end, high=end) if axis.name == name else axis for axis in self.axes
        )
        if axes == self.axes:
            # A capacitance bounds its resistance, beside the time constants that it had.
            others = {name, names_beside(name).tau} if name.startswith("C") else {name}
            ranges, fixed = (
                {own: known for own, known in given.items() if own not in others}
                for given in (bounds.ranges, bounds.fixed)
            )
            bounds = replace(bounds, ranges=ranges, fixed={**fixed, name: value})
        return replace(self, axes=axes, bounds=bounds, interchangeable=0)

    def columns(self, responses: Sequence[Columns]) -> tuple[list[Columns], Columns]:
        """The columns of R0 and of every axis, which are given, at some points; the base error."""
        base = np.broadcast_to(self.base, responses[0].shape)
        return [np.broadcast_to(self.current, base.shape), *responses], base

    def coefficient_box(
        self, log_scales: Float[np.ndarray, "axes points"]
    ) -> tuple[Float[np.ndarray, "unknowns points"], Float[np.ndarray, "unknowns points"]]:
        """Least and greatest of what multiplies current and the axes' columns: R0, R1, ...

        Gamma's column counts once.
        """
        pairs = self.bounds.pairs
        ends = self.bounds.resistance_box(np.exp(log_scales[:pairs]))
        once = np.ones((len(log_scales) - pairs, log_scales.shape[1]))
        low, high = (np.concatenate([end, once]) for end in ends)
        return low, high

    def solve(
        self, log_scales: LogScales, sides: Sides | None = None, exact: bool = False
    ) -> ConstantSolution:
        """The best resistances at some scales; `exact` takes the orthogonal factorization's
        digits."""
        pairs = self.bounds.pairs
        answers = [
            axis.columns_at(scale)[:, 0] for axis, scale in zip(self.axes, log_scales, strict=True)
        ]
        columns = np.stack([self.current, *answers[:pairs]], axis=1)
        base = sum(answers[pairs:], self.base)
        low, high = self._box(log_scales)
        normal = columns.T @ columns
        # Two pairs with one time constant share their resistance.
        normal[np.diag_indices(len(normal))] *= 1 + SHARED
        ohm, sides = least_in_box(normal, columns.T @ base, low, high, sides)
        if exact:
            ohm = np.clip(with_free_values(columns, base, ohm, sides == 0), low, high)
        error = base + columns @ ohm
        return ConstantSolution(log_scales, sides, float(error @ error), ohm, columns, error)

    def least_v2(self, log_scales: Float[np.ndarray, "axes points"]) -> Float[np.ndarray, "points"]:
        """The least J at many scales, all at once."""
        answers = []
        for axis, scales in zip(self.axes, log_scales, strict=True):
            places, at = np.unique(scales, return_inverse=True)
            answers.append(axis.columns(places)[at, :, 0])
        columns, base = self.columns(answers)
        box = self.coefficient_box(log_scales)
        found = least_in_boxes(*normal_equations(columns, base), *box)
        return np.sum(errors_of(columns, base, found) ** 2, axis=1)

    def slope(self, found: ConstantSolution) -> Float[np.ndarray, "axes"]:
        """The derivative of the least J by the scales: that at fixed resistances, and where one is
        at a bound in F, what that bound moves."""
        weights = [*found.ohm[1:], 1.0]
        slopes = []
        pull = np.where(found.sides, found.error @ found.columns, 0.0)
        for place, (axis, scale) in enumerate(zip(self.axes, found.log_scales, strict=True)):
            own = weights[min(place, self.bounds.pairs)] * axis.slopes_at(scale)[:, 0]
            slope = float(found.error @ own)
            if place < self.bounds.pairs and found.sides[place + 1]:
                ends = []
                for moved in (MOVED, -MOVED):
                    at = list(found.log_scales)
                    at[place] += moved
                    low, high = self._box(at)
                    ends.append((low if found.sides[place + 1] < 0 else high)[place + 1])
                slope += pull[place + 1] * (ends[0] - ends[1]) / (2 * MOVED)
            slopes.append(2 * slope)
        return np.array(slopes)

    def is_flat(self, found: ConstantSolution) -> bool:
        """True at the end of a descent: no slope of account but into an end of an axis."""
        slopes = self.slope(found)
        into = [
            (scale <= axis.low and slope > 0) or (scale >= axis.high and slope < 0)
            for axis, scale, slope in zip(self.axes, found.log_scales, slopes, strict=True)
        ]
        return bool(np.all(into | (np.abs(slopes) <= FLAT * found.objective_v2)))

    def _box(
        self, log_scales: Sequence[float]
    ) -> tuple[Float[np.ndarray, "resistances"], Float[np.ndarray, "resistances"]]:
        """Least and greatest R0, R1, ... at some scales."""
        tau_s = np.exp(np.array(log_scales[: self.bounds.pairs]))[:, None]
        low, high = self.bounds.resistance_box(tau_s)
        return low[:, 0], high[:, 0]

    def circuit(self, found: ConstantSolution) -> CircuitParameters:
        """The circuit of a solution."""
        (r0, *r), scales = found.ohm.tolist(), np.exp(found.log_scales).tolist()
        pairs = self.bounds.pairs
        rate = scales[pairs] if len(scales) > pairs else None
        return CircuitParameters.of_tau(r0, r, scales[:pairs], rate, self.bounds.elements)

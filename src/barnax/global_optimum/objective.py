"""The problem for given time constants: linear in the resistances, solved exactly in their box."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ..cell import CircuitParameters
from ..cell.elements import RC, get_element
from ..cell.parameters import RATE
from ..model.axes import Axis
from ..model.box_least_squares import Columns
from ..model.layout import Spans
from ..model.prepared import PreparedRecord
from ..model.problem import Problem
from ..model.search_space import Bounds, Range
from .remainders import remainders


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

    @cached_property
    def remainders(self) -> list[Float[np.ndarray, "2 _"]]:
        """The allowance of a proof between the scales that it looks at."""
        return remainders(self.prepared_records, self.axes, (0.5,))

    @property
    def interchangeable(self) -> int:
        """Number of the first axes that are of pairs with one box: only circuits with tau1 <= tau2
        and so on are in it."""
        return self.bounds.interchangeable_pairs

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
        records = problem.prepared_records
        return cls(factor[:, -1], factor[:, -2], tuple(axes), bounds, records)

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

    def circuit(
        self, log_scales: Float[np.ndarray, "axes"], coefficients: Float[np.ndarray, "unknowns"]
    ) -> CircuitParameters:
        """The circuit of the scales on all axes and what multiplies the columns there."""
        pairs = self.bounds.pairs
        tau_s, gamma = np.exp(log_scales[:pairs]).tolist(), np.exp(log_scales[pairs:]).tolist()
        r0, *r = coefficients[: pairs + 1].tolist()
        rate = gamma[0] if gamma else None
        return CircuitParameters.of_tau(r0, r, tau_s, rate, self.bounds.elements)

"""Levenberg-Marquardt inside the box: many circuits of one problem refined by one program."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float, Scalar

from .cell import CircuitParameters
from .errors import InputError
from .precision import in_float64
from .problem import Kind, Objective, Problem, point_blocks, residuals, rmse_by_scan
from .programs import SEEDS_PER_BLOCK, compile_for, run_blocks, wanted_rows

# A parameter this close to an end of its box, as a fraction of the (log) width, is at the bound.
AT_BOUND = 1e-3
# Steps of one round. Who needs many rounds creeps along a valley; only the best is followed there.
STEPS = 50
# An error under a picovolt is zero; it would not do as a unit.
SMALLEST_UNIT_V = 1e-12


@dataclass(frozen=True)
class RefinedSeed:
    """Where Levenberg-Marquardt took one seed; `moved` is the largest relative parameter change.

    `evaluations` counts the simulations that took, a Jacobian as one per free parameter.
    """

    rmse_v: float
    parameters: CircuitParameters
    moved: float
    has_converged: bool
    evaluations: int = 0


class Descent:
    """Levenberg-Marquardt on one problem, compiled once for blocks of `SEEDS_PER_BLOCK` starts.

    It runs on the compressed objective, whichever the search took, unless the box is too wide for
    that or `kind` says otherwise; the errors it returns are the scan's. Compiling depends on the
    problem alone, so it can be done beside the search.
    """

    @in_float64
    def __init__(self, problem: Problem, kind: Kind = "compressed"):
        self.problem = problem
        self.kind: Kind = kind
        try:
            self.objective = problem.objective_in("log", kind)
        except InputError:
            self.kind = "scan"
            self.objective = problem.objective_in("log", "scan")
        template = jnp.stack([self.objective.coordinates.lower] * SEEDS_PER_BLOCK)
        self._compiled = compile_for(
            _descend, self.objective, template, jnp.asarray(0.0), jnp.asarray(False)
        )

    @in_float64
    def __call__(
        self,
        circuits: Sequence[CircuitParameters],
        tolerance: float,
        *,
        holds_bounds: bool = False,
        progress: Callable[[int], None] | None = None,
    ) -> list[RefinedSeed]:
        """Every circuit refined; `tolerance` is relative to the circuit's own error."""
        starts = point_blocks(circuits, self.objective.coordinates)

        @in_float64  # the setting belongs to a thread
        def run(points):
            settings = (jnp.asarray(tolerance), jnp.asarray(holds_bounds))
            return jax.tree.map(np.asarray, self._compiled(self.objective, points, *settings))

        ends = run_blocks(run, starts, wanted_rows(len(circuits)), progress)
        points, errors_v, converged, evaluations = zip(*ends, strict=True)
        found = self.problem.parameters_at(points, self.objective.coordinates)
        if self.kind != "scan":
            errors_v = rmse_by_scan(self.problem, found)
        return [
            RefinedSeed(
                float(rmse_v), after, largest_change(before, after), bool(has_converged), int(spent)
            )
            for before, after, rmse_v, has_converged, spent in zip(
                circuits, found, errors_v, converged, evaluations, strict=True
            )
        ]


def _descend(
    objective: Objective,
    points: Float[Array, "seeds free"],
    tolerance: Scalar,
    holds_bounds: Bool[Array, ""],
):
    """End point, its RMSE in V, whether it converged, and its evaluations, from every start."""
    box = objective.coordinates
    width = box.upper - box.lower
    # Not QR: forming its Q is slower here, and two such programs at a time hang in XLA's CPU
    # runtime (jaxlib 0.10.2).
    to_tolerance: Any = tolerance  # an array where a float is declared: one program serves both
    solver = optx.LevenbergMarquardt(
        rtol=to_tolerance, atol=to_tolerance, linear_solver=lx.Normal(lx.Cholesky())
    )

    def place(angle, start):
        fraction = (start - box.lower) / width
        is_held = holds_bounds & ((fraction < AT_BOUND) | (fraction > 1 - AT_BOUND))
        bound = jnp.where(fraction < 0.5, box.lower, box.upper)
        return jnp.where(is_held, bound, box.lower + width * (1 + jnp.sin(angle)) / 2)

    def errors(angle, given):
        objective, start, unit_v = given
        return residuals(place(angle, start), objective) / unit_v

    def rmse_at(point):
        return jnp.linalg.norm(residuals(point, objective))

    def one(start):
        # In units of the start's own error, tolerances are relative and no seed sees another.
        unit_v = jnp.maximum(rmse_at(start), SMALLEST_UNIT_V)
        # The sine is flat at the ends of the box: a start exactly there could never leave.
        fraction = jnp.clip((start - box.lower) / width, AT_BOUND, 1 - AT_BOUND)
        solution = optx.least_squares(
            errors,
            solver,
            jnp.arcsin(2 * fraction - 1),
            (objective, start, unit_v),
            {"jac": "fwd"},
            max_steps=STEPS,
            throw=False,
        )
        has_converged = solution.result == optx.RESULTS.successful
        ends = jnp.stack([start, place(solution.value, start)])
        errors_v = jax.vmap(rmse_at)(ends)
        better = jnp.nanargmin(errors_v)
        jacobians = solution.state.num_accepted_steps * start.size
        # The start's own error and both ends' are evaluations too.
        evaluations = solution.stats["num_steps"] + jacobians + 3
        return ends[better], errors_v[better], has_converged, evaluations

    return jax.vmap(one)(points)


def largest_change(before: CircuitParameters, after: CircuitParameters) -> float:
    """The largest relative change of any parameter."""
    old, new = (np.array(list(values.to_dict().values())) for values in (before, after))
    return float(np.max(np.abs(new / old - 1)))

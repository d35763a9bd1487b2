"""The cross-check: Levenberg-Marquardt from every seed's answer, in the same box."""

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
from .coordinates import Coordinates
from .identification import (
    SEEDS_PER_BLOCK,
    Identification,
    compile_for,
    run_blocks,
    seed_blocks,
)
from .precision import in_float64
from .problem import Objective, Problem, impedance_of, residuals

# A parameter this close to an end of its box, as a fraction of the (log) width, is at the bound.
AT_BOUND = 1e-3
# Refined answers whose RMSE agree this closely (relative) are one optimum; if their parameters
# differ by more than this all the same, the optimum is a family of circuits.
SAME_RMSE = 1e-5
SAME_PARAMETER = 1e-2
# Relative tolerances of Levenberg-Marquardt, in the scaled residuals and their unknowns.
SEED_TOLERANCE = 1e-6
FINAL_TOLERANCE = 1e-10
# A descent that needs longer creeps along a valley; only the best one is followed to its end.
STEPS = 100
FINAL_ROUNDS = 20


@dataclass(frozen=True)
class RefinedSeed:
    """Where Levenberg-Marquardt took one seed; `moved` is the largest relative parameter change."""

    rmse_v: float
    parameters: CircuitParameters
    moved: float
    has_converged: bool


@dataclass(frozen=True)
class Optimum:
    """A distinct place where refined seeds ended, and how many of them.

    `is_family` says that circuits with different parameters fit equally well there.
    """

    rmse_v: float
    parameters: CircuitParameters
    seeds: int
    is_family: bool


@dataclass(frozen=True, eq=False)
class CrossCheck:
    """The refined answer and what the seeds agree on. `optima` begins with the best."""

    found: Identification
    refined: tuple[RefinedSeed, ...]
    optima: tuple[Optimum, ...]
    at_bound: tuple[str, ...]
    verdict: str

    @property
    def parameters(self) -> CircuitParameters:
        return self.optima[0].parameters

    @property
    def rmse_v(self) -> float:
        return self.optima[0].rmse_v


@in_float64
def refine(
    found: Identification,
    *,
    descent: "Descent | None" = None,
    progress: Callable[[int], None] | None = None,
) -> CrossCheck:
    """Refine every seed's best circuit by optimistix's Levenberg-Marquardt.

    It moves the logarithms of R and tau through a sine that maps the real line onto the box, so
    bounds hold exactly and an optimum at a bound is a stationary point. Every seed is taken to
    `SEED_TOLERANCE` in at most `STEPS` steps, the best then to `FINAL_TOLERANCE` with what is at
    a bound held there. No answer is made worse. `descent` may have been compiled beforehand;
    `progress` is called with the number of seeds finished since the last call.
    """
    descent = descent or Descent(found.problem)
    unit_v = found.best.rmse_v or 1.0
    answers = [answer.parameters for answer in found.seeds]
    refined = descent(answers, unit_v, SEED_TOLERANCE, progress=progress)
    best = min(refined, key=lambda seed: seed.rmse_v)
    for _ in range(FINAL_ROUNDS):
        (best,) = descent([best.parameters], unit_v, FINAL_TOLERANCE, holds_bounds=True)
        if best.has_converged:
            break
    optima = distinct_optima(refined, best)
    at_bound = _at_bound(descent.objective.coordinates, best.parameters)
    verdict = _verdict(found, refined, optima, at_bound)
    return CrossCheck(found, tuple(refined), optima, at_bound, verdict)


class Descent:
    """Levenberg-Marquardt on one problem, compiled once for blocks of `SEEDS_PER_BLOCK` starts.

    Compiling takes seconds and depends on the problem alone, so it can be done beside the search.
    """

    @in_float64
    def __init__(self, problem: Problem):
        self.problem = problem
        self.objective = problem.objective_in("log")
        template = jnp.stack([self.objective.coordinates.lower] * SEEDS_PER_BLOCK)
        scalar = jnp.asarray(1.0)
        self._compiled = compile_for(
            _descend, self.objective, template, scalar, scalar, jnp.asarray(False)
        )

    @in_float64
    def __call__(
        self,
        circuits: Sequence[CircuitParameters],
        unit_v: float,
        tolerance: float,
        *,
        holds_bounds: bool = False,
        progress: Callable[[int], None] | None = None,
    ) -> list[RefinedSeed]:
        """Every circuit refined; `tolerance` is relative to errors of `unit_v` volts."""
        encode = self.objective.coordinates.encode
        starts = [encode(impedance_of(circuit)) for circuit in circuits]
        blocks = seed_blocks(len(starts), SEEDS_PER_BLOCK)
        given = [
            jnp.stack([starts[min(index, len(starts) - 1)] for index in block]) for block in blocks
        ]

        @in_float64  # the setting belongs to a thread
        def run(points):
            settings = (jnp.asarray(unit_v), jnp.asarray(tolerance), jnp.asarray(holds_bounds))
            return jax.tree.map(np.asarray, self._compiled(self.objective, points, *settings))

        ends = run_blocks(run, given, len(starts), progress)
        points, errors_v, converged = zip(*ends, strict=True)
        found = self.problem.parameters_at(points, self.objective.coordinates)
        return [
            RefinedSeed(float(rmse_v), after, _largest_change(before, after), bool(has_converged))
            for before, after, rmse_v, has_converged in zip(
                circuits, found, errors_v, converged, strict=True
            )
        ]


def _descend(
    objective: Objective,
    points: Float[Array, "seeds free"],
    unit_v: Scalar,
    tolerance: Scalar,
    holds_bounds: Bool[Array, ""],
):
    """End point, its RMSE in V and whether it converged, from every start."""
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
        objective, start = given
        return residuals(place(angle, start), objective) / unit_v

    def one(start):
        # The sine is flat at the ends of the box: a start exactly there could never leave.
        fraction = jnp.clip((start - box.lower) / width, AT_BOUND, 1 - AT_BOUND)
        solution = optx.least_squares(
            errors,
            solver,
            jnp.arcsin(2 * fraction - 1),
            (objective, start),
            {"jac": "fwd"},
            max_steps=STEPS,
            throw=False,
        )
        has_converged = solution.result == optx.RESULTS.successful
        ends = jnp.stack([start, place(solution.value, start)])
        errors_v = jax.vmap(lambda end: jnp.linalg.norm(residuals(end, objective)))(ends)
        better = jnp.nanargmin(errors_v)
        return ends[better], errors_v[better], has_converged

    return jax.vmap(one)(points)


def distinct_optima(refined: Sequence[RefinedSeed], best: RefinedSeed) -> tuple[Optimum, ...]:
    """Refined seeds gathered into distinct optima, the first one being that of `best`."""
    groups = [[best]]
    for seed in sorted(refined, key=lambda seed: seed.rmse_v):
        if seed.rmse_v <= groups[-1][0].rmse_v * (1 + SAME_RMSE):
            groups[-1].append(seed)
        else:
            groups.append([seed])
    return tuple(
        Optimum(
            rmse_v=group[0].rmse_v,
            parameters=group[0].parameters,
            seeds=len(group) - (group is groups[0]),
            is_family=any(
                _largest_change(group[0].parameters, seed.parameters) > SAME_PARAMETER
                for seed in group
            ),
        )
        for group in groups
    )


def _largest_change(before: CircuitParameters, after: CircuitParameters) -> float:
    old, new = (np.array(list(values.to_dict().values())) for values in (before, after))
    return float(np.max(np.abs(new / old - 1)))


def _at_bound(box: Coordinates, parameters: CircuitParameters) -> tuple[str, ...]:
    point = np.asarray(box.encode(impedance_of(parameters)))
    lower, upper = np.asarray(box.lower), np.asarray(box.upper)
    fraction = (point - lower) / (upper - lower)
    return tuple(
        f"{name} at its {'lower' if place < 0.5 else 'upper'} bound"
        for name, place in zip(box.names, fraction, strict=True)
        if not AT_BOUND < place < 1 - AT_BOUND
    )


def _verdict(
    found: Identification,
    refined: Sequence[RefinedSeed],
    optima: Sequence[Optimum],
    at_bound: Sequence[str],
) -> str:
    total, best = len(refined), optima[0]
    gap = 100 * (found.best.rmse_v / best.rmse_v - 1)
    if total == 1:
        agreement = "One seed was run, so nothing tells whether another would end elsewhere."
    elif best.seeds == total:
        agreement = f"All {total} seeds end in one optimum."
    else:
        second = optima[1].rmse_v / best.rmse_v - 1
        agreement = (
            f"{best.seeds} of {total} seeds end in the best optimum; the others end in "
            f"{len(optima) - 1} more, the nearest {100 * second:.2g} % above it."
        )
    distance = f"{gap:.2g} % above it" if gap > 1e-6 else "already there, to 1e-6 %"
    sentences = [agreement, f"Before refinement the best seed was {distance}."]
    unconverged = sum(not seed.has_converged for seed in refined)
    if unconverged:
        sentences.append(
            f"Levenberg-Marquardt was still moving after {STEPS} steps from {unconverged} of "
            f"{total} seeds."
        )
    if best.is_family:
        sentences.append(
            "Circuits with different parameters fit equally well there: the data do not "
            "determine them one by one."
        )
    if at_bound:
        sentences.append(
            f"{'; '.join(at_bound)}: the box, not the data, decides there. Widen it with --bounds "
            "or hold the parameter with --fix."
        )
    else:
        sentences.append("No parameter is at a bound.")
    return " ".join(sentences)

"""The cross-check: Levenberg-Marquardt from every seed's answer, in the same box."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from .cell import CircuitParameters
from .coordinates import Coordinates
from .identification import SEEDS_PER_BLOCK, Identification, run_blocks, seed_blocks
from .precision import in_float64
from .problem import Objective, Problem, impedance_of, residuals

# A parameter this close to an end of its box, as a fraction of the (log) width, is at the bound.
AT_BOUND = 1e-3
# Two refined answers are one optimum if RMSE and every parameter agree this closely (relative).
SAME_RMSE = 1e-5
SAME_PARAMETER = 1e-2
# Relative tolerances of Levenberg-Marquardt, in the scaled residuals and their unknowns.
SEED_TOLERANCE = 1e-6
FINAL_TOLERANCE = 1e-10
MAX_STEPS = 500


@dataclass(frozen=True)
class RefinedSeed:
    """Where Levenberg-Marquardt took one seed; `moved` is the largest relative parameter change."""

    rmse_v: float
    parameters: CircuitParameters
    moved: float
    has_converged: bool


@dataclass(frozen=True)
class Optimum:
    """A distinct place where refined seeds ended, and how many of them."""

    rmse_v: float
    parameters: CircuitParameters
    seeds: int


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
def refine(found: Identification, *, progress: Callable[[int], None] | None = None) -> CrossCheck:
    """Refine every seed's best circuit by optimistix's Levenberg-Marquardt.

    It moves the logarithms of R and tau through a sine that maps the real line onto the box, so
    bounds hold exactly and an optimum at a bound is a stationary point. Every seed is taken to
    `SEED_TOLERANCE`, then the distinct optima to `FINAL_TOLERANCE`. `progress` is called with the
    number of seeds finished since the last call.
    """
    descent = _Descent(found.problem, unit_v=found.best.rmse_v)
    refined = descent([answer.parameters for answer in found.seeds], SEED_TOLERANCE, progress)
    coarse = distinct_optima(refined)
    foremost = coarse[:SEEDS_PER_BLOCK]
    polished = descent([optimum.parameters for optimum in foremost], FINAL_TOLERANCE)
    optima = [
        Optimum(end.rmse_v, end.parameters, optimum.seeds)
        for end, optimum in zip(polished, foremost, strict=True)
    ]
    optima = (*sorted(optima, key=lambda optimum: optimum.rmse_v), *coarse[len(foremost) :])
    at_bound = _at_bound(descent.objective.coordinates, optima[0].parameters)
    verdict = _verdict(found, refined, optima, at_bound)
    return CrossCheck(found, tuple(refined), optima, at_bound, verdict)


class _Descent:
    """Levenberg-Marquardt on one problem, compiled once for blocks of `SEEDS_PER_BLOCK` starts.

    Residuals are in units of `unit_v`, so that tolerances are relative to the error itself.
    """

    def __init__(self, problem: Problem, unit_v: float):
        self.problem = problem
        self.objective = problem.objective_in("log")
        self._unit_v = jnp.asarray(unit_v or 1.0)
        template = jnp.stack([self.objective.coordinates.lower] * SEEDS_PER_BLOCK)
        self._compiled = _descend.lower(
            self.objective, template, self._unit_v, jnp.asarray(FINAL_TOLERANCE)
        ).compile()

    def __call__(
        self,
        circuits: Sequence[CircuitParameters],
        tolerance: float,
        progress: Callable[[int], None] | None = None,
    ) -> list[RefinedSeed]:
        encode = self.objective.coordinates.encode
        starts = [encode(impedance_of(circuit)) for circuit in circuits]
        blocks = seed_blocks(len(starts), SEEDS_PER_BLOCK)
        given = [
            jnp.stack([starts[min(index, len(starts) - 1)] for index in block]) for block in blocks
        ]

        @in_float64  # the setting belongs to a thread
        def run(points):
            ends = self._compiled(self.objective, points, self._unit_v, jnp.asarray(tolerance))
            return jax.tree.map(np.asarray, ends)

        ends = run_blocks(run, given, len(starts), progress)
        points, errors_v, converged = zip(*ends, strict=True)
        found = self.problem.parameters_at(points, self.objective.coordinates)
        return [
            RefinedSeed(float(rmse_v), after, _largest_change(before, after), bool(has_converged))
            for before, after, rmse_v, has_converged in zip(
                circuits, found, errors_v, converged, strict=True
            )
        ]


@eqx.filter_jit
def _descend(objective: Objective, points: Float[Array, "seeds free"], unit_v, tolerance):
    """End point, its RMSE in V and whether it converged, from every start."""
    box = objective.coordinates
    width = box.upper - box.lower

    def inside(angle):
        return box.lower + width * (1 + jnp.sin(angle)) / 2

    def errors(angle, objective):
        return residuals(inside(angle), objective) / unit_v

    def one(point):
        # The sine is flat at the ends of the box: a start exactly there could never leave.
        fraction = jnp.clip((point - box.lower) / width, AT_BOUND, 1 - AT_BOUND)
        solution = optx.least_squares(
            errors,
            optx.LevenbergMarquardt(rtol=tolerance, atol=tolerance),
            jnp.arcsin(2 * fraction - 1),
            objective,
            {"jac": "fwd"},
            max_steps=MAX_STEPS,
            throw=False,
        )
        end = inside(solution.value)
        rmse_v = jnp.linalg.norm(residuals(end, objective))
        return end, rmse_v, solution.result == optx.RESULTS.successful

    return jax.vmap(one)(points)


def distinct_optima(refined: Sequence[RefinedSeed]) -> tuple[Optimum, ...]:
    """Refined answers gathered into distinct optima, the best first."""
    groups: list[list[RefinedSeed]] = []
    for seed in sorted(refined, key=lambda seed: seed.rmse_v):
        for group in groups:
            is_same_rmse = seed.rmse_v <= group[0].rmse_v * (1 + SAME_RMSE)
            if is_same_rmse and _largest_change(group[0].parameters, seed.parameters) < SAME_PARAMETER:
                group.append(seed)
                break
        else:
            groups.append([seed])
    return tuple(Optimum(group[0].rmse_v, group[0].parameters, len(group)) for group in groups)


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
    gap = found.best.rmse_v / best.rmse_v - 1
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
    sentences = [
        agreement,
        f"Before refinement the best seed was {100 * gap:.2g} % above it.",
    ]
    unconverged = sum(not seed.has_converged for seed in refined)
    if unconverged:
        sentences.append(f"Levenberg-Marquardt did not converge from {unconverged} of {total} seeds.")
    if at_bound:
        sentences.append(
            f"{'; '.join(at_bound)}: the box, not the data, decides there. Widen it with --bounds "
            "or hold the parameter with --fix."
        )
    else:
        sentences.append("No parameter is at a bound.")
    return " ".join(sentences)

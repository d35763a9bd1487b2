"""The search: many seeds of one population optimizer, on one problem or on many, and
Levenberg-Marquardt from every seed's answer, in the same box."""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from typing import Any

import jax
import jax.numpy as jnp
import jax.random as jr
import lineax as lx
import numpy as np
import optimistix as optx
from jaxtyping import Array, Bool, Float, Key, Scalar

from ..cell import CircuitParameters
from ..errors import InputError
from ..execution import (
    CIRCUITS_PER_BLOCK,
    as_input,
    compile_for,
    in_float64,
    run_blocks,
    seed_blocks,
    wanted_rows,
)
from ..model.coordinates import Coordinates
from ..model.problem import Objective, Problem, point_blocks, residuals, rmse, rmse_by_scan
from ..model.search_space import Kind
from ..optimizers import OPTIMIZERS, AbstractPopulationMinimiser, minimise
from ..optimizers.ask_tell import require_optimizer
from ..optimizers.run import Undifferentiated
from .answers import (
    AT_BOUND,
    AtBound,
    RefinedSeed,
    Refinement,
    Search,
    SeedAnswer,
    distinct_optima,
    largest_change,
    near_ends,
)


def search_seeds(
    problem: Problem,
    optimizer: AbstractPopulationMinimiser,
    *,
    key: Key[Array, ""],
    seeds: int = 30,
    progress: Callable[[int], None] | None = None,
) -> Search:
    """The answers of independent runs of an optimizer; seed k draws from `fold_in(key, k)`.

    Args:
        problem: A problem from `make_problem`.
        optimizer: An optimizer from `make_optimizer`, or your own.
        key: A key of `jax.random.key`.
        seeds: Number of runs.
        progress: Called with the number of seeds finished since the last call.

    Raises `InputError` if no seed finds a finite error.
    """
    return search_many([problem], optimizer, key=key, seeds=seeds, progress=progress)[0]


@in_float64
def search_many(
    problems: Sequence[Problem],
    optimizer: AbstractPopulationMinimiser,
    *,
    key: Key[Array, ""],
    seeds: int = 30,
    progress: Callable[[int], None] | None = None,
) -> list[Search]:
    """`search_seeds` for every problem; each answer is bit for bit what it would be alone.

    Problems of one kind share compiled programs: compressed records have the same size if their
    boxes span the same decades, and for the scan, records of many lengths are padded, with samples
    that are not counted, to one size an octave.

    Args:
        problems: Problems from `make_problem`.
        optimizer: An optimizer from `make_optimizer`, or your own.
        key: A key of `jax.random.key`.
        seeds: Number of runs for each problem.
        progress: Called with the number of seeds finished since the last call.

    Raises as `search_seeds`.
    """
    require_optimizer(optimizer)
    if seeds < 1:
        raise InputError(f"`seeds` {seeds}: at least one seed is needed")
    block_keys = [
        jax.vmap(lambda seed: jr.fold_in(key, seed))(jnp.asarray(block))
        for block in seed_blocks(seeds)
    ]

    is_alone = len(problems) == 1
    objectives = [
        problem.objective
        if is_alone or problem.kind != "scan"
        else Objective(problem.padded_scan, problem.coordinates)
        for problem in problems
    ]

    @in_float64  # the setting belongs to a thread
    def run(work):
        objective, keys = work
        search = compile_for(_search, optimizer, objective, keys)
        return jax.tree.map(np.asarray, search(optimizer, objective, keys))

    work = [(objective, keys) for objective in objectives for keys in block_keys]
    outcomes = run_blocks(run, work, wanted_rows(seeds) * len(problems), progress)
    # The integer that `jax.random.key` makes this key from.
    integer = int.from_bytes(np.asarray(jr.key_data(key)).astype(">u4").tobytes(), "big")
    searches = []
    for problem, first in zip(problems, range(0, len(outcomes), seeds), strict=True):
        rows = outcomes[first : first + seeds]
        points, losses_v, evaluations, failures = zip(*rows, strict=True)
        circuits = problem.parameters_at(points, problem.objective.coordinates)
        errors_v = [*map(float, losses_v)]
        if not np.isfinite(errors_v).any():
            raise InputError(
                f"{problem.prepared.record.name}: no candidate gave a finite error; check the "
                "record's values and the bounds"
            )
        if problem.kind != "scan":
            errors_v = rmse_by_scan(problem, circuits)
        answers = [*map(SeedAnswer, errors_v, circuits, map(int, evaluations), map(int, failures))]
        searches.append(search_of(problem, optimizer, integer, answers))
    return searches


def search_of(
    problem: Problem,
    optimizer: AbstractPopulationMinimiser,
    key: int,
    seeds: Sequence[SeedAnswer],
) -> Search:
    """The search of a problem by an optimizer."""
    budget = {"population": optimizer.population, "iterations": optimizer.iterations}
    registered = (name for name, make in OPTIMIZERS.items() if make(**budget) == optimizer)
    values = {field.name: getattr(optimizer, field.name) for field in fields(optimizer)}
    return Search(
        method=next(registered, type(optimizer).__name__),
        settings={
            name: value
            for name, value in values.items()
            if isinstance(value, bool | int | float | str)
        },
        coordinates=problem.scale,
        objective=problem.kind,
        **budget,
        key=key,
        evaluations=sum(answer.evaluations for answer in seeds),
        seeds=tuple(seeds),
        problem=problem,
        optimizer=optimizer,
    )


def _search(
    optimizer: AbstractPopulationMinimiser, objective: Objective, keys: Key[Array, "seeds"]
):
    """Best point and loss, evaluations and failures of every key, in one compiled call."""
    box = objective.coordinates
    solution = minimise(
        rmse, optimizer, box.lower, box.upper, key=keys, args=objective, throw=False
    )
    stats = solution.stats
    return solution.value, stats["best_loss"], stats["evaluations"], stats["failures"]


# Steps of one round. Seeds that need many rounds creep along a valley; only the best is followed
# there.
STEPS = 50
# An error below a picovolt is zero; it could not serve as a unit.
SMALLEST_UNIT_V = 1e-12


class Descent:
    """Levenberg-Marquardt on one problem, compiled once for blocks of `CIRCUITS_PER_BLOCK`.

    It runs on the compressed objective, whatever the search used, unless the box is too wide for
    that; the returned errors are the scan's. Compiling depends on the problem only, so it can run
    beside the search.
    """

    @in_float64
    def __init__(self, problem: Problem):
        self.problem = problem
        self.kind: Kind = "compressed" if problem.is_compressible else "scan"
        self.objective = problem.padded_objective(self.kind)
        template = [np.asarray(self.objective.coordinates.lower)] * CIRCUITS_PER_BLOCK
        self._compiled = compile_for(
            _descend, self.objective, as_input(template), as_input(0.0), as_input(False)
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
            settings = as_input(tolerance), as_input(holds_bounds)
            return jax.tree.map(np.asarray, self._compiled(self.objective, points, *settings))

        wanted = wanted_rows(len(circuits), CIRCUITS_PER_BLOCK)
        ends = run_blocks(run, starts, wanted, progress)
        points, errors_v, converged, evaluations = zip(*ends, strict=True)
        refined = self.problem.parameters_at(points, self.objective.coordinates)
        if self.kind != "scan":
            errors_v = rmse_by_scan(self.problem, refined)
        return [
            RefinedSeed(
                float(rmse_v), after, largest_change(before, after), bool(has_converged), int(spent)
            )
            for before, after, rmse_v, has_converged, spent in zip(
                circuits, refined, errors_v, converged, evaluations, strict=True
            )
        ]

    def led_on(
        self, ends: Sequence[RefinedSeed], tolerance: float, rounds: int
    ) -> tuple[list[RefinedSeed], int]:
        """Circuits that have not converged, continued with parameters at a bound held there; and
        the evaluations.

        Along a bound the sine is flat, and a descent wanders there without end.
        """
        ends, spent = list(ends), 0
        for _ in range(rounds):
            moving = [index for index, end in enumerate(ends) if not end.has_converged]
            if not moving:
                break
            starts = [ends[index].parameters for index in moving]
            for index, end in zip(moving, self(starts, tolerance, holds_bounds=True), strict=True):
                ends[index] = end
                spent += end.evaluations
        return ends, spent


def _descend(
    objective: Objective,
    points: Float[Array, "seeds free"],
    tolerance: Scalar,
    holds_bounds: Bool[Array, ""],
):
    """End point, its RMSE in V, whether it converged, and its evaluations, from every start.

    The unknowns are angles whose sine runs over the box.
    """
    box = objective.coordinates
    # Not QR: forming its Q is slower here, and two such programs at a time hang in XLA's CPU
    # runtime (jaxlib 0.10.2).
    to_tolerance: Any = tolerance  # an array where a float is declared: one program serves both
    solver = optx.LevenbergMarquardt(
        rtol=to_tolerance, atol=to_tolerance, linear_solver=lx.Normal(lx.Cholesky())
    )
    how: dict[str, Any] = {"max_steps": STEPS, "adjoint": Undifferentiated(), "throw": False}

    def point_at(angle, start):
        fraction = (start - box.lower) / (box.upper - box.lower)
        is_held = holds_bounds & ((fraction < AT_BOUND) | (fraction > 1 - AT_BOUND))
        bound = jnp.where(fraction < 0.5, box.lower, box.upper)
        inside = box.lower + (box.upper - box.lower) * (1 + jnp.sin(angle)) / 2
        return jnp.where(is_held, bound, inside)

    def errors(angle, given):
        objective, start, unit_v = given
        return residuals(point_at(angle, start), objective) / unit_v

    def rmse_at(point):
        return jnp.linalg.norm(residuals(point, objective))

    def one(start):
        # In units of the start's own error, so tolerances are relative and seeds do not affect each
        # other.
        unit_v = jnp.maximum(rmse_at(start), SMALLEST_UNIT_V)
        given = objective, start, unit_v
        # The sine is flat at the ends of the box: a start exactly there could never leave.
        fraction = jnp.clip((start - box.lower) / (box.upper - box.lower), AT_BOUND, 1 - AT_BOUND)
        angle = jnp.arcsin(2 * fraction - 1)
        solution = optx.least_squares(errors, solver, angle, given, {"jac": "fwd"}, **how)
        has_converged = solution.result == optx.RESULTS.successful
        ends = jnp.stack([start, point_at(solution.value, start)])
        errors_v = jax.vmap(rmse_at)(ends)
        better = jnp.nanargmin(errors_v)
        jacobians = solution.state.num_accepted_steps * start.size
        # The start's own error and both ends' count as evaluations too.
        evaluations = solution.stats["num_steps"] + jacobians + 3
        return ends[better], errors_v[better], has_converged, evaluations

    return jax.vmap(one)(points)


# Relative tolerances of Levenberg-Marquardt, in the scaled residuals and their unknowns.
SEED_TOLERANCE = 1e-6
FINAL_TOLERANCE = 1e-10
FINAL_ROUNDS = 20


@in_float64
def refine(
    search: Search, *, descent: Descent | None = None, progress: Callable[[int], None] | None = None
) -> Refinement:
    """The best circuit of every seed, refined by optimistix's Levenberg-Marquardt.

    It moves the logarithms of R and tau through a sine that maps the real line onto the box, so
    bounds hold exactly and an optimum at a bound is a stationary point. Every seed is taken to
    `SEED_TOLERANCE` in at most `STEPS` steps, and as many again with what is at a bound held there;
    the best then to `FINAL_TOLERANCE`. No answer is made worse.

    Args:
        search: A search from `search_seeds`.
        descent: The program, where it was compiled beforehand.
        progress: Called with the number of seeds finished since the last call.
    """
    descent = descent or Descent(search.problem)
    answers = [answer.parameters for answer in search.seeds]
    first = descent(answers, SEED_TOLERANCE, progress=progress)
    ends, again = descent.led_on(first, SEED_TOLERANCE, 1)
    refined = [
        replace(end, moved=largest_change(answer, end.parameters))
        for answer, end in zip(answers, ends, strict=True)
    ]
    leader = min(range(len(refined)), key=lambda seed: refined[seed].rmse_v)
    start = replace(refined[leader], has_converged=False)
    (best,), last = descent.led_on([start], FINAL_TOLERANCE, FINAL_ROUNDS)
    spent = sum(seed.evaluations for seed in first) + again + last
    ended = [best if seed == leader else refined[seed] for seed in range(len(refined))]
    optima = distinct_optima(ended)
    bounded = at_bound(descent.objective.coordinates, best.parameters)
    return Refinement(tuple(refined), optima, bounded, descent.kind, spent, search)


def at_bound(box: Coordinates, parameters: CircuitParameters) -> tuple[AtBound, ...]:
    """The parameters at an end of a box in `log` coordinates."""
    point = np.asarray(point_blocks([parameters], box)[0])[0]
    ends = np.asarray(box.lower), np.asarray(box.upper)
    values = list(zip(box.names, point, *ends, strict=True))
    # A pair bounded in C can also end at the limits of its tau.
    limits_s = np.asarray(box.tau_limits_s)
    for (name, tau_s), limits in zip(parameters.named_tau_s.items(), limits_s, strict=True):
        if name not in box.names and limits[0] < limits[1]:
            values.append((name, *np.log([tau_s, *limits])))
    return near_ends(values)

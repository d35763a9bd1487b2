"""Methods that search the box: population optimizers, Levenberg-Marquardt, SciPy's evolution,
variable projection."""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import differential_evolution

from ..execution import compile_for, in_float64, run_blocks
from ..global_optimum.search import find_global_optimum
from ..model.problem import Problem, rmse_by_scan, rmse_of_all
from ..optimizers import evaluations_per_iteration, make_optimizer, source_of
from ..search.answers import RefinedSeed
from ..search.seeds import SEED_TOLERANCE, STEPS, Descent, search_seeds
from .method import (
    Answer,
    Budget,
    Method,
    MethodFailure,
    Progress,
    deterministic,
    generator_of,
    latin_hypercube,
)

# Starts per seed, fewer if the budget is too small.
STARTS = 10


def population_method(name: str) -> Method:
    """The method that runs the optimizer registered as `name`, unrefined.

    It runs for as many generations as the budget allows: an optimizer that evaluates more
    candidates per generation runs for fewer.
    """

    def search(problem: Problem, budget: Budget, progress: Progress) -> list[Answer]:
        cost = evaluations_per_iteration(make_optimizer(name, budget.population, 1))
        iterations = (budget.evaluations - budget.population) // cost
        if iterations < 1:
            raise MethodFailure(
                f"it evaluates {cost} candidates per generation, more than the budget of "
                f"{budget.evaluations} per seed; raise `iterations`"
            )
        return _search(problem, name, iterations, budget, progress)

    return Method(name, source_of(name), is_deterministic=False, run=search)


def _search(
    problem: Problem, name: str, iterations: int, budget: Budget, progress: Progress
) -> list[Answer]:
    optimizer = make_optimizer(name, budget.population, iterations)
    key = jax.random.key(budget.key)
    search = search_seeds(problem, optimizer, key=key, seeds=budget.seeds, progress=progress)
    return [Answer(seed.parameters, seed.rmse_v, seed.evaluations) for seed in search.seeds]


@in_float64
def multistart(problem: Problem, budget: Budget, progress: Progress) -> list[Answer]:
    """The best of `STARTS` descents per seed (Marquardt, J. Soc. Ind. Appl. Math. 11 (1963) 431).

    Starts are a Latin hypercube in the logarithms of the box; each descends in at most 50 steps.
    Their number is what the budget allows if each takes all its steps, so fewer evaluations are
    used.
    """
    starts = max(1, min(STARTS, budget.evaluations // _dearest(problem)))
    box = problem.log_coordinates
    generators = (generator_of(budget.key, seed) for seed in range(budget.seeds))
    points = [point for drawn in generators for point in latin_hypercube(drawn, starts, box)]
    circuits = problem.parameters_at(points, box)
    finished = 0

    def advance(gained: int) -> None:
        nonlocal finished
        before, finished = finished // starts, finished + gained
        progress(finished // starts - before)

    ends = Descent(problem)(circuits, SEED_TOLERANCE, progress=advance)
    return [
        best_of(ends[first : first + starts]) for first in range(0, budget.seeds * starts, starts)
    ]


def _dearest(problem: Problem) -> int:
    """Evaluations of a descent that takes all its steps."""
    return STEPS * (1 + len(problem.coordinates.names))


def best_of(ends: list[RefinedSeed], spent: int = 0) -> Answer:
    """The best of the descents, with the cost of all of them and of the search before them."""
    best = min(ends, key=lambda end: end.rmse_v if math.isfinite(end.rmse_v) else math.inf)
    evaluations = spent + sum(end.evaluations for end in ends)
    return Answer(best.parameters, best.rmse_v, evaluations)


LM = Method(
    "lm",
    f"Levenberg-Marquardt (Marquardt, 1963) from {STARTS} starts, optimistix",
    is_deterministic=False,
    run=multistart,
)


def swarm_then_descent(problem: Problem, budget: Budget, progress: Progress) -> list[Answer]:
    """Levenberg-Marquardt from a particle swarm's best (Shen and Li, Energies 10 (2017) 432).

    The swarm has the budget less the largest cost of one descent of at most 50 steps. Their circuit
    differs; the two scales are theirs.
    """
    iterations = (budget.evaluations - _dearest(problem)) // budget.population - 1
    if iterations < 1:
        raise MethodFailure(
            f"the budget of {budget.evaluations} evaluations per seed is too small for a swarm and "
            "a descent; raise `iterations`"
        )
    seeds = _search(problem, "pso", iterations, budget, progress)
    ends = Descent(problem)([seed.parameters for seed in seeds], SEED_TOLERANCE)
    return [best_of([end], seed.evaluations) for seed, end in zip(seeds, ends, strict=True)]


PSO_LM = Method(
    "pso-lm",
    "Particle swarm, then Levenberg-Marquardt (Shen and Li, 2017)",
    is_deterministic=False,
    run=swarm_then_descent,
)


# SciPy's own limit.
FEWEST = 5


@in_float64
def evolve(problem: Problem, budget: Budget, progress: Progress) -> list[Answer]:
    """The best circuit of `scipy.optimize.differential_evolution` (Storn and Price, J. Global
    Optim. 11 (1997) 341).

    SciPy's defaults (best1bin, dithered mutation 0.5 to 1, crossover 0.7), in the search
    coordinates and box of all others, with our compiled RMSE; no polish, and no stop before the
    budget is spent unless the whole population has one error. Raises `MethodFailure` for a
    population under `FEWEST`.
    """
    box = problem.coordinates
    if budget.population < FEWEST:
        raise MethodFailure(
            f"differential evolution needs a population of at least {FEWEST}, not "
            f"{budget.population}"
        )
    low, high = np.asarray(box.lower), np.asarray(box.upper)
    candidates = jnp.zeros((budget.population, len(low)))
    compiled = compile_for(rmse_of_all, candidates, problem.objective)

    @in_float64  # the setting belongs to a thread
    def run(seed: int):
        generator = generator_of(budget.key, seed)

        def errors(points: np.ndarray) -> np.ndarray:
            rmse_v = np.asarray(compiled(jnp.asarray(points.T), problem.objective))
            return np.where(np.isfinite(rmse_v), rmse_v, np.inf)

        # SciPy's types only accept names.
        start: Any = latin_hypercube(generator, budget.population, box)
        end = differential_evolution(
            errors,
            list(zip(low, high, strict=True)),
            maxiter=budget.iterations,
            init=start,
            rng=generator,
            tol=0,
            polish=False,
            updating="deferred",
            vectorized=True,
        )
        # Whole populations are counted.
        return np.asarray(end.x)[None], np.array([[end.fun, end.nfev]])

    ends = run_blocks(run, range(budget.seeds), [1] * budget.seeds, progress)
    circuits = problem.parameters_at([point for point, _ in ends], box)
    errors_v = [fun_v for _, (fun_v, _) in ends]
    if problem.kind != "scan":
        errors_v = rmse_by_scan(problem, circuits)
    return [
        Answer(circuit, float(rmse_v), budget.population * int(populations))
        for circuit, rmse_v, (_, (_, populations)) in zip(circuits, errors_v, ends, strict=True)
    ]


DE = Method(
    "de",
    "Differential evolution (Storn and Price, 1997), SciPy's",
    is_deterministic=False,
    run=evolve,
)


def variable_projection(problem: Problem) -> Answer:
    """The best circuit of a search over ln tau alone (Golub and Pereyra, SIAM J. Numer. Anal. 10
    (1973) 413).

    At each set of time constants the resistances are the exact optimum of a bounded linear
    least-squares problem. The outer search is that of the global optimum without its proof: a grid
    over the ordered time constants, evenly spaced in ln tau, whose local minima are polished; a
    dynamic hysteresis adds ln gamma to the search. It draws nothing, and simulates only its answer.
    Raises `MethodFailure` if the box is too wide to compress.
    """
    if not problem.is_compressible:
        raise MethodFailure("the box of time constants is too wide for it; narrow the bounds")
    best = find_global_optimum(problem, prove=False)
    return Answer(best.parameters, best.rmse_v, evaluations=0)


VARPRO = deterministic(
    "varpro",
    "Variable projection (Golub and Pereyra, 1973), bounded resistances, polished grid in tau",
    variable_projection,
)

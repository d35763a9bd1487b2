"""Differential evolution from SciPy: the baseline that is not ours."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.optimize import differential_evolution

from ..execution import compile_for, in_float64, run_blocks
from ..model.problem import Objective, Problem, rmse, rmse_by_scan
from .method import Answer, Budget, Method, MethodFailure, Progress, generator_of, latin_hypercube

# SciPy's own limit.
FEWEST = 5


@in_float64
def evolve(problem: Problem, budget: Budget, progress: Progress) -> list[Answer]:
    """The best circuit of `scipy.optimize.differential_evolution` (Storn and Price, J. Global
    Optim. 11 (1997) 341).

    SciPy's defaults (best1bin, dithered mutation 0.5 to 1, crossover 0.7), in the search
    coordinates and box of all others, over our compiled RMSE; no polish, and no stop before the
    budget is spent but where the whole population has come to one error. Raises `MethodFailure`
    for a population under `FEWEST`.
    """
    box = problem.coordinates
    if budget.population < FEWEST:
        raise MethodFailure(
            f"differential evolution needs a population of at least {FEWEST}, not "
            f"{budget.population}"
        )
    low, high = np.asarray(box.lower), np.asarray(box.upper)
    candidates = jnp.zeros((budget.population, len(low)))
    compiled = compile_for(_errors, candidates, problem.objective)

    @in_float64  # the setting belongs to a thread
    def run(seed: int):
        generator = generator_of(budget.key, seed)
        history = []

        def errors(points: np.ndarray) -> np.ndarray:
            rmse_v = np.asarray(compiled(jnp.asarray(points.T), problem.objective))
            finite = np.where(np.isfinite(rmse_v), rmse_v, np.inf)
            history.append(min(np.min(finite), history[-1] if history else np.inf))
            return finite

        point = evolve_in_box(errors, low, high, generator, budget.population, budget.iterations)
        return point[None], np.array(history)[None]

    ends = run_blocks(run, range(budget.seeds), [1] * budget.seeds, progress)
    circuits = problem.parameters_at([point for point, _ in ends], box)
    errors_v = [history_v[-1] for _, history_v in ends]
    if problem.kind != "scan":
        errors_v = rmse_by_scan(problem, circuits)
    return [
        Answer(circuit, float(rmse_v), budget.population * len(history_v), history_v)
        for circuit, rmse_v, (_, history_v) in zip(circuits, errors_v, ends, strict=True)
    ]


def evolve_in_box(
    errors: Callable[[np.ndarray], np.ndarray],
    low: Float[np.ndarray, "dims"],
    high: Float[np.ndarray, "dims"],
    generator: np.random.Generator,
    population: int,
    iterations: int,
) -> Float[np.ndarray, "dims"]:
    """Where differential evolution ends that starts from a Latin hypercube.

    `errors` takes points as columns. It ends sooner only where all have come to one error.
    """
    fractions = latin_hypercube(generator, population, len(low))
    start: Any = low + fractions * (high - low)  # SciPy's types know of names only
    end = differential_evolution(
        errors,
        list(zip(low, high, strict=True)),
        maxiter=iterations,
        init=start,
        rng=generator,
        tol=0,
        polish=False,
        updating="deferred",
        vectorized=True,
    )
    return np.asarray(end.x)


def _errors(points, objective: Objective):
    return jax.vmap(rmse, in_axes=(0, None))(points, objective)


DE = Method(
    "de",
    "Differential evolution (Storn and Price, 1997), SciPy's",
    is_deterministic=False,
    run=evolve,
)

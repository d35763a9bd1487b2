"""What a user would pick instead: SciPy's differential evolution and the `cmaes` package."""

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor

import cmaes
import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize
from numpy.typing import NDArray

from benchmarks.li2023.test_functions import (
    DIMS,
    FUNCTIONS,
    Problem,
    make_problem,
    quiet_loss_of_problem,
)

from .runs import EVALUATIONS, POPULATION, RUNS, Losses, displacements

METHODS = ("de", "cma-es")


def play_baselines(conditions: tuple[str, ...], key: int, workers: int = 2) -> Losses:
    """Final losses of both baselines, by the same keys and names as those of the optimizers."""
    tasks = [
        (condition, function, method, key)
        for condition in conditions
        for function in FUNCTIONS
        for method in METHODS
    ]
    # Matrices of 30 rows are slower on two threads than on one; the children read this at start.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    # A fork would copy the state of JAX's threads.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        return {
            task[:3]: losses for task, losses in zip(tasks, pool.map(_play, tasks), strict=True)
        }


def differential_evolution(losses_of, half_width: float, seed: int) -> float:
    """SciPy's defaults (best1bin, dithered) with 30 candidates and 499 generations."""
    generator = np.random.default_rng(seed)
    found = scipy.optimize.differential_evolution(
        lambda columns: losses_of(columns.T),
        [(-half_width, half_width)] * DIMS,
        init=generator.uniform(-half_width, half_width, (POPULATION, DIMS)),
        maxiter=EVALUATIONS // POPULATION - 1,
        tol=0,
        polish=False,
        vectorized=True,
        updating="deferred",
        rng=generator,
    )
    return float(found.fun)


def cma_es(losses_of, half_width: float, seed: int) -> float:
    """The package's defaults (14 candidates) from a random point, sigma 0.3 of the box's width.

    But it draws a point outside the box anew once, not a hundred times, and goes on where it would
    stop itself, so that it spends what all others spend.
    """
    generator = np.random.default_rng(seed)
    search = cmaes.CMA(
        mean=generator.uniform(-half_width, half_width, DIMS),
        sigma=0.6 * half_width,
        bounds=np.array([[-half_width, half_width]] * DIMS),
        n_max_resampling=1,
        seed=seed,
    )
    best = np.inf
    for _ in range(EVALUATIONS // search.population_size):
        points = np.array([search.ask() for _ in range(search.population_size)])
        losses = losses_of(points)
        best = min(best, float(losses.min()))
        # A converged search has a covariance that is zero to rounding, and goes on all the same.
        with np.errstate(all="ignore"):
            search.tell(list(zip(points, losses, strict=True)))
    return best


def _play(task: tuple[str, str, str, int]) -> NDArray:
    condition, function, method, key = task
    minimize = {"de": differential_evolution, "cma-es": cma_es}[method]
    half_width = FUNCTIONS[function].half_width
    with jax.enable_x64(True):
        displaced = displacements(condition, key)
        problem = make_problem(function)
        final = []
        for run in range(RUNS):
            displacement = jax.tree.map(lambda leaf, run=run: leaf[run], displaced)
            moved = Problem(problem.index, problem.half_width, displacement)

            def losses_of(points, moved=moved):
                return np.asarray(_losses(jnp.asarray(points), moved))

            final.append(minimize(losses_of, half_width, key % 1_000_000 + run))
    return np.array(final)


@jax.jit
def _losses(points, problem):
    return jax.vmap(quiet_loss_of_problem, (0, None))(points, problem)

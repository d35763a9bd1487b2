"""Paired runs on displaced functions at equal evaluations."""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import optimistix as optx
from numpy.typing import NDArray

from barnax.optimizers import (
    OPTIMIZERS,
    AbstractPopulationMinimiser,
    evaluations_per_iteration,
    make_optimizer,
)
from benchmarks.li2023.test_functions import (
    DIMS,
    FUNCTIONS,
    Displacement,
    Problem,
    draw_displacement,
    make_problem,
    quiet_loss_of_problem,
)

POPULATION, EVALUATIONS, RUNS = 30, 15_000, 30
# Offsets, rotations and keys on which variants were chosen, and those reported on. Nothing may
# be chosen by the second.
DEVELOPMENT_KEY, REPORTING_KEY = 1, 20_261_121
# Folded into a key it gives none of the displacements' keys, whose number is that of their run.
_SEARCHES = 1_000_000
CONDITIONS = ("centered", "shifted", "rotated")

# Final losses of all runs by (condition, function, method).
Losses = dict[tuple[str, str, str], NDArray]


def displacements(condition: str, key: int, runs: int = RUNS) -> Displacement:
    """The displacement of every run, the same for all functions and methods."""
    keys = jr.split(jr.key(key), runs)
    drawn = jax.vmap(lambda key: draw_displacement(key, DIMS, is_rotated=True))(keys)
    straight = jnp.broadcast_to(jnp.eye(DIMS), drawn.rotation.shape)
    if condition == "centered":
        return Displacement(jnp.zeros_like(drawn.offset), straight)
    return drawn if condition == "rotated" else Displacement(drawn.offset, straight)


def optimizers_at_equal_evaluations() -> dict[str, AbstractPopulationMinimiser]:
    """Every registered optimizer with as many generations as the evaluations allow."""
    found = {}
    for name in OPTIMIZERS:
        per_generation = evaluations_per_iteration(make_optimizer(name, POPULATION, 1))
        generations = (EVALUATIONS - POPULATION) // per_generation
        found[name] = make_optimizer(name, POPULATION, generations)
    return found


def play(
    optimizers: Mapping[str, AbstractPopulationMinimiser],
    conditions: tuple[str, ...],
    key: int,
    runs: int = RUNS,
    workers: int = 2,
) -> Losses:
    """Final losses of every optimizer under every condition, two optimizers at a time."""

    def play_one(name: str) -> Losses:
        # The setting of precision is the thread's own.
        with jax.enable_x64(True):
            keys = jr.split(jr.fold_in(jr.key(key), _SEARCHES), runs)
            losses = {}
            for condition in conditions:
                displaced = displacements(condition, key, runs)
                for function in FUNCTIONS:
                    problem = make_problem(function)
                    final = _searches(
                        optimizers[name], problem.index, problem.half_width, displaced, keys
                    )
                    losses[condition, function, name] = np.asarray(final)
            return losses

    with ThreadPoolExecutor(workers) as pool:
        played = pool.map(play_one, optimizers)
        return {name: losses for part in played for name, losses in part.items()}


@eqx.filter_jit
def _searches(optimizer, index, half_width, displaced, keys):
    def one(displacement, key):
        solution = optx.minimise(
            quiet_loss_of_problem,
            optimizer,
            jnp.zeros(DIMS, half_width.dtype),
            Problem(index, half_width, displacement),
            options={"key": key, "lower": -half_width, "upper": half_width},
            max_steps=None,
            throw=False,
        )
        return solution.stats["best_loss"]

    return jax.vmap(one)(displaced, keys)

"""The runs behind Table 2: all of one optimizer on one function in one compiled call."""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np

from barnax.optimizers import (
    AbstractPopulationMinimiser,
    ParticleSwarm,
    make_optimizer,
    minimise,
)
from benchmarks.li2023.test_functions import DIMS, FUNCTIONS, loss_of_problem, make_problem

POPULATION, ITERATIONS, RUNS = 30, 500, 30
OPTIMIZERS = ("pso", "woa", "soa", "sfo", "gwo", "igwo", "bmo", "ibmo")


class Runs(NamedTuple):
    """Best losses of all runs of one optimizer on one function, generation by generation."""

    histories: np.ndarray
    evaluations: int

    @property
    def final(self) -> np.ndarray:
        """The best loss of every run; below the smallest normal number it counts as zero."""
        last = self.histories[:, -1]
        return np.where(np.abs(last) < np.finfo(float).tiny, 0.0, last)


def optimizer_of_table(name: str) -> AbstractPopulationMinimiser:
    """The registered optimizer with the options under which the paper's cells come out."""
    if name == "pso":
        return ParticleSwarm(POPULATION, ITERATIONS, velocity_limit=6.0, bounded=False)
    optimizer = make_optimizer(name, POPULATION, ITERATIONS)
    if name in ("bmo", "ibmo"):
        return dataclasses.replace(optimizer, reevaluate_parents=True)  # pyrefly: ignore
    return optimizer


def run_table(optimizer_name: str, function_name: str, key: jax.Array, runs: int = RUNS) -> Runs:
    """`runs` independent searches; the key of each is folded from `key` by name and number."""
    place = OPTIMIZERS.index(optimizer_name) * len(FUNCTIONS) + list(FUNCTIONS).index(function_name)
    return run_optimizer(
        optimizer_of_table(optimizer_name), function_name, jr.fold_in(key, place), runs
    )


def run_optimizer(
    optimizer: AbstractPopulationMinimiser, function_name: str, key: jax.Array, runs: int
) -> Runs:
    """`runs` independent searches of an optimizer in one compiled call."""
    problem, width = make_problem(function_name), FUNCTIONS[function_name].half_width
    solution = minimise(
        loss_of_problem,
        optimizer,
        jnp.full(DIMS, -width),
        jnp.full(DIMS, width),
        key=jr.split(key, runs),
        args=(problem, key),
        keyed_objective=True,
        throw=False,
    )
    stats = solution.stats
    return Runs(np.asarray(stats["history"]), int(stats["evaluations"][0]))

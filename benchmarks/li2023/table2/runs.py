"""The runs behind Table 2: all of one optimizer on one function in one compiled call."""

import dataclasses
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import optimistix as optx

from barnax.optimizers import AbstractPopulationMinimiser, ParticleSwarm, make_optimizer
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
    histories, evaluations = _searches(optimizer, make_problem(function_name), jr.split(key, runs))
    return Runs(np.asarray(histories), int(evaluations[0]))


@eqx.filter_jit
def _searches(optimizer, problem, keys):
    half_width = problem.half_width

    def one(key):
        solution = optx.minimise(
            loss_of_problem,
            optimizer,
            jnp.zeros(DIMS, half_width.dtype),
            (problem, key),
            options={
                "key": key,
                "lower": -half_width,
                "upper": half_width,
                "keyed_objective": True,
            },
            max_steps=None,
            throw=False,
        )
        return solution.stats["history"], solution.stats["evaluations"]

    return jax.vmap(one)(keys)

"""Our searches on the same problems, and our values at the same points."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import optimistix as optx
from numpy.typing import NDArray

from barnax.optimizers import AbstractPopulationMinimiser
from benchmarks.li2023.test_functions import (
    DIMS,
    FUNCTIONS,
    QUIET_FUNCTIONS,
    Displacement,
    Problem,
    make_problem,
    quiet_loss_of_problem,
)

from .comparisons import COMPARISONS, Comparison
from .sizes import OUR_RUNS, POINTS, SHIFTED


class Sample(NamedTuple):
    """Final losses by problem, and how many evaluations a run took."""

    final: dict[str, NDArray]
    evaluations: list[int]


def make_experiment(key: int) -> dict:
    """What every worker is told: problems, key and points. It can be written as JSON."""
    generator = np.random.default_rng(key)
    offset = generator.uniform(-0.6, 0.6, DIMS)
    problems = [
        {
            "name": f"{name} shifted" if is_shifted else name,
            "function": name,
            "half_width": FUNCTIONS[name].half_width,
            "offset": (offset * FUNCTIONS[name].half_width * is_shifted).tolist(),
        }
        for is_shifted in (False, True)
        for name in (SHIFTED if is_shifted else FUNCTIONS)
    ]
    points = {
        name: (generator.uniform(-1, 1, (POINTS, DIMS)) * function.half_width).tolist()
        for name, function in FUNCTIONS.items()
    }
    return {"key": key, "problems": problems, "points": points}


def our_values(points: dict[str, list]) -> dict[str, NDArray]:
    """Our functions, F5 without noise, at the points."""
    with jax.enable_x64(True):
        return {
            name: np.array(
                [QUIET_FUNCTIONS[name].loss(jnp.asarray(x), jr.key(0)) for x in points[name]]
            )
            for name in points
        }


def our_samples(experiment: dict) -> dict[str, tuple[Sample, Sample]]:
    """By comparison, what ours find under the same rule and under the control's."""
    histories: dict[str, dict[str, NDArray]] = {}
    with jax.enable_x64(True):
        for comparison in COMPARISONS:
            for optimizer in (comparison.ours, comparison.control):
                if repr(optimizer) not in histories:
                    key = jr.fold_in(jr.key(experiment["key"]), len(histories))
                    histories[repr(optimizer)] = _histories(optimizer, experiment, key)
    return {
        comparison.name: (
            _sample(histories[repr(comparison.ours)], comparison),
            _sample(histories[repr(comparison.control)], comparison),
        )
        for comparison in COMPARISONS
    }


def _histories(
    optimizer: AbstractPopulationMinimiser, experiment: dict, key: jax.Array
) -> dict[str, NDArray]:
    """Best losses by run and generation; other keys for every problem."""
    found = {}
    for place, problem in enumerate(experiment["problems"]):
        plain = make_problem(problem["function"])
        moved = Problem(
            plain.index,
            plain.half_width,
            Displacement(jnp.asarray(problem["offset"]) / plain.half_width),
        )
        keys = jr.split(jr.fold_in(key, place), OUR_RUNS)
        found[problem["name"]] = np.asarray(_searches(optimizer, moved, keys))
    return found


def _sample(histories: dict[str, NDArray], comparison: Comparison) -> Sample:
    generation = comparison.ours.iterations - (not comparison.evaluates_last_move)
    return Sample(
        {name: history[:, generation] for name, history in histories.items()},
        [comparison.ours.population * (generation + 1)],
    )


@eqx.filter_jit
def _searches(optimizer, problem, keys):
    half_width = problem.half_width

    def one(key):
        solution = optx.minimise(
            quiet_loss_of_problem,
            optimizer,
            jnp.zeros(DIMS, half_width.dtype),
            problem,
            options={"key": key, "lower": -half_width, "upper": half_width},
            max_steps=None,
            throw=False,
        )
        return solution.stats["history"]

    return jax.vmap(one)(keys)

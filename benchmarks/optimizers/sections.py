"""The sections of the page beside the suites: the circuit, and what a generation costs."""

import time
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np

import barnax
from barnax.bundled import BUNDLED
from barnax.execution import in_float64
from barnax.model.problem import rmse
from barnax.optimizers import ParticleSwarm, evaluations_per_iteration, make_optimizer, minimise

from .runs import CANDIDATES, HALF_WIDTH, OURS

DIMS, GENERATIONS, SEEDS = 30, 2000, 32
# Relative excess over the lowest RMSE at which a seed has the circuit.
CLOSE = 1e-6


@in_float64
def circuit() -> dict[str, Any]:
    """How many of 32 seeds find the bundled cell's circuit, and after how many evaluations."""
    tests = [barnax.read_record(path) for path in BUNDLED.ocv]
    cell = barnax.characterize(tests, ocv_fit="interpolated")
    record = barnax.read_record(barnax.bundled_file("identification"))
    problem = barnax.make_problem(record, cell, "iso-rc", coordinates="log")
    objective, box = problem.objective, problem.objective.coordinates
    lowest_v = barnax.find_global_optimum(problem).rmse_v
    keys = jax.vmap(partial(jr.fold_in, jr.key(1)))(jnp.arange(SEEDS))
    rows = []
    for name, population, evaluations in (
        *((name, CANDIDATES, 15_000) for name in OURS),
        *(("ibmo-adaptive", *budget) for budget in ((40, 3000), (30, 3000), (30, 2000))),
    ):
        cost = evaluations_per_iteration(make_optimizer(name, population, 1))
        optimizer = make_optimizer(name, population, (evaluations - population) // cost)
        solution = minimise(rmse, optimizer, box.lower, box.upper, key=keys, args=objective)
        is_there = np.asarray(solution.stats["history"]) <= (1 + CLOSE) * lowest_v
        spent = population + cost * is_there.argmax(axis=1)[is_there[:, -1]]
        median_and_most = [int(np.median(spent)), int(spent.max())] if len(spent) else ["", ""]
        rows.append([name, population, f"{evaluations:,}", len(spent), *median_and_most])
    return {"rows": rows}


def sphere(position, args):
    return jnp.sum(position**2)


def seconds(compiled: Any, *args: Any) -> float:
    """The shortest of three runs."""
    spent = []
    for _ in range(3):
        start = time.perf_counter()
        jax.block_until_ready(compiled(*args))
        spent.append(time.perf_counter() - start)
    return min(spent)


class TwoNumbers(ParticleSwarm):
    """A swarm that draws two numbers a particle as evosax's does, in place of two a dimension."""

    def draw(self, key, generation, box):
        pulls = jnp.array([self.memory_pull, self.swarm_pull], box.lower.dtype)[:, None, None]
        return pulls * jr.uniform(key, (2, self.population, 1), box.lower.dtype)


# What is timed beside the optimizers that have a name.
VARIANTS = {"pso, two numbers a particle": TwoNumbers}


def compiled_search(name: str, generations: int, keys: jax.Array) -> Any:
    ends = jnp.full(DIMS, -HALF_WIDTH), jnp.full(DIMS, HALF_WIDTH)
    make = VARIANTS.get(name, partial(make_optimizer, name))
    optimizer = make(CANDIDATES, generations)
    search = jax.jit(lambda keys: minimise(sphere, optimizer, *ends, key=keys).stats["best_loss"])
    return search.lower(keys).compile()


def speed() -> dict[str, Any]:
    """Microseconds of a generation."""
    key = jr.key(0)
    rates = [
        [name, 1e6 * seconds(compiled_search(name, GENERATIONS, key), key) / GENERATIONS]
        for name in (*OURS, *VARIANTS)
    ]
    return {"rows": rates + evosax_rates(key)}


def many_seeds() -> dict[str, Any]:
    """Seconds and memory of a call against its seeds."""
    rows = []
    for count in (1, 10, 100, 1000):
        keys = jr.split(jr.key(0), count)
        search = compiled_search("ibmo", 200, keys)
        usage = search.memory_analysis()
        size = usage.temp_size_in_bytes + usage.argument_size_in_bytes + usage.output_size_in_bytes
        rows.append([count, seconds(search, keys), size / 2**20])
    return {"rows": rows}


def evosax_rates(key: jax.Array) -> list[list[Any]]:
    """The same of evosax, where it is installed."""
    try:
        from evosax import algorithms
    except ImportError:
        return []
    losses, rows = jax.vmap(lambda x: sphere(x, None)), []
    for name in ("PSO", "DifferentialEvolution", "CMA_ES"):
        strategy = getattr(algorithms, name)(population_size=CANDIDATES, solution=jnp.zeros(DIMS))
        params = strategy.default_params
        first = jr.uniform(key, (CANDIDATES, DIMS), minval=-HALF_WIDTH, maxval=HALF_WIDTH)
        if name == "CMA_ES":
            state = strategy.init(key, first[0], params)
        else:
            state = strategy.init(key, first, losses(first), params)

        def generation(state, key, strategy=strategy, params=params):
            ask_key, tell_key = jr.split(key)
            positions, state = strategy.ask(ask_key, state, params)
            return strategy.tell(tell_key, positions, losses(positions), state, params)[0], None

        run = jax.jit(lambda state, keys, f=generation: jax.lax.scan(f, state, keys)[0])
        keys = jr.split(key, GENERATIONS)
        jax.block_until_ready(run(state, keys))
        rows.append([f"evosax {name}", 1e6 * seconds(run, state, keys) / GENERATIONS])
    return rows

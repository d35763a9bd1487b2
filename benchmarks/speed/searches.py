"""Our side of the table: generations, searches, descents, the reduction."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Float

import barnax
from barnax.execution import compile_for
from barnax.model.compressed import Compressed, compress
from barnax.model.problem import Objective, rmse
from barnax.optimizers import make_optimizer
from barnax.search.seeds import _search

from .sizes import KEY, POPULATION, Sizes


def generations(
    objective: Objective, points: Float[Array, "points free"], count: int
) -> Callable[[], object]:
    """The errors of a population `count` times over, in one compiled call as in a search."""
    populations = jnp.stack([points] * count)
    program = compile_for(_generations, populations, objective)
    return lambda: jax.block_until_ready(program(populations, objective))


def _generations(populations: Float[Array, "count points free"], objective: Objective):
    evaluate = jax.vmap(rmse, in_axes=(0, None))
    return jax.lax.map(lambda points: evaluate(points, objective), populations)


def optimizer_of(sizes: Sizes):
    """The default optimizer, with the paper's population."""
    return make_optimizer("ibmo", POPULATION, sizes.generations)


def one_search(objective: Objective, sizes: Sizes) -> Callable[[], object]:
    """The program of a single seed. `barnax.identify` would run it in a block of eight."""
    optimizer = optimizer_of(sizes)
    keys = jr.key(KEY)[None]
    program = compile_for(_search, optimizer, objective, keys)
    return lambda: jax.block_until_ready(program(optimizer, objective, keys))


def identify(problem: barnax.Problem, sizes: Sizes, seeds: int) -> barnax.Search:
    """Many seeds, as a user asks for them."""
    return barnax.search_seeds(problem, optimizer_of(sizes), key=jr.key(KEY), seeds=seeds)


def reduce_record(problem: barnax.Problem) -> Compressed:
    """The factor of a problem's records, made afresh."""
    return compress(problem.prepared_records, problem.coordinates)

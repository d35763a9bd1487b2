"""Where the time goes: the parts of a reduction and of a search, each on its own."""

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import optimistix as optx

from barnax.compressed import TOLERANCE, _blocks
from barnax.exponentials import span_of

from .case import bundled_problem, points_of
from .searches import generations, one_search, optimizer_of, reduce_record
from .sizes import KEY, POPULATION, Sizes
from .turns import Run, take_turns


def profile(sizes: Sizes) -> list[tuple[str, float]]:
    """Names and seconds of wholes and of their parts."""
    problem = bundled_problem("compressed")
    box, drive, objective = problem.coordinates, problem.drives[0], problem.objective
    span = span_of(box.shortest_tau_s, box.longest_tau_s, TOLERANCE)
    optimizer, keys = optimizer_of(sizes), jr.key(KEY)[None]
    points = points_of(problem, POPULATION)
    short = problem.compressed
    runs = {
        "the reduction": Run(lambda: reduce_record(problem)),
        f"of it, the answers of {len(span.skeleton)} pairs to the current": Run(
            lambda: list(_blocks(drive, span, None))
        ),
        f"a compressed search, factor of {short.factor.shape[0]} x {short.factor.shape[1]}": Run(
            one_search(objective, sizes)
        ),
        "the same generations without a search": Run(
            generations(objective, points, sizes.generations)
        ),
        "the same search of a sphere, which costs nothing": Run(
            lambda: jax.block_until_ready(_search_sphere(optimizer, keys, box))
        ),
    }
    taken = take_turns(runs, 3 * sizes.turns)
    return [(name, taken[name]) for name in runs]


@eqx.filter_jit
def _search_sphere(optimizer, keys, box):
    def one(key):
        options = {"key": key, "lower": box.lower, "upper": box.upper}
        middle = (box.lower + box.upper) / 2
        solution = optx.minimise(
            _sphere, optimizer, box.lower, middle, options, max_steps=None, throw=False
        )
        return solution.value, solution.stats["history"]

    return jax.vmap(one)(keys)


def _sphere(point, middle):
    return jnp.sum((point - middle) ** 2)

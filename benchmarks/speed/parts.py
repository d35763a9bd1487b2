"""Where the time goes: the parts of a reduction and of a search, each on its own."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import optimistix as optx

from barnax.blas import one_blas_thread
from barnax.cell.parameters import ANYWHERE
from barnax.execution import in_float64
from barnax.model.factor import update_triangular
from barnax.model.layout import Layout, ends_of, spans_between
from barnax.model.reduced import CHAINS, blocks
from barnax.model.simulate import BLOCK as TURN

from .case import bundled_problem, points_of
from .searches import generations, one_search, optimizer_of, reduce_record
from .sizes import KEY, POPULATION, Sizes
from .turns import Run, take_turns


def profile(sizes: Sizes) -> tuple[list[tuple[str, float]], list[str]]:
    """Names and seconds of wholes and of their parts, and what follows from them."""
    problem = bundled_problem("compressed")
    box, prepared, objective = problem.coordinates, problem.prepared, problem.objective
    spans = span, _ = spans_between(ends_of([prepared], box))
    layout = Layout(ANYWHERE, ANYWHERE, *spans, has_correction=False, has_amplitude=False)
    optimizer, keys = optimizer_of(sizes), jr.key(KEY)[None]
    points = points_of(problem, POPULATION)
    short, scan = problem.compressed, bundled_problem().objective
    rows, columns = len(prepared.soc), len(span.skeleton) + 2
    samples = np.random.default_rng(KEY).normal(size=(rows, columns))
    halves = np.array_split(samples, CHAINS)
    count = sizes.generations_a_turn
    factoring = f"of it, the factor of {rows:,} x {columns} numbers"
    reduction = "the reduction"
    generation = f"one generation, scan, {POPULATION} candidates"
    runs = {
        reduction: Run(lambda: reduce_record(problem)),
        f"of it, the answers of {len(span.skeleton)} pairs to the current": Run(
            in_float64(lambda: list(blocks(prepared, layout)))
        ),
        factoring: Run(lambda: _factor_chains(halves)),
        f"a compressed search, factor of {short.factor.shape[0]} x {short.factor.shape[1]}": Run(
            one_search(objective, sizes)
        ),
        "the same generations without a search": Run(
            generations(objective, points, sizes.generations)
        ),
        "the same search of a sphere, which costs nothing": Run(
            lambda: jax.block_until_ready(_search_sphere(optimizer, keys, box))
        ),
        generation: Run(generations(scan, points, count), each=count),
    }
    taken = take_turns(runs, 3 * sizes.turns)
    speed = 2 * rows * columns**2 / taken[factoring]
    follows = [
        f"The factor by itself takes {100 * taken[factoring] / taken[reduction]:.0f} % of the "
        f"reduction's time. It is LAPACK's work, {speed / 1e9:.0f} GFLOP/s of 2 rows columns^2 "
        "operations. Normal equations would need half as many and cost half the digits, which the "
        "promised 1e-9 does not allow.",
        f"A sample of a generation takes {1e9 * taken[generation] / rows:.1f} ns. The scan moves "
        f"every state {(2 * TURN - 1) / TURN:g} times a sample, for XLA sums the errors apart from "
        "the states, the kernel once; it needs one operation for that where the kernel needs two.",
    ]
    return [(name, taken[name]) for name in runs], follows


def _factor_chains(parts: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The factors of several matrices at a time, which a reduction then joins."""
    with one_blas_thread(), ThreadPoolExecutor(len(parts)) as pool:
        empty = np.zeros((parts[0].shape[1],) * 2)
        return list(pool.map(lambda rows: update_triangular(empty, rows), parts))


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

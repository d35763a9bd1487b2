"""What every registered optimizer promises, run over the registry.

An optimizer's tests share two compiled programs, one search and three beside each other; what
differs from test to test are the numbers of the trial, which are arguments.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import optimistix as optx
import pytest

from barnax.optimizers import (
    OPTIMIZERS,
    Box,
    Swarm,
    evaluations_per_iteration,
    make_optimizer,
    minimise,
)
from helpers.compiling import USERS_KERNELS

POPULATION, ITERATIONS, DIMS = 12, 60, 4
LOWER, UPPER = -3.0, 2.0


class Trial(eqx.Module):
    """A sphere about `center` that fails where the first coordinate exceeds `limit`, and outside
    the box."""

    center: float = 1.0
    limit: float = jnp.inf
    failure: float = jnp.nan


# One of each family; what its others do otherwise has tests in `test_rules`.
QUICK = ("ibmo", "pso", "gwo", "aga")
ALL = [pytest.param(each, marks=[] if each in QUICK else [pytest.mark.slow]) for each in OPTIMIZERS]


@pytest.fixture(scope="module", params=ALL)
def name(request):
    return request.param


def sphere(x, center):
    return jnp.sum((x - center) ** 2)


def trial_loss(x, trial):
    fails = (x[0] > trial.limit) | jnp.any((x < LOWER) | (x > UPPER))
    return jnp.where(fails, trial.failure, sphere(x, trial.center)), x + 1


def searches(name, keys, trial):
    """One compilation an optimizer and number of keys; the trial's numbers are arguments."""

    return minimise(
        trial_loss,
        make_optimizer(name, POPULATION, ITERATIONS),
        jnp.full(DIMS, LOWER, trial.center.dtype),
        jnp.full(DIMS, UPPER, trial.center.dtype),
        key=keys,
        args=trial,
        has_aux=True,
        throw=False,
    )


quick_searches = jax.jit(searches, static_argnames="name")
as_users_search = jax.jit(searches, static_argnames="name", compiler_options=USERS_KERNELS)


def three_searches(name, seed=3, dtype=jnp.float32, run=quick_searches, **trial):
    arrays = jax.tree.map(lambda number: jnp.asarray(number, dtype), Trial(**trial))
    with jax.numpy_dtype_promotion("strict"):
        return run(name, jr.split(jr.key(seed), 3), arrays)


@functools.cache
def searched(name):
    return three_searches(name)


def test_the_same_key_gives_the_same_bits(name):
    first, second, other = searched(name), three_searches(name), three_searches(name, seed=4)
    np.testing.assert_array_equal(first.stats["history"], second.stats["history"])
    np.testing.assert_array_equal(first.value, second.value)
    assert not np.array_equal(first.stats["history"], other.stats["history"])


# It takes a program of its own.
@pytest.mark.slow
def test_a_search_gives_the_same_bits_alone_and_beside_others(name):
    together = three_searches(name, run=as_users_search)
    trial = jax.tree.map(jnp.float32, Trial())
    for index, key in enumerate(jr.split(jr.key(3), 3)):
        alone = as_users_search(name, key[None], trial)
        np.testing.assert_array_equal(alone.stats["history"][0], together.stats["history"][index])
        np.testing.assert_array_equal(alone.value[0], together.value[index])


def test_the_best_loss_never_rises_and_is_the_loss_of_the_answer(name):
    solution = searched(name)
    history = np.asarray(solution.stats["history"])
    assert history.shape == (3, ITERATIONS + 1)
    assert (np.diff(history) <= 0).all()
    assert (history[:, -1] < history[:, 0]).all()
    np.testing.assert_array_equal(history[:, -1], solution.stats["best_loss"])
    losses = jax.vmap(sphere, (0, None))(solution.value, 1.0)
    np.testing.assert_allclose(history[:, -1], losses, rtol=1e-5)
    np.testing.assert_array_equal(solution.aux, solution.value + 1)


def test_each_evaluation_is_counted(name):
    optimizer = make_optimizer(name, POPULATION, ITERATIONS)
    expected = POPULATION + ITERATIONS * evaluations_per_iteration(optimizer)
    assert (searched(name).stats["evaluations"] == expected).all()


def test_candidates_never_leave_the_box_though_the_best_lies_outside(name):
    solution = three_searches(name, center=5.0)
    np.testing.assert_array_equal(solution.stats["failures"], 0)


@pytest.mark.parametrize("failure", [jnp.nan, jnp.inf, -jnp.inf])
def test_a_loss_that_is_not_finite_never_wins(name, failure):
    solution = three_searches(name, limit=0.5, failure=failure)
    assert jnp.all(jnp.isfinite(solution.stats["best_loss"]))
    assert jnp.all(solution.value[:, 0] <= 0.5)
    assert jnp.all(solution.stats["failures"] > 0)


def test_a_search_where_everything_fails_says_so(name):
    solution = three_searches(name, limit=-jnp.inf)
    assert jnp.all(solution.result == optx.RESULTS.nonfinite)
    np.testing.assert_array_equal(solution.stats["failures"], solution.stats["evaluations"])


# Some hundred times what the worst of sixty keys leaves.
SOLVED_TO = {
    "ibmo": 1e-24,
    "ibmo-printed": 1e-24,
    "ibmo-centered": 1e-3,
    "ibmo-adaptive": 1.0,
    "bmo": 1e-20,
    "pso": 1e-4,
    "woa": 1e-4,
    "soa": 1e-2,
    "sfo": 1e-2,
    "gwo": 1e-6,
    "igwo": 1e-6,
    "apso": 1e-4,
    "mcpso": 1e-2,
    "cpso": 1e-4,
    "aga": 1.0,
    "esfo": 2.0,
    "aeo": 1e-2,
}


def test_the_sphere_about_the_origin_is_solved(name):
    assert jnp.max(three_searches(name, center=0.0).stats["best_loss"]) < SOLVED_TO[name]


def test_single_precision_stays_single(name):
    solution = searched(name)
    assert solution.value.dtype == solution.stats["history"].dtype == jnp.float32


# What all share holds double precision too; what is an algorithm's own does in the test below.
def test_a_search_in_double_precision_is_double_throughout():
    with jax.enable_x64(True):
        solution = jax.eval_shape(lambda: three_searches("bmo", dtype=jnp.float64, run=searches))
    assert solution.value.dtype == solution.stats["history"].dtype == jnp.float64


@pytest.mark.parametrize(("population", "dtype"), [(4, jnp.float32), (31, jnp.float64)])
def test_any_population_of_four_or_more_keeps_its_size_and_precision(name, population, dtype):
    optimizer = make_optimizer(name, population, 3)

    def a_generation(key):
        box = Box(jnp.zeros(1, dtype), jnp.ones(1, dtype))
        start = optimizer.start(key, box, dtype)
        swarm = optimizer.prepare(Swarm(start, start[:, 0]), box)
        drawn = optimizer.draw(key, jnp.array(1), box)
        positions, memory = optimizer.propose(drawn, swarm, jnp.array(1), box)
        offspring = Swarm(positions, positions[:, 0], memory)
        return swarm, optimizer.survive(swarm, offspring, jnp.array(1))

    with jax.enable_x64(dtype is jnp.float64), jax.numpy_dtype_promotion("strict"):
        before, after = jax.eval_shape(a_generation, jr.key(0))
    assert before.positions.shape == (population, 1)
    assert before.positions.dtype == dtype
    assert jax.tree.map(lambda leaf: (leaf.shape, leaf.dtype), before) == jax.tree.map(
        lambda leaf: (leaf.shape, leaf.dtype), after
    )


@pytest.mark.slow
def test_a_keyed_objective_sees_a_fresh_key_at_every_evaluation():
    seen = []

    def write_down(draws):
        seen.append(np.array(draws))
        return seen[-1]

    def draw_of(x, data_and_key):
        draw = jr.uniform(data_and_key[1])
        # The loss comes back from Python, so nothing can be evaluated and not written down.
        return jax.pure_callback(write_down, draw, draw, vmap_method="expand_dims")

    solution = minimise(
        draw_of,
        make_optimizer("bmo", 12, 25),
        jnp.full(3, LOWER),
        jnp.full(3, UPPER),
        key=jr.key(6),
        args=(None, jr.key(0)),
        keyed_objective=True,
    )
    draws = np.concatenate(seen)
    # Uniform float32 numbers have 2^23 values, so a few hundred draws hardly ever coincide.
    assert len(set(draws.tolist())) > 0.99 * len(draws)
    assert solution.stats["evaluations"] == len(draws)
    assert solution.stats["best_loss"] == draws.min()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (("simplex", 30, 10), "there are ibmo, "),
        (("bmo", 3, 10), "at least 4 candidates; 3 was"),
        (("bmo", 30, 0), "at least 1 iteration; 0 was"),
    ],
)
def test_an_unknown_name_and_a_budget_too_small_are_refused(given, words):
    with pytest.raises(ValueError, match=words):
        make_optimizer(*given)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"key": None}, "key"),
        ({"lower": None}, "lack lower"),
        ({"upper": None}, "lack upper"),
        ({"lower": 5.0, "upper": -5.0}, "above the upper"),
    ],
)
def test_options_that_make_no_search_are_refused(changed, words):
    options = {"key": jr.key(0), "lower": LOWER, "upper": UPPER} | changed
    options = {name: value for name, value in options.items() if value is not None}

    with pytest.raises(ValueError, match=words):
        optx.minimise(sphere, make_optimizer("bmo", 4, 1), jnp.zeros(2), 0.0, options=options)

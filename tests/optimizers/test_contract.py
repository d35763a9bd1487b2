"""What every registered optimizer promises, run over the registry.

An optimizer's tests follow one another on one worker and share three compiled programs: five
searches, one search, and one search whose every evaluation is written down.
"""

import functools
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import optimistix as optx
import pytest

from barnax.optimizers import OPTIMIZERS, Box, Swarm, evaluations_per_iteration, make_optimizer

POPULATION, ITERATIONS, DIMS = 30, 500, 10
LOWER, UPPER = -3.0, 2.0

# What is written down is so in Python, so these searches are short.
FEW, SHORT = 12, 25
NARROW = (jnp.array([0.0, 10.0, -5.0]), jnp.array([1.0, 20.0, -4.0]))


class Trial(eqx.Module):
    """A sphere about `center` that fails where the first coordinate exceeds `limit`."""

    center: float
    limit: float = jnp.inf
    failure: float = jnp.nan


class Seen(NamedTuple):
    """Every evaluation of one search, and the search's own account of itself."""

    positions: np.ndarray
    draws: np.ndarray
    losses: np.ndarray
    solution: optx.Solution


@pytest.fixture(scope="module", params=list(OPTIMIZERS))
def name(request):
    return request.param


def sphere(x, center):
    return jnp.sum((x - center) ** 2)


def trial_loss(x, trial):
    loss = jnp.where(x[0] > trial.limit, trial.failure, sphere(x, trial.center))
    return loss, x + 1


@eqx.filter_jit
def searches(name, keys, trial):
    """One compilation an optimizer and number of keys; the trial's numbers are arguments."""

    def one(key):
        return optx.minimise(
            trial_loss,
            make_optimizer(name, POPULATION, ITERATIONS),
            jnp.zeros(DIMS, trial.center.dtype),
            trial,
            has_aux=True,
            options={"key": key, "lower": LOWER, "upper": UPPER},
            max_steps=None,
            throw=False,
        )

    return jax.vmap(one)(keys)


def five_searches(name, seed, trial=None, dtype=jnp.float32):
    trial = Trial(1.0) if trial is None else trial
    arrays = jax.tree.map(lambda number: jnp.asarray(number, dtype), trial)
    with jax.numpy_dtype_promotion("strict"):
        return searches(name, jr.split(jr.key(seed), 5), arrays)


def test_the_same_key_gives_the_same_bits(name):
    first, second, other = (five_searches(name, seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.stats["history"], second.stats["history"])
    np.testing.assert_array_equal(first.value, second.value)
    assert not np.array_equal(first.stats["history"], other.stats["history"])


def test_a_search_gives_the_same_bits_alone_and_beside_others(name):
    together = five_searches(name, 5)
    trial = jax.tree.map(jnp.float32, Trial(1.0))
    for seed, key in enumerate(jr.split(jr.key(5), 5)):
        alone = searches(name, key[None], trial)
        np.testing.assert_array_equal(alone.stats["history"][0], together.stats["history"][seed])
        np.testing.assert_array_equal(alone.value[0], together.value[seed])


def test_the_best_loss_never_rises_and_is_the_loss_of_the_answer(name):
    solution = five_searches(name, 1)
    history = np.asarray(solution.stats["history"])
    assert history.shape == (5, ITERATIONS + 1)
    assert (np.diff(history) <= 0).all()
    assert (history[:, -1] < history[:, 0]).all()
    np.testing.assert_array_equal(history[:, -1], solution.stats["best_loss"])
    losses = jax.vmap(sphere, (0, None))(solution.value, 1.0)
    np.testing.assert_allclose(history[:, -1], losses, rtol=1e-5)


def test_the_extra_output_is_that_of_the_best_candidate(name):
    solution = five_searches(name, 7)
    np.testing.assert_array_equal(solution.aux, solution.value + 1)


@pytest.mark.parametrize("failure", [jnp.nan, jnp.inf, -jnp.inf])
def test_a_loss_that_is_not_finite_never_wins(name, failure):
    solution = five_searches(name, 2, Trial(1.0, limit=0.5, failure=failure))
    assert jnp.all(jnp.isfinite(solution.stats["best_loss"]))
    assert jnp.all(solution.value[:, 0] <= 0.5)
    assert jnp.all(solution.stats["failures"] > 0)


def test_a_search_where_everything_fails_says_so(name):
    solution = five_searches(name, 2, Trial(1.0, limit=-jnp.inf))
    assert jnp.all(solution.result == optx.RESULTS.nonfinite)
    np.testing.assert_array_equal(solution.stats["failures"], solution.stats["evaluations"])


# Upper bounds in ten dimensions, which are easier than the thirty of Li et al. (2023), Table 2.
SOLVED_TO = {
    "ibmo": 1e-30,
    "ibmo-printed": 1e-30,
    "ibmo-centered": 1e-12,
    "bmo": 1e-30,
    "pso": 1e-4,
    "woa": 1e-6,
    "soa": 1e-4,
    "sfo": 1e-4,
    "gwo": 1e-12,
    "igwo": 1e-12,
}


def test_the_sphere_about_the_origin_is_solved_to_the_published_order(name):
    solution = five_searches(name, 0, Trial(0.0))
    assert jnp.max(solution.stats["best_loss"]) < SOLVED_TO[name]


@functools.cache
def watched(name):
    """One search of an objective that pulls out of the box and adds noise of its own."""
    seen = []

    def write_down(*batch):
        seen.append(jax.tree.map(np.array, batch))
        return seen[-1][-1]

    def pull(x, center_and_key):
        center, key = center_and_key
        draw = jr.uniform(key)
        loss = sphere(x, center) + draw
        # The loss comes back from Python, so nothing can be evaluated and not written down.
        return jax.pure_callback(write_down, loss, x, draw, loss, vmap_method="broadcast_all")

    @eqx.filter_jit
    def search(lower, upper):
        # The key is a constant: its draws are made while compiling, in a quarter of the time.
        options = {"key": jr.key(6), "lower": lower, "upper": upper, "keyed_objective": True}
        solver = make_optimizer(name, FEW, SHORT)
        args = (5.0, jr.key(0))
        return optx.minimise(pull, solver, jnp.zeros(3), args, options=options, max_steps=None)

    solution = jax.block_until_ready(search(*NARROW))
    return Seen(*map(np.concatenate, zip(*seen, strict=True)), solution)


def test_candidates_never_leave_the_box(name):
    positions = watched(name).positions
    assert (positions.min(axis=0) >= NARROW[0]).all()
    assert (positions.max(axis=0) <= NARROW[1]).all()


def test_each_evaluation_is_counted(name):
    seen = watched(name)
    expected = FEW + SHORT * evaluations_per_iteration(make_optimizer(name, FEW, SHORT))
    assert seen.solution.stats["evaluations"] == len(seen.losses) == expected


def test_a_keyed_objective_sees_a_fresh_key_at_every_evaluation(name):
    seen = watched(name)
    # Uniform float32 numbers have 2^23 values, so a few hundred draws hardly ever coincide.
    assert len(set(seen.draws)) > 0.99 * len(seen.draws)
    assert seen.solution.stats["best_loss"] == np.float32(seen.losses.min())


def test_double_precision_is_kept_and_nothing_is_promoted(name):
    """Single precision is what the other tests run in."""
    with jax.enable_x64(True):
        solution = jax.eval_shape(lambda: five_searches(name, 8, dtype=jnp.float64))
    assert solution.value.dtype == solution.stats["history"].dtype == jnp.float64


def test_single_precision_is_kept(name):
    solution = five_searches(name, 1)
    assert solution.value.dtype == solution.stats["history"].dtype == jnp.float32


@pytest.mark.parametrize("population", [4, 5, 31, 200])
def test_any_population_of_four_or_more_keeps_its_size(name, population):
    optimizer = make_optimizer(name, population, 3)

    def a_generation(key):
        box = Box(jnp.zeros(1), jnp.ones(1))
        start = optimizer.start(key, box, box.lower.dtype)
        swarm = optimizer.prepare(Swarm(start, start[:, 0]), box)
        drawn = optimizer.draw(key, jnp.array(1), box)
        positions, memory = optimizer.propose(drawn, swarm, jnp.array(1), box)
        offspring = Swarm(positions, positions[:, 0], memory)
        return swarm, optimizer.survive(swarm, offspring, jnp.array(1))

    before, after = jax.eval_shape(a_generation, jr.key(0))
    assert before.positions.shape == (population, 1)
    assert jax.tree.map(jnp.shape, before) == jax.tree.map(jnp.shape, after)


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(ValueError, match="there are ibmo, "):
        make_optimizer("simplex", 30, 10)


@pytest.mark.parametrize(("population", "iterations"), [(3, 10), (30, 0)])
def test_a_budget_too_small_is_refused(population, iterations):
    with pytest.raises(ValueError, match="at least"):
        make_optimizer("bmo", population, iterations)


@pytest.mark.parametrize("missing", ["key", "lower", "upper"])
def test_a_missing_option_is_named(missing):
    options = {"key": jr.key(0), "lower": LOWER, "upper": UPPER}
    del options[missing]
    with pytest.raises(ValueError, match=missing):
        optx.minimise(sphere, make_optimizer("bmo", 4, 1), jnp.zeros(2), 0.0, options=options)


def test_bounds_in_the_wrong_order_are_refused():
    options = {"key": jr.key(0), "lower": 5.0, "upper": -5.0}
    with pytest.raises(ValueError, match="above the upper"):
        optx.minimise(sphere, make_optimizer("bmo", 4, 1), jnp.zeros(2), 0.0, options=options)


def test_a_start_that_is_no_array_is_refused():
    options = {"key": jr.key(0), "lower": LOWER, "upper": UPPER}
    start = {"x": jnp.zeros(2)}
    with pytest.raises(ValueError, match="one array"):
        optx.minimise(
            lambda y, args: sphere(y["x"], args), make_optimizer("bmo", 4, 1), start, 0.0,
            options=options,
        )  # fmt: skip

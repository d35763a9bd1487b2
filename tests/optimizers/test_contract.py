"""What every registered optimizer promises, run over the registry."""

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import optimistix as optx
import pytest

from barnax.optimizers import OPTIMIZERS, evaluations_per_iteration, make_optimizer

POPULATION, ITERATIONS, DIMS = 12, 25, 4
LOWER, UPPER = -3.0, 2.0

# Exponentials and cosines are rounded by the width of the loop they run in, so with these the last
# bits depend on how many searches run together.
ROUNDED_BY_BATCH = {"woa", "soa"}

every_optimizer = pytest.mark.parametrize("name", OPTIMIZERS)


class Trial(eqx.Module):
    """A sphere about `center` that fails where the first coordinate exceeds `limit`."""

    center: float
    limit: float = jnp.inf
    failure: float = jnp.nan


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
    return searches(name, jr.split(jr.key(seed), 5), arrays)


@every_optimizer
def test_the_same_key_gives_the_same_bits(name):
    first, second, other = (five_searches(name, seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.stats["history"], second.stats["history"])
    np.testing.assert_array_equal(first.value, second.value)
    assert not np.array_equal(first.value, other.value)


@every_optimizer
def test_a_search_gives_the_same_numbers_alone_and_beside_others(name):
    together = five_searches(name, 5)
    trial = jax.tree.map(jnp.float32, Trial(1.0))
    for seed, key in enumerate(jr.split(jr.key(5), 5)):
        alone = searches(name, key[None], trial)
        difference = alone.stats["history"][0] - together.stats["history"][seed]
        if name in ROUNDED_BY_BATCH:
            np.testing.assert_allclose(difference[:6], 0, atol=1e-5)
        else:
            np.testing.assert_array_equal(difference, 0)
            np.testing.assert_array_equal(alone.value[0], together.value[seed])


@every_optimizer
def test_the_best_loss_never_rises_and_is_the_loss_of_the_answer(name):
    solution = five_searches(name, 1)
    history = np.asarray(solution.stats["history"])
    assert history.shape == (5, ITERATIONS + 1)
    assert (np.diff(history) <= 0).all()
    assert (history[:, -1] < history[:, 0]).all()
    np.testing.assert_array_equal(history[:, -1], solution.stats["best_loss"])
    losses = jax.vmap(sphere, (0, None))(solution.value, 1.0)
    np.testing.assert_allclose(history[:, -1], losses, rtol=1e-5)


@every_optimizer
def test_the_extra_output_is_that_of_the_best_candidate(name):
    solution = five_searches(name, 7)
    np.testing.assert_array_equal(solution.aux, solution.value + 1)


@every_optimizer
@pytest.mark.parametrize("failure", [jnp.nan, jnp.inf, -jnp.inf])
def test_a_loss_that_is_not_finite_never_wins(name, failure):
    solution = five_searches(name, 2, Trial(1.0, limit=0.5, failure=failure))
    assert jnp.all(jnp.isfinite(solution.stats["best_loss"]))
    assert jnp.all(solution.value[:, 0] <= 0.5)
    assert jnp.all(solution.stats["failures"] > 0)


@every_optimizer
def test_a_search_where_everything_fails_says_so(name):
    solution = five_searches(name, 2, Trial(1.0, limit=-jnp.inf))
    assert jnp.all(solution.result == optx.RESULTS.nonfinite)
    np.testing.assert_array_equal(solution.stats["failures"], solution.stats["evaluations"])


@every_optimizer
def test_candidates_never_leave_the_box_and_each_evaluation_is_counted(name):
    seen = []

    def watched(x, center):
        jax.debug.callback(lambda x: seen.append(np.array(x)), x)
        return sphere(x, center)

    optimizer = make_optimizer(name, POPULATION, ITERATIONS)
    lower, upper = jnp.array([0.0, 10.0, -5.0]), jnp.array([1.0, 20.0, -4.0])
    options = {"key": jr.key(6), "lower": lower, "upper": upper}
    solution = optx.minimise(watched, optimizer, jnp.zeros(3), 5.0, options=options, max_steps=None)
    jax.effects_barrier()
    assert (np.min(seen, axis=0) >= lower).all()
    assert (np.max(seen, axis=0) <= upper).all()
    expected = POPULATION + ITERATIONS * evaluations_per_iteration(optimizer)
    assert solution.stats["evaluations"] == len(seen) == expected


@every_optimizer
def test_the_dtype_of_the_input_is_kept_and_nothing_is_promoted(name):
    for dtype in (jnp.float32, jnp.float64):
        with jax.enable_x64(dtype == jnp.float64), jax.numpy_dtype_promotion("strict"):
            solution = jax.eval_shape(lambda dtype=dtype: five_searches(name, 8, dtype=dtype))
        assert solution.value.dtype == solution.stats["history"].dtype == dtype


@every_optimizer
def test_a_keyed_objective_sees_a_fresh_key_at_every_evaluation(name):
    seen = []

    def noise_alone(x, args):
        _, key = args
        draw = jr.uniform(key)
        jax.debug.callback(lambda value: seen.append(float(value)), draw)
        return draw + 0 * jnp.sum(x)

    options = {"key": jr.key(9), "lower": LOWER, "upper": UPPER, "keyed_objective": True}
    solver = make_optimizer(name, POPULATION, ITERATIONS)
    args = (None, jr.key(0))
    solution = optx.minimise(
        noise_alone, solver, jnp.zeros(DIMS), args, options=options, max_steps=None
    )
    jax.effects_barrier()
    # Uniform float32 numbers have 2^23 values, so a few hundred draws hardly ever coincide.
    assert len(set(seen)) > 0.99 * solution.stats["evaluations"]
    assert solution.stats["best_loss"] == np.float32(min(seen))


@every_optimizer
@pytest.mark.parametrize("population", [4, 5, 31])
def test_any_population_of_four_or_more_is_accepted(name, population):
    optimizer = make_optimizer(name, population, 3)

    def history():
        options = {"key": jr.key(0), "lower": LOWER, "upper": UPPER}
        start = jnp.zeros(1)
        solution = optx.minimise(sphere, optimizer, start, 0.5, options=options, max_steps=None)
        return solution.stats["history"]

    assert jax.eval_shape(history).shape == (4,)


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

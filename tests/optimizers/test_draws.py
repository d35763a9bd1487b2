"""Draws: the tent map and the Levy step against their distributions, Threefry against JAX's own."""

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from barnax.optimizers import draws
from barnax.optimizers.draws import levy_step, written_out

tent_map = jax.jit(draws.tent_map, static_argnums=(1, 2, 3, 4))


def test_the_tent_map_branching_at_random_leaves_the_unit_interval():
    values = np.asarray(tent_map(jr.key(0), 500, 30, "random", float))
    assert np.mean((values < 0) | (values > 1)) > 0.5


def test_each_tent_value_follows_from_the_one_before():
    values = np.asarray(tent_map(jr.key(3), 50, 10, "state", float))
    before, after = values[:, :-1], values[:, 1:]
    expected = np.where(before < 0.7, before / 0.7, (1 - before) / 0.3)
    np.testing.assert_allclose(after, expected, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("exponent", [1.2, 1.5, 1.8])
def test_levy_steps_have_the_tail_of_their_exponent(exponent):
    """P(|step| > t) falls as t to the minus exponent."""
    steps = np.abs(np.asarray(levy_step(jr.key(1), (400_000,), exponent, float)))
    # Mantegna's steps reach the power law slowly at exponents near 2, hence the width.
    near, far = np.mean(steps > 10), np.mean(steps > 100)
    assert np.log10(near / far) == pytest.approx(exponent, abs=0.2)


def test_the_scale_of_a_levy_step_is_that_of_mantegna():
    """With exponent 1.5, sigma is 0.6966; then the median of |step| follows by quadrature."""
    generator = np.random.default_rng(0)
    numbers = np.abs(generator.standard_normal((2, 400_000)))
    expected = np.median(0.696575 * numbers[0] / numbers[1] ** (1 / 1.5))
    steps = np.abs(np.asarray(levy_step(jr.key(1), (400_000,), 1.5, float)))
    assert np.median(steps) == pytest.approx(expected, rel=0.01)


@jax.jit
def drawn(key):
    """Whatever can be drawn from a key."""
    return {
        "uniform": jr.uniform(key, (7, 3)),
        "normal": jr.normal(key, (4,), jnp.float32),
        "bits": jr.bits(key, (5,), jnp.uint8),
        "integers": jr.randint(key, (6,), 0, 30, jnp.int32),
        "split": jr.uniform(jr.split(key, (2, 3))[1, 2]),
        "folded": jr.uniform(jr.fold_in(key, 7)),
        "batch": jax.vmap(jr.uniform)(jr.split(key, 4)),
    }


@pytest.mark.parametrize("is_double", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_numbers_from_threefry_written_out_are_those_of_jax(is_double):
    with jax.enable_x64(is_double):
        for key in (jr.key(0), jr.key(2**32 - 1)):
            jax.tree.map(np.testing.assert_array_equal, drawn(key), drawn(written_out(key)))

"""The nine functions against SciPy, formulas written out anew in NumPy, and their optima."""

import itertools

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest
from benchmarks.li2023.test_functions import (
    DIMS,
    FUNCTIONS,
    QUIET_FUNCTIONS,
    draw_displacement,
    make_problem,
    quiet_loss_of_problem,
)

ordinals = np.arange(1, DIMS + 1)


def penalized(x):
    y = (x + 5) / 4
    inner = 10 * np.sin(np.pi * y[0]) ** 2 + (y[-1] - 1) ** 2
    for here, after in itertools.pairwise(y):
        inner += (here - 1) ** 2 * (1 + 10 * np.sin(np.pi * after) ** 2)
    outside = sum(100 * (abs(value) - 10) ** 4 for value in x if abs(value) > 10)
    return np.pi / len(x) * inner + outside


WRITTEN_OUT = {
    "F1": lambda x: x @ x,
    "F2": lambda x: np.linalg.norm(x, 1) + np.prod(np.abs(x)),
    "F3": lambda x: np.linalg.norm(x + 0.5) ** 2,
    "F4": lambda x: np.linalg.norm(x, np.inf),
    "F5": lambda x: ordinals @ x**4,
    "F6": lambda x: 1 + x @ x / 4000 - np.prod(np.cos(x / np.sqrt(ordinals))),
    "F7": lambda x: 10 * DIMS + sum(v**2 - 10 * np.cos(2 * np.pi * v) for v in x),
    "F8": lambda x: (
        20
        + np.e
        - 20 * np.exp(-0.2 * np.sqrt(x @ x / DIMS))
        - np.exp(sum(np.cos(2 * np.pi * v) for v in x) / DIMS)
    ),
    "F9": penalized,
}

every_function = pytest.mark.parametrize("name", FUNCTIONS)


@every_function
def test_values_at_random_points_equal_the_formula_written_out(name):
    function = QUIET_FUNCTIONS[name]
    points = np.random.default_rng(0).uniform(-1, 1, (20, DIMS)) * function.half_width
    with jax.enable_x64(True):
        values = jax.vmap(lambda x: function.loss(x, jr.key(0)))(jnp.asarray(points))
    np.testing.assert_allclose(values, [WRITTEN_OUT[name](x) for x in points], rtol=1e-12)


@every_function
def test_the_minimum_lies_where_it_is_said_to(name):
    function = QUIET_FUNCTIONS[name]
    with jax.enable_x64(True):
        minimizer = jnp.full(DIMS, function.minimizer)
        at_minimum = function.loss(minimizer, jr.key(0))
        assert at_minimum == pytest.approx(function.minimum, abs=1e-14)
        nearby = minimizer + 1e-3 * jr.normal(jr.key(1), (50, DIMS))
        assert jnp.all(jax.vmap(lambda x: function.loss(x, jr.key(0)))(nearby) > at_minimum)


def test_the_noise_of_f5_is_drawn_anew_for_every_key_and_lies_in_the_unit_interval():
    keys = jr.split(jr.key(0), 1000)
    noise = jax.vmap(lambda key: FUNCTIONS["F5"].loss(jnp.zeros(DIMS), key))(keys)
    assert len(np.unique(noise)) > 990
    assert 0 <= noise.min() < 0.01 < 0.99 < noise.max() < 1
    assert [name for name, function in FUNCTIONS.items() if function.is_noisy] == ["F5"]


@every_function
@pytest.mark.parametrize("is_rotated", [False, True])
def test_a_displaced_function_has_its_minimum_at_the_offset(name, is_rotated):
    with jax.enable_x64(True):
        displacement = draw_displacement(jr.key(4), DIMS, is_rotated)
        problem = make_problem(name, displacement)
        minimizer = jnp.full(DIMS, FUNCTIONS[name].minimizer)
        if is_rotated:
            minimizer = displacement.rotation.T @ minimizer
        minimizer += displacement.offset * FUNCTIONS[name].half_width
        assert quiet_loss_of_problem(minimizer, problem) == pytest.approx(0, abs=1e-12)
        assert jnp.max(jnp.abs(minimizer)) < FUNCTIONS[name].half_width


def test_a_displacement_is_an_offset_within_bounds_and_an_orthogonal_matrix():
    displacement = draw_displacement(jr.key(5), 200, is_rotated=True)
    assert 0.55 < jnp.max(jnp.abs(displacement.offset)) <= 0.6
    identity = displacement.rotation @ displacement.rotation.T
    np.testing.assert_allclose(identity, np.eye(200), atol=1e-5)
    other = draw_displacement(jr.key(6), 200, is_rotated=True)
    assert not np.allclose(displacement.offset, other.offset)

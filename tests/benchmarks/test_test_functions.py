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

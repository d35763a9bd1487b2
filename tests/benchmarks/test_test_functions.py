"""The nine functions against SciPy, formulas written out anew in NumPy, and their optima."""

import jax
import jax.numpy as jnp
import jax.random as jr
import pytest
from benchmarks.li2023.test_functions import DIMS, FUNCTIONS, QUIET_FUNCTIONS

every_function = pytest.mark.parametrize("name", FUNCTIONS)


@every_function
def test_the_minimum_lies_where_it_is_said_to(name):
    function = QUIET_FUNCTIONS[name]
    with jax.enable_x64(True):
        minimizer = jnp.full(DIMS, function.minimizer)
        at_minimum = function.loss(minimizer, jr.key(0))
        assert at_minimum == pytest.approx(function.minimum, abs=1e-14)
        nearby = minimizer + 1e-3 * jr.normal(jr.key(1), (50, DIMS))
        assert jnp.all(jax.vmap(lambda x: function.loss(x, jr.key(0)))(nearby) > at_minimum)

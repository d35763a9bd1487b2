"""The bits of Threefry written out are those of `jax.random`, whatever is drawn from them."""

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from barnax.optimizers.draws import written_out

DRAWS = {
    "uniform": lambda key: jr.uniform(key, (7, 3)),
    "normal": lambda key: jr.normal(key, (4,), jnp.float32),
    "bits": lambda key: jr.bits(key, (5,), jnp.uint8),
    "integers": lambda key: jr.randint(key, (6,), 0, 30, jnp.int32),
    "split": lambda key: jr.uniform(jr.split(key, (2, 3))[1, 2]),
    "folded": lambda key: jr.uniform(jr.fold_in(key, 7)),
    "batch": lambda key: jax.vmap(jr.uniform)(jr.split(key, 4)),
}


@pytest.mark.parametrize("draw", DRAWS.values(), ids=DRAWS)
@pytest.mark.parametrize("is_double", [False, True])
def test_numbers_are_those_of_jax(draw, is_double):
    with jax.enable_x64(is_double):
        for key in (jr.key(0), jr.key(2**32 - 1)):
            np.testing.assert_array_equal(draw(key), draw(written_out(key)))


def test_keys_of_another_kind_stay_as_they_are():
    key = jr.key(0, impl="rbg")
    assert jr.key_impl(written_out(key)) == jr.key_impl(key)

"""The order of candidates by loss, against NumPy's stable sort, by counting and by sorting."""

import jax.numpy as jnp
import numpy as np
import pytest

from barnax.optimizers import Swarm, keep_best
from barnax.optimizers.swarm import COUNTED, items_at_ranks, ranks

either_size = pytest.mark.parametrize("size", [1, 12, COUNTED + 10])


def losses_with_ties(size, seed=0):
    numbers = np.random.default_rng(seed).integers(0, max(2, size // 2), size)
    return np.where(numbers == 0, np.inf, numbers).astype(np.float32)


@either_size
def test_ranks_are_indices_in_a_stable_sort(size):
    losses = losses_with_ties(size)
    order = np.argsort(losses, kind="stable")
    np.testing.assert_array_equal(np.asarray(ranks(jnp.asarray(losses)))[order], np.arange(size))


@either_size
def test_items_at_ranks_is_the_inverse_permutation(size):
    permutation = np.random.default_rng(1).permutation(size)
    count = max(1, size // 2)
    np.testing.assert_array_equal(
        items_at_ranks(jnp.asarray(permutation), count), np.argsort(permutation)[:count]
    )


@either_size
def test_the_best_of_parents_and_offspring_are_kept_in_order_and_parents_win_ties(size):
    losses = np.concatenate([np.sort(losses_with_ties(size)), losses_with_ties(size, seed=2)])
    numbers = np.arange(2 * size, dtype=np.float32)[:, None]
    parents, offspring = (
        Swarm(jnp.asarray(numbers[half]), jnp.asarray(losses[half]))
        for half in (slice(size), slice(size, None))
    )
    kept = keep_best(parents, offspring, size)
    order = np.argsort(losses, kind="stable")[:size]
    np.testing.assert_array_equal(kept.losses, losses[order])
    np.testing.assert_array_equal(kept.positions[:, 0], order)

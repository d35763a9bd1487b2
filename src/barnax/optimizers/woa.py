"""WOA, the whale optimization algorithm."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import jax.random as jr
import optimistix as optx
from jaxtyping import Array, Float, Int, Key, PyTree, Scalar

from .leader import best_of, better_leader
from .population import AbstractPopulationMinimiser, Box, Swarm


class WhaleSearch(AbstractPopulationMinimiser):
    """The whale optimization algorithm (Mirjalili and Lewis, 2016).

    Each whale either swims a logarithmic spiral about the best place met so far, or encircles
    that place, or, while the step is large, a random whale. As in the authors' code, and as Li
    et al. (2023), Table 2, requires, A, C, l and the choice are one number a whale, and the
    random whale is drawn anew for every dimension; with `one_random_whale` it is one for all
    dimensions, as the paper's Eq. 2.8 reads.
    """

    population: int = 30
    iterations: int = 500
    one_random_whale: bool = False
    bounded: bool = True
    rtol: float = 0.0
    atol: float = 0.0
    norm: Callable[[PyTree], Scalar] = optx.max_norm

    def start(self, key: Key[Array, ""], box: Box, dtype: Any) -> Float[Array, "candidates dims"]:
        return box.scale(jr.uniform(key, (self.population, len(box.lower)), dtype))

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        return Swarm(swarm.positions, swarm.losses, best_of(swarm))

    def propose(
        self, key: Key[Array, ""], swarm: Swarm, generation: Int[Array, ""], box: Box
    ) -> tuple[Float[Array, "offspring dims"], PyTree]:
        positions = swarm.positions
        best = swarm.memory.position
        progress = (generation - 1).astype(positions.dtype) / self.iterations
        a = 2 - 2 * progress
        # Four numbers of its own and a whale for every dimension, one row a whale.
        numbers = jr.uniform(key, (self.population, 4 + positions.shape[1]), positions.dtype)
        numbers, whale_numbers = numbers[:, :4].T[:, :, None], numbers[:, 4:]
        step = 2 * a * numbers[0] - a
        weight = 2 * numbers[1]
        turn = 1 - (2 + progress) * numbers[2]

        random = self._random_whales(whale_numbers, positions)
        prey = jnp.where(jnp.abs(step) >= 1, random, best)
        encircling = prey - step * jnp.abs(weight * prey - positions)
        spiral = jnp.abs(best - positions) * jnp.exp(turn) * jnp.cos(2 * jnp.pi * turn) + best
        return jnp.where(numbers[3] < 0.5, encircling, spiral), swarm.memory

    def survive(self, swarm: Swarm, offspring: Swarm) -> Swarm:
        leader = better_leader(offspring.memory, offspring)
        return Swarm(offspring.positions, offspring.losses, leader)

    def _random_whales(self, numbers: Array, positions: Array) -> Array:
        whale = jnp.floor(numbers * self.population).astype(int)
        if self.one_random_whale:
            return positions[whale[:, 0]]
        return jnp.take_along_axis(positions, whale, axis=0)

"""IGWO, the improved grey wolf optimizer."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import jax.random as jr
import optimistix as optx
from jaxtyping import Array, Float, Int, Key, PyTree, Scalar

from .gwo import hunt
from .population import AbstractPopulationMinimiser, Box, Swarm


class ImprovedGreyWolf(AbstractPopulationMinimiser):
    """The improved grey wolf optimizer (Nadimi-Shahraki et al., 2021).

    Every wolf weighs two places, that of the grey wolf optimizer and one learned from its
    neighbors dimension by dimension, and moves to the better if that beats where it stands. Two
    evaluations a wolf and generation. The leaders are the three best wolves.

    Li et al. (2023) cite this algorithm, but their Table 2 column of the same name is not its
    work: only the Griewank cells come out alike. No option here gives that column.
    """

    population: int = 30
    iterations: int = 500
    bounded: bool = True
    rtol: float = 0.0
    atol: float = 0.0
    norm: Callable[[PyTree], Scalar] = optx.max_norm

    def start(self, key: Key[Array, ""], box: Box, dtype: Any) -> Float[Array, "candidates dims"]:
        return box.scale(jr.uniform(key, (self.population, len(box.lower)), dtype))

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        return swarm

    def propose(
        self, key: Key[Array, ""], swarm: Swarm, generation: Int[Array, ""], box: Box
    ) -> tuple[Float[Array, "offspring dims"], PyTree]:
        hunt_key, learn_key = jr.split(key)
        positions = swarm.positions
        leaders = positions[jnp.argsort(swarm.losses, stable=True)[:3]]
        hunted = hunt(hunt_key, positions, leaders, generation, self.iterations)
        if self.bounded:
            hunted = box.clip(hunted)
        return jnp.concatenate([hunted, learn_from_neighbors(learn_key, positions, hunted)]), None

    def survive(self, swarm: Swarm, offspring: Swarm) -> Swarm:
        stacked = (self.population, 2)
        losses = offspring.losses.reshape(stacked[::-1]).T
        positions = offspring.positions.reshape(*stacked[::-1], -1)
        takes_hunted = losses[:, 0] < losses[:, 1]
        chosen = jnp.where(takes_hunted[:, None], positions[0], positions[1])
        chosen_loss = jnp.min(losses, axis=1)
        is_better = chosen_loss < swarm.losses
        return Swarm(
            jnp.where(is_better[:, None], chosen, swarm.positions),
            jnp.where(is_better, chosen_loss, swarm.losses),
        )


def learn_from_neighbors(
    key: Key[Array, ""],
    positions: Float[Array, "candidates dims"],
    hunted: Float[Array, "candidates dims"],
) -> Float[Array, "candidates dims"]:
    """Steps along the difference of a random neighbor and a random wolf, anew in every dimension.

    Neighbors are the wolves no farther than the hunt would have taken this one (Eq. 10 to 12).
    """
    chance, wolf_chance, step = jr.uniform(key, (3, *positions.shape), positions.dtype)
    radius = jnp.sum((positions - hunted) ** 2, axis=1)
    distances = jnp.sum((positions[:, None, :] - positions[None, :, :]) ** 2, axis=2)
    is_near = (distances <= radius[:, None]).astype(positions.dtype)

    # The k-th true entry of a row is the number of entries whose running count is at most k.
    running_count = is_near @ jnp.triu(jnp.ones_like(is_near))
    k = jnp.floor(chance * running_count[:, -1:])
    neighbor = jnp.sum(running_count[:, None, :] <= k[:, :, None], axis=2)

    wolf = jnp.floor(wolf_chance * len(positions)).astype(int)
    learned = jnp.take_along_axis(positions, neighbor, axis=0)
    return positions + step * (learned - jnp.take_along_axis(positions, wolf, axis=0))

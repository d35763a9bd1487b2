"""SOA, the seagull optimization algorithm."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import jax.random as jr
import optimistix as optx
from jaxtyping import Array, Float, Int, Key, PyTree, Scalar

from .leader import best_of, better_leader
from .population import AbstractPopulationMinimiser, Box, Swarm


class SeagullSearch(AbstractPopulationMinimiser):
    """The seagull optimization algorithm (Dhiman and Kumar, 2019), as its authors programmed it.

    `x = (F x + A (best - x)) exp(l) cos(2 pi l) + best`, with F falling from 2 to 0. The code
    and the paper differ, and Li et al. (2023), Table 2, follows the code, so that is the default.
    With `spiral_attack` the paper's Eq. 5 to 14 run instead: a step `|A x + B (best - x)|` times
    the product of the three coordinates of a spiral, one angle a gull (on the sphere function
    it ends near 300 where the code ends near 1e-11).
    """

    population: int = 30
    iterations: int = 500
    spiral_attack: bool = False
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
        positions, best = swarm.positions, swarm.memory.position
        progress = (generation - 1).astype(positions.dtype) / self.iterations
        control = 2 - 2 * progress
        attack = _attack_of_the_paper if self.spiral_attack else _attack_of_the_code
        return attack(key, positions, best, control), swarm.memory

    def survive(self, swarm: Swarm, offspring: Swarm) -> Swarm:
        leader = better_leader(offspring.memory, offspring)
        return Swarm(offspring.positions, offspring.losses, leader)


def _attack_of_the_code(
    key: Key[Array, ""], positions: Float[Array, "candidates dims"], best: Array, control: Array
) -> Float[Array, "candidates dims"]:
    numbers = jr.uniform(key, (2, *positions.shape), positions.dtype)
    step = control * (2 * numbers[0] - 1)
    turn = 1 + (control - 1) * numbers[1]
    migration = control * positions + step * (best - positions)
    return migration * jnp.exp(turn) * jnp.cos(2 * jnp.pi * turn) + best


def _attack_of_the_paper(
    key: Key[Array, ""], positions: Float[Array, "candidates dims"], best: Array, control: Array
) -> Float[Array, "candidates dims"]:
    numbers = jr.uniform(key, (2, len(positions), 1), positions.dtype)
    movement = 2 * control**2 * numbers[0]
    distance = jnp.abs(control * positions + movement * (best - positions))
    angle = 2 * jnp.pi * numbers[1]
    radius = jnp.exp(angle)
    spiral = (radius * jnp.cos(angle)) * (radius * jnp.sin(angle)) * (radius * angle)
    return distance * spiral + best

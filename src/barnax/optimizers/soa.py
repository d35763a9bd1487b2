"""SOA, the seagull optimization algorithm."""

from typing import Any, NamedTuple

import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Float, Int, Key, PyTree, Scalar

from .population import AbstractPopulationMinimiser
from .swarm import Box, Swarm, best_of, better_leader


class Flight(NamedTuple):
    """One generation's numbers: A of each gull, the factor of its spiral, and F of them all."""

    step: Float[Array, "candidates #dims"]
    spiral: Float[Array, "candidates #dims"]
    control: Scalar


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

    def start(self, key: Key[Array, ""], box: Box, dtype: Any) -> Float[Array, "candidates dims"]:
        return box.scale(jr.uniform(key, (self.population, len(box.lower)), dtype))

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        return Swarm(swarm.positions, swarm.losses, best_of(swarm))

    def draw(self, key: Key[Array, ""], generation: Int[Array, ""], box: Box) -> Flight:
        progress = (generation - 1).astype(box.lower.dtype) / self.iterations
        control = 2 - 2 * progress
        columns = 1 if self.spiral_attack else len(box.lower)
        numbers = jr.uniform(key, (2, self.population, columns), box.lower.dtype)
        if self.spiral_attack:
            angle = 2 * jnp.pi * numbers[1]
            radius = jnp.exp(angle)
            spiral = (radius * jnp.cos(angle)) * (radius * jnp.sin(angle)) * (radius * angle)
            return Flight(2 * control**2 * numbers[0], spiral, control)
        turn = 1 + (control - 1) * numbers[1]
        spiral = jnp.exp(turn) * jnp.cos(2 * jnp.pi * turn)
        return Flight(control * (2 * numbers[0] - 1), spiral, control)

    def propose(
        self, drawn: Flight, swarm: Swarm, generation: Int[Array, ""], box: Box
    ) -> tuple[Float[Array, "offspring dims"], PyTree]:
        positions, best = swarm.positions, swarm.memory.position
        migration = drawn.control * positions + drawn.step * (best - positions)
        if self.spiral_attack:
            migration = jnp.abs(migration)
        return migration * drawn.spiral + best, swarm.memory

    def survive(self, swarm: Swarm, offspring: Swarm, generation: Int[Array, ""]) -> Swarm:
        leader = better_leader(offspring.memory, offspring)
        return Swarm(offspring.positions, offspring.losses, leader)

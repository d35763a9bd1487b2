"""PSO, particle swarm optimization."""

import equinox as eqx
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Float, Int, Key, PyTree

from .population import AbstractUniformStart
from .swarm import Box, Swarm


class Flight(eqx.Module):
    """What particles remember: velocities, and the best place each has been."""

    velocities: Float[Array, "candidates dims"]
    best_positions: Float[Array, "candidates dims"]
    best_losses: Float[Array, "candidates"]


class ParticleSwarm(AbstractUniformStart):
    """Particle swarm optimization (Kennedy and Eberhart, 1995) with falling inertia.

    The inertia falls linearly from `inertia_start` to `inertia_end` (Shi and Eberhart, 1998);
    fresh uniform numbers weigh both pulls in every dimension; velocities start at zero.

    By default the velocity limit is `velocity_fraction` of the box's width and particles stay in
    the box. Li et al. (2023), Table 2, is reproduced only by the code distributed with the grey
    wolf optimizer, which limits every velocity to 6 on every function and never clips a
    position: `ParticleSwarm(velocity_limit=6.0, bounded=False)`.
    """

    population: int = 30
    iterations: int = 500
    inertia_start: float = 0.9
    inertia_end: float = 0.2
    own_pull: float = 2.0
    swarm_pull: float = 2.0
    velocity_fraction: float = 0.06
    velocity_limit: float | None = None
    bounded: bool = True

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        flight = Flight(jnp.zeros_like(swarm.positions), swarm.positions, swarm.losses)
        return Swarm(swarm.positions, swarm.losses, flight)

    def draw(self, key: Key[Array, ""], generation: Int[Array, ""], box: Box) -> Array:
        return jr.uniform(key, (2, self.population, len(box.lower)), box.lower.dtype)

    def propose(
        self, drawn: Array, swarm: Swarm, generation: Int[Array, ""], box: Box
    ) -> tuple[Float[Array, "offspring dims"], PyTree]:
        positions, flight = swarm.positions, swarm.memory
        progress = generation.astype(positions.dtype) / self.iterations
        inertia = self.inertia_start - progress * (self.inertia_start - self.inertia_end)
        best = flight.best_positions[jnp.argmin(flight.best_losses)]
        own, common = drawn
        velocities = (
            inertia * flight.velocities
            + self.own_pull * own * (flight.best_positions - positions)
            + self.swarm_pull * common * (best - positions)
        )
        limit = self.velocity_limit
        if limit is None:
            limit = self.velocity_fraction * (box.upper - box.lower)
        velocities = jnp.clip(velocities, -limit, limit)
        return positions + velocities, Flight(velocities, flight.best_positions, flight.best_losses)

    def survive(self, swarm: Swarm, offspring: Swarm, generation: Int[Array, ""]) -> Swarm:
        flight = offspring.memory
        is_better = offspring.losses < flight.best_losses
        flight = Flight(
            flight.velocities,
            jnp.where(is_better[:, None], offspring.positions, flight.best_positions),
            jnp.where(is_better, offspring.losses, flight.best_losses),
        )
        return Swarm(offspring.positions, offspring.losses, flight)

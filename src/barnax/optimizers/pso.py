"""Particle swarms: PSO, and three variants used for battery identification."""

from dataclasses import field
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Bool, Float, Key, Scalar

from .ask_tell import Generation, Proposal
from .population import AbstractPopulationMinimiser
from .swarm import Box, Swarm, best_of, better_of_each


class Flight(eqx.Module):
    """The memory of particles: velocities, and the best position of each."""

    velocities: Float[Array, "candidates dims"]
    best: Swarm

    @staticmethod
    def start(swarm: Swarm) -> "Flight":
        return Flight(jnp.zeros_like(swarm.positions), swarm)

    def landed(self, swarm: Swarm) -> "Flight":
        """The memory after a swarm was evaluated; only a strictly better position is remembered."""
        return Flight(self.velocities, better_of_each(self.best, swarm))

    @property
    def leader(self) -> Float[Array, "1 dims"]:
        return best_of(self.best).positions


def fly(
    flight: Flight,
    positions: Float[Array, "candidates dims"],
    inertia: Float[Array, "#candidates 1"],
    pulls: Float[Array, "2 candidates dims"],
    guides: Float[Array, "#candidates dims"],
    limit: Float[Array, "dims"] | float,
) -> Flight:
    """The memory with new velocities: the old ones, and pulls toward the particle's best position
    and a guide."""
    to_memory, to_guide = pulls
    velocities = (
        inertia * flight.velocities
        + to_memory * (flight.best.positions - positions)
        + to_guide * (guides - positions)
    )
    velocities = jnp.clip(velocities, -limit, limit)
    return Flight(velocities, flight.best)


class AbstractFlyingSwarm(AbstractPopulationMinimiser):
    """A search whose particles always move on, and remember their best positions.

    The inertia falls linearly from `inertia_start` to `inertia_end`; the velocity limit is
    `velocity_fraction` of the box's width.
    """

    inertia_start: float = field(default=0.9, kw_only=True)
    inertia_end: float = field(default=0.2, kw_only=True)
    velocity_fraction: float = field(default=0.06, kw_only=True)

    def inertia(self, generation: Generation, dtype: Any) -> Scalar:
        progress = generation.astype(dtype) / self.iterations
        return self.inertia_start - progress * (self.inertia_start - self.inertia_end)

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        return Swarm(swarm.positions, swarm.losses, Flight.start(swarm))

    def survive(self, swarm: Swarm, offspring: Swarm, generation: Generation) -> Swarm:
        return Swarm(offspring.positions, offspring.losses, offspring.memory.landed(offspring))


class ParticleSwarm(AbstractFlyingSwarm):
    """Particle swarm optimization (Kennedy and Eberhart, 1995) with falling inertia.

    The inertia falls linearly from `inertia_start` to `inertia_end` (Shi and Eberhart, 1998);
    fresh uniform numbers weigh both pulls in every dimension; velocities start at zero. With
    `adaptive` a particle's inertia follows its loss instead: `apso`.

    By default the velocity limit is `velocity_fraction` of the box's width and particles stay in
    the box. Li et al. (2023), Table 2, is reproduced only by the code distributed with the grey
    wolf optimizer, which limits every velocity to 6 on every function and never clips a
    position: `ParticleSwarm(velocity_limit=6.0, bounded=False)`.
    """

    memory_pull: float = field(default=2.0, kw_only=True)
    swarm_pull: float = field(default=2.0, kw_only=True)
    velocity_limit: float | None = field(default=None, kw_only=True)
    adaptive: bool = field(default=False, kw_only=True)

    def draw(self, key: Key[Array, ""], generation: Generation, box: Box) -> Array:
        pulls = jnp.array([self.memory_pull, self.swarm_pull], box.lower.dtype)[:, None, None]
        return pulls * jr.uniform(key, (2, self.population, len(box.lower)), box.lower.dtype)

    def propose(self, drawn: Array, swarm: Swarm, generation: Generation, box: Box) -> Proposal:
        positions, flight = swarm.positions, swarm.memory
        if self.adaptive:
            share = badness(swarm.losses)[:, None]
            inertia = self.inertia_end + share * (self.inertia_start - self.inertia_end)
        else:
            inertia = self.inertia(generation, positions.dtype)[None, None]
        limit = self.velocity_limit
        if limit is None:
            limit = self.velocity_fraction * box.width
        flown = fly(flight, positions, inertia, drawn, flight.leader, limit)
        return positions + flown.velocities, flown


def apso(population: int = 30, iterations: int = 500) -> ParticleSwarm:
    """PSO with an adaptive strategy, in the manner of He et al. (2021).

    The inertia of a particle grows with its loss, from `inertia_end` at the swarm's best to
    `inertia_start` at the mean loss and above, so that good particles search where they are and
    the others travel. That is the textbook rule of adaptive inertia; what He et al. adapt, and
    their constants, could not be read. The inertia runs from 0.4 to 0.9 and both pulls are 2.
    """
    return ParticleSwarm(population, iterations, inertia_end=0.4, adaptive=True)


def badness(losses: Float[Array, "candidates"]) -> Float[Array, "candidates"]:
    """Each loss on a scale from the least (0) to the mean of the finite ones (1), 1 above it."""
    is_finite = jnp.isfinite(losses)
    above = jnp.where(is_finite, losses - jnp.min(losses), 0)
    mean = jnp.sum(above) / jnp.maximum(jnp.sum(is_finite.astype(losses.dtype)), 1)
    is_good = is_finite & (above < mean)
    return jnp.where(is_good, above / jnp.where(mean > 0, mean, 1), 1)


class MixedSwarm(AbstractFlyingSwarm):
    """Mixed-swarm cooperative PSO, in the manner of Li et al. (2020).

    A share of the particles explore: each follows the best place of another particle, drawn anew
    in every generation, at constant inertia. The others exploit: they follow the best place of
    all, at an inertia that falls linearly. The swarms cooperate through the best places, which
    both read. The paper, of which the name and the summary could be read, speaks of swarms of
    different behavior that exchange what they find; halves, the rule of either swarm, an inertia
    of 0.7 and one from 0.9 to 0.2 are ours.
    """

    explorers: float = 0.5
    exploring_inertia: float = 0.7
    pull: float = field(default=2.0, kw_only=True)
    exploring_pull: float = field(default=1.5, kw_only=True)

    def draw(self, key: Key[Array, ""], generation: Generation, box: Box) -> tuple[Array, Array]:
        """The weights of both pulls, and the particle that each explorer follows."""
        weight_key, followed_key = jr.split(key)
        shape, dtype = (2, self.population, len(box.lower)), box.lower.dtype
        pull = jnp.where(self._explores(), self.exploring_pull, self.pull).astype(dtype)
        weights = pull[:, None] * jr.uniform(weight_key, shape, dtype)
        followed = jr.randint(followed_key, (self.population,), 0, self.population, jnp.int32)
        return weights, followed

    def propose(
        self, drawn: tuple[Array, Array], swarm: Swarm, generation: Generation, box: Box
    ) -> Proposal:
        (weights, followed), positions, flight = drawn, swarm.positions, swarm.memory
        fallen = self.inertia(generation, positions.dtype)
        explores = self._explores()[:, None]
        inertia = jnp.where(explores, jnp.full_like(fallen, self.exploring_inertia), fallen)
        guides = jnp.where(explores, flight.best.positions[followed], flight.leader)
        limit = self.velocity_fraction * box.width
        flown = fly(flight, positions, inertia, weights, guides, limit)
        return positions + flown.velocities, flown

    def _explores(self) -> Bool[Array, "candidates"]:
        return jnp.arange(self.population) < int(self.explorers * self.population)


class Species(eqx.Module):
    """Sub-swarms, and the context: the best candidate that any of them has made with the others."""

    flight: Flight
    context: Swarm


class CoevolvingSwarm(AbstractFlyingSwarm):
    """Co-evolutionary PSO, in the manner of Yu et al. (2017).

    The coordinates are split into `groups` of neighbors, and a sub-swarm searches each: its
    particles move their own coordinates and are evaluated with the others' taken from the
    context, the best candidate so far, toward which they are pulled too. That is the cooperative
    PSO of van den Bergh and Engelbrecht (2004), CPSO-S_K, the usual reading of co-evolution in
    PSO; Yu et al. could not be read. Departures: all sub-swarms move at once, and one further
    candidate a generation joins the best of each. Inertia and limits are those of `pso`.
    """

    groups: int = 3
    pull: float = field(default=2.0, kw_only=True)

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        return Swarm(swarm.positions, swarm.losses, Species(Flight.start(swarm), best_of(swarm)))

    def draw(self, key: Key[Array, ""], generation: Generation, box: Box) -> Array:
        shape = (2, self.population, len(box.lower))
        return self.pull * jr.uniform(key, shape, box.lower.dtype)

    def propose(self, drawn: Array, swarm: Swarm, generation: Generation, box: Box) -> Proposal:
        positions, flight, context = swarm.positions, swarm.memory.flight, swarm.memory.context
        inertia = self.inertia(generation, positions.dtype)
        limit = self.velocity_fraction * box.width
        flown = fly(flight, positions, inertia[None, None], drawn, context.positions, limit)
        is_moved = self._is_moved(positions.shape[1])
        moved = jnp.where(is_moved, positions + flown.velocities, context.positions)
        # The best particle of each sub-swarm, with its own coordinates.
        losses = jnp.where(is_moved, flight.best.losses[:, None], jnp.inf)
        best = jnp.argmin(losses, axis=0)[None]
        joined = jnp.take_along_axis(flight.best.positions, best, axis=0)
        return jnp.concatenate([moved, joined]), Species(flown, context)

    def survive(self, swarm: Swarm, offspring: Swarm, generation: Generation) -> Swarm:
        moved = Swarm(offspring.positions[:-1], offspring.losses[:-1])
        flight, context = offspring.memory.flight, offspring.memory.context
        species = Species(flight.landed(moved), better_of_each(context, best_of(offspring)))
        return Swarm(moved.positions, moved.losses, species)

    def _is_moved(self, dims: int) -> Bool[Array, "candidates dims"]:
        groups = min(self.groups, dims, self.population // 2)
        group = jnp.arange(self.population) % groups
        return group[:, None] == (jnp.arange(dims) * groups // dims)[None]

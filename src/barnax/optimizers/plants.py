"""Searches whose candidates give way only to better ones: an ecosystem (AEO) and sunflowers."""

from typing import NamedTuple

import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Float, Int, Key, PyTree

from .draws import normal
from .population import AbstractUniformStart
from .swarm import Box, Swarm, sort_by_loss


class AbstractGreedySearch(AbstractUniformStart):
    """Each candidate is replaced by its own offspring if that is better; the best stands first."""

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        return sort_by_loss(swarm)

    def survive(self, swarm: Swarm, offspring: Swarm, generation: Int[Array, ""]) -> Swarm:
        is_better = offspring.losses < swarm.losses
        return sort_by_loss(
            Swarm(
                jnp.where(is_better[:, None], offspring.positions, swarm.positions),
                jnp.where(is_better, offspring.losses, swarm.losses),
            )
        )


class Season(NamedTuple):
    """One generation's numbers: of either half of an ecosystem's iteration.

    A consumer moves by `from_producer` and `from_other` times its distance from the producer and
    from a worse consumer, `other`. What decays ends at `best + to_best * best + away * itself`.
    """

    producer: Float[Array, "dims"]
    stay: Float[Array, ""]
    from_producer: Float[Array, "candidates dims"]
    from_other: Float[Array, "candidates dims"]
    other: Int[Array, "candidates"]
    to_best: Float[Array, "candidates dims"]
    away: Float[Array, "candidates dims"]


class Ecosystem(AbstractGreedySearch):
    """Artificial ecosystem-based optimization (Zhao, Wang and Zhang, 2020; Ferahtia et al., 2021).

    The worst candidate is the producer: it moves between the best and a random place. The others
    consume it, a worse consumer, or both; then all decay about the best. As in the authors' code
    the consumption factor is a fresh number in every dimension, and the decay one number or one a
    dimension, by a coin; but each diet has its third, where their `1/3<r<2/3`, which never holds
    in MATLAB, leaves out the hunt for another consumer. One of its iterations is two generations
    here, consumption and decay, each evaluated once; an odd last generation only consumes.
    Ferahtia et al. could not be read; Li et al. (2023) say that they use this algorithm.
    """

    population: int = 30
    iterations: int = 500
    bounded: bool = True

    def draw(self, key: Key[Array, ""], generation: Int[Array, ""], box: Box) -> Season:
        normal_key, uniform_key = jr.split(key)
        shape, dtype = (self.population, len(box.lower)), box.lower.dtype
        top, bottom, decay = normal(normal_key, (3, *shape), dtype)
        numbers = jr.uniform(uniform_key, (7 * self.population + shape[1],), dtype)
        place, numbers = numbers[: shape[1]], numbers[shape[1] :].reshape(7, self.population, 1)
        diet, share, chance, third, coin, other_coin, wander = numbers
        half = (generation + 1) // 2
        wander = (1 - half.astype(dtype) / ((self.iterations + 1) // 2)) * wander[0, 0]
        factor = 0.5 * top / jnp.abs(bottom)
        on_producer = jnp.where(diet >= 2 / 3, share, (diet < 1 / 3).astype(dtype))
        # Sorted, so the worse are those after; the last consumer has only the producer to eat.
        rank = jnp.arange(self.population)[:, None]
        worse = self.population - 2 - rank
        on_producer = jnp.where(worse <= 0, 1, on_producer)
        skipped = jnp.floor(chance * jnp.maximum(worse, 1).astype(dtype)).astype(rank.dtype)
        spread = 3 * jnp.where(other_coin < 0.5, decay[:, :1], decay)
        weight = jnp.where(coin < 0.5, third, 2 * third) - 1
        return Season(
            producer=wander * box.scale(place),
            stay=1 - wander,
            from_producer=factor * on_producer,
            from_other=factor * (1 - on_producer),
            other=jnp.minimum(rank + 1 + skipped, self.population - 1)[:, 0],
            to_best=spread * weight,
            away=spread * (1 - 2 * third),
        )

    def propose(
        self, drawn: Season, swarm: Swarm, generation: Int[Array, ""], box: Box
    ) -> tuple[Float[Array, "offspring dims"], PyTree]:
        positions, best = swarm.positions, swarm.positions[0]
        producer = drawn.stay * best + drawn.producer
        consuming = (
            positions
            + drawn.from_producer * (positions - producer)
            + drawn.from_other * (positions - positions[drawn.other])
        )
        consuming = consuming.at[-1].set(producer)
        decaying = best + drawn.to_best * best + drawn.away * positions
        return jnp.where(generation % 2 == 1, consuming, decaying), None


class Light(NamedTuple):
    """One generation's numbers: how far each plant steps, where pollen goes, and who is born."""

    step: Float[Array, "candidates dims"]
    born: Float[Array, "candidates dims"]


class SunflowerSearch(AbstractGreedySearch):
    """Enhanced sunflower optimization, in the manner of El-Sehiemy et al. (2020).

    The best plants are pollinated: each mixes with the next in order. The worst die, and seeds
    fall anywhere in the box. The others step toward the best, the sun. That is the algorithm of
    Gomes et al. (2019) with its rates of pollination and mortality. What El-Sehiemy et al. changed
    could not be read, so the enhancement is ours: plants are in the order of their losses; a step
    is drawn anew in every dimension and goes up to twice the distance to the sun, so that plants
    search about it, where the code by Gomes goes up to 1 in the units of the coordinates along
    the straight line; and it is at most `longest_step` widths of the box, so that ohms and farads
    weigh alike.
    """

    population: int = 30
    iterations: int = 500
    pollination: float = 0.05
    mortality: float = 0.1
    longest_step: float = 0.1
    bounded: bool = True

    def draw(self, key: Key[Array, ""], generation: Int[Array, ""], box: Box) -> Light:
        step_key, born_key = jr.split(key)
        shape, dtype = (self.population, len(box.lower)), box.lower.dtype
        return Light(
            jr.uniform(step_key, shape, dtype),
            box.scale(jr.uniform(born_key, shape, dtype)),
        )

    def propose(
        self, drawn: Light, swarm: Swarm, generation: Int[Array, ""], box: Box
    ) -> tuple[Float[Array, "offspring dims"], PyTree]:
        positions = swarm.positions
        pollinated = max(1, round(self.pollination * self.population))
        dying = max(1, round(self.mortality * self.population))
        rank = jnp.arange(self.population)[:, None]
        is_pollinated = rank < pollinated
        goal = jnp.where(is_pollinated, jnp.roll(positions, -1, axis=0), positions[0])
        limit = self.longest_step * (box.upper - box.lower)
        reach = jnp.where(is_pollinated, drawn.step, 2 * drawn.step)
        stepped = positions + jnp.clip(reach * (goal - positions), -limit, limit)
        return jnp.where(rank < self.population - dying, stepped, drawn.born), None

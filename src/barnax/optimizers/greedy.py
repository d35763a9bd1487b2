"""Searches in which only better candidates replace others: AGA, an ecosystem and sunflowers."""

from typing import NamedTuple

import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Bool, Float, Int, Key

from .ask_tell import Generation, Proposal
from .draws import normal
from .population import AbstractSortedSearch
from .pso import badness
from .swarm import Box, Swarm, keep_best


class Mating(NamedTuple):
    """One generation's random numbers: tournaments, chances, shares and mutations."""

    rivals: Int[Array, "2 2 candidates"]
    crosses: Float[Array, "candidates 1"]
    share: Float[Array, "candidates dims"]
    mutates: Float[Array, "candidates dims"]
    is_up: Bool[Array, "candidates dims"]
    stretch: Float[Array, "candidates dims"]


class AdaptiveGenetic(AbstractSortedSearch):
    """The adaptive genetic algorithm (Srinivas and Patnaik, 1994), as Ling and Wei (2021) name it.

    Parents win a tournament of two. A pair is crossed with probability `crossover`, less the
    better its better parent is than the mean, and a child's coordinates mutate with probability
    `mutation`, less the better its parent is: both fall to zero at the best candidate. The rates
    at the mean are those of Srinivas and Patnaik. Ling and Wei's operators could not be read:
    crossover is BLX-0.5 (Eshelman and Schaffer, 1993), mutation
    non-uniform (Michalewicz, 1992, b = 2), and the best of parents and children live on.
    """

    crossover: float = 1.0
    mutation: float = 0.5

    def draw(self, key: Key[Array, ""], generation: Generation, box: Box) -> Mating:
        shape, dtype = (self.population, len(box.lower)), box.lower.dtype
        columns = jr.uniform(key, (self.population, 5 + 4 * shape[1]), dtype)
        rivals = jnp.floor(columns[:, :4] * self.population).astype(jnp.int32)
        share, mutates, direction, length = jnp.split(columns[:, 5:], 4, axis=1)
        left = 1 - (generation - 1).astype(dtype) / self.iterations
        return Mating(
            rivals=rivals.T.reshape(2, 2, -1),
            crosses=columns[:, 4:5],
            share=2 * share - 0.5,
            mutates=mutates,
            is_up=direction < 0.5,
            stretch=1 - length ** (left**2),
        )

    def propose(self, drawn: Mating, swarm: Swarm, generation: Generation, box: Box) -> Proposal:
        positions = swarm.positions
        # Candidates are sorted, so the best of several has the smallest index.
        first, second = jnp.min(drawn.rivals, axis=1)
        share = badness(swarm.losses)
        best_parent = share[jnp.minimum(first, second)][:, None]
        is_crossed = drawn.crosses < self.crossover * best_parent
        weight = jnp.where(is_crossed, drawn.share, 1)
        children = positions[second] + weight * (positions[first] - positions[second])
        is_mutated = drawn.mutates < self.mutation * share[first][:, None]
        end = jnp.where(drawn.is_up, box.upper, box.lower)
        return children + jnp.where(is_mutated, drawn.stretch, 0) * (end - children), None

    def survive(self, swarm: Swarm, offspring: Swarm, generation: Generation) -> Swarm:
        return keep_best(swarm, offspring, self.population)


class Season(NamedTuple):
    """One generation's random numbers, for either half of an ecosystem's iteration.

    A consumer moves by `from_producer` and `from_other` times its distance from the producer and
    from a worse consumer, `other`. Decay ends at `best + to_best * best + away * itself`.
    """

    producer: Float[Array, "dims"]
    stay: Float[Array, ""]
    from_producer: Float[Array, "candidates dims"]
    from_other: Float[Array, "candidates dims"]
    other: Int[Array, "candidates"]
    to_best: Float[Array, "candidates dims"]
    away: Float[Array, "candidates dims"]


class Ecosystem(AbstractSortedSearch):
    """Artificial ecosystem-based optimization (Zhao, Wang and Zhang, 2020; Ferahtia et al., 2021).

    The worst candidate is the producer: it moves between the best and a random place. The others
    consume it, a worse consumer, or both; then all decay about the best. As in the authors' code
    the consumption factor is a fresh number in every dimension, and the decay one number or one a
    dimension, by a coin; but each diet has its third, where their `1/3<r<2/3`, which never holds
    in MATLAB, leaves out the hunt for another consumer. One of its iterations is two generations
    here, consumption and decay, each evaluated once; an odd last generation only consumes.
    Ferahtia et al. could not be read; Li et al. (2023) say that they use this algorithm.
    """

    def draw(self, key: Key[Array, ""], generation: Generation, box: Box) -> Season:
        normal_key, uniform_key = jr.split(key)
        shape, dtype = (self.population, len(box.lower)), box.lower.dtype
        top, bottom, decay = normal(normal_key, (3, *shape), dtype)
        numbers = jr.uniform(uniform_key, (7 * self.population + shape[1],), dtype)
        position, numbers = numbers[: shape[1]], numbers[shape[1] :].reshape(7, self.population, 1)
        diet, share, chance, third, coin, other_coin, wander = numbers
        half = (generation + 1) // 2
        wander = (1 - half.astype(dtype) / ((self.iterations + 1) // 2)) * wander[0, 0]
        factor = 0.5 * top / jnp.abs(bottom)
        on_producer = jnp.where(diet >= 2 / 3, share, (diet < 1 / 3).astype(dtype))
        # Sorted, so the worse ones come after; the last consumer only has the producer to eat.
        rank = jnp.arange(self.population)[:, None]
        worse = self.population - 2 - rank
        on_producer = jnp.where(worse <= 0, 1, on_producer)
        skipped = jnp.floor(chance * jnp.maximum(worse, 1).astype(dtype)).astype(rank.dtype)
        spread = 3 * jnp.where(other_coin < 0.5, decay[:, :1], decay)
        weight = jnp.where(coin < 0.5, third, 2 * third) - 1
        return Season(
            producer=wander * box.scale(position),
            stay=1 - wander,
            from_producer=factor * on_producer,
            from_other=factor * (1 - on_producer),
            other=jnp.minimum(rank + 1 + skipped, self.population - 1)[:, 0],
            to_best=spread * weight,
            away=spread * (1 - 2 * third),
        )

    def propose(self, drawn: Season, swarm: Swarm, generation: Generation, box: Box) -> Proposal:
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


class SunflowerSearch(AbstractSortedSearch):
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

    pollination: float = 0.05
    mortality: float = 0.1
    longest_step: float = 0.1

    def draw(self, key: Key[Array, ""], generation: Generation, box: Box) -> tuple[Array, Array]:
        """How far each plant steps, and which seeds fall."""
        step_key, born_key = jr.split(key)
        shape, dtype = (self.population, len(box.lower)), box.lower.dtype
        return jr.uniform(step_key, shape, dtype), box.scale(jr.uniform(born_key, shape, dtype))

    def propose(
        self, drawn: tuple[Array, Array], swarm: Swarm, generation: Generation, box: Box
    ) -> Proposal:
        (step, born), positions = drawn, swarm.positions
        pollinated = max(1, round(self.pollination * self.population))
        dying = max(1, round(self.mortality * self.population))
        rank = jnp.arange(self.population)[:, None]
        is_pollinated = rank < pollinated
        goal = jnp.where(is_pollinated, jnp.roll(positions, -1, axis=0), positions[0])
        limit = self.longest_step * box.width
        reach = jnp.where(is_pollinated, step, 2 * step)
        stepped = positions + jnp.clip(reach * (goal - positions), -limit, limit)
        return jnp.where(rank < self.population - dying, stepped, born), None

"""AGA, a genetic algorithm whose rates follow the losses."""

from typing import NamedTuple

import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Bool, Float, Int, Key, PyTree

from .population import AbstractUniformStart
from .pso import badness
from .swarm import Box, Swarm, keep_best, sort_by_loss


class Mating(NamedTuple):
    """One generation's numbers: who fights for parenthood, chances, shares and mutations."""

    rivals: Int[Array, "2 2 candidates"]
    crosses: Float[Array, "candidates 1"]
    share: Float[Array, "candidates dims"]
    mutates: Float[Array, "candidates dims"]
    is_up: Bool[Array, "candidates dims"]
    stretch: Float[Array, "candidates dims"]


class AdaptiveGenetic(AbstractUniformStart):
    """The adaptive genetic algorithm (Srinivas and Patnaik, 1994), as Ling and Wei (2021) name it.

    Parents win a tournament of two. A pair is crossed with probability `crossover`, less the
    better its better parent is than the mean, and a child's coordinates mutate with probability
    `mutation`, less the better its parent is: both fall to zero at the best candidate. The rates
    at the mean are those of Srinivas and Patnaik. Ling and Wei's operators could not be read:
    crossover is BLX-0.5 (Eshelman and Schaffer, 1993), mutation
    non-uniform (Michalewicz, 1992, b = 2), and the best of parents and children live on.
    """

    population: int = 30
    iterations: int = 500
    crossover: float = 1.0
    mutation: float = 0.5
    bounded: bool = True

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        return sort_by_loss(swarm)

    def draw(self, key: Key[Array, ""], generation: Int[Array, ""], box: Box) -> Mating:
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

    def propose(
        self, drawn: Mating, swarm: Swarm, generation: Int[Array, ""], box: Box
    ) -> tuple[Float[Array, "offspring dims"], PyTree]:
        positions = swarm.positions
        # Candidates are sorted, so the better of some is the one of the smallest number.
        first, second = jnp.min(drawn.rivals, axis=1)
        share = badness(swarm.losses)
        best_parent = share[jnp.minimum(first, second)][:, None]
        is_crossed = drawn.crosses < self.crossover * best_parent
        weight = jnp.where(is_crossed, drawn.share, 1)
        children = positions[second] + weight * (positions[first] - positions[second])
        is_mutated = drawn.mutates < self.mutation * share[first][:, None]
        end = jnp.where(drawn.is_up, box.upper, box.lower)
        return children + jnp.where(is_mutated, drawn.stretch, 0) * (end - children), None

    def survive(self, swarm: Swarm, offspring: Swarm, generation: Int[Array, ""]) -> Swarm:
        return keep_best(swarm, offspring, self.population)

"""Searches that follow the best place met so far: whales (WOA) and seagulls (SOA)."""

from typing import NamedTuple

import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Bool, Float, Int, Key, PyTree, Scalar

from .population import AbstractUniformStart
from .swarm import Box, Swarm, best_of, better_leader


class AbstractLedSearch(AbstractUniformStart):
    """All candidates move on in every generation; only the best ever met is remembered."""

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        return Swarm(swarm.positions, swarm.losses, best_of(swarm))

    def survive(self, swarm: Swarm, offspring: Swarm, generation: Int[Array, ""]) -> Swarm:
        leader = better_leader(offspring.memory, offspring)
        return Swarm(offspring.positions, offspring.losses, leader)


class Swim(NamedTuple):
    """One generation's numbers: one of each a whale, and whom it follows in each dimension.

    A whale ends at `place + step * |weight * place - position|`, where `place` is that of a random
    whale where `follows_random`, else the best. On a spiral the weight is one.
    """

    step: Float[Array, "candidates 1"]
    weight: Float[Array, "candidates 1"]
    follows_random: Bool[Array, "candidates 1"]
    whale: Int[Array, "candidates #dims"]


class WhaleSearch(AbstractLedSearch):
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

    def draw(self, key: Key[Array, ""], generation: Int[Array, ""], box: Box) -> Swim:
        dims, dtype = len(box.lower), box.lower.dtype
        progress = (generation - 1).astype(dtype) / self.iterations
        a = 2 - 2 * progress
        own_key, whale_key = jr.split(key)
        own = jr.uniform(own_key, (4, self.population, 1), dtype)
        turn = 1 - (2 + progress) * own[2]
        whales = jr.randint(
            whale_key,
            (self.population, 1 if self.one_random_whale else dims),
            0,
            self.population,
            jnp.int32,
        )
        # Told apart here, spiral and circle are one formula below: were both computed there to
        # choose from, the compiler would round their products differently from one number of
        # searches to another.
        spiral = jnp.exp(turn) * jnp.cos(2 * jnp.pi * turn)
        is_spiral = own[3] >= 0.5
        circle = a - 2 * a * own[0]
        return Swim(
            step=jnp.where(is_spiral, spiral, circle),
            weight=jnp.where(is_spiral, 1, 2 * own[1]),
            follows_random=~is_spiral & (jnp.abs(circle) >= 1),
            whale=whales,
        )

    def propose(
        self, drawn: Swim, swarm: Swarm, generation: Int[Array, ""], box: Box
    ) -> tuple[Float[Array, "offspring dims"], PyTree]:
        positions, best = swarm.positions, swarm.memory.position
        random = jnp.take_along_axis(positions, drawn.whale, axis=0)
        place = jnp.where(drawn.follows_random, random, best)
        return place + drawn.step * jnp.abs(drawn.weight * place - positions), swarm.memory


class Glide(NamedTuple):
    """One generation's numbers: A of each gull, the factor of its spiral, and F of them all."""

    step: Float[Array, "candidates #dims"]
    spiral: Float[Array, "candidates #dims"]
    control: Scalar


class SeagullSearch(AbstractLedSearch):
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

    def draw(self, key: Key[Array, ""], generation: Int[Array, ""], box: Box) -> Glide:
        progress = (generation - 1).astype(box.lower.dtype) / self.iterations
        control = 2 - 2 * progress
        columns = 1 if self.spiral_attack else len(box.lower)
        numbers = jr.uniform(key, (2, self.population, columns), box.lower.dtype)
        if self.spiral_attack:
            angle = 2 * jnp.pi * numbers[1]
            radius = jnp.exp(angle)
            spiral = (radius * jnp.cos(angle)) * (radius * jnp.sin(angle)) * (radius * angle)
            return Glide(2 * control**2 * numbers[0], spiral, control)
        turn = 1 + (control - 1) * numbers[1]
        spiral = jnp.exp(turn) * jnp.cos(2 * jnp.pi * turn)
        return Glide(control * (2 * numbers[0] - 1), spiral, control)

    def propose(
        self, drawn: Glide, swarm: Swarm, generation: Int[Array, ""], box: Box
    ) -> tuple[Float[Array, "offspring dims"], PyTree]:
        positions, best = swarm.positions, swarm.memory.position
        migration = drawn.control * positions + drawn.step * (best - positions)
        if self.spiral_attack:
            migration = jnp.abs(migration)
        return migration * drawn.spiral + best, swarm.memory

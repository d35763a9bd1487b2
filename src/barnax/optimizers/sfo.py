"""SFO, the sailfish optimizer."""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import jax.random as jr
import optimistix as optx
from jaxtyping import Array, Float, Int, Key, PyTree, Scalar

from .leader import best_of, better_leader
from .population import AbstractPopulationMinimiser, Box, Swarm, sort_by_loss


class SailfishSearch(AbstractPopulationMinimiser):
    """The sailfish optimizer (Shadravan et al., 2019).

    A share of the population are sailfish, which swim about the best sailfish so far and the
    best sardine; the rest are sardines, which flee. A sailfish takes the place of a sardine
    fitter than itself, and a new sardine appears at random: the paper removes the eaten one and
    does not say what follows when all are gone. The replacements are evaluated, so a generation
    costs the population and once more the sardines (51 evaluations for 30 fish).

    Which form made Li et al. (2023), Table 2, is not known; this one reaches the orders of
    magnitude of most of its cells, not those of F1 and F3.
    """

    population: int = 30
    iterations: int = 500
    sailfish_share: float = 0.3
    attack_power: float = 4.0
    bounded: bool = True
    rtol: float = 0.0
    atol: float = 0.0
    norm: Callable[[PyTree], Scalar] = optx.max_norm

    def start(self, key: Key[Array, ""], box: Box, dtype: Any) -> Float[Array, "candidates dims"]:
        return box.scale(jr.uniform(key, (self.population, len(box.lower)), dtype))

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        sailfish, _ = self._schools(swarm)
        return Swarm(swarm.positions, swarm.losses, best_of(sailfish))

    def propose(
        self, key: Key[Array, ""], swarm: Swarm, generation: Int[Array, ""], box: Box
    ) -> tuple[Float[Array, "offspring dims"], PyTree]:
        attack_key, flee_key, fish_key, dimension_key, birth_key = jr.split(key, 5)
        sailfish, sardines = self._schools(swarm)
        elite, injured = swarm.memory.position, best_of(sardines).position
        dtype = swarm.positions.dtype

        density = 1 - len(sailfish.losses) / self.population
        numbers = jr.uniform(attack_key, (2, len(sailfish.losses), 1), dtype)
        rate = density * (2 * numbers[0] - 1)
        attacking = elite - rate * (numbers[1] * (elite + injured) / 2 - sailfish.positions)

        # The paper's A (1 - 2 l eps) with its eps of 0.001 is this at its 500 iterations.
        power = self.attack_power * (1 - generation.astype(dtype) / self.iterations)
        school = sardines.positions
        fled = jr.uniform(flee_key, (len(school), 1), dtype) * (elite - school + power)
        chances = jr.uniform(dimension_key, school.shape, dtype)
        some_flee = _is_chosen(jr.uniform(fish_key, (1, len(school)), dtype), power)[0][:, None]
        flees = (power >= 0.5) | (some_flee & _is_chosen(chances, power))
        fleeing = jnp.where(flees, fled, school)

        born = box.scale(jr.uniform(birth_key, school.shape, dtype))
        return jnp.concatenate([attacking, fleeing, born]), swarm.memory

    def survive(self, swarm: Swarm, offspring: Swarm) -> Swarm:
        moved = jnp.arange(self.population)
        sailfish, sardines = self._schools(_rows(offspring, moved))
        born = _rows(offspring, self.population + jnp.arange(len(sardines.losses)))

        hunters = len(sailfish.losses)
        sailfish, sardines = sort_by_loss(sailfish), sort_by_loss(sardines)
        meals = min(hunters, len(sardines.losses))
        is_eaten = sardines.losses[:meals] < sailfish.losses[:meals]
        is_fed = jnp.pad(is_eaten, (0, hunters - meals))
        is_gone = jnp.pad(is_eaten, (0, len(sardines.losses) - meals))
        prey = _rows(sardines, jnp.arange(hunters) % len(sardines.losses))
        sailfish = _replace(is_fed, prey, sailfish)
        sardines = _replace(is_gone, born, sardines)

        elite = better_leader(offspring.memory, sailfish)
        return Swarm(
            jnp.concatenate([sailfish.positions, sardines.positions]),
            jnp.concatenate([sailfish.losses, sardines.losses]),
            elite,
        )

    def _schools(self, swarm: Swarm) -> tuple[Swarm, Swarm]:
        sailfish = max(1, int(self.population * self.sailfish_share))
        return (
            Swarm(swarm.positions[:sailfish], swarm.losses[:sailfish]),
            Swarm(swarm.positions[sailfish:], swarm.losses[sailfish:]),
        )


def _is_chosen(chances: Float[Array, "rows items"], share: Array) -> Array:
    """A random subset of every row, of `share` of its length rounded down; none if negative."""
    count = jnp.floor(share * chances.shape[1]).astype(int)
    index = jnp.clip(count, 0, chances.shape[1] - 1)
    threshold = jnp.take(jnp.sort(chances, axis=1), index, axis=1)
    return chances < threshold[:, None]


def _rows(swarm: Swarm, rows: Int[Array, "rows"]) -> Swarm:
    return Swarm(swarm.positions[rows], swarm.losses[rows])


def _replace(is_replaced: Array, new: Swarm, old: Swarm) -> Swarm:
    return Swarm(
        jnp.where(is_replaced[:, None], new.positions, old.positions),
        jnp.where(is_replaced, new.losses, old.losses),
    )

"""SFO, the sailfish optimizer."""

import jax
import jax.numpy as jnp
import jax.random as jr
from jax import lax
from jaxtyping import Array, Bool, Float, Int, Key, PyTree

from .population import AbstractUniformStart
from .swarm import Box, Swarm, best_of, better_leader, ranks, sort_by_loss


class SailfishSearch(AbstractUniformStart):
    """The sailfish optimizer (Shadravan et al., 2019).

    A share of the population are sailfish, which swim about the best sailfish so far and the
    best sardine; the rest are sardines, which flee. A sailfish takes the place of a sardine
    fitter than itself, and a new sardine appears at random: the paper removes the eaten one and
    does not say what follows when all are gone. As many newcomers are evaluated as there are
    sailfish, or sardines where those are fewer (39 evaluations a generation for 30 fish).

    Which form made Li et al. (2023), Table 2, is not known; this one reproduces three of its nine
    cells: `benchmarks/results/table2_z_scores.md`.
    """

    population: int = 30
    iterations: int = 500
    sailfish_share: float = 0.3
    attack_power: float = 4.0
    bounded: bool = True

    def __check_init__(self):
        if not 0 < self.sailfish_share < 1:
            raise ValueError(f"a sailfish_share of {self.sailfish_share} leaves one of both out")
        if self.population < 2:
            raise ValueError("a sailfish and a sardine are two: the population is too small")

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        sailfish, _ = self._schools(swarm)
        return Swarm(swarm.positions, swarm.losses, best_of(sailfish))

    def draw(self, key: Key[Array, ""], generation: Int[Array, ""], box: Box) -> Array:
        # Each fish has two numbers of its own and two rows of numbers, one a dimension.
        shape = (self.population, 2 + 2 * len(box.lower))
        return jr.uniform(key, shape, box.lower.dtype)

    def propose(
        self, drawn: Array, swarm: Swarm, generation: Int[Array, ""], box: Box
    ) -> tuple[Float[Array, "offspring dims"], PyTree]:
        sailfish, sardines = self._schools(swarm)
        elite, injured = swarm.memory.position, best_of(sardines).position
        dims, dtype = swarm.positions.shape[1], swarm.positions.dtype
        attack_numbers, flee_numbers = jnp.split(drawn, [len(sailfish.losses)])

        density = 1 - len(sailfish.losses) / self.population
        rate = density * (2 * attack_numbers[:, :1] - 1)
        goal = attack_numbers[:, 1:2] * (elite + injured) / 2
        attacking = elite - rate * (goal - sailfish.positions)

        # The paper's A (1 - 2 l eps) with its eps of 0.001 is this at its 500 iterations.
        power = self.attack_power * (1 - generation.astype(dtype) / self.iterations)
        fled = flee_numbers[:, :1] * (elite - sardines.positions + power)
        flees = lax.cond(
            power >= 0.5,
            lambda numbers, power: jnp.ones(fled.shape, bool),
            lambda numbers, power: (
                random_subset(numbers[:, 0], power)[:, None]
                & jax.vmap(random_subset, (0, None))(numbers[:, 1:], power)
            ),
            flee_numbers[:, 1 : 2 + dims],
            power,
        )
        fleeing = jnp.where(flees, fled, sardines.positions)

        # No more can be eaten than there are sailfish to eat or sardines to be eaten.
        meals = min(len(sailfish.losses), len(sardines.losses))
        born = box.scale(flee_numbers[:meals, 2 + dims :])
        return jnp.concatenate([attacking, fleeing, born]), swarm.memory

    def survive(self, swarm: Swarm, offspring: Swarm, generation: Int[Array, ""]) -> Swarm:
        moved, born = _split(offspring, self.population)
        sailfish, sardines = self._schools(moved)
        hunters, meals = len(sailfish.losses), len(born.losses)
        sailfish, sardines = sort_by_loss(sailfish), sort_by_loss(sardines)
        is_eaten = sardines.losses[:meals] < sailfish.losses[:meals]
        is_fed = jnp.pad(is_eaten, (0, hunters - meals))
        is_gone = jnp.pad(is_eaten, (0, len(sardines.losses) - meals))
        prey = _rows(sardines, jnp.arange(hunters) % len(sardines.losses))
        sailfish = _replace(is_fed, prey, sailfish)
        newcomers = _rows(born, jnp.arange(len(sardines.losses)) % meals)
        sardines = _replace(is_gone, newcomers, sardines)

        elite = better_leader(offspring.memory, sailfish)
        return Swarm(
            jnp.concatenate([sailfish.positions, sardines.positions]),
            jnp.concatenate([sailfish.losses, sardines.losses]),
            elite,
        )

    def _schools(self, swarm: Swarm) -> tuple[Swarm, Swarm]:
        return _split(swarm, max(1, int(self.population * self.sailfish_share)))


def random_subset(numbers: Float[Array, "items"], share: Array) -> Bool[Array, "items"]:
    """A random subset of `share` of the items, rounded down: those of the smallest numbers."""
    return ranks(numbers).astype(numbers.dtype) < jnp.floor(share * len(numbers))


def _split(swarm: Swarm, first: int) -> tuple[Swarm, Swarm]:
    return _rows(swarm, slice(first)), _rows(swarm, slice(first, None))


def _rows(swarm: Swarm, rows: Int[Array, "rows"] | slice) -> Swarm:
    return Swarm(swarm.positions[rows], swarm.losses[rows])


def _replace(is_replaced: Array, new: Swarm, old: Swarm) -> Swarm:
    return Swarm(
        jnp.where(is_replaced[:, None], new.positions, old.positions),
        jnp.where(is_replaced, new.losses, old.losses),
    )

"""GWO, the grey wolf optimizer."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import jax.random as jr
import optimistix as optx
from jax import lax
from jaxtyping import Array, Float, Int, Key, PyTree, Scalar

from .population import AbstractPopulationMinimiser
from .swarm import Box, Swarm, best_first


class Leaders(eqx.Module):
    """The three wolves the pack follows: alpha, beta and delta."""

    positions: Float[Array, "3 dims"]
    losses: Float[Array, "3"]


class GreyWolf(AbstractPopulationMinimiser):
    """The grey wolf optimizer (Mirjalili et al., 2014), in the form of its authors' code.

    Every wolf moves to the mean of three places, one about each leader. The paper says the
    leaders are the three best wolves; the code, and with it Li et al. (2023), Table 2, replaces
    a leader without moving the old one down a rank. `demote_leaders` gives the paper's.
    """

    population: int = 30
    iterations: int = 500
    demote_leaders: bool = False
    bounded: bool = True
    rtol: float = 0.0
    atol: float = 0.0
    norm: Callable[[PyTree], Scalar] = optx.max_norm

    def start(self, key: Key[Array, ""], box: Box, dtype: Any) -> Float[Array, "candidates dims"]:
        return box.scale(jr.uniform(key, (self.population, len(box.lower)), dtype))

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        nobody = Leaders(swarm.positions[:3], jnp.full_like(swarm.losses[:3], jnp.inf))
        return self._follow(Swarm(swarm.positions, swarm.losses, nobody))

    def draw(self, key: Key[Array, ""], generation: Int[Array, ""], box: Box) -> Array:
        return jr.uniform(key, (2, 3, self.population, len(box.lower)), box.lower.dtype)

    def propose(
        self, drawn: Array, swarm: Swarm, generation: Int[Array, ""], box: Box
    ) -> tuple[Float[Array, "offspring dims"], PyTree]:
        leaders = swarm.memory
        return hunt(drawn, swarm.positions, leaders.positions, generation, self.iterations), leaders

    def survive(self, swarm: Swarm, offspring: Swarm, generation: Int[Array, ""]) -> Swarm:
        return self._follow(offspring)

    def _follow(self, swarm: Swarm) -> Swarm:
        choose = three_best if self.demote_leaders else replace_leaders
        return Swarm(swarm.positions, swarm.losses, choose(swarm.memory, swarm))


def hunt(
    numbers: Float[Array, "2 3 candidates dims"],
    positions: Float[Array, "candidates dims"],
    leaders: Float[Array, "3 dims"],
    generation: Int[Array, ""],
    iterations: int,
) -> Float[Array, "candidates dims"]:
    """Where the pack moves: the mean of one place about each leader (Eq. 3.5 to 3.7).

    `numbers` are uniform in [0, 1).
    """
    a = 2 - 2 * (generation - 1).astype(positions.dtype) / iterations
    step = a * (2 * numbers[0] - 1)
    weight = 2 * numbers[1]
    prey = leaders[:, None, :]
    about_alpha, about_beta, about_delta = prey - step * jnp.abs(weight * prey - positions)
    return (about_alpha + about_beta + about_delta) / 3


def three_best(leaders: Leaders, swarm: Swarm) -> Leaders:
    """The three best of the old leaders and the swarm, in order."""
    positions = jnp.concatenate([leaders.positions, swarm.positions])
    losses = jnp.concatenate([leaders.losses, swarm.losses])
    order = best_first(losses, 3)
    return Leaders(positions[order], losses[order])


def replace_leaders(leaders: Leaders, swarm: Swarm) -> Leaders:
    """The leaders after the authors' loop over the wolves: who is beaten leaves the pack's head.

    The loop takes the wolves one by one: better than alpha, a wolf becomes alpha; else, worse
    than alpha and better than beta, it becomes beta; and so on. Running minima say the same for
    all wolves at once.
    """
    losses = swarm.losses
    alpha_so_far = jnp.minimum(lax.cummin(losses), leaders.losses[0])
    may_be_beta = losses > alpha_so_far
    beta_losses = jnp.where(may_be_beta, losses, jnp.inf)
    beta_so_far = jnp.minimum(lax.cummin(beta_losses), leaders.losses[1])
    delta_losses = jnp.where(may_be_beta & (losses > beta_so_far), losses, jnp.inf)

    challenges = jnp.stack([losses, beta_losses, delta_losses])
    chosen = jnp.argmin(challenges, axis=1)
    challenge = jnp.min(challenges, axis=1)
    is_better = challenge < leaders.losses
    return Leaders(
        jnp.where(is_better[:, None], swarm.positions[chosen], leaders.positions),
        jnp.where(is_better, challenge, leaders.losses),
    )

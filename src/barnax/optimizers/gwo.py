"""Grey wolves: GWO, and the improved IGWO."""

import equinox as eqx
import jax.numpy as jnp
import jax.random as jr
from jax import lax
from jaxtyping import Array, Float, Int, Key, PyTree

from .population import AbstractUniformStart
from .swarm import Box, Swarm, best_first


class Leaders(eqx.Module):
    """The three wolves the pack follows: alpha, beta and delta."""

    positions: Float[Array, "3 dims"]
    losses: Float[Array, "3"]


class GreyWolf(AbstractUniformStart):
    """The grey wolf optimizer (Mirjalili et al., 2014), in the form of its authors' code.

    Every wolf moves to the mean of three places, one about each leader. The paper says the
    leaders are the three best wolves; the code, and with it Li et al. (2023), Table 2, replaces
    a leader without moving the old one down a rank. `demote_leaders` gives the paper's.
    """

    population: int = 30
    iterations: int = 500
    demote_leaders: bool = False
    bounded: bool = True

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


class ImprovedGreyWolf(AbstractUniformStart):
    """The improved grey wolf optimizer (Nadimi-Shahraki et al., 2021).

    Every wolf weighs two places, that of the grey wolf optimizer and one learned from its
    neighbors dimension by dimension, and moves to the better if that beats where it stands. Two
    evaluations a wolf and generation. The leaders are the three best wolves.

    Li et al. (2023) cite this algorithm, but their Table 2 column of the same name is not its
    work: `benchmarks/results/table2_z_scores.md`. No option here gives that column.
    """

    population: int = 30
    iterations: int = 500
    bounded: bool = True

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        return swarm

    def draw(
        self, key: Key[Array, ""], generation: Int[Array, ""], box: Box
    ) -> tuple[Array, Array]:
        hunt_key, learn_key = jr.split(key)
        shape, dtype = (self.population, len(box.lower)), box.lower.dtype
        return jr.uniform(hunt_key, (2, 3, *shape), dtype), jr.uniform(
            learn_key, (3, *shape), dtype
        )

    def propose(
        self, drawn: tuple[Array, Array], swarm: Swarm, generation: Int[Array, ""], box: Box
    ) -> tuple[Float[Array, "offspring dims"], PyTree]:
        hunt_numbers, learn_numbers = drawn
        positions = swarm.positions
        leaders = positions[best_first(swarm.losses, 3)]
        hunted = hunt(hunt_numbers, positions, leaders, generation, self.iterations)
        if self.bounded:
            hunted = box.clip(hunted)
        learned = learn_from_neighbors(learn_numbers, positions, hunted)
        return jnp.concatenate([hunted, learned]), None

    def survive(self, swarm: Swarm, offspring: Swarm, generation: Int[Array, ""]) -> Swarm:
        stacked = (self.population, 2)
        losses = offspring.losses.reshape(stacked[::-1]).T
        positions = offspring.positions.reshape(*stacked[::-1], -1)
        takes_hunted = losses[:, 0] < losses[:, 1]
        chosen = jnp.where(takes_hunted[:, None], positions[0], positions[1])
        chosen_loss = jnp.min(losses, axis=1)
        is_better = chosen_loss < swarm.losses
        return Swarm(
            jnp.where(is_better[:, None], chosen, swarm.positions),
            jnp.where(is_better, chosen_loss, swarm.losses),
        )


def learn_from_neighbors(
    numbers: Float[Array, "3 candidates dims"],
    positions: Float[Array, "candidates dims"],
    hunted: Float[Array, "candidates dims"],
) -> Float[Array, "candidates dims"]:
    """Steps along the difference of a random neighbor and a random wolf, anew in every dimension.

    Neighbors are the wolves no farther than the hunt would have taken this one (Eq. 10 to 12).
    `numbers`, uniform in [0, 1), choose the neighbor, the wolf and the length of the step.
    """
    chance, wolf_chance, step = numbers
    radius = jnp.sum((positions - hunted) ** 2, axis=1)
    # Sums over the first axis run several times faster than over the last.
    columns = positions.T
    distances = jnp.sum((columns[:, :, None] - columns[:, None, :]) ** 2, axis=0)
    is_near = (distances <= radius[None, :]).astype(positions.dtype)

    # The k-th true entry of a column is the number of entries whose running count is at most k.
    running_count = jnp.tril(jnp.ones_like(is_near)) @ is_near
    k = jnp.floor(chance * running_count[-1][:, None])
    neighbor = jnp.sum(running_count[:, :, None] <= k[None, :, :], axis=0)

    wolf = jnp.floor(wolf_chance * len(positions)).astype(int)
    learned = jnp.take_along_axis(positions, neighbor, axis=0)
    return positions + step * (learned - jnp.take_along_axis(positions, wolf, axis=0))

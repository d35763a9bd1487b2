"""Searches that follow the best candidates so far: whales, seagulls, sailfish and grey wolves."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import jax.random as jr
from jax import lax
from jaxtyping import Array, Bool, Float, Int, Key, Scalar

from .ask_tell import Generation, Proposal
from .population import AbstractPopulationMinimiser
from .swarm import (
    Box,
    Swarm,
    best_first,
    best_of,
    better_of_each,
    joined,
    ranks,
    replaced,
    sort_by_loss,
)


class AbstractLedSearch(AbstractPopulationMinimiser):
    """All candidates move in every generation; only the best so far is remembered."""

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        return Swarm(swarm.positions, swarm.losses, best_of(swarm))

    def survive(self, swarm: Swarm, offspring: Swarm, generation: Generation) -> Swarm:
        leader = better_of_each(offspring.memory, best_of(offspring))
        return Swarm(offspring.positions, offspring.losses, leader)


class Swim(NamedTuple):
    """One generation's random numbers: one of each per whale, and the whale it follows in each
    dimension.

    A whale ends at `leader + step * |weight * leader - position|`; its leader is a random whale if
    `follows_random`, else the best. On a spiral the weight is one.
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

    one_random_whale: bool = False

    def draw(self, key: Key[Array, ""], generation: Generation, box: Box) -> Swim:
        dtype, columns = box.lower.dtype, 1 if self.one_random_whale else len(box.lower)
        progress = (generation - 1).astype(dtype) / self.iterations
        a = 2 - 2 * progress
        number_key, whale_key = jr.split(key)
        numbers = jr.uniform(number_key, (4, self.population, 1), dtype)
        turn = 1 - (2 + progress) * numbers[2]
        shape = (self.population, columns)
        whales = jr.randint(whale_key, shape, 0, self.population, jnp.int32)
        # Distinguished here, spiral and circle are one formula below: if both were computed there
        # to choose from, the compiler would round their products differently depending on the
        # number of searches.
        spiral = jnp.exp(turn) * jnp.cos(2 * jnp.pi * turn)
        is_spiral = numbers[3] >= 0.5
        circle = a - 2 * a * numbers[0]
        return Swim(
            step=jnp.where(is_spiral, spiral, circle),
            weight=jnp.where(is_spiral, 1, 2 * numbers[1]),
            follows_random=~is_spiral & (jnp.abs(circle) >= 1),
            whale=whales,
        )

    def propose(self, drawn: Swim, swarm: Swarm, generation: Generation, box: Box) -> Proposal:
        positions, best = swarm.positions, swarm.memory.positions
        random = jnp.take_along_axis(positions, drawn.whale, axis=0)
        leader = jnp.where(drawn.follows_random, random, best)
        return leader + drawn.step * jnp.abs(drawn.weight * leader - positions), swarm.memory


class Glide(NamedTuple):
    """One generation's random numbers: A of each gull, the factor of its spiral, and the common
    F."""

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

    spiral_attack: bool = False

    def draw(self, key: Key[Array, ""], generation: Generation, box: Box) -> Glide:
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

    def propose(self, drawn: Glide, swarm: Swarm, generation: Generation, box: Box) -> Proposal:
        positions, best = swarm.positions, swarm.memory.positions
        migration = drawn.control * positions + drawn.step * (best - positions)
        if self.spiral_attack:
            migration = jnp.abs(migration)
        return migration * drawn.spiral + best, swarm.memory


class SailfishSearch(AbstractPopulationMinimiser):
    """The sailfish optimizer (Shadravan et al., 2019).

    A share of the population are sailfish, which swim about the best sailfish so far and the
    best sardine; the rest are sardines, which flee. A sailfish takes the place of a sardine
    fitter than itself, and a new sardine appears at random: the paper removes the eaten one and
    does not say what follows when all are gone. As many newcomers are evaluated as there are
    sailfish, or sardines where those are fewer (39 evaluations a generation for 30 fish).

    Which form made Li et al. (2023), Table 2, is not known; this one reproduces three of its nine
    cells: `benchmarks/results/table2_z_scores.md`.
    """

    sailfish_share: float = 0.3
    attack_power: float = 4.0

    def __check_init__(self):
        if not 0 < self.sailfish_share < 1:
            raise ValueError(f"a sailfish_share of {self.sailfish_share} leaves one of both out")
        if self.population < 2:
            raise ValueError("a sailfish and a sardine are two: the population is too small")

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        sailfish, _ = self._schools(swarm)
        return Swarm(swarm.positions, swarm.losses, best_of(sailfish))

    def draw(self, key: Key[Array, ""], generation: Generation, box: Box) -> Array:
        # Each fish has two numbers of its own and two rows of numbers, one per dimension.
        shape = (self.population, 2 + 2 * len(box.lower))
        return jr.uniform(key, shape, box.lower.dtype)

    def propose(self, drawn: Array, swarm: Swarm, generation: Generation, box: Box) -> Proposal:
        sailfish, sardines = self._schools(swarm)
        elite, injured = swarm.memory.positions, best_of(sardines).positions
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

    def survive(self, swarm: Swarm, offspring: Swarm, generation: Generation) -> Swarm:
        moved, born = _split(offspring, self.population)
        sailfish, sardines = self._schools(moved)
        hunters, meals = len(sailfish.losses), len(born.losses)
        sailfish, sardines = sort_by_loss(sailfish), sort_by_loss(sardines)
        is_eaten = sardines.losses[:meals] < sailfish.losses[:meals]
        is_fed = jnp.pad(is_eaten, (0, hunters - meals))
        is_gone = jnp.pad(is_eaten, (0, len(sardines.losses) - meals))
        prey = sardines.at(jnp.arange(hunters) % len(sardines.losses))
        sailfish = replaced(is_fed, prey, sailfish)
        newcomers = born.at(jnp.arange(len(sardines.losses)) % meals)
        sardines = replaced(is_gone, newcomers, sardines)

        elite = better_of_each(offspring.memory, best_of(sailfish))
        school = joined(sailfish, sardines)
        return Swarm(school.positions, school.losses, elite)

    def _schools(self, swarm: Swarm) -> tuple[Swarm, Swarm]:
        return _split(swarm, max(1, int(self.population * self.sailfish_share)))


def random_subset(numbers: Float[Array, "items"], share: Array) -> Bool[Array, "items"]:
    """A random subset of `share` of the items, rounded down: those with the smallest numbers."""
    return ranks(numbers).astype(numbers.dtype) < jnp.floor(share * len(numbers))


def _split(swarm: Swarm, first: int) -> tuple[Swarm, Swarm]:
    return swarm.at(slice(first)), swarm.at(slice(first, None))


class GreyWolf(AbstractPopulationMinimiser):
    """The grey wolf optimizer (Mirjalili et al., 2014), in the form of its authors' code.

    Every wolf moves to the mean of three places, one about each leader. The paper says the
    leaders are the three best wolves; the code, and with it Li et al. (2023), Table 2, replaces
    a leader without moving the old one down a rank. `demote_leaders` gives the paper's. The
    memory are the leaders: alpha, beta and delta.
    """

    demote_leaders: bool = False

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        return self._follow(without_leaders(swarm))

    def draw(self, key: Key[Array, ""], generation: Generation, box: Box) -> Array:
        return jr.uniform(key, (2, 3, self.population, len(box.lower)), box.lower.dtype)

    def propose(self, drawn: Array, swarm: Swarm, generation: Generation, box: Box) -> Proposal:
        leaders = swarm.memory
        return hunt(drawn, swarm.positions, leaders.positions, generation, self.iterations), leaders

    def survive(self, swarm: Swarm, offspring: Swarm, generation: Generation) -> Swarm:
        return self._follow(offspring)

    def _follow(self, swarm: Swarm) -> Swarm:
        return follow(swarm, three_best if self.demote_leaders else replace_leaders)


def hunt(
    numbers: Float[Array, "2 3 candidates dims"],
    positions: Float[Array, "candidates dims"],
    leaders: Float[Array, "3 dims"],
    generation: Generation,
    iterations: int,
) -> Float[Array, "candidates dims"]:
    """The next positions of the pack: the mean of one position around each leader (Eq. 3.5 to 3.7).

    `numbers` are uniform in [0, 1).
    """
    a = 2 - 2 * (generation - 1).astype(positions.dtype) / iterations
    step = a * (2 * numbers[0] - 1)
    weight = 2 * numbers[1]
    prey = leaders[:, None, :]
    about_alpha, about_beta, about_delta = prey - step * jnp.abs(weight * prey - positions)
    return (about_alpha + about_beta + about_delta) / 3


def without_leaders(swarm: Swarm) -> Swarm:
    """The pack before its first leaders: every wolf is better than those."""
    nobody = Swarm(swarm.positions[:3], jnp.full_like(swarm.losses[:3], jnp.inf))
    return Swarm(swarm.positions, swarm.losses, nobody)


def follow(swarm: Swarm, choose: Callable[[Swarm, Swarm], Swarm]) -> Swarm:
    """The pack with the leaders chosen from its previous ones, which are its memory, and its
    wolves."""
    return Swarm(swarm.positions, swarm.losses, choose(swarm.memory, swarm))


def three_best(leaders: Swarm, swarm: Swarm) -> Swarm:
    """The three best of the previous leaders and the swarm, in order."""
    both = joined(leaders, swarm)
    return both.at(best_first(both.losses, 3))


def replace_leaders(leaders: Swarm, swarm: Swarm) -> Swarm:
    """The leaders after the authors' loop over the wolves: a replaced leader does not move down a
    rank.

    The loop takes the wolves one by one: better than alpha, a wolf becomes alpha; else, worse than
    alpha and better than beta, it becomes beta; and so on. Running minima give the same for all
    wolves at once.
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
    return better_of_each(leaders, Swarm(swarm.positions[chosen], challenge))


class ImprovedGreyWolf(AbstractPopulationMinimiser):
    """The improved grey wolf optimizer (Nadimi-Shahraki et al., 2021).

    Every wolf weighs two places, that of the grey wolf optimizer and one learned from its
    neighbors dimension by dimension, and moves to the better if that beats where it stands. Two
    evaluations a wolf and generation. The leaders are those of `GreyWolf`, as in the authors' code.
    By default a coordinate that leaves the box is put on its bound, as by every optimizer of this
    package, and the random wolf of a step is drawn anew in every dimension, as the paper's Eq. 12
    reads. The authors' code (IGWO.m, version 1.0) does otherwise: with `midpoint_bounds` the
    coordinate is put halfway between the bound and where the wolf stands, and with
    `one_random_wolf` that wolf is one for all dimensions, from a permutation of the pack. With
    both, the search is that of the code, line by line, but that a beta or delta nobody is yet
    stands where a wolf does, not at the origin; a test compares its final losses with the code's.

    Li et al. (2023) cite this algorithm, but their Table 2 column of the same name is not its
    work: `benchmarks/results/table2_z_scores.md`. No option here gives that column.
    """

    midpoint_bounds: bool = False
    one_random_wolf: bool = False

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        return follow(without_leaders(swarm), replace_leaders)

    def draw(self, key: Key[Array, ""], generation: Generation, box: Box) -> tuple[Array, Array]:
        hunt_key, learn_key = jr.split(key)
        shape, dtype = (self.population, len(box.lower)), box.lower.dtype
        hunt_numbers = jr.uniform(hunt_key, (2, 3, *shape), dtype)
        learn_numbers = jr.uniform(learn_key, (3, *shape), dtype)
        if self.one_random_wolf:
            order = ranks(learn_numbers[1, :, 0]).astype(dtype)
            learn_numbers = learn_numbers.at[1].set(((order + 0.5) / self.population)[:, None])
        return hunt_numbers, learn_numbers

    def propose(
        self, drawn: tuple[Array, Array], swarm: Swarm, generation: Generation, box: Box
    ) -> Proposal:
        hunt_numbers, learn_numbers = drawn
        positions, leaders = swarm.positions, swarm.memory
        hunted = hunt(hunt_numbers, positions, leaders.positions, generation, self.iterations)
        hunted = self._inside(hunted, positions, box)
        learned = learn_from_neighbors(learn_numbers, positions, hunted)
        return jnp.concatenate([hunted, self._inside(learned, positions, box)]), leaders

    def survive(self, swarm: Swarm, offspring: Swarm, generation: Generation) -> Swarm:
        stacked = (self.population, 2)
        losses = offspring.losses.reshape(stacked[::-1]).T
        positions = offspring.positions.reshape(*stacked[::-1], -1)
        takes_hunted = losses[:, 0] < losses[:, 1]
        chosen = jnp.where(takes_hunted[:, None], positions[0], positions[1])
        kept = better_of_each(swarm, Swarm(chosen, jnp.min(losses, axis=1)))
        return follow(Swarm(kept.positions, kept.losses, offspring.memory), replace_leaders)

    def _inside(self, moved: Array, positions: Array, box: Box) -> Array:
        if not (self.bounded and self.midpoint_bounds):
            return box.clip(moved) if self.bounded else moved
        return box.midway(moved, positions)


def learn_from_neighbors(
    numbers: Float[Array, "3 candidates dims"],
    positions: Float[Array, "candidates dims"],
    hunted: Float[Array, "candidates dims"],
) -> Float[Array, "candidates dims"]:
    """Steps along the difference of a random neighbor and a random wolf, drawn for every dimension.

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

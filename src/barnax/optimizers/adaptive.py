"""Barnacle mating that learns from its success, in a population that shrinks."""

from typing import NamedTuple

import jax.numpy as jnp
import jax.random as jr
from jaxtyping import Array, Float, Int, Key, Scalar

from .ask_tell import Generation, Proposal
from .draws import normal
from .population import AbstractPopulationMinimiser, where_else
from .swarm import Box, Swarm, sort_by_loss

# Spread of scales (Cauchy) and of crossover rates (normal) around the remembered ones (SHADE).
SPREAD = 0.1
# A best loss that falls by no more than this share of itself stagnates.
FLAT = 1e-9


class Chances(NamedTuple):
    """The draws of one generation, uniform in [0, 1): by offspring, and also by dimension; `normal`
    are normal numbers, `fresh` the positions of a population for a restart."""

    uniform: Float[Array, "draws offspring"]
    kept: Float[Array, "offspring dims"]
    normal: Float[Array, "offspring dims+1"]
    fresh: Float[Array, "candidates dims"]


class Brood(NamedTuple):
    """For every offspring the rank of its mother, its scale and crossover rate, and the shell that
    its mother leaves if it replaces her."""

    mother: Int[Array, "offspring"]
    scale: Float[Array, "offspring"]
    rate: Float[Array, "offspring"]
    shell: Int[Array, "offspring"]


class History(NamedTuple):
    """What succeeded, and who was replaced.

    Attributes:
        scales: Means of successful scales, the next to be replaced first.
        rates: The same of crossover rates.
        shells: Positions of replaced mothers; at first those of the first population.
        brood: The latest offspring.
        restart: The generation in which the population was last fresh.
        best: Its best loss since.
        latest: The generation in which that last fell.
    """

    scales: Float[Array, "memory"]
    rates: Float[Array, "memory"]
    shells: Float[Array, "candidates dims"]
    brood: Brood
    restart: Generation
    best: Scalar
    latest: Generation


class AdaptiveMating(AbstractPopulationMinimiser):
    """Barnacle mating with scales that it learns from success, ours.

    Barnacles stand in the order of their losses, and every mother has a random father. Where
    their ranks differ by at most `pl` the offspring is `p * father + (1 - p) * mother`, p normal
    in every dimension about a scale F. Otherwise sperm is cast: the offspring is `mother + F
    (elite - mother) + F (one - other)`. The elite is one of the best, a quarter of the living at
    first and an eighth at the end; `one` is of the living, more often of a good rank where
    `rank_pressure` is above one; `other` is of the living and the shells of the replaced. A
    crossover keeps the mother's coordinates but for a share CR. An offspring replaces its mother
    where it is no worse. The switches:

    - `is_adaptive`: F and CR scatter about means of those that succeeded, weighted by gain
      (Tanabe and Fukunaga, 2013); else about `scale` and `rate`, with which the means begin.
    - `eigen_share`: of offspring, whose crossover is along the eigenvectors of the covariance of
      the better half (Guo and Yang, 2015).
    - `is_shrinking`: the living fall from `population` to four with the `reduction_power` of the
      share of the generations that is over; at one that is linear (Tanabe and Fukunaga, 2014). The
      arrays keep their sizes, and so do the offspring of a generation: where few live, each has
      several, and every evaluation is one of an offspring.
    - `patience`: generations in which the best loss may stagnate; then a fresh population, as
      large as the first, restarts the search and shrinks in the generations that are left.
    - `pl`: below zero none mate.

    `python -m benchmarks.optimizers --only ablation restarts` measures what each part is worth;
    `benchmarks/results/optimizers.md` has its ranks beside L-SHADE, jSO and CMA-ES. In 10
    dimensions and 100,000 evaluations restarts lower the mean error of five of 15 functions that it
    was developed on, and of three of 12 others, and raise one; neither is significant.
    """

    pl: int = 4
    is_adaptive: bool = True
    eigen_share: float = 0.5
    is_shrinking: bool = True
    patience: float = 200
    offspring_share: float = 0.5
    memory: int = 6
    scale: float = 0.3
    rate: float = 0.8
    factor_spread: float = 0.5
    elite_share: float = 0.25
    rank_pressure: float = 1.5
    reduction_power: float = 0.6

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        return self._begun(sort_by_loss(swarm), jnp.array(0))

    def _begun(self, swarm: Swarm, generation: Generation) -> Swarm:
        """A population with a new history."""
        dtype, count = swarm.positions.dtype, self._offspring
        nobody = jnp.zeros(count, jnp.int32)
        brood = Brood(nobody, jnp.zeros(count, dtype), jnp.zeros(count, dtype), nobody)
        scales, rates = (jnp.full(self.memory, mean, dtype) for mean in (self.scale, self.rate))
        start = generation, swarm.losses[0], generation
        history = History(scales, rates, swarm.positions, brood, *start)
        return Swarm(swarm.positions, swarm.losses, history)

    def draw(self, key: Key[Array, ""], generation: Generation, box: Box) -> Chances:
        count, dims, dtype = self._offspring, len(box.lower), box.lower.dtype
        uniform_key, kept_key, normal_key, fresh_key = jr.split(key, 4)
        fresh = jr.uniform(fresh_key, (self.population, dims), jnp.float32).astype(dtype)
        return Chances(
            jr.uniform(uniform_key, (11, count), jnp.float32).astype(dtype),
            jr.uniform(kept_key, (count, dims), jnp.float32).astype(dtype),
            normal(normal_key, (count, dims + 1), dtype),
            box.scale(fresh),
        )

    def propose(self, drawn: Chances, swarm: Swarm, generation: Generation, box: Box) -> Proposal:
        history: History = swarm.memory
        count, nothing = self._offspring, jnp.full_like(swarm.losses, jnp.inf)
        fresh = self._begun(Swarm(drawn.fresh, nothing), generation)
        is_stuck = generation - history.latest > self.patience
        positions, history = where_else(
            is_stuck, (fresh.positions, fresh.memory), (swarm.positions, history)
        )
        living = self._living(generation, history)
        of_mother, of_father, of_elite, of_one, of_other, of_shell, of_slot, *rest = drawn.uniform
        of_scale, of_low_scale, of_axis, of_turn = rest
        # One mother from each of as many parts of the ranking as there are offspring.
        part = jnp.arange(count, dtype=of_mother.dtype)
        mother = _chosen((part + of_mother) / count, living)
        # After a restart the population itself comes first, part by part.
        first = (generation - history.restart) * count
        is_fresh = (history.restart > 0) & (first < self.population)
        row = jnp.minimum(first.astype(jnp.int32) + part.astype(jnp.int32), self.population - 1)
        mother = jnp.where(is_fresh, row, mother)
        father = (mother + 1 + _chosen(of_father, living - 1)) % living
        one = _chosen(of_one**self.rank_pressure, living)
        one = jnp.where(one == mother, (one + 1) % living, one)
        share_over = self._share_over(generation, history).astype(part.dtype)
        share = self.elite_share * (1 - share_over / 2)
        elites = jnp.maximum(2, (share * living.astype(part.dtype)).astype(jnp.int32))
        elite = positions[_chosen(of_elite, elites)]
        others = jnp.concatenate([history.shells, positions])
        other = others[_chosen(of_other, self.population + living)]

        scale, rate = self._scale_and_rate(history, of_slot, of_scale, of_low_scale, drawn.normal)
        brood = Brood(mother, scale, rate, _chosen(of_shell, jnp.int32(self.population)))
        start, scale = positions[mother], scale[:, None]
        p = scale * (1 + self.factor_spread * drawn.normal[:, 1:])
        mated = p * (positions[father] - start)
        cast = scale * (elite - start + positions[one] - other)
        step = jnp.where((jnp.abs(father - mother) <= self.pl)[:, None], mated, cast)

        axis = jnp.arange(positions.shape[1], dtype=jnp.int32)
        forced = _chosen(of_axis, jnp.int32(len(axis)))[:, None]
        is_new = (drawn.kept < rate[:, None]) | (axis == forced)
        axes = _eigenvectors(positions, living // 2)
        turned = _product(jnp.where(is_new, _product(step, axes), 0), axes.T)
        step = jnp.where((of_turn < self.eigen_share)[:, None], turned, jnp.where(is_new, step, 0))
        step = jnp.where(is_fresh, 0, step)
        return self._inside(start + step, start, box), history._replace(brood=brood)

    def survive(self, swarm: Swarm, offspring: Swarm, generation: Generation) -> Swarm:
        history: History = offspring.memory
        brood = history.brood
        is_begun = history.restart == generation
        swarm = Swarm(
            jnp.where(is_begun, history.shells, swarm.positions),
            jnp.where(is_begun, jnp.inf, swarm.losses),
        )
        mothers = swarm.at(brood.mother)
        gain = mothers.losses - offspring.losses
        gain = jnp.where((gain > 0) & jnp.isfinite(gain), gain, 0)
        # Rows beyond the last are dropped.
        shell = jnp.where(offspring.losses < mothers.losses, brood.shell, self.population)
        shells = history.shells.at[shell].set(mothers.positions, mode="drop")
        losses = swarm.losses.at[brood.mother].min(offspring.losses)
        is_best = offspring.losses == losses[brood.mother]
        row = jnp.where(is_best, brood.mother, self.population)
        positions = swarm.positions.at[row].set(offspring.positions, mode="drop")

        is_living = jnp.arange(self.population, dtype=jnp.int32) < self._living(generation, history)
        order = jnp.argsort(jnp.where(is_living, losses, jnp.inf))
        scales, rates = history.scales, history.rates
        if self.is_adaptive:
            scales, rates = (
                _remembered(means, values, gain)
                for means, values in ((scales, brood.scale), (rates, brood.rate))
            )
        best = jnp.min(losses)
        has_fallen = history.best - best > FLAT * jnp.abs(best)
        best, latest = where_else(has_fallen, (best, generation), (history.best, history.latest))
        history = History(scales, rates, shells, brood, history.restart, best, latest)
        return Swarm(positions[order], losses[order], history)

    @property
    def _offspring(self) -> int:
        """Offspring of a generation."""
        return max(1, int(self.offspring_share * self.population))

    def _share_over(self, generation: Generation, history: History) -> Scalar:
        """The share of the generations since the latest restart that is over."""
        return (generation - history.restart) / jnp.maximum(1, self.iterations - history.restart)

    def _living(self, generation: Generation, history: History) -> Int[Array, ""]:
        """How many of the population live in a generation."""
        if not self.is_shrinking:
            return jnp.int32(self.population)
        least = min(4, self.population)
        share = self._share_over(generation, history).astype(jnp.float32)
        spent = share**self.reduction_power
        living = jnp.round(self.population - (self.population - least) * spent)
        return jnp.maximum(least, living).astype(jnp.int32)

    def _scale_and_rate(self, history: History, of_slot, of_scale, of_low_scale, normals):
        slot = _chosen(of_slot, jnp.int32(self.memory))
        scale = history.scales[slot] + SPREAD * jnp.tan(jnp.pi * (of_scale - 0.5))
        # SHADE draws again until the scale is positive.
        scale = jnp.where(scale > 0, jnp.minimum(scale, 1), SPREAD + 0.4 * of_low_scale)
        rate = jnp.clip(history.rates[slot] + SPREAD * normals[:, 0], 0, 1)
        return scale, rate

    def _inside(self, moved: Array, start: Array, box: Box) -> Array:
        return box.midway(moved, start) if self.bounded else moved


def _chosen(chance: Float[Array, "_"], count: Int[Array, ""]) -> Int[Array, "_"]:
    """One of `count` for every uniform number."""
    return jnp.minimum((chance * count.astype(chance.dtype)).astype(jnp.int32), count - 1)


def _eigenvectors(
    positions: Float[Array, "candidates dims"], count: Int[Array, ""]
) -> Float[Array, "dims dims"]:
    """The principal axes of the first `count`."""
    is_counted = (jnp.arange(len(positions), dtype=jnp.int32) < count)[:, None]
    mean = jnp.sum(jnp.where(is_counted, positions, 0), axis=0) / count.astype(positions.dtype)
    apart = jnp.where(is_counted, positions - mean, 0)
    return jnp.linalg.eigh(_product(apart.T, apart))[1]


def _product(first: Float[Array, "rows _"], second: Float[Array, "_ columns"]) -> Array:
    """The matrix product, whose rounding does not depend on the searches beside this one."""
    return jnp.sum(first.T[:, :, None] * second[:, None, :], axis=0)


def _remembered(
    means: Float[Array, "memory"],
    values: Float[Array, "offspring"],
    gain: Float[Array, "offspring"],
) -> Float[Array, "memory"]:
    """The means with the values' Lehmer mean, weighted by gain, in the oldest one's stead."""
    weighted = gain * values
    total = jnp.sum(weighted)
    mean = jnp.sum(weighted * values) / jnp.where(total > 0, total, 1)
    return jnp.where(jnp.any(gain > 0), jnp.append(means[1:], mean), means)

"""The barnacle mating optimizer and its improvements, each a switchable field."""

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float, Int, Key, PyTree, Scalar

from .chaos import TentBranch, levy_step, tent_map
from .population import AbstractPopulationMinimiser, Box, Swarm, keep_best, sort_by_loss


class Brood(NamedTuple):
    """Which mother, by rank, each offspring has, and when."""

    mother_rank: Int[Array, "candidates"]
    generation: Int[Array, ""]


class BarnacleMating(AbstractPopulationMinimiser):
    """Mate close barnacles, cast the sperm of distant ones, keep the best of both generations.

    With the defaults this is the barnacle mating optimizer (Sulaiman et al., 2020) in the form
    that reproduces Li et al. (2023), Table 2. Two random permutations pair a father and a mother;
    where their ranks differ by at most `pl` the offspring is `p * father + (1 - p) * mother`,
    otherwise it is the mother's sperm cast toward `cast_center`.

    The improvements of Li et al. (2023), each on its own:

    - `tent_start`: a tent-map first population (Eq. 13, 14); `tent_branch` as in `tent_map`.
    - `cosine_factor`: `0.5 cos(l / iterations) + 0.5` (Eq. 15, as printed: it falls from 1 to
      0.77) multiplies p.
    - `cast_step="levy"`: a Levy step in place of a uniform number (Eq. 17 to 19), times
      `cast_scale`; "normal" takes a normal number instead.

    And what the paper leaves open:

    - `gaussian_factor`: p holds standard normal numbers, one a dimension; off, p is the cosine
      factor alone (Eq. 16 as printed). `shared_factor`: one such vector a generation for all
      matings, or one each.
    - `factor_mean`, `factor_spread`: mean and standard deviation of those numbers.
    - `cast_per_dimension`: a step for every dimension, or one for the whole offspring.
    - `cast_center`: "origin" contracts toward coordinate zero whatever the objective is;
      "centroid" casts about the mean of the population, "elite" about the mean of its better
      half, weighted by the logarithm of the rank as in CMA-ES (Hansen, 2016, Eq. 49). Neither of
      the two depends on where the origin lies.
    - `cast_mothers`: the sperm is that of one mother, or a random normal mixture of the whole
      population's, so that its spread follows the population's in any rotated axes.
    - `brood_share`: for this share of the generations an offspring competes with its mother
      alone, which keeps the population apart; then with everyone.
    - `reevaluate_parents`: evaluate the parents again in every generation, which doubles the
      cost and matters for noisy objectives only.
    """

    population: int = 30
    iterations: int = 500
    pl: int = 7
    tent_start: bool = False
    tent_branch: TentBranch = "state"
    cosine_factor: bool = False
    gaussian_factor: bool = True
    shared_factor: bool = True
    factor_mean: float = 0.0
    factor_spread: float = 1.0
    cast_step: Literal["uniform", "levy", "normal"] = "uniform"
    levy_exponent: float = 1.5
    cast_scale: float = 1.0
    cast_per_dimension: bool = False
    cast_center: Literal["origin", "centroid", "elite"] = "origin"
    cast_mothers: Literal["one", "all"] = "one"
    brood_share: float = 0.0
    reevaluate_parents: bool = False
    bounded: bool = True
    rtol: float = 0.0
    atol: float = 0.0
    norm: Callable[[PyTree], Scalar] = optx.max_norm

    def __check_init__(self):
        if not (self.cosine_factor or self.gaussian_factor):
            raise ValueError("mating needs cosine_factor or gaussian_factor, or both")
        if self.reevaluate_parents and self.brood_share > 0:
            raise ValueError("reevaluate_parents asks for a brood_share of zero")

    def start(self, key: Key[Array, ""], box: Box, dtype: Any) -> Float[Array, "candidates dims"]:
        dims = len(box.lower)
        if self.tent_start:
            return box.scale(tent_map(key, self.population, dims, self.tent_branch, dtype))
        return box.scale(jr.uniform(key, (self.population, dims), dtype))

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        return sort_by_loss(swarm)

    def propose(
        self, key: Key[Array, ""], swarm: Swarm, generation: Int[Array, ""], box: Box
    ) -> tuple[Float[Array, "offspring dims"], PyTree]:
        father_key, mother_key, factor_key, step_key, sperm_key = jr.split(key, 5)
        father_rank = jr.permutation(father_key, self.population)
        mother_rank = jr.permutation(mother_key, self.population)
        father = swarm.positions[father_rank]
        mother = swarm.positions[mother_rank]

        p = self._mating_factor(factor_key, generation, mother)
        mated = p * father + (1 - p) * mother

        center = self._cast_center(swarm.positions)
        sperm = mother - center
        if self.cast_mothers == "all":
            weights = jr.normal(sperm_key, (self.population,) * 2, mother.dtype)
            sperm = weights @ (swarm.positions - center) / self.population**0.5
        cast = center + self._cast_steps(step_key, mother) * sperm

        is_near = jnp.abs(father_rank - mother_rank) <= self.pl
        offspring = jnp.where(is_near[:, None], mated, cast)
        if self.reevaluate_parents:
            offspring = jnp.concatenate([swarm.positions, offspring])
        return offspring, Brood(mother_rank, generation)

    def survive(self, swarm: Swarm, offspring: Swarm) -> Swarm:
        brood, offspring = offspring.memory, Swarm(offspring.positions, offspring.losses)
        if self.reevaluate_parents:
            best = sort_by_loss(offspring)
            return Swarm(best.positions[: self.population], best.losses[: self.population])
        kept = keep_best(swarm, offspring, self.population)
        if self.brood_share == 0:
            return kept
        is_early = brood.generation <= self.brood_share * self.iterations
        broods = _better_than_mother(swarm, offspring, brood.mother_rank)
        return jax.tree.map(lambda early, late: jnp.where(is_early, early, late), broods, kept)

    def _mating_factor(self, key: Key[Array, ""], generation: Int[Array, ""], like: Array) -> Array:
        factor = jnp.ones((), like.dtype)
        if self.gaussian_factor:
            shape = like.shape[1:] if self.shared_factor else like.shape
            factor = self.factor_mean + self.factor_spread * jr.normal(key, shape, like.dtype)
        if self.cosine_factor:
            factor = factor * (0.5 * jnp.cos(generation.astype(like.dtype) / self.iterations) + 0.5)
        return factor

    def _cast_center(self, positions: Float[Array, "candidates dims"]) -> Array:
        if self.cast_center == "origin":
            return jnp.zeros_like(positions[0])
        if self.cast_center == "centroid":
            return jnp.mean(positions, axis=0)
        ranks = np.arange(1, self.population + 1)
        weights = np.maximum(np.log(self.population / 2 + 0.5) - np.log(ranks), 0)
        return jnp.asarray(weights / weights.sum(), positions.dtype) @ positions

    def _cast_steps(self, key: Key[Array, ""], like: Array) -> Array:
        shape = like.shape if self.cast_per_dimension else (len(like), 1)
        if self.cast_step == "levy":
            steps = levy_step(key, shape, self.levy_exponent, like.dtype)
        elif self.cast_step == "normal":
            steps = jr.normal(key, shape, like.dtype)
        else:
            steps = jr.uniform(key, shape, like.dtype)
        return self.cast_scale * steps


def _better_than_mother(swarm: Swarm, offspring: Swarm, mother_rank: Array) -> Swarm:
    """Every offspring or, where that is no worse, its mother; sorted."""
    mothers = Swarm(swarm.positions[mother_rank], swarm.losses[mother_rank])
    is_better = offspring.losses < mothers.losses
    return sort_by_loss(
        Swarm(
            jnp.where(is_better[:, None], offspring.positions, mothers.positions),
            jnp.where(is_better, offspring.losses, mothers.losses),
        )
    )

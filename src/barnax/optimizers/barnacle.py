"""The barnacle mating optimizer and its improvements, each a switchable field."""

from collections.abc import Callable
from typing import Any, Literal

import jax.numpy as jnp
import jax.random as jr
import optimistix as optx
from jaxtyping import Array, Float, Int, Key, PyTree, Scalar

from .chaos import TentBranch, levy_step, tent_map
from .population import AbstractPopulationMinimiser, Box, Swarm, keep_best, sort_by_loss


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
    - `levy_cast`: a Levy step times `levy_scale` in place of a uniform number (Eq. 17 to 19).

    And what the paper leaves open:

    - `gaussian_factor`: p holds standard normal numbers, one a dimension; off, p is the cosine
      factor alone (Eq. 16 as printed). `shared_factor`: one such vector a generation for all
      matings, or one each.
    - `levy_per_dimension`: a step for every dimension, or one for the whole offspring.
    - `cast_center`: "origin" contracts toward coordinate zero whatever the objective is;
      "centroid" casts about the mean of the population and does not move with the origin.
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
    levy_cast: bool = False
    levy_exponent: float = 1.5
    levy_scale: float = 1.0
    levy_per_dimension: bool = False
    cast_center: Literal["origin", "centroid"] = "origin"
    reevaluate_parents: bool = False
    bounded: bool = True
    rtol: float = 0.0
    atol: float = 0.0
    norm: Callable[[PyTree], Scalar] = optx.max_norm

    def __check_init__(self):
        if not (self.cosine_factor or self.gaussian_factor):
            raise ValueError("mating needs cosine_factor or gaussian_factor, or both")

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
        father_key, mother_key, factor_key, cast_key = jr.split(key, 4)
        father_rank = jr.permutation(father_key, self.population)
        mother_rank = jr.permutation(mother_key, self.population)
        father = swarm.positions[father_rank]
        mother = swarm.positions[mother_rank]

        p = self._mating_factor(factor_key, generation, mother)
        mated = p * father + (1 - p) * mother

        step = self._cast_step(cast_key, mother)
        center = 0.0 if self.cast_center == "origin" else jnp.mean(swarm.positions, axis=0)
        cast = center + step * (mother - center)

        is_near = jnp.abs(father_rank - mother_rank) <= self.pl
        offspring = jnp.where(is_near[:, None], mated, cast)
        if self.reevaluate_parents:
            offspring = jnp.concatenate([swarm.positions, offspring])
        return offspring, None

    def survive(self, swarm: Swarm, offspring: Swarm) -> Swarm:
        if self.reevaluate_parents:
            best = sort_by_loss(offspring)
            return Swarm(best.positions[: self.population], best.losses[: self.population])
        return keep_best(swarm, offspring, self.population)

    def _mating_factor(self, key: Key[Array, ""], generation: Int[Array, ""], like: Array) -> Array:
        factor = jnp.ones((), like.dtype)
        if self.gaussian_factor:
            shape = like.shape[1:] if self.shared_factor else like.shape
            factor = jr.normal(key, shape, like.dtype)
        if self.cosine_factor:
            factor = factor * (0.5 * jnp.cos(generation.astype(like.dtype) / self.iterations) + 0.5)
        return factor

    def _cast_step(self, key: Key[Array, ""], like: Array) -> Array:
        shape = like.shape if self.levy_cast and self.levy_per_dimension else (len(like), 1)
        if self.levy_cast:
            return self.levy_scale * levy_step(key, shape, self.levy_exponent, like.dtype)
        return jr.uniform(key, shape, like.dtype)

"""Candidates in a box: swarms, their order by loss, and which of them are kept."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PyTree, Shaped

# Up to this many numbers, counting for each how many come before it is several times faster than
# sorting: the comparisons run in parallel, on every device.
COUNTED = 256


class Box(eqx.Module):
    """Lower and upper bound of every dimension."""

    lower: Float[Array, "dims"]
    upper: Float[Array, "dims"]

    @property
    def width(self) -> Float[Array, "dims"]:
        return self.upper - self.lower

    def clip(self, positions: Float[Array, "*candidates dims"]) -> Float[Array, "*candidates dims"]:
        return jnp.clip(positions, self.lower, self.upper)

    def midway(
        self,
        moved: Float[Array, "candidates dims"],
        start: Float[Array, "candidates dims"],
    ) -> Float[Array, "candidates dims"]:
        """The positions, with coordinates outside the box moved halfway from the start to its
        end."""
        passed = jnp.where(moved < self.lower, self.lower, self.upper)
        is_out = (moved < self.lower) | (moved > self.upper)
        return jnp.where(is_out, (passed + start) / 2, moved)

    def scale(
        self, fractions: Float[Array, "*candidates dims"]
    ) -> Float[Array, "*candidates dims"]:
        """Fractions of the box, in [0, 1], as positions."""
        return self.lower + fractions * self.width


class Swarm(eqx.Module):
    """Candidates and their losses; `memory` is the additional state of an algorithm."""

    positions: Float[Array, "candidates dims"]
    losses: Float[Array, "candidates"]
    memory: PyTree = None

    def at(self, rows: Int[Array, "rows"] | slice) -> "Swarm":
        """Some of the candidates, with the memory."""
        return Swarm(self.positions[rows], self.losses[rows], self.memory)


def joined(first: Swarm, second: Swarm) -> Swarm:
    """The candidates of two swarms, without a memory."""
    return Swarm(
        jnp.concatenate([first.positions, second.positions]),
        jnp.concatenate([first.losses, second.losses]),
    )


def ranks(values: Shaped[Array, "items"]) -> Int[Array, "items"]:
    """The rank of every item in ascending order, from 0; equal items keep their order."""
    if len(values) > COUNTED:
        return jnp.argsort(jnp.argsort(values, stable=True))
    index = jnp.arange(len(values), dtype=jnp.int32)
    comes_before = jnp.where(
        index[:, None] < index[None, :],
        values[:, None] <= values[None, :],
        values[:, None] < values[None, :],
    )
    return jnp.sum(comes_before, axis=0, dtype=jnp.int32)


def items_at_ranks(ranks: Int[Array, "items"], count: int) -> Int[Array, "count"]:
    """The items with the ranks 0 to `count - 1`: the inverse of the permutation `ranks`."""
    if len(ranks) > COUNTED:
        return jnp.argsort(ranks)[:count]
    item = jnp.arange(len(ranks), dtype=jnp.int32)
    holds_rank = ranks[:, None] == item[None, :count]
    return jnp.sum(jnp.where(holds_rank, item[:, None], 0), axis=0, dtype=jnp.int32)


def best_first(losses: Float[Array, "candidates"], count: int) -> Int[Array, "count"]:
    """The `count` candidates with the smallest loss, in order; equal losses keep their order."""
    return items_at_ranks(ranks(losses), count)


def sort_by_loss(swarm: Swarm) -> Swarm:
    """The swarm with its best candidate first; equal losses keep their order."""
    return swarm.at(best_first(swarm.losses, len(swarm.losses)))


def keep_best(swarm: Swarm, offspring: Swarm, population: int) -> Swarm:
    """The best of sorted parents and their offspring together, sorted; a parent wins a tie."""
    both = joined(swarm, offspring)
    kept = best_first(both.losses, population)
    return Swarm(both.positions[kept], both.losses[kept], offspring.memory)


def replaced(is_replaced: Bool[Array, "candidates"], new: Swarm, old: Swarm) -> Swarm:
    """The old candidates, with new ones in place of those at these indices."""
    return Swarm(
        jnp.where(is_replaced[:, None], new.positions, old.positions),
        jnp.where(is_replaced, new.losses, old.losses),
    )


def better_of_each(swarm: Swarm, offspring: Swarm) -> Swarm:
    """Every candidate, or its own offspring if that is strictly better."""
    return replaced(offspring.losses < swarm.losses, offspring, swarm)


def best_of(swarm: Swarm) -> Swarm:
    """The swarm's best candidate as a swarm of one; of equal ones the first."""
    best = jnp.argmin(swarm.losses)[None]
    return Swarm(swarm.positions[best], swarm.losses[best])

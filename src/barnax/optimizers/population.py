"""The one population minimiser: what every algorithm here shares.

An algorithm says how a first population is laid out (`start`, `prepare`), what of a generation is
random (`draw`), how new positions are proposed (`propose`) and which candidates live on
(`survive`). Bounds, keys, the vmap over candidates, losses that are not finite, counting and the
history are settled here, once. Every algorithm is an `optimistix.AbstractMinimiser`, so one call,
`optimistix.minimise`, runs it.
"""

import abc
import math
from collections.abc import Callable
from dataclasses import field
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import optimistix as optx
from jax import lax
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Int, Key, PyTree, Scalar, Shaped

from .draws import written_out

# Random numbers are drawn for several generations at once, up to so many in all: large loops over
# numbers run faster than small ones, until they leave the processor's cache.
DRAWN_AT_ONCE = 8192
# Up to so many numbers, counting for each how many come before it is several times faster than
# sorting: the comparisons run side by side, on every device.
COUNTED = 256

Generation = Int[Array, ""]
# New positions to evaluate, and the new memory.
Proposal = tuple[Float[Array, "offspring dims"], PyTree]


class Box(eqx.Module):
    """Lower and upper bound of every dimension."""

    lower: Float[Array, "dims"]
    upper: Float[Array, "dims"]

    @property
    def width(self) -> Float[Array, "dims"]:
        return self.upper - self.lower

    def clip(self, positions: Float[Array, "*candidates dims"]) -> Float[Array, "*candidates dims"]:
        return jnp.clip(positions, self.lower, self.upper)

    def scale(
        self, fractions: Float[Array, "*candidates dims"]
    ) -> Float[Array, "*candidates dims"]:
        """Fractions of the box, in [0, 1], as positions."""
        return self.lower + fractions * self.width


class Swarm(eqx.Module):
    """Candidates and their losses; `memory` is what one algorithm carries beside them."""

    positions: Float[Array, "candidates dims"]
    losses: Float[Array, "candidates"]
    memory: PyTree = None

    def at(self, rows: Int[Array, "rows"] | slice) -> "Swarm":
        """Some of the candidates, and the memory."""
        return Swarm(self.positions[rows], self.losses[rows], self.memory)


def joined(first: Swarm, second: Swarm) -> Swarm:
    """The candidates of two swarms, without a memory."""
    return Swarm(
        jnp.concatenate([first.positions, second.positions]),
        jnp.concatenate([first.losses, second.losses]),
    )


def ranks(values: Shaped[Array, "items"]) -> Int[Array, "items"]:
    """The place of every item in ascending order, from 0; equal items keep their order."""
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
    """The items that hold the ranks 0 to `count - 1`: the inverse of the permutation `ranks`."""
    if len(ranks) > COUNTED:
        return jnp.argsort(ranks)[:count]
    item = jnp.arange(len(ranks), dtype=jnp.int32)
    holds_rank = ranks[:, None] == item[None, :count]
    return jnp.sum(jnp.where(holds_rank, item[:, None], 0), axis=0, dtype=jnp.int32)


def best_first(losses: Float[Array, "candidates"], count: int) -> Int[Array, "count"]:
    """The `count` candidates of smallest loss, in order; equal losses keep theirs."""
    return items_at_ranks(ranks(losses), count)


def sort_by_loss(swarm: Swarm) -> Swarm:
    """The swarm with its best candidate first; equal losses keep their order."""
    return swarm.at(best_first(swarm.losses, len(swarm.losses)))


def keep_best(swarm: Swarm, offspring: Swarm, population: int) -> Swarm:
    """The best of sorted parents and their offspring together, sorted; a parent wins a tie."""
    both = joined(swarm, offspring)
    if len(both.losses) > COUNTED:
        kept = best_first(both.losses, population)
    else:
        parents, children = swarm.losses, offspring.losses
        is_beaten = children[:, None] < parents[None, :]
        is_behind = parents[:, None] <= children[None, :]
        parent_ranks = jnp.arange(len(parents), dtype=jnp.int32) + _count(is_beaten)
        kept = items_at_ranks(
            jnp.concatenate([parent_ranks, ranks(children) + _count(is_behind)]), population
        )
    return Swarm(both.positions[kept], both.losses[kept], offspring.memory)


def replaced(is_replaced: Bool[Array, "candidates"], new: Swarm, old: Swarm) -> Swarm:
    """The old candidates, but for those that are replaced by the new ones at their places."""
    return Swarm(
        jnp.where(is_replaced[:, None], new.positions, old.positions),
        jnp.where(is_replaced, new.losses, old.losses),
    )


def better_of_each(swarm: Swarm, offspring: Swarm) -> Swarm:
    """Every candidate, or its own offspring where that is strictly better."""
    return replaced(offspring.losses < swarm.losses, offspring, swarm)


def _count(claims: Shaped[Array, "others items"]) -> Int[Array, "items"]:
    return jnp.sum(claims, axis=0, dtype=jnp.int32)


def best_of(swarm: Swarm) -> Swarm:
    """The swarm's best candidate as a swarm of one; of equal ones the first."""
    best = jnp.argmin(swarm.losses)[None]
    return Swarm(swarm.positions[best], swarm.losses[best])


class PopulationState(eqx.Module):
    """The solver state: the swarm, the best seen so far, and what has been spent."""

    swarm: Swarm
    best_position: Float[Array, "dims"]
    best_loss: Scalar
    best_aux: PyTree
    generation: Generation
    evaluations: Int[Array, ""]
    failures: Int[Array, ""]
    history: Float[Array, "generations"]


class AbstractPopulationMinimiser(optx.AbstractMinimiser):
    """Minimise inside a box with a population of candidates, for `iterations` generations.

    Use through `optimistix.minimise(fn, solver, y0, args, options, max_steps=None)`:

    - `options["key"]`: a PRNG key (`jax.random.key(0)`). It alone makes the run.
    - `options["lower"]`, `options["upper"]`: bounds, scalars or arrays shaped as `y0`.
    - `options["keyed_objective"]`: if true, `args` is a pair `(data, key)` and `key` is replaced
      by a fresh one for every single evaluation; for objectives with noise of their own.
    - `y0` gives shape and dtype only; its value is never used as a guess.

    Optimistix traces `fn` before the search begins, so `fn` uses `jax.numpy`, or NumPy within
    `jax.pure_callback`. To Optimistix the whole search is one step, so `max_steps` may be anything.

    With `bounded` every candidate is clipped to the box before it is evaluated. Without, only
    the first population lies inside; some published results were made that way.

    A loss that is NaN or infinite counts as infinite and can never become the best. The
    solution's `stats` hold `best_loss`, `history` (the best loss after each generation, the
    initial population first), `evaluations`, `population` (the initial evaluations among them)
    and `failures` (losses that were not finite). Where every loss was infinite the result is
    `RESULTS.nonfinite`.
    """

    population: int = 30
    iterations: int = 500
    bounded: bool = field(default=True, kw_only=True)
    # Optimistix asks for these three; here the budget alone ends a run, so they are no settings.
    if TYPE_CHECKING:
        rtol: float = field(default=0.0, init=False)
        atol: float = field(default=0.0, init=False)
        norm: Callable[[PyTree], Scalar] = field(default=optx.max_norm, init=False)
    else:
        rtol = property(lambda self: 0.0)
        atol = property(lambda self: 0.0)
        norm = property(lambda self: optx.max_norm)

    def start(self, key: Key[Array, ""], box: Box, dtype: Any) -> Float[Array, "candidates dims"]:
        """The initial positions, `population` of them; by default at random all over the box."""
        return box.scale(jr.uniform(key, (self.population, len(box.lower)), dtype))

    @abc.abstractmethod
    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        """The evaluated first population in the algorithm's order, with its first memory."""

    @abc.abstractmethod
    def draw(self, key: Key[Array, ""], generation: Generation, box: Box) -> PyTree:
        """All that is random in `generation` (1 to `iterations`), whatever the swarm is like."""

    @abc.abstractmethod
    def propose(self, drawn: PyTree, swarm: Swarm, generation: Generation, box: Box) -> Proposal:
        """New positions to evaluate in `generation`, and the new memory."""

    @abc.abstractmethod
    def survive(self, swarm: Swarm, offspring: Swarm, generation: Generation) -> Swarm:
        """The survivors of `generation`, of the parents and their evaluated offspring."""

    def init(self, fn, y, args, options, f_struct, aux_struct, tags) -> PopulationState:
        del aux_struct, tags
        if f_struct.shape != ():
            raise ValueError(
                f"a population minimiser needs a scalar objective, not shape {f_struct.shape}"
            )
        box = _box(y, options)
        start_key, noise_key = jr.split(jr.fold_in(_key(options), 0))
        positions = box.clip(self.start(start_key, box, box.lower.dtype))
        losses, aux, failures = _evaluate(fn, positions, y, args, options, noise_key)
        best = jnp.argmin(losses)
        history = jnp.full(self.iterations + 1, losses[best])
        return PopulationState(
            swarm=self.prepare(Swarm(positions, losses), box),
            best_position=positions[best],
            best_loss=losses[best],
            best_aux=jax.tree.map(lambda leaf: leaf[best], aux),
            generation=jnp.array(0),
            evaluations=jnp.array(len(positions)),
            failures=failures,
            history=history,
        )

    def step(self, fn, y, args, options, state: PopulationState, tags):
        del tags
        key, box = _key(options), _box(y, options)

        def draw(generation):
            propose_key, noise_key = jr.split(jr.fold_in(key, generation))
            return self.draw(propose_key, generation, box), noise_key

        at_once = self._generations_at_once(box)

        def some_generations(chunk, carry):
            first = 1 + chunk * at_once
            drawn = jax.vmap(draw)(first + 1 + jnp.arange(at_once))

            def one_generation(offset, carry):
                state, (positions, memory), noise_key = carry
                numbers, next_noise_key = jax.tree.map(lambda leaf: leaf[offset], drawn)
                generation = first + offset
                losses, aux, failures = _evaluate(fn, positions, y, args, options, noise_key)
                offspring = Swarm(positions, losses, memory)
                state = self._advance(state, offspring, aux, failures, generation)
                proposal = self._propose(numbers, state.swarm, generation + 1, box)
                return state, proposal, next_noise_key

            remaining = 1 + self.iterations - first
            return lax.fori_loop(0, jnp.minimum(at_once, remaining), one_generation, carry)

        # What is drawn and what is proposed each pass from one turn of a loop to the next, that
        # is, through memory. Within a turn the compiler would compute both again wherever they
        # are used, at a cost, and with last bits that depend on the searches beside this one.
        numbers, noise_key = draw(jnp.array(1))
        carry = state, self._propose(numbers, state.swarm, jnp.array(1), box), noise_key
        chunks = math.ceil(self.iterations / at_once)
        state, _, _ = lax.fori_loop(0, chunks, some_generations, carry)
        return state.best_position.reshape(y.shape), state, state.best_aux

    def _generations_at_once(self, box: Box) -> int:
        struct = jax.eval_shape(self.draw, jr.key(0), jnp.array(1), box)
        numbers = sum(leaf.size for leaf in jax.tree.leaves(struct))
        return max(1, min(DRAWN_AT_ONCE // numbers, self.iterations))

    def _propose(self, drawn: PyTree, swarm: Swarm, generation: Generation, box: Box):
        positions, memory = self.propose(drawn, swarm, generation, box)
        return box.clip(positions) if self.bounded else positions, memory

    def _advance(
        self,
        state: PopulationState,
        offspring: Swarm,
        aux: PyTree,
        failures,
        generation: Generation,
    ) -> PopulationState:
        """The state one generation later."""
        positions, losses = offspring.positions, offspring.losses
        best = jnp.argmin(losses)
        better = losses[best] < state.best_loss
        best_loss = jnp.where(better, losses[best], state.best_loss)
        return PopulationState(
            swarm=self.survive(state.swarm, offspring, generation),
            best_position=jnp.where(better, positions[best], state.best_position),
            best_loss=best_loss,
            best_aux=jax.tree.map(
                lambda new, old: jnp.where(better, new[best], old), aux, state.best_aux
            ),
            generation=generation,
            evaluations=state.evaluations + len(positions),
            failures=state.failures + failures,
            history=state.history.at[generation].set(best_loss, mode="promise_in_bounds"),
        )

    def terminate(self, fn, y, args, options, state: PopulationState, tags):
        del fn, y, args, options, tags
        is_over = state.generation >= self.iterations
        is_lost = is_over & jnp.isinf(state.best_loss)
        result = optx.RESULTS.where(is_lost, optx.RESULTS.nonfinite, optx.RESULTS.successful)
        return is_over, result

    def postprocess(self, fn, y, aux, args, options, state: PopulationState, tags, result):
        del fn, aux, args, options, tags, result
        stats = {
            "best_loss": state.best_loss,
            "history": state.history,
            "evaluations": state.evaluations,
            "population": jnp.array(self.population),
            "failures": state.failures,
        }
        return state.best_position.reshape(y.shape), state.best_aux, stats


class AbstractSortedSearch(AbstractPopulationMinimiser):
    """A search whose candidates stand in the order of their losses, the best first; each is
    replaced by its own offspring where that is better."""

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        return sort_by_loss(swarm)

    def survive(self, swarm: Swarm, offspring: Swarm, generation: Generation) -> Swarm:
        return sort_by_loss(better_of_each(swarm, offspring))


def _key(options: dict[str, Any]) -> Key[Array, ""]:
    if "key" not in options:
        raise ValueError('a population minimiser needs options["key"], such as jax.random.key(0)')
    key = jnp.asarray(options["key"])
    if not jnp.issubdtype(key.dtype, jax.dtypes.prng_key):
        key = jr.wrap_key_data(key)
    return written_out(key)


def _box(y: Array, options: dict[str, Any]) -> Box:
    if not isinstance(y, jax.Array | np.ndarray):
        raise ValueError(
            f"a population minimiser needs one array to start from, not a {type(y).__name__}; "
            "jax.flatten_util.ravel_pytree makes one"
        )
    missing = [name for name in ("lower", "upper") if name not in options]
    if missing:
        raise ValueError(
            f"a population minimiser searches inside a box; options lack {' and '.join(missing)}"
        )
    ends = options["lower"], options["upper"]
    # Bounds that are traced have no value yet.
    is_concrete = not any(isinstance(end, Tracer) for end in ends)
    if is_concrete and np.any(np.asarray(ends[0]) > np.asarray(ends[1])):
        raise ValueError(f"the lower bound {ends[0]} is above the upper bound {ends[1]}")
    return Box(*(jnp.broadcast_to(jnp.asarray(end, y.dtype), y.shape).ravel() for end in ends))


def _evaluate(
    fn: Callable, positions: Array, y: Array, args: PyTree, options: dict[str, Any], key: Array
) -> tuple[Float[Array, "candidates"], PyTree, Int[Array, ""]]:
    """Losses of all candidates, non-finite ones as infinity, and how many those were."""
    if options.get("keyed_objective", False):
        kind = jr.key_impl(args[1])
        keys = jr.wrap_key_data(jr.key_data(jr.split(key, len(positions))), impl=kind)
        keyed = jax.vmap(lambda x, key: fn(x.reshape(y.shape), (args[0], key)))
        losses, aux = keyed(positions, keys)
    else:
        losses, aux = jax.vmap(lambda x: fn(x.reshape(y.shape), args))(positions)
    is_finite = jnp.isfinite(losses)
    return jnp.where(is_finite, losses, jnp.inf), aux, jnp.sum(~is_finite)

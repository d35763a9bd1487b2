"""The one population minimiser: what every algorithm here shares.

An algorithm says how a first population is laid out (`start`, `prepare`), what of a generation is
random (`draw`), how new positions are proposed (`propose`) and which candidates live on
(`survive`). Bounds, keys, the vmap over candidates, losses that are not finite, counting, stops and
the history are settled here, once: `begin`, `ask` and `tell` are a search step by step, and
`optimistix.minimise` runs the same three.
"""

import abc
from collections.abc import Callable
from dataclasses import field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import optimistix as optx
from jax import lax
from jax.core import Tracer
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int, Key, PyTree, Scalar

from ..errors import InputError
from .draws import written_out
from .swarm import Box, Swarm, better_of_each, sort_by_loss

# Random numbers are drawn for several generations at once, up to so many in all: large loops over
# numbers run faster than small ones, until they leave the processor's cache.
DRAWN_AT_ONCE = 8192

Generation = Int[Array, ""]
# New positions to evaluate, and the new memory.
Proposal = tuple[Float[Array, "offspring dims"], PyTree]


class Stop(NamedTuple):
    """When a search ends before its `iterations` are over; None is never.

    Attributes:
        target: At a best loss of this or less.
        max_evaluations: Before a generation that would take the evaluations beyond these.
        ftol: Where the best loss fell by no more than this share of itself in `patience`
            generations.
        patience: Those generations.
    """

    target: float | None = None
    max_evaluations: Any = None
    ftol: float | None = None
    patience: int = 50

    @property
    def is_early(self) -> bool:
        """True if there is anything to stop at."""
        return any(limit is not None for limit in self[:3])


class PopulationState(eqx.Module):
    """A search between two generations: the swarm, the best so far, and what has been spent.

    Before the first population is evaluated its swarm has no losses. `history` holds the best loss
    after each generation, the first population's first.
    """

    key: Key[Array, ""] | None
    box: Box
    swarm: Swarm
    best_position: Float[Array, "dims"]
    best_loss: Scalar
    best_aux: PyTree
    generation: Generation
    evaluations: Int[Array, ""]
    failures: Int[Array, ""]
    history: Float[Array, "generations"]

    @property
    def is_new(self) -> bool:
        """True before the first population is evaluated."""
        return not len(self.swarm.losses)


class AbstractPopulationMinimiser(optx.AbstractMinimiser):
    """Minimise inside a box with a population of candidates, for `iterations` generations.

    `barnax.optimizers.minimise` is the short way to use it, `begin`, `ask` and `tell` the one for
    losses that JAX does not compute. `optimistix.minimise(fn, solver, y0, args, options,
    max_steps=None)` takes:

    - `y0`: a pytree of arrays; inside the box, where it is the first candidate.
    - `options["key"]`: a PRNG key (`jax.random.key(0)`). It alone makes the run.
    - `options["lower"]`, `options["upper"]`: bounds, numbers or pytrees like `y0`.
    - `options["keyed_objective"]`: if true, `args` is a pair `(data, key)` and `key` is replaced
      by a fresh one for every single evaluation; for objectives with noise of their own.
    - `options["use_y0"]`: if false, `y0` gives shapes and dtypes only.
    - `options["in_one_step"]`: if true, Optimistix counts the whole search as one step, which is
      up to four times faster for a cheap objective than a step a generation.
    - `options["callback"]`: called with generation, evaluations and best loss, each generation.

    With `bounded` every candidate is clipped to the box before it is evaluated. Without, only
    the first population lies inside; some published results were made that way.

    A loss that is NaN or infinite counts as infinite and can never become the best, so NaN says
    that a constraint is broken. The solution's `stats` hold `best_loss`, `history` (the best loss
    after each generation, the initial population first), `evaluations`, `population` (the initial
    evaluations among them) and `failures` (losses that were not finite). Where every loss was
    infinite the result is `RESULTS.nonfinite`.
    """

    population: int = 30
    iterations: int = 500
    bounded: bool = field(default=True, kw_only=True)
    stop: Stop = field(default=Stop(), kw_only=True)
    # Optimistix asks for these three; here `stop` ends a run, so they are no settings.
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
        """The survivors of `generation`, of the parents and their evaluated offspring, which bring
        the new memory."""

    def begin(
        self,
        key: Key[Array, ""],
        lower: Float[Array, "dims"] | float,
        upper: Float[Array, "dims"] | float,
        guess: Float[Array, "dims"] | None = None,
    ) -> PopulationState:
        """The state before anything is evaluated; `guess`, inside the box, is the first candidate.

        Raises `ValueError` where a lower bound is above its upper bound.
        """
        _require_order(lower, upper)
        dtype = jnp.result_type(float, lower, upper)
        ends = (jnp.atleast_1d(jnp.asarray(end, dtype)) for end in (lower, upper))
        box = Box(*jnp.broadcast_arrays(*ends))
        key = as_key(key)
        start_key, _ = jr.split(jr.fold_in(key, 0))
        positions = box.clip(self.start(start_key, box, box.lower.dtype))
        if guess is not None:
            positions = positions.at[0].set(box.clip(jnp.asarray(guess, positions.dtype)))
        infinity = jnp.full((), jnp.inf, positions.dtype)
        return PopulationState(
            key=key,
            box=box,
            swarm=Swarm(positions, infinity[None][:0]),
            best_position=positions[0],
            best_loss=infinity,
            best_aux=None,
            generation=jnp.array(0),
            evaluations=jnp.array(0),
            failures=jnp.array(0),
            history=jnp.full(self.iterations + 1, infinity),
        )

    def ask(
        self, state: PopulationState, drawn: PyTree = None
    ) -> tuple[Float[Array, "candidates dims"], PopulationState]:
        """The positions to evaluate next, and the state that `tell` takes with their losses.

        The first are the first population. `drawn` are the generation's numbers, where they were
        drawn before; by default they are drawn here.
        """
        swarm, generation = state.swarm, state.generation + 1
        if state.is_new:
            return swarm.positions, state
        if drawn is None:
            drawn = self.draw(_draw_key(state.key, generation), generation, state.box)
        positions, memory = self.propose(drawn, swarm, generation, state.box)
        positions = state.box.clip(positions) if self.bounded else positions
        return positions, replace(state, swarm=Swarm(swarm.positions, swarm.losses, memory))

    def tell(
        self,
        state: PopulationState,
        positions: Float[Array, "candidates dims"],
        losses: Float[Array, "candidates"],
        aux: PyTree = None,
    ) -> PopulationState:
        """The state after the positions that `ask` gave were evaluated.

        A loss that is not finite counts as infinite, and as a failure. Of `aux`, a row for every
        position, the best one's is kept.
        """
        is_finite = jnp.isfinite(losses)
        losses = jnp.where(is_finite, losses, jnp.inf)
        best = jnp.argmin(losses)
        best_aux = jax.tree.map(lambda leaf: leaf[best], aux)
        evaluations = state.evaluations + len(positions)
        failures = state.failures + jnp.sum(~is_finite)
        if state.is_new:
            return PopulationState(
                key=state.key,
                box=state.box,
                swarm=self.prepare(Swarm(positions, losses), state.box),
                best_position=positions[best],
                best_loss=losses[best],
                best_aux=best_aux,
                generation=state.generation,
                evaluations=evaluations,
                failures=failures,
                history=jnp.full(self.iterations + 1, losses[best]),
            )
        generation = state.generation + 1
        better = losses[best] < state.best_loss
        best_loss = jnp.where(better, losses[best], state.best_loss)
        offspring = Swarm(positions, losses, state.swarm.memory)
        # Who asks for more than `iterations` has the last of them at the history's end.
        latest = jnp.minimum(generation, self.iterations)
        return PopulationState(
            key=state.key,
            box=state.box,
            swarm=self.survive(state.swarm, offspring, generation),
            best_position=jnp.where(better, positions[best], state.best_position),
            best_loss=best_loss,
            best_aux=jax.tree.map(
                lambda new, old: jnp.where(better, new, old), best_aux, state.best_aux
            ),
            generation=generation,
            evaluations=evaluations,
            failures=failures,
            history=state.history.at[latest].set(best_loss, mode="promise_in_bounds"),
        )

    def is_over(self, state: PopulationState) -> Bool[Array, ""]:
        """True if the search has spent its generations, or has come to its `stop`."""
        stop, best = self.stop, state.best_loss
        over = state.generation >= self.iterations
        if stop.target is not None:
            over |= best <= stop.target
        if stop.max_evaluations is not None:
            over |= state.evaluations + evaluations_per_iteration(self) > stop.max_evaluations
        if stop.ftol is not None:
            before = state.history[jnp.maximum(state.generation - stop.patience, 0)]
            is_flat = before - best <= stop.ftol * jnp.abs(best)
            over |= (state.generation >= stop.patience) & is_flat
        return over

    def init(self, fn, y, args, options, f_struct, aux_struct, tags) -> PopulationState:
        del aux_struct, tags
        if f_struct.shape != ():
            raise ValueError(
                f"a population minimiser needs a scalar objective, not shape {f_struct.shape}"
            )
        if "key" not in options:
            raise ValueError(
                'a population minimiser needs options["key"], such as jax.random.key(0)'
            )
        guess, _ = ravel_pytree(y)
        guess = guess if options.get("use_y0", True) else None
        lower, upper = flat_bounds(y, options)
        positions, state = self.ask(self.begin(options["key"], lower, upper, guess))
        return replace(self._evaluated(fn, positions, state, y, args, options), key=None)

    def step(self, fn, y, args, options, state: PopulationState, tags):
        del tags
        # Optimistix keeps numbers only, so the key is not in the states that it sees.
        state = replace(state, key=as_key(options["key"]))
        box, count = state.box, 1
        if options.get("in_one_step", False):
            # A constant keeps the counts of searches beside each other one number.
            count, state = self.iterations, replace(state, generation=jnp.array(0))
        first = state.generation + 1

        def draw(generation):
            return self.draw(_draw_key(state.key, generation), generation, box)

        def goes_on(done, end, state):
            is_short = done < end
            return is_short & _any_of_all(~self.is_over(state)) if self.stop.is_early else is_short

        at_once = min(self._generations_at_once(box), count)

        def some_generations(carry):
            done, state, positions = carry
            drawn = jax.vmap(draw)(first + done + 1 + jnp.arange(at_once))
            end = jnp.minimum(done + at_once, count)

            def one_generation(carry):
                now, state, positions = carry
                told = self._evaluated(fn, positions, state, y, args, options)
                if self.stop.is_early:
                    told = where_else(self.is_over(state), state, told)
                numbers = jax.tree.map(lambda leaf: leaf[now - done], drawn)
                positions, told = self.ask(told, numbers)
                return now + 1, told, positions

            return lax.while_loop(
                lambda carry: goes_on(carry[0], end, carry[1]),
                one_generation,
                (done, state, positions),
            )

        # What is drawn and what is proposed each pass from one turn of a loop to the next, that
        # is, through memory. Within a turn the compiler would compute both again wherever they
        # are used, at a cost, and with last bits that depend on the searches beside this one.
        positions, state = self.ask(state, draw(first))
        _, state, _ = lax.while_loop(
            lambda carry: goes_on(carry[0], count, carry[1]),
            some_generations,
            (jnp.array(0), state, positions),
        )
        return y, replace(state, key=None), state.best_aux

    def _generations_at_once(self, box: Box) -> int:
        struct = jax.eval_shape(self.draw, jr.key(0), jnp.array(1), box)
        numbers = sum(leaf.size for leaf in jax.tree.leaves(struct))
        return max(1, min(DRAWN_AT_ONCE // numbers, self.iterations))

    def _evaluated(self, fn, positions, state, y, args, options) -> PopulationState:
        """The state after `fn` was evaluated at the positions that were asked for."""
        _, unravel = ravel_pytree(y)
        if options.get("keyed_objective", False):
            asked = state.generation + (not state.is_new)
            _, noise_key = jr.split(jr.fold_in(state.key, asked))
            kind = jr.key_impl(args[1])
            keys = jr.wrap_key_data(jr.key_data(jr.split(noise_key, len(positions))), impl=kind)
            keyed = jax.vmap(lambda x, key: fn(unravel(x), (args[0], key)))
            losses, aux = keyed(positions, keys)
        else:
            losses, aux = jax.vmap(lambda x: fn(unravel(x), args))(positions)
        state = self.tell(state, positions, losses, aux)
        if options.get("callback") is not None:
            spent = state.generation, state.evaluations, state.best_loss
            jax.debug.callback(options["callback"], *spent)
        return state

    def terminate(self, fn, y, args, options, state: PopulationState, tags):
        del fn, y, args, options, tags
        is_over = self.is_over(state)
        is_lost = is_over & jnp.isinf(state.best_loss)
        result = optx.RESULTS.where(is_lost, optx.RESULTS.nonfinite, optx.RESULTS.successful)
        return is_over, result

    def postprocess(self, fn, y, aux, args, options, state: PopulationState, tags, result):
        del fn, aux, args, options, tags, result
        _, unravel = ravel_pytree(y)
        is_past = jnp.arange(self.iterations + 1) <= state.generation
        stats = {
            "best_loss": state.best_loss,
            "history": jnp.where(is_past, state.history, state.best_loss),
            "evaluations": state.evaluations,
            "population": jnp.array(self.population),
            "failures": state.failures,
        }
        return unravel(state.best_position), state.best_aux, stats


class AbstractSortedSearch(AbstractPopulationMinimiser):
    """A search whose candidates stand in the order of their losses, the best first; each is
    replaced by its own offspring where that is better."""

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        return sort_by_loss(swarm)

    def survive(self, swarm: Swarm, offspring: Swarm, generation: Generation) -> Swarm:
        return sort_by_loss(better_of_each(swarm, offspring))


def evaluations_per_iteration(optimizer: AbstractPopulationMinimiser) -> int:
    """Number of candidates that the optimizer evaluates in one generation."""

    def first_offspring(key):
        first, state = optimizer.ask(optimizer.begin(key, jnp.zeros(2), jnp.ones(2)))
        return optimizer.ask(optimizer.tell(state, first, first[:, 0]))[0]

    return jax.eval_shape(first_offspring, jax.random.key(0)).shape[0]


@jax.custom_batching.custom_vmap
def _any_of_all(claim: Bool[Array, ""]) -> Bool[Array, ""]:
    """The claim of one search; of many beside each other, that of any: one number for them all."""
    return claim


@_any_of_all.def_vmap
def _(axis_size, in_batched, claims):
    del axis_size, in_batched
    return _any_of_all(jnp.any(claims)), False


def where_else(claim: Bool[Array, ""], first: PyTree, second: PyTree) -> PyTree:
    return jax.tree.map(lambda one, other: jnp.where(claim, one, other), first, second)


def _draw_key(key: Key[Array, ""], generation: Generation) -> Key[Array, ""]:
    return jr.split(jr.fold_in(key, generation))[0]


def as_key(key: Array) -> Key[Array, "*keys"]:
    key = jnp.asarray(key)
    if not jnp.issubdtype(key.dtype, jax.dtypes.prng_key):
        key = jr.wrap_key_data(key)
    return written_out(key)


def flat_bounds(y: PyTree, options: dict[str, Any]) -> list[Array]:
    """Lower and upper bound of every number of `y`."""
    missing = [name for name in ("lower", "upper") if name not in options]
    if missing:
        raise ValueError(
            f"a population minimiser searches inside a box; options lack {' and '.join(missing)}"
        )
    leaves, structure = jax.tree.flatten(y)
    ends = [
        jax.tree.leaves(bound) if jax.tree.structure(bound) == structure else [bound] * len(leaves)
        for bound in (options["lower"], options["upper"])
    ]
    for low, high in zip(*ends, strict=True):
        _require_order(low, high)
    return [
        jnp.concatenate(
            [
                jnp.broadcast_to(jnp.asarray(end, leaf.dtype), leaf.shape).ravel()
                for end, leaf in zip(bound, leaves, strict=True)
            ]
        )
        for bound in ends
    ]


def _require_order(lower: Any, upper: Any) -> None:
    # Bounds that are traced have no value yet.
    is_concrete = not any(isinstance(end, Tracer) for end in (lower, upper))
    if is_concrete and np.any(np.asarray(lower) > np.asarray(upper)):
        raise InputError(f"the lower bound {lower} is above the upper bound {upper}; exchange them")

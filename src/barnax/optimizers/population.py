"""The one population minimiser: the vmap over candidates and the loop over generations.

Every algorithm is an `optimistix.AbstractMinimiser` made of its `begin`, `ask` and `tell`, so that
`optimistix.minimise` runs it.
"""

from collections.abc import Callable
from dataclasses import field, replace
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import optimistix as optx
from jax import lax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, PyTree, Scalar

from ..errors import InputError
from .ask_tell import (
    AbstractPopulationSearch,
    Generation,
    PopulationState,
    as_key,
    draw_key,
    require_order,
)
from .swarm import Box, Swarm, better_of_each, sort_by_loss

# Random numbers are drawn for several generations at once, up to this many in total: large loops
# over numbers are faster than small ones, until they exceed the processor's cache.
DRAWN_AT_ONCE = 8192


class AbstractPopulationMinimiser(AbstractPopulationSearch, optx.AbstractMinimiser):
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
      faster for a cheap objective than a step a generation.
    - `options["callback"]`: called with generation, evaluations and best loss, each generation.

    A loss that is NaN or infinite counts as infinite and can never become the best, so NaN says
    that a constraint is broken. The solution's `stats` hold `best_loss`, `history` (the best loss
    after each generation, the initial population first), `evaluations`, `population` (the initial
    evaluations among them) and `failures` (losses that were not finite). Where every loss was
    infinite the result is `RESULTS.nonfinite`.
    """

    # Optimistix requires these three; here `stop` ends a run, so they are not settings.
    if TYPE_CHECKING:
        rtol: float = field(default=0.0, init=False)
        atol: float = field(default=0.0, init=False)
        norm: Callable[[PyTree], Scalar] = field(default=optx.max_norm, init=False)
    else:
        rtol = property(lambda self: 0.0)
        atol = property(lambda self: 0.0)
        norm = property(lambda self: optx.max_norm)

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
        # Optimistix only keeps numbers, so the key is not in the states that it sees.
        state = replace(state, key=as_key(options["key"]))
        if not options.get("in_one_step", False):
            positions, asked = self.ask(state)
            state = self._evaluated(fn, positions, asked, y, args, options)
            return y, replace(state, key=None), state.best_aux
        # A constant keeps the counts of parallel searches a single number.
        box, count, state = state.box, self.iterations, replace(state, generation=jnp.array(0))

        def draw(generation):
            return self.draw(draw_key(state.key, generation), generation, box)

        def goes_on(done, end, state):
            is_short = done < end
            return is_short & _any_of_all(~self.is_over(state)) if self.stop.is_early else is_short

        at_once = self._generations_at_once(box)

        def some_generations(carry):
            done, state, positions = carry
            drawn = jax.vmap(draw)(done + 2 + jnp.arange(at_once))
            end = jnp.minimum(done + at_once, count)

            def one_generation(carry):
                now, state, positions = carry
                after = self._evaluated(fn, positions, state, y, args, options)
                if self.stop.is_early:
                    after = where_else(self.is_over(state), state, after)
                numbers = jax.tree.map(lambda leaf: leaf[now - done], drawn)
                positions, after = self.ask(after, numbers)
                return now + 1, after, positions

            return lax.while_loop(
                lambda carry: goes_on(carry[0], end, carry[1]),
                one_generation,
                (done, state, positions),
            )

        # Both the drawn numbers and the proposed positions pass from one turn of a loop to the
        # next, that is, through memory. Within a turn the compiler would compute both again
        # wherever they are used, at a cost, and with last bits that depend on parallel searches.
        positions, state = self.ask(state, draw(jnp.array(1)))
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
        """The state after `fn` was evaluated at the requested positions."""
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
        was_over, state = self.is_over(state), self.tell(state, positions, losses, aux)
        if (callback := options.get("callback")) is not None:
            # A finished search continues alongside others that are not.
            def report(is_over, *spent):
                return None if is_over else callback(*spent)

            spent = state.generation, state.evaluations, state.best_loss
            jax.debug.callback(report, was_over, *spent)
        return state

    def terminate(self, fn, y, args, options, state: PopulationState, tags):
        del fn, y, args, options, tags
        is_over = self.is_over(state)
        is_lost = is_over & jnp.isinf(state.best_loss)
        result = optx.RESULTS.where(is_lost, optx.RESULTS.nonfinite, optx.RESULTS.successful)
        return is_over, result

    def postprocess(self, fn, y, aux, args, options, state: PopulationState, tags, result):
        """The best position, what came with its loss, and `stats`: `best_loss`, its `history`,
        `evaluations`, `population` and `failures`."""
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
    """A search whose candidates are in the order of their losses, the best first; each is replaced
    by its own offspring if that is better."""

    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        return sort_by_loss(swarm)

    def survive(self, swarm: Swarm, offspring: Swarm, generation: Generation) -> Swarm:
        return sort_by_loss(better_of_each(swarm, offspring))


@jax.custom_batching.custom_vmap
def _any_of_all(claim: Bool[Array, ""]) -> Bool[Array, ""]:
    """The claim of one search; for parallel searches, that of any: one number for them all."""
    return claim


@_any_of_all.def_vmap
def _(axis_size, in_batched, claims):
    del axis_size, in_batched
    return _any_of_all(jnp.any(claims)), False


def where_else(claim: Bool[Array, ""], first: PyTree, second: PyTree) -> PyTree:
    return jax.tree.map(lambda one, other: jnp.where(claim, one, other), first, second)


def flat_bounds(y: PyTree, options: dict[str, Any]) -> list[Array]:
    """Lower and upper bound of every number of `y`."""
    missing = [name for name in ("lower", "upper") if name not in options]
    if missing:
        raise ValueError(
            f"a population minimiser searches inside a box; options lack {' and '.join(missing)}"
        )
    leaves, structure = jax.tree.flatten(y)
    ends = []
    for name in ("lower", "upper"):
        bound = options[name]
        its, is_whole = jax.tree.structure(bound), jax.tree.structure(bound) == structure
        if not is_whole and not jax.tree_util.treedef_is_leaf(its):
            raise InputError(f"`{name}` is a {its}, and `y0` a {structure}; give the same")
        ends.append(jax.tree.leaves(bound) if is_whole else [bound] * len(leaves))
    for low, high in zip(*ends, strict=True):
        require_order(low, high)
    try:
        return [
            jnp.concatenate(
                [
                    jnp.broadcast_to(jnp.asarray(end, leaf.dtype), leaf.shape).ravel()
                    for end, leaf in zip(bound, leaves, strict=True)
                ]
            )
            for bound in ends
        ]
    except ValueError as problem:
        shapes = [[np.shape(leaf) for leaf in jax.tree.leaves(each)] for each in (leaves, *ends)]
        raise InputError(
            "`y0` has arrays of the shapes {}, and the bounds {} and {}; give `y0` as the bounds "
            "are".format(*shapes)
        ) from problem

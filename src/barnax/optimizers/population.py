"""The one population minimiser: what every algorithm here shares.

An algorithm says how a first population is laid out (`start`, `prepare`), how new positions are
proposed (`propose`) and which candidates live on (`survive`). Bounds, keys, the vmap over
candidates, losses that are not finite, counting and the history are settled here, once. Every
algorithm is an `optimistix.AbstractMinimiser`, so one call, `optimistix.minimise`, runs it.
"""

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import optimistix as optx
from equinox import AbstractVar
from jaxtyping import Array, Float, Int, Key, PyTree, Scalar


class Box(eqx.Module):
    """Lower and upper bound of every dimension."""

    lower: Float[Array, "dims"]
    upper: Float[Array, "dims"]

    def clip(self, positions: Float[Array, "*candidates dims"]) -> Float[Array, "*candidates dims"]:
        return jnp.clip(positions, self.lower, self.upper)

    def scale(
        self, fractions: Float[Array, "*candidates dims"]
    ) -> Float[Array, "*candidates dims"]:
        """Fractions of the box, in [0, 1], as positions."""
        return self.lower + fractions * (self.upper - self.lower)


class Swarm(eqx.Module):
    """Candidates and their losses; `memory` is what one algorithm carries beside them."""

    positions: Float[Array, "candidates dims"]
    losses: Float[Array, "candidates"]
    memory: PyTree = None


class PopulationState(eqx.Module):
    """The solver state: the swarm, the best seen so far, and what has been spent."""

    swarm: Swarm
    best_position: Float[Array, "dims"]
    best_loss: Scalar
    best_aux: PyTree
    generation: Int[Array, ""]
    evaluations: Int[Array, ""]
    failures: Int[Array, ""]
    history: Float[Array, "generations"]


def sort_by_loss(swarm: Swarm) -> Swarm:
    """The swarm with its best candidate first; equal losses keep their order."""
    order = jnp.argsort(swarm.losses, stable=True)
    return Swarm(swarm.positions[order], swarm.losses[order], swarm.memory)


def keep_best(swarm: Swarm, offspring: Swarm, population: int) -> Swarm:
    """The best of parents and offspring together, sorted; a parent wins a tie."""
    together = sort_by_loss(
        Swarm(
            jnp.concatenate([swarm.positions, offspring.positions]),
            jnp.concatenate([swarm.losses, offspring.losses]),
            offspring.memory,
        )
    )
    return Swarm(together.positions[:population], together.losses[:population], together.memory)


class AbstractPopulationMinimiser(optx.AbstractMinimiser):
    """Minimise inside a box with a population of candidates, for `iterations` generations.

    Use through `optimistix.minimise(fn, solver, y0, args, options, max_steps=None)`:

    - `options["key"]`: a PRNG key (`jax.random.key(0)`). It alone makes the run.
    - `options["lower"]`, `options["upper"]`: bounds, scalars or arrays shaped as `y0`.
    - `options["keyed_objective"]`: if true, `args` is a pair `(data, key)` and `key` is replaced
      by a fresh one for every single evaluation; for objectives with noise of their own.
    - `y0` gives shape and dtype only; its value is never used as a guess.

    With `bounded` every candidate is clipped to the box before it is evaluated. Without, only
    the first population lies inside; some published results were made that way.

    A loss that is NaN or infinite counts as infinite and can never become the best. The
    solution's `stats` hold `best_loss`, `history` (the best loss after each generation, the
    initial population first), `evaluations`, and `failures` (losses that were not finite). Where
    every loss was infinite the result is `RESULTS.nonfinite`.
    """

    population: AbstractVar[int]
    iterations: AbstractVar[int]
    bounded: AbstractVar[bool]
    # Optimistix asks for these three; here the budget alone ends a run, so they stay unread.
    rtol: AbstractVar[float]
    atol: AbstractVar[float]
    norm: AbstractVar[Callable[[PyTree], Scalar]]

    @abc.abstractmethod
    def start(self, key: Key[Array, ""], box: Box, dtype: Any) -> Float[Array, "candidates dims"]:
        """The initial positions, `population` of them."""

    @abc.abstractmethod
    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        """The evaluated first population in the algorithm's order, with its first memory."""

    @abc.abstractmethod
    def propose(
        self, key: Key[Array, ""], swarm: Swarm, generation: Int[Array, ""], box: Box
    ) -> tuple[Float[Array, "offspring dims"], PyTree]:
        """New positions to evaluate in `generation` (1 to `iterations`), and the new memory."""

    @abc.abstractmethod
    def survive(self, swarm: Swarm, offspring: Swarm) -> Swarm:
        """The next generation, from this one and its evaluated offspring."""

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
        box = _box(y, options)
        generation = state.generation + 1
        propose_key, noise_key = jr.split(jr.fold_in(_key(options), generation))
        positions, memory = self.propose(propose_key, state.swarm, generation, box)
        if self.bounded:
            positions = box.clip(positions)
        losses, aux, failures = _evaluate(fn, positions, y, args, options, noise_key)

        best = jnp.argmin(losses)
        better = losses[best] < state.best_loss
        best_loss = jnp.where(better, losses[best], state.best_loss)
        state = PopulationState(
            swarm=self.survive(state.swarm, Swarm(positions, losses, memory)),
            best_position=jnp.where(better, positions[best], state.best_position),
            best_loss=best_loss,
            best_aux=jax.tree.map(
                lambda new, old: jnp.where(better, new[best], old), aux, state.best_aux
            ),
            generation=generation,
            evaluations=state.evaluations + len(positions),
            failures=state.failures + failures,
            history=state.history.at[generation].set(best_loss),
        )
        return state.best_position.reshape(y.shape), state, state.best_aux

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
            "failures": state.failures,
        }
        return state.best_position.reshape(y.shape), state.best_aux, stats


def _key(options: dict[str, Any]) -> Key[Array, ""]:
    if "key" not in options:
        raise ValueError('a population minimiser needs options["key"], such as jax.random.key(0)')
    return options["key"]


def _box(y: Array, options: dict[str, Any]) -> Box:
    missing = [name for name in ("lower", "upper") if name not in options]
    if missing:
        raise ValueError(
            f"a population minimiser searches inside a box; options lack {' and '.join(missing)}"
        )
    lower, upper = (
        jnp.broadcast_to(jnp.asarray(options[name], y.dtype), y.shape).ravel()
        for name in ("lower", "upper")
    )
    return Box(lower, upper)


def _evaluate(
    fn: Callable, positions: Array, y: Array, args: PyTree, options: dict[str, Any], key: Array
) -> tuple[Float[Array, "candidates"], PyTree, Int[Array, ""]]:
    """Losses of all candidates, non-finite ones as infinity, and how many those were."""

    def one(position, evaluation_key):
        if options.get("keyed_objective", False):
            return fn(position.reshape(y.shape), (args[0], evaluation_key))
        return fn(position.reshape(y.shape), args)

    losses, aux = jax.vmap(one)(positions, jr.split(key, len(positions)))
    is_finite = jnp.isfinite(losses)
    return jnp.where(is_finite, losses, jnp.inf), aux, jnp.sum(~is_finite)

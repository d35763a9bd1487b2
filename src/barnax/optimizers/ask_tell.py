"""A search step by step: its state, its stops, and the functions `ask` and `tell`.

An algorithm defines the first population (`start`, `prepare`), the random numbers of a generation
(`draw`), new positions (`propose`) and the survivors (`survive`). Bounds, keys, losses that are not
finite, counting, stops and the history are handled here, once.
"""

import abc
from dataclasses import field, replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Int, Key, PyTree, Scalar

from ..errors import InputError, require_number
from .draws import written_out
from .swarm import Box, Swarm

Generation = Int[Array, ""]
# New positions to evaluate, and the new memory.
Proposal = tuple[Float[Array, "offspring dims"], PyTree]


class Stop(eqx.Module):
    """When a search ends before its `iterations` are over; None for never.

    Attributes:
        target: At a best loss of this or less.
        max_evaluations: Before a generation that would take the evaluations beyond these; the
            first population is evaluated in any case.
        ftol: Where the best loss fell by no more than this share of itself in `patience`
            generations.
        patience: Those generations.

    Raises `InputError` for what is no finite number, and a `patience` below 1.
    """

    target: float | None = None
    max_evaluations: Any = None
    ftol: float | None = None
    patience: int = 50

    def __check_init__(self) -> None:
        kinds = {"target": float, "max_evaluations": int, "ftol": float, "patience": int}
        for name, kind in kinds.items():
            require_number(name, getattr(self, name), kind)
            value, least = getattr(self, name), 1 if kind is int else -np.inf
            is_number = isinstance(value, float | int)
            if (is_number and not least <= value < np.inf) or (
                value is None and name == "patience"
            ):
                from_one = " from 1 on" if kind is int else ""
                raise InputError(f"`{name}` {value} ends no search; give a finite number{from_one}")

    @property
    def is_early(self) -> bool:
        """True if there is anything to stop at."""
        return (self.target, self.max_evaluations, self.ftol) != (None, None, None)


NEVER = Stop()


class PopulationState(eqx.Module):
    """A search between two generations.

    Attributes:
        key: The key of all its numbers; None in a state that Optimistix keeps.
        box: Its bounds.
        swarm: The candidates, without losses before the first population is evaluated.
        best_position: The best candidate so far.
        best_loss: Its loss.
        best_aux: What came with that loss.
        generation: Generations after the first population.
        evaluations: Candidates evaluated.
        failures: Losses that were not finite.
        history: The best loss after each generation, the first population's first.
    """

    key: Any
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


class AbstractPopulationSearch(eqx.Module):
    """A search inside a box with a population of candidates, for `iterations` generations.

    Attributes:
        population: Candidates of a generation.
        iterations: Generations of a run, by which rates that fall or rise with them are set.
        bounded: True if every candidate is clipped to the box before it is evaluated. Else only
            the first population lies inside; some published results were made that way.
        stop: When a search ends earlier.
    """

    population: int = 30
    iterations: int = 500
    bounded: bool = field(default=True, kw_only=True)
    stop: Stop = field(default=NEVER, kw_only=True)

    def start(self, key: Key[Array, ""], box: Box, dtype: Any) -> Float[Array, "candidates dims"]:
        """The initial positions, `population` of them; by default uniform random in the box."""
        return box.scale(jr.uniform(key, (self.population, len(box.lower)), dtype))

    @abc.abstractmethod
    def prepare(self, swarm: Swarm, box: Box) -> Swarm:
        """The evaluated first population in the algorithm's order, with its first memory."""

    @abc.abstractmethod
    def draw(self, key: Key[Array, ""], generation: Generation, box: Box) -> PyTree:
        """All random numbers of `generation` (1 to `iterations`), independent of the swarm."""

    @abc.abstractmethod
    def propose(self, drawn: PyTree, swarm: Swarm, generation: Generation, box: Box) -> Proposal:
        """New positions to evaluate in `generation`, and the new memory."""

    @abc.abstractmethod
    def survive(self, swarm: Swarm, offspring: Swarm, generation: Generation) -> Swarm:
        """The survivors of `generation`, from the parents and their evaluated offspring, with the
        new memory."""

    def begin(
        self,
        key: Key[Array, ""],
        lower: Float[Array, "dims"] | float,
        upper: Float[Array, "dims"] | float,
        guess: Float[Array, "dims"] | None = None,
    ) -> PopulationState:
        """The state before anything is evaluated; `guess`, inside the box, is the first candidate.

        Raises `InputError` for bounds in the wrong order, and for infinite ones.
        """
        require_order(lower, upper)
        lower, upper = jnp.asarray(lower), jnp.asarray(upper)
        dtype = jnp.result_type(float, lower, upper)
        ends = (jnp.atleast_1d(end.astype(dtype)) for end in (lower, upper))
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

        The first positions are the first population. `drawn` are the generation's random numbers,
        if they already exist; by default they are drawn here.
        """
        swarm, generation = state.swarm, state.generation + 1
        if state.is_new:
            return swarm.positions, state
        if drawn is None:
            drawn = self.draw(draw_key(state.key, generation), generation, state.box)
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
        """The state after the positions from `ask` were evaluated.

        A loss that is not finite counts as infinite, and as a failure. Of `aux`, with a row for
        every position, the best one's row is kept.
        """
        losses = jnp.asarray(losses)
        if losses.shape != (len(positions),):
            given = f"`losses` has the shape {losses.shape}"
            raise InputError(f"{given}; give one for each of the {len(positions)} positions")
        is_finite = jnp.isfinite(losses)
        losses = jnp.where(is_finite, losses, jnp.inf)
        best = jnp.argmin(losses)
        latest = positions[best], losses[best], jax.tree.map(lambda leaf: leaf[best], aux)
        if state.is_new:
            generation, swarm = state.generation, self.prepare(Swarm(positions, losses), state.box)
            history = jnp.full(self.iterations + 1, losses[best])
        else:
            generation = state.generation + 1
            before = state.best_position, state.best_loss, state.best_aux
            better = losses[best] < state.best_loss
            latest = jax.tree.map(lambda new, old: jnp.where(better, new, old), latest, before)
            offspring = Swarm(positions, losses, state.swarm.memory)
            swarm = self.survive(state.swarm, offspring, generation)
            # Beyond `iterations`, the last entry of the history is overwritten.
            end = jnp.minimum(generation, self.iterations)
            history = state.history.at[end].set(latest[1], mode="promise_in_bounds")
        best_position, best_loss, best_aux = latest
        return PopulationState(
            key=state.key,
            box=state.box,
            swarm=swarm,
            best_position=best_position,
            best_loss=best_loss,
            best_aux=best_aux,
            generation=generation,
            evaluations=state.evaluations + len(positions),
            failures=state.failures + jnp.sum(~is_finite),
            history=history,
        )

    def is_over(self, state: PopulationState) -> Bool[Array, ""]:
        """True if the search has spent its generations, or has reached its `stop`. With
        `max_evaluations`, compile it too: it traces a generation to count its evaluations."""
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


def evaluations_per_iteration(optimizer: AbstractPopulationSearch) -> int:
    """Number of candidates that the optimizer evaluates in one generation."""
    require_optimizer(optimizer)

    def first_offspring(key):
        first, state = optimizer.ask(optimizer.begin(key, jnp.zeros(2), jnp.ones(2)))
        return optimizer.ask(optimizer.tell(state, first, first[:, 0]))[0]

    return jax.eval_shape(first_offspring, jax.random.key(0)).shape[0]


def draw_key(key: Key[Array, ""], generation: Generation) -> Key[Array, ""]:
    return jr.split(jr.fold_in(key, generation))[0]


def as_key(key: Array) -> Key[Array, "*keys"]:
    if isinstance(key, int):
        raise InputError(f"`key` is a number; give `jax.random.key({key})`")
    key = jnp.asarray(key)
    if not jnp.issubdtype(key.dtype, jax.dtypes.prng_key):
        key = jr.wrap_key_data(key)
    return written_out(key)


def require_optimizer(optimizer: Any) -> None:
    if not isinstance(optimizer, AbstractPopulationSearch):
        name = optimizer if isinstance(optimizer, str) else "ibmo"
        raise InputError(
            f"`optimizer` {optimizer!r} is no optimizer; give one that was made, such as "
            f"make_optimizer({name!r}, population=30, iterations=500)"
        )


def require_order(lower: Any, upper: Any) -> None:
    shapes = np.shape(lower), np.shape(upper)
    if shapes[0] != shapes[1] and () not in shapes:
        raise InputError(f"the bounds have the shapes {shapes[0]} and {shapes[1]}; give one shape")
    # Traced bounds have no values yet.
    if any(isinstance(end, Tracer) for end in (lower, upper)):
        return
    if np.any(np.asarray(lower) > np.asarray(upper)):
        raise InputError(f"the lower bound {lower} is above the upper bound {upper}; exchange them")
    if not np.all(np.isfinite(lower) & np.isfinite(upper)):
        raise InputError(f"the bounds {lower} and {upper} are not finite; a population fills a box")

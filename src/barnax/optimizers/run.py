"""A search in one call: the user's functions, NumPy ones, many keys, restarts."""

import inspect
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import optimistix as optx
from jax import lax
from jax.core import Tracer
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Key, PyTree

from ..errors import InputError, reason_of
from .ask_tell import as_key, require_optimizer, require_order
from .population import AbstractPopulationMinimiser, flat_bounds, where_else

# What JAX raises where a function asks for the values of a traced argument, as NumPy's do.
ASKS_FOR_VALUES = (
    jax.errors.ConcretizationTypeError,
    jax.errors.TracerArrayConversionError,
    jax.errors.TracerIntegerConversionError,
)


class Undifferentiated(optx.AbstractAdjoint):
    """Iterations that nothing differentiates: made a program in half the time."""

    def apply(self, primal_fn, rewrite_fn, inputs, tags):
        def loop(goes_on, step, start, *, max_steps):
            def goes_on_so_far(carry):
                return goes_on(carry) & (True if max_steps is None else carry[1] < max_steps)

            return lax.while_loop(goes_on_so_far, step, start)

        return primal_fn((*inputs, loop))


def minimise(
    fn: Callable[[PyTree, PyTree], Any],
    optimizer: AbstractPopulationMinimiser,
    lower: PyTree,
    upper: PyTree,
    *,
    key: Key[Array, "*seeds"],
    args: PyTree = None,
    y0: PyTree = None,
    has_aux: bool = False,
    keyed_objective: bool = False,
    restarts: int = 0,
    callback: Callable[[Any, Any, Any], None] | None = None,
    throw: bool = True,
) -> optx.Solution:
    """The solution of `optimistix.minimise` by a population optimizer, in one compiled call.

    Args:
        fn: `fn(y, args)`, a number to minimise, written with `jax.numpy`; NaN or infinity where
            `y` is not allowed. `from_numpy` makes one of a NumPy function.
        optimizer: Such as `ibmo_centered()`; its `stop` ends a search early.
        lower: Lower bounds, a pytree of numbers and arrays that has the structure of `y`.
        upper: Upper bounds, the same.
        key: A key of `jax.random`, or a row of keys: a search for each, the same as alone but for
            rounding.
        args: Passed on to `fn`.
        y0: A guess inside the bounds, which is the first candidate.
        has_aux: True if `fn` returns a pair, of a number and something to keep of the best.
        keyed_objective: True if `args` is a pair `(data, key)` whose key is to be a fresh one at
            every evaluation.
        restarts: Further searches, of fresh populations, while the target is missed and
            evaluations are left. The best is the answer, counts are those of all.
        callback: Called with generation, evaluations and best loss after each generation of each
            search.
        throw: True if a search where no loss was finite is to raise.

    Raises `InputError` for bounds in the wrong order or infinite, a `y0` outside them, keys of more
    than one row, what is no optimizer, and a function that JAX cannot trace, that fails on lists
    which the bounds are, or that is nowhere finite.

    >>> from barnax.optimizers import ibmo_centered
    >>> ends = {"r": 0.0, "tau": jnp.zeros(2)}, {"r": 1.0, "tau": jnp.full(2, 9.0)}
    >>> solution = minimise(
    ...     lambda y, args: (y["r"] - 0.5) ** 2 + jnp.sum((y["tau"] - 4) ** 2),
    ...     ibmo_centered(iterations=30),
    ...     *ends,
    ...     key=jax.random.key(0),
    ... )
    >>> bool(abs(solution.value["r"] - 0.5) < 0.1)
    True
    """
    require_optimizer(optimizer)
    structures = jax.tree.structure(lower), jax.tree.structure(upper)
    if structures[0] != structures[1]:
        raise InputError("`lower` is a {}, and `upper` a {}; give the same".format(*structures))
    use_y0, (name, given) = y0 is not None, ("lower", lower) if y0 is None else ("y0", y0)
    try:
        if use_y0:
            y0 = jax.tree.map(lambda leaf: jnp.asarray(leaf) * 1.0, y0)
        else:
            y0 = jax.tree.map(_zeros_between, lower, upper)
    except TypeError as error:
        raise InputError(f"`{name}` {given!r} is of no numbers; give numbers or arrays") from error
    options = {"lower": lower, "upper": upper, "in_one_step": True, "callback": callback}
    options |= {"keyed_objective": keyed_objective, "use_y0": use_y0}
    _require_inside(y0, options)
    if (keys := as_key(key)).ndim > 1:
        raise InputError(f"`key` has the shape {keys.shape}; give a key, or a row of keys")
    try:
        solution = _solve(fn, optimizer, y0, args, options, keys, restarts, has_aux)
    except ASKS_FOR_VALUES as error:
        raise InputError(
            "the function asks for values while JAX traces it, as NumPy and branches on them do; "
            "write it with jax.numpy, or give `from_numpy(fn)`, which calls Python every time"
        ) from error
    except TypeError as error:
        if not isinstance(y0, list | tuple) or not _can_compute(fn, jnp.asarray(y0), args):
            raise
        raise InputError(
            f"`fn` fails on a {type(y0).__name__}, as `{name}` {given} is ({reason_of(error)}); "
            f"give an array, such as jnp.array({given})"
        ) from error
    is_lost = solution.result == optx.RESULTS.nonfinite
    if throw and isinstance(is_lost, Tracer):
        return solution.result.error_if(solution, is_lost)
    if throw and np.any(is_lost):
        raise InputError(
            f"`fn` is NaN or infinite at all {np.max(solution.stats['evaluations'])} candidates of "
            f"a search between {lower} and {upper}; search where it is finite, or give a `y0` "
            "where it is"
        )
    return solution


def _can_compute(fn: Callable[[PyTree, PyTree], Any], y: Array, args: Any) -> bool:
    with suppress(Exception):
        jax.eval_shape(fn, y, args)
        return True
    return False


@eqx.filter_jit
def _solve(fn, optimizer, y0, args, options, keys, restarts, has_aux) -> optx.Solution:
    how: dict[str, Any] = {"has_aux": has_aux, "max_steps": None, "adjoint": Undifferentiated()}
    how["throw"] = False

    def search(key):
        return optx.minimise(fn, optimizer, y0, args, options | {"key": key}, **how)

    def search_again(key):
        first = search(key)
        arrays, rest = eqx.partition(first, eqx.is_array)
        stop = optimizer.stop

        def goes_on(carry):
            number, best = carry
            going = number <= restarts
            if stop.target is not None:
                going &= best.stats["best_loss"] > stop.target
            if stop.max_evaluations is not None:
                going &= best.stats["evaluations"] + optimizer.population <= stop.max_evaluations
            return going

        def again(carry):
            number, best = carry
            left = stop.max_evaluations
            left = left if left is None else left - best.stats["evaluations"]
            asked = options | {"key": jr.fold_in(key, number), "use_y0": False}
            solver = replace(optimizer, stop=replace(stop, max_evaluations=left))
            new = optx.minimise(fn, solver, y0, args, asked, **how)
            is_better = new.stats["best_loss"] < best.stats["best_loss"]
            kept = where_else(is_better, eqx.filter(new, eqx.is_array), best)
            spent = {
                name: best.stats[name] + new.stats[name] for name in ("evaluations", "failures")
            }
            return number + 1, eqx.tree_at(lambda s: s.stats, kept, kept.stats | spent)

        _, arrays = lax.while_loop(goes_on, again, (jnp.array(1), arrays))
        return eqx.combine(arrays, rest)

    one = search_again if restarts else search
    return one(keys) if keys.ndim == 0 else eqx.filter_vmap(one)(keys)


def _zeros_between(low: Any, high: Any) -> Array:
    require_order(low, high)
    shape = np.broadcast_shapes(np.shape(low), np.shape(high))
    return jnp.zeros(shape, jnp.result_type(float, low, high))


def _require_inside(y: PyTree, options: dict[str, Any]) -> None:
    """Raise `InputError` for bounds in the wrong order, and a guess outside them."""
    ends = [*flat_bounds(y, options), ravel_pytree(y)[0]]
    if not options["use_y0"] or any(isinstance(end, Tracer) for end in ends):
        return
    low, high, guess = map(np.asarray, ends)
    if not np.all((low <= guess) & (guess <= high)):
        raise InputError(f"`y0` {guess} is not between the bounds {low} and {high}; move it inside")


def from_numpy(fn: Callable[[PyTree, PyTree], Any]) -> Callable[[PyTree, PyTree], Array]:
    """A function of NumPy arrays as one that JAX can trace.

    Args:
        fn: `fn(y, args)`, a number, of NumPy arrays.

    Each generation leaves the compiled program and calls Python once for every candidate, one after
    the other, which takes far longer than a cheap `fn` itself. To compute a whole population at
    once, use `ask` and `tell`. Make it once: another one is compiled anew.

    Raises `InputError` for a function that does not take `y` and `args`.

    >>> bool(from_numpy(lambda y, args: np.sum(y**2))(jnp.ones(3), None) == 3)
    True
    """

    try:
        inspect.signature(fn).bind(None, None)
    except TypeError as error:
        raise InputError("`fn` has to take `y` and `args`: def fn(y, args)") from error
    except ValueError:
        # Some built-in functions have no signature.
        pass

    def objective(y: PyTree, args: PyTree) -> Array:
        arrays, rest = eqx.partition(args, eqx.is_array)
        leaves = jax.tree.leaves(y)
        dtype, dims = jnp.result_type(*leaves), leaves[0].ndim

        def call(*given):
            given = jax.tree.map(np.asarray, given)
            every = jax.tree.leaves(given)
            # What is the same for all candidates has leading axes of one.
            leading = every[0].ndim - dims
            batch = np.broadcast_shapes(*(leaf.shape[:leading] for leaf in every))
            spread = [np.broadcast_to(leaf, batch + leaf.shape[leading:]) for leaf in every]
            losses = np.empty(batch, dtype)
            for at in np.ndindex(batch):
                one = [leaf[at] for leaf in spread]
                y, arrays = jax.tree.unflatten(jax.tree.structure(given), one)
                losses[at] = fn(y, eqx.combine(arrays, rest))
            return losses

        number = jax.ShapeDtypeStruct((), dtype)
        return jax.pure_callback(call, number, y, arrays, vmap_method="expand_dims")

    return objective

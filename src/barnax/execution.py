"""Execution of the numerics: in float64, compiled once per shape, in blocks on all cores.

JAX is loaded only by functions that run it: results are read and shown without it.
"""

import functools
import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor, as_completed
from contextlib import AbstractContextManager, nullcontext
from contextvars import ContextVar
from typing import Any, ParamSpec, TypeVar

import numpy as np

from . import programs
from .blas import one_blas_thread

P = ParamSpec("P")
R = TypeVar("R")
Watch = Callable[..., AbstractContextManager[Callable[[int], None]]]


def unwatched(title: str, total: int = 0) -> AbstractContextManager[Callable[[int], None]]:
    """A watch that does nothing."""
    del title, total
    return nullcontext(lambda gained: None)


def in_float64(function: Callable[P, R]) -> Callable[P, R]:
    """`function`, run with JAX in float64 and linear algebra on one thread whatever the caller's
    settings, which are restored: a library's several threads would change the last bits."""

    @functools.wraps(function)
    def scoped(*args: P.args, **kwargs: P.kwargs) -> R:
        import jax

        with jax.enable_x64(True), one_blas_thread():
            return function(*args, **kwargs)

    return scoped


def as_input(values: Any) -> Any:
    """Values as a NumPy array, the form in which a compiled program takes its arguments.

    A call takes all its arguments at once. Putting them on the device one by one took a tenth of a
    small problem's time, and `jnp.asarray` compiles a program for every new shape.
    """
    return np.asarray(values)


Given = TypeVar("Given")
Outcome = TypeVar("Outcome")

# Runs are in blocks of one fixed shape, so a seed's bits do not depend on the number of seeds.
SEEDS_PER_BLOCK = 8
# Circuits per block of a refinement or evaluation: usually there are one or two.
CIRCUITS_PER_BLOCK = 4
# Enough for a comparison of all methods on a few models; the oldest program is released.
PROGRAMS_KEPT = 64

_programs: dict[Any, Any] = {}
_making: dict[Any, threading.Lock] = {}
_guard = threading.Lock()


def compile_for(function: Callable[..., Outcome], *arguments: Any) -> Callable[..., Outcome]:
    """The function, compiled for arguments of these shapes, and for the values of those that are
    not arrays, which calls of it cannot change.

    Another request for the same arguments returns the same program, without tracing.
    """
    import equinox as eqx
    import jax

    leaves, structure = jax.tree.flatten(arguments)
    shapes = tuple(
        (leaf.shape, str(leaf.dtype)) if eqx.is_array(leaf) else (type(leaf), leaf)
        for leaf in leaves
    )
    wanted = (function, structure, shapes)
    with _guard:
        lock = _making.setdefault(wanted, threading.Lock())
    with lock:
        with _guard:
            program = _programs.get(wanted)
        if program is None:
            program = _program(function, arguments)
            with _guard:
                _programs[wanted] = program
                while len(_programs) > PROGRAMS_KEPT:
                    oldest = next(iter(_programs))
                    del _programs[oldest]
                    _making.pop(oldest, None)
        return program


def _program(function: Callable[..., Outcome], arguments: Sequence[Any]) -> Callable[..., Outcome]:
    import equinox as eqx
    import jax

    leaves, structure = jax.tree.flatten(arguments)
    arrays, others = eqx.partition(leaves, eqx.is_array)

    def compile_as(ending: str) -> Any:
        def of_arrays(arrays: Sequence[Any]) -> Outcome:
            return function(*jax.tree.unflatten(structure, eqx.combine(arrays, others)))

        of_arrays.__name__ = getattr(function, "__name__", "program") + ending
        return _compile(of_arrays, arrays)

    program = programs.kept(function, arguments, compile_as)
    return lambda *given: program(eqx.filter(jax.tree.leaves(given), eqx.is_array))


def _compile(of_arrays: Callable[..., Any], arrays: Sequence[Any]) -> Any:
    import jax

    def compiled() -> Any:
        # A new function each time: JAX caches the tracing of a function that it knows.
        options: Any = {"compiler_options": _OPTIONS if _in_one_function.get() else None}
        return jax.jit(functools.partial(of_arrays), **options).lower(arrays).compile()

    if jax.default_backend() != "cpu":
        return compiled()
    asked = _in_one_function.set(True)
    try:
        return compiled()
    except jax.errors.JaxRuntimeError:
        # The programs that XLA can compile as one function may change with its version.
        _in_one_function.set(False)
        return compiled()
    finally:
        _in_one_function.reset(asked)


# On a CPU, registers as wide as it has: XLA's own limit is 256 bits.
_OPTIONS = {"xla_cpu_prefer_vector_width": "512"}
# Whether a program may be compiled as one function, while it is traced; and XLA's options for it.
_in_one_function: ContextVar[bool] = ContextVar("in one function", default=False)
_ASKED = {"xla_cpu_small_call": "true", "inlineable": "false"}


def in_one_function(function: Callable[P, R]) -> Callable[P, R]:
    """`function`, compiled as one machine function where `compile_for` compiles for a CPU.

    For a scan with short iterations. XLA splits an iteration into kernels and starts each of them
    again every time, which takes longer than their computation: filters and simulations of a few
    states take two to six times as long. An iteration must not call a library, so it can contain
    neither a product of large matrices nor a decomposition.
    """

    @functools.wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> R:
        if not _in_one_function.get():
            return function(*args, **kwargs)
        import jax.experimental.xla_metadata

        with jax.experimental.xla_metadata.set_xla_metadata(**_ASKED):
            return jax.jit(function)(*args, **kwargs)

    return called


def seed_blocks(seeds: int, size: int = SEEDS_PER_BLOCK) -> list[list[int]]:
    """Seed numbers in blocks of one size; the last one is padded with further seeds."""
    return [list(range(first, first + size)) for first in range(0, seeds, size)]


def wanted_rows(seeds: int, size: int = SEEDS_PER_BLOCK) -> list[int]:
    """The number of rows of each block that belong to requested seeds."""
    return [min(size, seeds - first) for first in range(0, seeds, size)]


class AtOnce(Executor):
    """An executor that does work immediately, in the calling thread."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future:
        future: Future = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as problem:
            future.set_exception(problem)
        return future


def threads(count: int) -> Executor:
    """An executor with `count` threads; none in a process with a single core, such as a fleet's
    worker, which XLA also learns from `NPROC`: there they would only alternate."""
    return AtOnce() if os.environ.get("NPROC") == "1" else ThreadPoolExecutor(count)


def run_blocks(
    run: Callable[[Given], tuple[np.ndarray, ...]],
    blocks: Sequence[Given],
    wanted: Sequence[int],
    progress: Callable[[int], None] | None,
) -> list[tuple[np.ndarray, ...]]:
    """Run a compiled function on every block, on all cores; the wanted rows of each, in order."""
    with threads(min(len(blocks), os.cpu_count() or 1)) as pool:
        waiting = {
            pool.submit(run, block): rows for block, rows in zip(blocks, wanted, strict=True)
        }
        try:
            for done in as_completed(waiting):
                done.result()
                if progress is not None:
                    progress(waiting[done])
        except BaseException:
            # An interruption waits for running blocks, because nothing can stop them; those still
            # in the queue never start.
            pool.shutdown(cancel_futures=True)
            raise
    return [
        row
        for future, rows in waiting.items()
        for row in list(zip(*future.result(), strict=True))[:rows]
    ]

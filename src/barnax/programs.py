"""Compiled programs: made once for arguments of one shape, run in blocks on all cores."""

import os
import threading
from collections.abc import Callable, MutableMapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from typing import Any, TypeVar

import equinox as eqx
import jax
import numpy as np

from .traces import arrays_in, traced

Given = TypeVar("Given")
Outcome = TypeVar("Outcome")
# Blocks that are done, by their number; a mapping that keeps them on disk lets a run be resumed.
Finished = MutableMapping[str, tuple[np.ndarray, ...]]

# Runs go in blocks of one fixed shape, so a seed's bits do not depend on how many run beside it.
SEEDS_PER_BLOCK = 8
# Enough for a comparison of all methods on a few models; the oldest program is let go.
PROGRAMS_KEPT = 64

_programs: dict[Any, Any] = {}
_making: dict[Any, threading.Lock] = {}
_guard = threading.Lock()


def compile_for(function: Callable[..., Outcome], *arguments: Any) -> Callable[..., Outcome]:
    """The function, compiled for arguments of these shapes and settings.

    Asked again for the same ones it gives the same program, without tracing.
    """
    leaves, structure = jax.tree.flatten(arguments)
    shapes = tuple((leaf.shape, str(leaf.dtype)) if eqx.is_array(leaf) else leaf for leaf in leaves)
    wanted = (function, structure, shapes)
    with _guard:
        lock = _making.setdefault(wanted, threading.Lock())
    with lock:
        if wanted not in _programs:
            compiled = jax.jit(traced(function, arguments)).lower(*arrays_in(arguments)).compile()

            def program(*given: Any) -> Any:
                leaves, found = jax.tree.flatten(given)
                if found != structure:
                    raise TypeError(f"compiled for {structure}, not {found}")
                return compiled(*filter(eqx.is_array, leaves))

            with _guard:
                _programs[wanted] = program
                while len(_programs) > PROGRAMS_KEPT:
                    oldest = next(iter(_programs))
                    del _programs[oldest]
                    _making.pop(oldest, None)
        return _programs[wanted]


def seed_blocks(seeds: int) -> list[list[int]]:
    """Seed numbers in blocks of one size; the last one is filled up with further seeds."""
    return [
        list(range(first, first + SEEDS_PER_BLOCK)) for first in range(0, seeds, SEEDS_PER_BLOCK)
    ]


def wanted_rows(seeds: int) -> list[int]:
    """How many rows of each block are seeds that were asked for."""
    return [min(SEEDS_PER_BLOCK, seeds - first) for first in range(0, seeds, SEEDS_PER_BLOCK)]


def run_blocks(
    run: Callable[[Given], tuple[np.ndarray, ...]],
    blocks: Sequence[Given],
    wanted: Sequence[int],
    progress: Callable[[int], None] | None,
    finished: Finished | None = None,
) -> list[tuple[np.ndarray, ...]]:
    """Run a compiled function on every block, on all cores; the wanted rows of each, in order.

    Blocks whose number is in `finished` are taken from there; the others are put there as they
    finish, those too that run when it is interrupted.
    """
    finished = {} if finished is None else finished
    missing = [index for index in range(len(blocks)) if str(index) not in finished]
    if progress is not None and len(missing) < len(blocks):
        progress(sum(wanted) - sum(wanted[index] for index in missing))
    with ThreadPoolExecutor(max_workers=min(len(blocks), os.cpu_count() or 1)) as pool:
        waiting = {pool.submit(run, blocks[index]): index for index in missing}
        try:
            for done in as_completed(waiting):
                finished[str(waiting[done])] = done.result()
                if progress is not None:
                    progress(wanted[waiting[done]])
        except BaseException:
            # An interruption waits for the blocks that run, for nothing can stop them, and keeps
            # what they find; those still in the queue never start.
            pool.shutdown(cancel_futures=True)
            for future, index in waiting.items():
                if not future.cancelled() and future.exception() is None:
                    finished[str(index)] = future.result()
            raise
    return [
        row
        for index, rows in enumerate(wanted)
        for row in list(zip(*finished[str(index)], strict=True))[:rows]
    ]

"""The search: many seeds of one population optimizer on one problem."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from typing import Any, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float, Key

from .cell import CircuitParameters
from .errors import InputError
from .optimizers import AbstractPopulationMinimiser
from .precision import in_float64
from .problem import Objective, Problem, rmse

Given = TypeVar("Given")
Outcome = TypeVar("Outcome")

# Seeds run in blocks of one fixed shape, so a seed's bits do not depend on how many run beside it.
SEEDS_PER_BLOCK = 8


@dataclass(frozen=True, eq=False)
class SeedAnswer:
    """What one seed found: its best circuit, and the best RMSE after every generation, in V."""

    rmse_v: float
    parameters: CircuitParameters
    history_v: Float[np.ndarray, "generations"]
    evaluations: int
    failures: int


@dataclass(frozen=True, eq=False)
class Identification:
    """The answers of all seeds, in the order of the seeds."""

    problem: Problem
    optimizer: AbstractPopulationMinimiser
    key: int
    seeds: tuple[SeedAnswer, ...]

    @property
    def best(self) -> SeedAnswer:
        return min(self.seeds, key=lambda answer: answer.rmse_v)

    @property
    def evaluations(self) -> int:
        return sum(answer.evaluations for answer in self.seeds)


@in_float64
def identify(
    problem: Problem,
    optimizer: AbstractPopulationMinimiser,
    *,
    key: Key[Array, ""],
    seeds: int = 30,
    progress: Callable[[int], None] | None = None,
) -> Identification:
    """Search with `seeds` independent runs; seed k draws from `fold_in(key, k)`.

    `progress` is called with the number of seeds finished since the last call. Raises
    `InputError` where no seed finds a single finite error.
    """
    if seeds < 1:
        raise InputError(f"--seeds {seeds}: at least one seed is needed")
    blocks = seed_blocks(seeds, SEEDS_PER_BLOCK)
    block_keys = [
        jax.vmap(lambda seed: jr.fold_in(key, seed))(jnp.asarray(block)) for block in blocks
    ]
    search = compile_for(_search, optimizer, problem.objective, block_keys[0])

    @in_float64  # the setting belongs to a thread
    def run(keys):
        return jax.tree.map(np.asarray, search(optimizer, problem.objective, keys))

    outcomes = run_blocks(run, block_keys, seeds, progress)
    points, histories, evaluations, failures = zip(*outcomes, strict=True)
    circuits = problem.parameters_at(points, problem.objective.coordinates)
    answers = [
        SeedAnswer(float(history_v[-1]), circuit, history_v, int(spent), int(failed))
        for circuit, history_v, spent, failed in zip(
            circuits, histories, evaluations, failures, strict=True
        )
    ]
    if not np.isfinite([answer.rmse_v for answer in answers]).any():
        raise InputError(
            f"{problem.course.record.name}: no candidate gave a finite error; check the record's "
            "values and the bounds"
        )
    return Identification(problem, optimizer, key_integer(key), tuple(answers))


def _search(
    optimizer: AbstractPopulationMinimiser, objective: Objective, keys: Key[Array, "seeds"]
):
    """Best point, history, evaluations and failures of every key, in one compiled call."""
    box = objective.coordinates

    def one(key):
        solution = optx.minimise(
            rmse,
            optimizer,
            jnp.zeros_like(box.lower),
            objective,
            {"key": key, "lower": box.lower, "upper": box.upper},
            max_steps=None,
            throw=False,
        )
        stats = solution.stats
        return solution.value, stats["history"], stats["evaluations"], stats["failures"]

    return jax.vmap(one)(keys)


def compile_for(function: Callable[..., Outcome], *arguments: Any) -> Callable[..., Outcome]:
    """The function, compiled for arguments of these shapes and settings."""
    jitted: Any = eqx.filter_jit(function)
    return jitted.lower(*arguments).compile()


def seed_blocks(seeds: int, size: int) -> list[list[int]]:
    """Seed numbers in blocks of `size`; the last one is filled up with further seeds."""
    return [list(range(first, first + size)) for first in range(0, seeds, size)]


def run_blocks(
    run: Callable[[Given], tuple[np.ndarray, ...]],
    blocks: Sequence[Given],
    rows: int,
    progress: Callable[[int], None] | None,
) -> list[tuple[np.ndarray, ...]]:
    """Run a compiled function on every block, on all cores; the first `rows` rows, in order."""
    outcomes: dict[int, tuple[np.ndarray, ...]] = {}
    finished = 0
    with ThreadPoolExecutor(max_workers=min(len(blocks), os.cpu_count() or 1)) as pool:
        waiting = {pool.submit(run, block): index for index, block in enumerate(blocks)}
        try:
            for done in as_completed(waiting):
                outcome = done.result()
                outcomes[waiting[done]] = outcome
                gained = min(len(outcome[0]), rows - finished)
                finished += gained
                if progress is not None:
                    progress(gained)
        except BaseException:
            # An interruption waits for the blocks that run, not for those still in the queue.
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    every = [row for index in range(len(blocks)) for row in zip(*outcomes[index], strict=True)]
    return every[:rows]


def key_integer(key: Key[Array, ""]) -> int:
    """The integer that `jax.random.key` makes this key from, as results store it."""
    return int.from_bytes(np.asarray(jr.key_data(key)).astype(">u4").tobytes(), "big")

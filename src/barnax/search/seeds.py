"""The search: many seeds of one population optimizer, on one problem or on many."""

from collections.abc import Callable, Sequence
from dataclasses import fields

import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
from jaxtyping import Array, Key

from ..errors import InputError
from ..execution import compile_for, in_float64, run_blocks, seed_blocks, wanted_rows
from ..model.problem import Objective, Problem, rmse, rmse_by_scan
from ..optimizers import OPTIMIZERS, AbstractPopulationMinimiser, minimise
from .answers import Search, SeedAnswer


def search_seeds(
    problem: Problem,
    optimizer: AbstractPopulationMinimiser,
    *,
    key: Key[Array, ""],
    seeds: int = 30,
    progress: Callable[[int], None] | None = None,
) -> Search:
    """The answers of independent runs of an optimizer; seed k draws from `fold_in(key, k)`.

    Args:
        problem: A problem from `make_problem`.
        optimizer: An optimizer from `make_optimizer`, or your own.
        key: A key of `jax.random.key`.
        seeds: Number of runs.
        progress: Called with the number of seeds finished since the last call.

    Raises `InputError` if no seed finds a finite error.
    """
    return search_many([problem], optimizer, key=key, seeds=seeds, progress=progress)[0]


@in_float64
def search_many(
    problems: Sequence[Problem],
    optimizer: AbstractPopulationMinimiser,
    *,
    key: Key[Array, ""],
    seeds: int = 30,
    progress: Callable[[int], None] | None = None,
) -> list[Search]:
    """`search_seeds` for every problem; each answer is bit for bit what it would be alone.

    Problems of one kind share compiled programs: compressed records have the same size if their
    boxes span the same decades, and for the scan, records of many lengths are padded, with samples
    that are not counted, to one size an octave.

    Args:
        problems: Problems from `make_problem`.
        optimizer: An optimizer from `make_optimizer`, or your own.
        key: A key of `jax.random.key`.
        seeds: Number of runs for each problem.
        progress: Called with the number of seeds finished since the last call.

    Raises as `search_seeds`.
    """
    if seeds < 1:
        raise InputError(f"`seeds` {seeds}: at least one seed is needed")
    block_keys = [
        jax.vmap(lambda seed: jr.fold_in(key, seed))(jnp.asarray(block))
        for block in seed_blocks(seeds)
    ]

    is_alone = len(problems) == 1
    objectives = [
        problem.objective
        if is_alone or problem.kind != "scan"
        else Objective(problem.padded_scan, problem.coordinates)
        for problem in problems
    ]

    @in_float64  # the setting belongs to a thread
    def run(work):
        objective, keys = work
        search = compile_for(_search, optimizer, objective, keys)
        return jax.tree.map(np.asarray, search(optimizer, objective, keys))

    work = [(objective, keys) for objective in objectives for keys in block_keys]
    outcomes = run_blocks(run, work, wanted_rows(seeds) * len(problems), progress)
    # The integer that `jax.random.key` makes this key from.
    integer = int.from_bytes(np.asarray(jr.key_data(key)).astype(">u4").tobytes(), "big")
    searches = []
    for problem, first in zip(problems, range(0, len(outcomes), seeds), strict=True):
        rows = outcomes[first : first + seeds]
        points, losses_v, evaluations, failures = zip(*rows, strict=True)
        circuits = problem.parameters_at(points, problem.objective.coordinates)
        errors_v = [*map(float, losses_v)]
        if not np.isfinite(errors_v).any():
            raise InputError(
                f"{problem.prepared.record.name}: no candidate gave a finite error; check the "
                "record's values and the bounds"
            )
        if problem.kind != "scan":
            errors_v = rmse_by_scan(problem, circuits)
        answers = [*map(SeedAnswer, errors_v, circuits, map(int, evaluations), map(int, failures))]
        searches.append(search_of(problem, optimizer, integer, answers))
    return searches


def search_of(
    problem: Problem,
    optimizer: AbstractPopulationMinimiser,
    key: int,
    seeds: Sequence[SeedAnswer],
) -> Search:
    """The search of a problem by an optimizer."""
    budget = {"population": optimizer.population, "iterations": optimizer.iterations}
    registered = (name for name, make in OPTIMIZERS.items() if make(**budget) == optimizer)
    values = {field.name: getattr(optimizer, field.name) for field in fields(optimizer)}
    return Search(
        method=next(registered, type(optimizer).__name__),
        settings={
            name: value
            for name, value in values.items()
            if isinstance(value, bool | int | float | str)
        },
        coordinates=problem.scale,
        objective=problem.kind,
        **budget,
        key=key,
        evaluations=sum(answer.evaluations for answer in seeds),
        seeds=tuple(seeds),
        problem=problem,
        optimizer=optimizer,
    )


def _search(
    optimizer: AbstractPopulationMinimiser, objective: Objective, keys: Key[Array, "seeds"]
):
    """Best point and loss, evaluations and failures of every key, in one compiled call."""
    box = objective.coordinates
    solution = minimise(
        rmse, optimizer, box.lower, box.upper, key=keys, args=objective, throw=False
    )
    stats = solution.stats
    return solution.value, stats["best_loss"], stats["evaluations"], stats["failures"]

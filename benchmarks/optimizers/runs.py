"""Runs of a method on a function of CEC or BBOB: every evaluation is counted here."""

import itertools
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import jax.random as jr
import minionpy
import numpy as np
from numpy.typing import NDArray

from barnax.optimizers import (
    AbstractPopulationMinimiser,
    AdaptiveMating,
    evaluations_per_iteration,
    make_optimizer,
)

from .statistics import expected_evaluations, reached

HALF_WIDTH = 100.0
# The year of COCO's noiseless functions, which are searched in a box of this half-width.
BBOB, OF_BBOB = 2009, 5.0
# The competitions count an error of this or less as zero, and the run as over.
SOLVED = 1e-8
# 51 targets, as COCO has them.
TARGETS = 10.0 ** np.linspace(2, -8, 51)
# Evaluations a dimension at which the share of reached targets is taken; columns of the ERT.
SPENT, ERT = np.logspace(0.5, 5, 28), [10, 30, 50]
CANDIDATES = 30
OURS = ("ibmo-adaptive", "ibmo-centered", "ibmo", "bmo", "pso", "gwo", "igwo")
# What each part of `ibmo-adaptive` is worth is seen by leaving it out.
VARIANTS: dict[str, dict[str, Any]] = {
    "ibmo-adaptive": {},
    "no mating": {"pl": -1},
    "no history of success": {"is_adaptive": False},
    "no eigen coordinates": {"eigen_share": 0.0},
    "no reduction": {"is_shrinking": False},
    "no restarts": {"patience": np.inf},
}
# Those between which restarts are judged; Friedman's test takes three.
RESTARTS = ("ibmo-adaptive", "no restarts", "no mating")
# The published settings. The package would stop where its candidates lie close together.
BASELINES: dict[str, tuple[str, Callable[[int], dict[str, Any]]]] = {
    "de": (
        "Differential_Evolution",
        lambda dims: {
            "population_size": 10 * dims,
            "mutation_strategy": "rand1bin",
            "mutation_rate": 0.5,
            "crossover_rate": 0.9,
            "x_tol": -1.0,
        },
    ),
    "l-shade": ("LSHADE", lambda dims: {"population_size": 18 * dims, "x_tol": -1.0}),
    "jso": ("jSO", lambda dims: {"x_tol": -1.0}),
    "bipop-cma-es": ("BIPOP_aCMAES", lambda dims: {}),
}


class Suite(NamedTuple):
    """Functions of a year's CEC, or of BBOB, in one dimension, with the evaluations of a run and
    how many runs."""

    year: int
    dims: int
    functions: tuple[int, ...]
    budget: int
    runs: int

    @property
    def name(self) -> str:
        family = "BBOB" if self.year == BBOB else f"CEC {self.year}"
        return f"{family}, {self.dims}-D"

    def function(self, number: int, runs: Sequence[int]) -> Any:
        """A function of the suite for some runs: rows of positions, one run's after the other's, to
        their losses."""
        if self.year == BBOB:
            return Instances(number, self.dims, runs)
        return getattr(minionpy, f"CEC{self.year}Functions")(number, self.dims)


class Instances:
    """A function of BBOB (Hansen et al., 2009), of which every run has an instance."""

    f_opt = 0.0

    def __init__(self, number: int, dims: int, runs: Sequence[int]) -> None:
        from cocoex import BareProblem

        self.instances = [BareProblem("bbob", number, dims, 1 + run) for run in runs]

    def __call__(self, rows: NDArray) -> NDArray:
        blocks = np.split(np.asarray(rows) * (OF_BBOB / HALF_WIDTH), len(self.instances))
        pairs = zip(self.instances, blocks, strict=True)
        return np.concatenate([one(block) - one.best_value() for one, block in pairs])


@dataclass
class Record:
    """The errors of several runs beside each other, as they are evaluated.

    Attributes:
        function: What is evaluated, in C++.
        budget: Evaluations of a run; those beyond it are not counted.
        best: The best error of every run.
        hits: The evaluations after which each run had reached each target; infinite, never.
        evaluations: Of each run so far.
    """

    function: Any
    budget: int
    runs: int = 1
    evaluations: int = 0
    best: NDArray = field(init=False)
    hits: NDArray = field(init=False)

    def __post_init__(self) -> None:
        self.best = np.full(self.runs, np.inf)
        self.hits = np.full((self.runs, len(TARGETS)), np.inf)

    @property
    def is_over(self) -> bool:
        return self.evaluations >= self.budget or bool((self.best <= SOLVED).all())

    def evaluate(self, positions: NDArray) -> NDArray:
        """Losses of positions `[runs, candidates, dims]`, in one call; zeros where over."""
        if self.is_over:
            return np.zeros(positions.shape[:2])
        rows = positions.reshape(-1, positions.shape[-1])
        losses = np.array(self.function(rows)).reshape(self.runs, -1)
        errors = losses[:, : max(0, self.budget - self.evaluations)] - self.function.f_opt
        lowest = np.minimum.accumulate(np.c_[self.best, errors], axis=1)
        for run in np.flatnonzero(lowest[:, -1] < self.best):
            first = np.searchsorted(-lowest[run], -TARGETS)
            at = np.where(first < lowest.shape[1], self.evaluations + first, np.inf)
            self.hits[run] = np.minimum(self.hits[run], at)
        self.best = lowest[:, -1]
        self.evaluations += errors.shape[1]
        return losses


def run_ours(make: Callable[[int], AbstractPopulationMinimiser], suite: Suite) -> list[Record]:
    """All runs on all functions of one of our optimizers beside each other, by `ask` and `tell`;
    `make` takes its generations."""
    optimizer = make(1)
    per_generation = evaluations_per_iteration(optimizer)
    optimizer = make(-(-(suite.budget - optimizer.population) // per_generation))
    records = [
        Record(suite.function(number, range(suite.runs)), suite.budget, suite.runs)
        for number in suite.functions
    ]
    ask, tell = jax.vmap(optimizer.ask), jax.vmap(optimizer.tell)
    with jax.enable_x64(True):
        ends = jnp.full(suite.dims, -HALF_WIDTH), jnp.full(suite.dims, HALF_WIDTH)
        keys = jr.split(jr.key(suite.year), len(records) * suite.runs)
        state = jax.vmap(lambda key: optimizer.begin(key, *ends))(keys)
        generation = jax.jit(lambda state, positions, losses: ask(tell(state, positions, losses)))
        positions, state = ask(state)
        while True:
            blocks = np.split(np.asarray(positions), len(records))
            losses = [record.evaluate(block) for record, block in zip(records, blocks, strict=True)]
            if all(record.is_over for record in records):
                return records
            positions, state = generation(state, positions, np.concatenate(losses))


def run_baseline(name: str, suite: Suite, number: int) -> Record:
    """The runs of a baseline one after the other, joined."""
    algorithm, options = BASELINES[name]
    joined = Record(None, suite.budget, suite.runs)
    for run in range(suite.runs):
        record = Record(suite.function(number, [run]), suite.budget)
        getattr(minionpy, algorithm)(
            lambda rows, record=record: record.evaluate(np.asarray(rows)[None])[0],
            [(-HALF_WIDTH, HALF_WIDTH)] * suite.dims,
            maxevals=suite.budget,
            callback=lambda _, record=record: record.is_over,
            seed=1000 * number + run + 1,
            options=options(suite.dims),
        ).optimize()
        joined.best[run], joined.hits[run] = record.best[0], record.hits[0]
    return joined


def run_method(name: str, suite: Suite) -> list[Record]:
    """The runs of a method or variant, by its name, on every function of the suite."""
    if name in BASELINES:
        return [run_baseline(name, suite, number) for number in suite.functions]

    def make(generations: int) -> AbstractPopulationMinimiser:
        if name in VARIANTS:
            return AdaptiveMating(18 * suite.dims, generations, **VARIANTS[name])
        return make_optimizer(name, CANDIDATES, generations)

    return run_ours(make, suite)


def measured(task: tuple[str, Suite]) -> list[dict[str, Any]]:
    """The runs of one method on the functions of a suite, a row a function."""
    name, suite = task
    return [
        {
            "suite": suite.name,
            "function": number,
            "method": name,
            "errors": [float(f"{error:.4g}") for error in record.best],
            "reached": [round(reached(record.hits, suite.dims * spent), 4) for spent in SPENT],
            "ert": [expected_evaluations(hits, suite.budget) for hits in record.hits.T[ERT]],
        }
        for number, record in zip(suite.functions, run_method(name, suite), strict=True)
    ]


def measure_suites(suites: Iterable[Suite], methods: Iterable[str], workers: int) -> dict[str, Any]:
    """Rows of every method on every function of every suite."""
    tasks = itertools.product(methods, suites)
    if workers == 1:
        blocks = [*map(measured, tasks)]
    else:
        with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
            blocks = [*pool.map(measured, tasks)]
    rows = [*itertools.chain.from_iterable(blocks)]
    return {"rows": rows, "suites": [(suite.name, *suite) for suite in suites]}

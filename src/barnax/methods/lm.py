"""Levenberg-Marquardt from many starts."""

import math

from ..descent import STEPS, Descent, RefinedSeed
from ..problem import Problem
from ..refinement import SEED_TOLERANCE
from .answer import Answer
from .method import Budget, Method, Progress
from .starts import generator_of, random_circuits

# Starts a seed, fewer where the budget does not hold as many.
STARTS = 10


def multistart(problem: Problem, budget: Budget, progress: Progress) -> list[Answer]:
    """The best of `STARTS` descents a seed (Marquardt, J. Soc. Ind. Appl. Math. 11 (1963) 431).

    Starts are a Latin hypercube in the logarithms of the box; each descends in at most 50 steps.
    As many starts are made as the budget could hold if each took all its steps, so the evaluations
    spent are fewer.
    """
    dearest = STEPS * (1 + len(problem.coordinates.names))
    starts = max(1, min(STARTS, budget.evaluations // dearest))
    circuits = [
        circuit
        for seed in range(budget.seeds)
        for circuit in random_circuits(problem, generator_of(budget.key, seed), starts)
    ]
    finished = 0

    def advance(gained: int) -> None:
        nonlocal finished
        before, finished = finished // starts, finished + gained
        progress(finished // starts - before)

    ends = Descent(problem)(circuits, SEED_TOLERANCE, progress=advance)
    return [
        best_of(ends[first : first + starts]) for first in range(0, budget.seeds * starts, starts)
    ]


def best_of(ends: list[RefinedSeed], spent: int = 0) -> Answer:
    """The best of some descents, with what all of them and the search before them cost."""
    best = min(ends, key=lambda end: end.rmse_v if math.isfinite(end.rmse_v) else math.inf)
    evaluations = spent + sum(end.evaluations for end in ends)
    return Answer(best.parameters, best.rmse_v, evaluations)


LM = Method(
    "lm",
    f"Levenberg-Marquardt (Marquardt, 1963) from {STARTS} starts, optimistix",
    is_deterministic=False,
    run=multistart,
)

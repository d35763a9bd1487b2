"""Particle swarm for the coarse scale, Levenberg-Marquardt for the fine one."""

import jax

from ..descent import STEPS, Descent
from ..identification import identify
from ..optimizers import make_optimizer
from ..problem import Problem
from ..refinement import SEED_TOLERANCE
from .answer import Answer, MethodFailure
from .lm import best_of
from .method import Budget, Method, Progress


def swarm_then_descent(problem: Problem, budget: Budget, progress: Progress) -> list[Answer]:
    """What Levenberg-Marquardt makes of a particle swarm's best (Shen and Li, Energies 10 (2017)
    432).

    The swarm has the budget less what one descent of at most 50 steps could cost. Their circuit
    is another; the two scales are theirs.
    """
    dearest = STEPS * (1 + len(problem.coordinates.names))
    iterations = (budget.evaluations - dearest) // budget.population - 1
    if iterations < 1:
        raise MethodFailure(
            f"the budget of {budget.evaluations} evaluations a seed holds no swarm and a descent; "
            "raise --iterations"
        )
    found = identify(
        problem,
        make_optimizer("pso", budget.population, iterations),
        key=jax.random.key(budget.key),
        seeds=budget.seeds,
        progress=progress,
    )
    ends = Descent(problem)([seed.parameters for seed in found.seeds], SEED_TOLERANCE)
    return [best_of([end], seed.evaluations) for seed, end in zip(found.seeds, ends, strict=True)]


PSO_LM = Method(
    "pso-lm",
    "Particle swarm, then Levenberg-Marquardt (Shen and Li, 2017)",
    is_deterministic=False,
    run=swarm_then_descent,
)

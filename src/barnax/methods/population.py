"""Every registered population optimizer as a method by itself."""

import inspect

import jax

from ..identification import identify
from ..optimizers import OPTIMIZERS, evaluations_per_iteration, make_optimizer
from ..problem import Problem
from .answer import Answer, MethodFailure
from .method import Budget, Method, Progress


def population_method(name: str) -> Method:
    """The method that is the optimizer registered as `name`, unrefined.

    It runs for as many generations as the budget holds: an optimizer that evaluates more
    candidates in one runs for fewer.
    """

    def search(problem: Problem, budget: Budget, progress: Progress) -> list[Answer]:
        cost = evaluations_per_iteration(make_optimizer(name, budget.population, 1))
        iterations = (budget.evaluations - budget.population) // cost
        if iterations < 1:
            raise MethodFailure(
                f"it evaluates {cost} candidates a generation, more than the budget of "
                f"{budget.evaluations} a seed holds; raise --iterations"
            )
        found = identify(
            problem,
            make_optimizer(name, budget.population, iterations),
            key=jax.random.key(budget.key),
            seeds=budget.seeds,
            progress=progress,
        )
        return [
            Answer(seed.parameters, seed.rmse_v, seed.evaluations, seed.history_v)
            for seed in found.seeds
        ]

    source = (inspect.getdoc(OPTIMIZERS[name]) or "").split("\n")[0].rstrip(".")
    return Method(name, source, is_deterministic=False, run=search)

"""NiaPy's grey wolves and test functions; run by the Python of an environment that has it."""

import numpy as np
from niapy import problems
from niapy.algorithms.basic import GreyWolfOptimizer
from niapy.task import Task
from sizes import ITERATIONS, POPULATION
from work import work


class Objective(problems.Problem):
    """A loss as NiaPy wants it."""

    def __init__(self, loss, half_width, dims):
        super().__init__(dims, -half_width, half_width)
        self.loss = loss

    def _evaluate(self, x):
        return self.loss(x)


def first_pack(task, population_size, rng, **_):
    """Uniform in the box and evaluated beside the count, from which NiaPy takes its schedule."""
    pack = rng.uniform(task.lower, task.upper, (population_size, task.dimension))
    return pack, np.array([task.problem.evaluate(wolf) for wolf in pack])


def grey_wolves(loss, half_width, dims, seed):
    task = Task(Objective(loss, half_width, dims), max_evals=POPULATION * ITERATIONS)
    search = GreyWolfOptimizer(
        population_size=POPULATION, initialization_function=first_pack, seed=seed
    )
    return search.run(task)[1]


def value_of(problem):
    return lambda x: problem(dimension=len(x)).evaluate(x)


work(
    {"gwo": grey_wolves},
    {
        "F1": value_of(problems.Sphere),
        "F2": value_of(problems.Schwefel222),
        "F4": value_of(problems.Schwefel221),
        "F6": value_of(problems.Griewank),
        "F7": value_of(problems.Rastrigin),
        "F8": value_of(problems.Ackley),
    },
)

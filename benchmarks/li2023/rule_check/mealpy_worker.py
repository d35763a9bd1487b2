"""mealpy's searches and opfunu's functions; run by the Python of an environment that has them."""

# The library draws from NumPy's global state.
# ruff: noqa: NPY002

import numpy as np
from mealpy import AEO, GA, SOA, FloatVar
from opfunu import name_based
from opfunu.utils import operator
from sizes import ITERATIONS, POPULATION
from work import work


def seagulls(loss, half_width, dims, seed):
    # Its control falls as 1 - t / T from t = 1, ours as 1 - (t - 1) / T: one epoch more, with
    # this height, makes both the same, and in the epoch more it is zero and nothing moves.
    epochs = ITERATIONS + 1
    search = SOA.OriginalSOA(epoch=epochs, pop_size=POPULATION, fc=2 * epochs / ITERATIONS)
    return solve(search, loss, half_width, dims, seed)


def ecosystem(*problem):
    # An epoch of it evaluates everyone twice.
    return solve(AEO.OriginalAEO(epoch=ITERATIONS // 2, pop_size=POPULATION), *problem)


def genes(*problem):
    return solve(GA.BaseGA(epoch=ITERATIONS, pop_size=POPULATION), *problem)


def solve(search, loss, half_width, dims, seed):
    problem = {
        "obj_func": loss,
        "bounds": FloatVar(lb=[-half_width] * dims, ub=[half_width] * dims),
        "minmax": "min",
        "log_to": None,
    }
    return search.solve(problem, seed=seed).target.fitness


def quartic(x):
    """opfunu's without its noise: the same draw again, taken away."""
    np.random.seed(1)
    noise = np.random.rand()
    np.random.seed(1)
    return name_based.Quartic(ndim=len(x)).evaluate(x) - noise


work(
    {"soa": seagulls, "aeo": ecosystem, "ga": genes},
    {
        "F1": operator.sphere_func,
        "F5": quartic,
        "F6": lambda x: name_based.Griewank(ndim=len(x)).evaluate(x),
        "F7": operator.rastrigin_func,
        "F8": lambda x: name_based.Ackley01(ndim=len(x)).evaluate(x),
    },
)

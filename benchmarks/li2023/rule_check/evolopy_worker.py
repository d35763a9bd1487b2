"""EvoloPy's swarms and test functions; run by the Python of an environment that has it."""

# The library draws from NumPy's global state.
# ruff: noqa: NPY002

import contextlib
import io
import random

import numpy as np
from EvoloPy import benchmarks
from EvoloPy.optimizers import GWO, PSO, WOA
from sizes import ITERATIONS, POPULATION
from work import work


def search_with(algorithm):
    """A search that keeps EvoloPy's lines about every iteration to itself."""

    def search(loss, half_width, dims, seed):
        # One of these two feeds each of the algorithms.
        np.random.seed(seed)
        random.seed(seed)
        with contextlib.redirect_stdout(io.StringIO()), np.errstate(under="ignore"):
            found = algorithm(loss, -half_width, half_width, dims, POPULATION, ITERATIONS)
        return found.convergence[-1]

    return search


def quartic(x):
    """F7 of EvoloPy without its noise: the same draw again, taken away."""
    np.random.seed(1)
    noise = np.random.uniform(0, 1)
    np.random.seed(1)
    return benchmarks.F7(x) - noise


def penalized(x):
    """F12 of EvoloPy with the factor pi / n of its source in place of EvoloPy's pi n / 10."""
    penalty = np.sum(benchmarks.Ufun(x, 10, 100, 4))
    return (benchmarks.F12(x) - penalty) * 10 / len(x) ** 2 + penalty


work(
    {"pso": search_with(PSO.PSO), "woa": search_with(WOA.WOA), "gwo": search_with(GWO.GWO)},
    {
        "F1": benchmarks.F1,
        "F2": benchmarks.F2,
        "F3": benchmarks.F6,
        "F4": benchmarks.F4,
        "F5": quartic,
        "F6": benchmarks.F11,
        "F7": benchmarks.F9,
        "F8": benchmarks.F10,
        "F9": penalized,
    },
)

"""Random numbers of methods that are not population optimizers, and their starting circuits."""

import numpy as np
from jaxtyping import Float
from scipy.stats import qmc

from ..cell import CircuitParameters
from ..precision import in_float64
from ..problem import Problem


def generator_of(key: int, seed: int) -> np.random.Generator:
    """What one seed draws from; other keys and seeds are independent of it."""
    return np.random.default_rng([key, seed])


def latin_hypercube(
    generator: np.random.Generator, points: int, dims: int
) -> Float[np.ndarray, "points dims"]:
    """Points in the unit cube, one in each of `points` slices of every dimension."""
    return qmc.LatinHypercube(dims, rng=generator).random(points)


@in_float64
def random_circuits(
    problem: Problem, generator: np.random.Generator, count: int
) -> list[CircuitParameters]:
    """Circuits spread evenly over the logarithms of the search box."""
    box = problem.objective_in("log").coordinates
    low, high = np.asarray(box.lower), np.asarray(box.upper)
    fractions = latin_hypercube(generator, count, len(low))
    return problem.parameters_at(list(low + fractions * (high - low)), box)

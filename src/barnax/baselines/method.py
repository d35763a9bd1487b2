"""The input and the answer of a method."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import qmc

from ..cell import CircuitParameters
from ..cell.elements import alike
from ..metrics import Count
from ..model.coordinates import Coordinates
from ..model.problem import Problem
from ..schema import Loss


class MethodFailure(Exception):
    """A method that cannot answer on these data; the message gives the reason in one sentence."""


@dataclass(frozen=True, eq=False)
class Answer:
    """One run's answer as the method gives it, without refinement.

    `evaluations` counts simulations of one candidate, a Jacobian as one per free parameter.
    """

    parameters: CircuitParameters
    rmse_v: Loss
    evaluations: Count
    notes: tuple[str, ...] = ()


Progress = Callable[[int], None]


@dataclass(frozen=True)
class Budget:
    """The budget of a method.

    Methods without random numbers run once; a method that needs less reports its actual use.

    Args:
        population: Candidates per generation.
        iterations: Generations per run.
        seeds: Runs.
        key: Key of all random numbers.
    """

    population: int = 30
    iterations: int = 500
    seeds: int = 30
    key: int = 0

    @property
    def evaluations(self) -> int:
        """Simulations per seed, including the first population."""
        return self.population * (self.iterations + 1)


@dataclass(frozen=True)
class Method:
    """One way to identify a circuit.

    `run(problem, budget, progress)` gives one answer per seed, or a single one if the method draws
    nothing; `progress` is called with the number of seeds finished since the last call. It raises
    `MethodFailure` if there is no answer. `source` is a one-line reference.
    """

    name: str
    source: str
    is_deterministic: bool
    run: Callable[[Problem, Budget, Progress], list[Answer]]


def deterministic(name: str, source: str, identify: Callable[[Problem], Answer]) -> Method:
    """The method with the single answer of `identify`; it draws nothing and needs no budget."""

    def run(problem: Problem, budget: Budget, progress: Progress) -> list[Answer]:
        del budget
        elements = problem.bounds.elements
        if alike(elements) < len(elements):
            raise MethodFailure(
                f"{name} knows circuits of RC pairs alone, and {problem.circuit} has "
                f"{', '.join(elements[alike(elements) :])}; use another method, such as ibmo"
            )
        answer = identify(problem)
        progress(1)
        return [answer]

    return Method(name, source, is_deterministic=True, run=run)


def generator_of(key: int, seed: int) -> np.random.Generator:
    """The random generator of one seed, independent of those of other keys and seeds."""
    return np.random.default_rng([key, seed])


def latin_hypercube(
    generator: np.random.Generator, points: int, box: Coordinates
) -> Float[np.ndarray, "points free"]:
    """Points in a box, one in each of `points` slices of every coordinate."""
    fractions = qmc.LatinHypercube(len(box.names), rng=generator).random(points)
    low, high = np.asarray(box.lower), np.asarray(box.upper)
    return low + fractions * (high - low)

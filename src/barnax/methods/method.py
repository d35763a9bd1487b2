"""What a method of identification is, and what every one of them may spend."""

from collections.abc import Callable
from dataclasses import dataclass

from ..problem import Problem
from .answer import Answer

Progress = Callable[[int], None]


@dataclass(frozen=True)
class Budget:
    """What a method may spend: per seed, the evaluations of a population search.

    All randomness comes from `key`. Methods that draw nothing run once; a method that needs less
    says what it spent.
    """

    population: int = 30
    iterations: int = 500
    seeds: int = 30
    key: int = 0

    @property
    def evaluations(self) -> int:
        """Simulations a seed, the first population included."""
        return self.population * (self.iterations + 1)


@dataclass(frozen=True)
class Method:
    """One way to identify a circuit.

    `run(problem, budget, progress)` gives one answer a seed, or a single one where the method
    draws nothing; `progress` is called with the number of seeds finished since the last call.
    It raises `MethodFailure` where there is no answer. `source` says in a line where the method
    comes from.
    """

    name: str
    source: str
    is_deterministic: bool
    run: Callable[[Problem, Budget, Progress], list[Answer]]

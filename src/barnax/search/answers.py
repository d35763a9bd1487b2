"""The answers of a search and its refinement, as results store them: seeds and distinct optima."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from ..cell import CircuitParameters
from ..display import Brief
from ..metrics import Count, Volts
from ..model.search_space import Kind, Scale
from ..schema import Key as Seed
from ..schema import Loss, Unstored

# A parameter this close to an end of its box, as a fraction of the (log) width, is at the bound.
AT_BOUND = 1e-3
# Refined answers whose RMSE agree this closely (relative) are one optimum; if their parameters
# still differ by more than this, the optimum is a family of circuits.
SAME_RMSE = 1e-5
SAME_PARAMETER = 1e-2


@dataclass(frozen=True, eq=False, repr=False)
class SeedAnswer(Brief):
    """The answer of one seed.

    Attributes:
        rmse_v: RMSE of its best circuit, always by scan.
        parameters: Its best circuit.
        evaluations: Simulated candidates.
        failures: Candidates without a finite error.
    """

    rmse_v: Loss
    parameters: CircuitParameters
    evaluations: int
    failures: int


@dataclass(frozen=True, eq=False, repr=False)
class Search(Brief):
    """A search with its settings and the answers of all seeds.

    Attributes:
        method: The optimizer.
        settings: Its own settings.
        coordinates: Search coordinates: "rc", or logarithms of R and tau.
        objective: How errors were computed: by "scan" or "compressed".
        population: Candidates of a generation.
        iterations: Generations of a run.
        key: The key of all random numbers.
        evaluations: Simulated candidates of all seeds.
        seeds: Each seed's answer before refinement, in order.
        problem: The problem that was searched; None of a stored search.
        optimizer: By which optimizer; None likewise.
    """

    method: str
    settings: dict[str, bool | int | float | str]
    coordinates: Scale
    objective: Kind
    population: Count
    iterations: Count
    key: Seed
    evaluations: Count
    seeds: Annotated[tuple[SeedAnswer, ...], Field(min_length=1)]
    problem: Unstored[Any] = None
    optimizer: Unstored[Any] = None

    @property
    def best(self) -> SeedAnswer:
        """The answer with the lowest RMSE."""
        return min(self.seeds, key=lambda answer: answer.rmse_v)


@dataclass(frozen=True)
class RefinedSeed:
    """The end of one seed's refinement; `moved` is the largest relative change of a parameter.

    `evaluations` counts the simulations it took, a Jacobian as one per free parameter.
    """

    rmse_v: float
    parameters: CircuitParameters
    moved: float
    has_converged: bool
    evaluations: int = 0


@dataclass(frozen=True)
class AtBound:
    """A parameter that ended at one end of its box.

    Attributes:
        name: PyBaMM's name.
        side: Which end.
    """

    name: str
    side: Literal["lower", "upper"]


@dataclass(frozen=True)
class Optimum:
    """A distinct optimum that refined seeds reached.

    Attributes:
        rmse_v: Its RMSE.
        parameters: Its circuit.
        seeds: Number of seeds that reached it.
        is_family: True if circuits with different parameters fit equally well there.
    """

    rmse_v: Volts
    parameters: CircuitParameters
    seeds: int
    is_family: bool


class WithOptima(Brief):
    """Anything with distinct `optima`, the best first."""

    optima: Any

    @property
    def parameters(self) -> CircuitParameters:
        """The best circuit."""
        return self.optima[0].parameters

    @property
    def rmse_v(self) -> float:
        """Its RMSE."""
        return self.optima[0].rmse_v


@dataclass(frozen=True, eq=False, repr=False)
class Refinement(WithOptima):
    """Every seed's answer after refinement; `parameters` and `rmse_v` are those of the best.

    Attributes:
        seeds: Each seed's answer.
        optima: The distinct optima, the best first.
        at_bound: Parameters of the best at a bound.
        objective: How errors were computed on the way.
        evaluations: Simulations, a Jacobian as one per free parameter.
        search: The search that was refined; None of a stored refinement.
    """

    seeds: Annotated[tuple[RefinedSeed, ...], Field(min_length=1)]
    optima: Annotated[tuple[Optimum, ...], Field(min_length=1)]  # pyrefly: ignore
    at_bound: tuple[AtBound, ...]
    objective: Kind
    evaluations: Count
    search: Unstored[Any] = None


def largest_change(before: CircuitParameters, after: CircuitParameters) -> float:
    """The largest relative change of any parameter."""
    old, new = (np.array(list(values.to_dict().values())) for values in (before, after))
    return float(np.max(np.abs(new / old - 1)))


def distinct_optima(refined: Sequence[RefinedSeed]) -> tuple[Optimum, ...]:
    """Refined seeds grouped into distinct optima, the best first.

    A seed that was still moving counts only if it has reached an optimum nevertheless.
    """
    groups: list[list[RefinedSeed]] = []
    for seed in sorted(refined, key=lambda seed: seed.rmse_v):
        if groups and seed.rmse_v <= groups[-1][0].rmse_v * (1 + SAME_RMSE):
            groups[-1].append(seed)
        else:
            groups.append([seed])
    settled = [group for group in groups[1:] if any(seed.has_converged for seed in group)]
    return tuple(
        Optimum(
            rmse_v=group[0].rmse_v,
            parameters=group[0].parameters,
            seeds=len(group),
            is_family=any(
                largest_change(group[0].parameters, seed.parameters) > SAME_PARAMETER
                for seed in group
            ),
        )
        for group in [groups[0], *settled]
    )


def near_ends(values: Iterable[tuple[str, float, float, float]]) -> tuple[AtBound, ...]:
    """The names whose value is at the lower or the upper end given with it."""
    return tuple(
        AtBound(name, "lower" if fraction < 0.5 else "upper")
        for name, value, low, high in values
        if not AT_BOUND < (fraction := (value - low) / (high - low)) < 1 - AT_BOUND
    )

"""Population optimizers as Optimistix minimisers; they know arrays and losses, not batteries."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

from ..errors import InputError, require_number
from .adaptive import AdaptiveMating as AdaptiveMating
from .ask_tell import NEVER
from .ask_tell import PopulationState as PopulationState
from .ask_tell import Stop as Stop
from .ask_tell import evaluations_per_iteration as evaluations_per_iteration
from .barnacle import BarnacleMating as BarnacleMating
from .barnacle import bmo as bmo
from .barnacle import ibmo as ibmo
from .barnacle import ibmo_centered as ibmo_centered
from .barnacle import ibmo_printed as ibmo_printed
from .greedy import AdaptiveGenetic as AdaptiveGenetic
from .greedy import Ecosystem as Ecosystem
from .greedy import SunflowerSearch as SunflowerSearch
from .leaders import GreyWolf as GreyWolf
from .leaders import ImprovedGreyWolf as ImprovedGreyWolf
from .leaders import SailfishSearch as SailfishSearch
from .leaders import SeagullSearch as SeagullSearch
from .leaders import WhaleSearch as WhaleSearch
from .population import AbstractPopulationMinimiser as AbstractPopulationMinimiser
from .pso import CoevolvingSwarm as CoevolvingSwarm
from .pso import MixedSwarm as MixedSwarm
from .pso import ParticleSwarm as ParticleSwarm
from .pso import apso as apso
from .run import from_numpy as from_numpy
from .run import minimise as minimise
from .swarm import Box as Box
from .swarm import Swarm as Swarm
from .swarm import keep_best as keep_best
from .swarm import sort_by_loss as sort_by_loss

# A new optimizer is one file and one line here.
OPTIMIZERS: Mapping[str, Callable[..., AbstractPopulationMinimiser]] = MappingProxyType(
    {
        "ibmo": ibmo,
        "ibmo-printed": ibmo_printed,
        "ibmo-centered": ibmo_centered,
        "ibmo-adaptive": AdaptiveMating,
        "bmo": bmo,
        "pso": ParticleSwarm,
        "woa": WhaleSearch,
        "soa": SeagullSearch,
        "sfo": SailfishSearch,
        "gwo": GreyWolf,
        "igwo": ImprovedGreyWolf,
        "apso": apso,
        "mcpso": MixedSwarm,
        "cpso": CoevolvingSwarm,
        "aga": AdaptiveGenetic,
        "esfo": SunflowerSearch,
        "aeo": Ecosystem,
    }
)


class OptimizerSummary(NamedTuple):
    """One line of a list of optimizers."""

    name: str
    source: str
    evaluations_per_iteration: int


def make_optimizer(
    name: str, population: int, iterations: int, stop: Stop = NEVER
) -> AbstractPopulationMinimiser:
    """The optimizer registered under a name.

    Args:
        name: One of `OPTIMIZERS`.
        population: Candidates of a generation.
        iterations: Generations of a run.
        stop: When it ends earlier.

    Raises `InputError` for an unknown name, and for a population or budget that is too small.
    """
    if name not in OPTIMIZERS:
        raise InputError(f"no optimizer is called {name!r}; there are {', '.join(OPTIMIZERS)}")
    for option, value in (("population", population), ("iterations", iterations)):
        require_number(option, value, int)
    if population < 4:
        raise InputError(f"a population needs at least 4 candidates; {population} was given")
    if iterations < 1:
        raise InputError(f"a search needs at least 1 iteration; {iterations} was given")
    return replace(OPTIMIZERS[name](population=population, iterations=iterations), stop=stop)


def source_of(name: str) -> str:
    """What a registered optimizer is and whose: the first line of its docstring."""
    return (inspect.getdoc(OPTIMIZERS[name]) or "").split("\n")[0].rstrip(".")


def summarize_optimizers() -> list[OptimizerSummary]:
    """Every registered optimizer with its source and what an iteration costs.

    >>> summarize_optimizers()[10].evaluations_per_iteration
    60
    """
    return [
        OptimizerSummary(name, source_of(name), evaluations_per_iteration(make()))
        for name, make in OPTIMIZERS.items()
    ]

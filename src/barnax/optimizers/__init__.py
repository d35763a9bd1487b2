"""Population optimizers as Optimistix minimisers; they know arrays and losses, not batteries."""

import inspect
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import jax
import jax.numpy as jnp

from ..errors import InputError
from .barnacle import BarnacleMating, bmo, ibmo, ibmo_centered, ibmo_printed
from .genetic import AdaptiveGenetic
from .gwo import GreyWolf, ImprovedGreyWolf
from .leader import SeagullSearch, WhaleSearch
from .plants import Ecosystem, SunflowerSearch
from .population import AbstractPopulationMinimiser
from .pso import CoevolvingSwarm, MixedSwarm, ParticleSwarm, apso
from .sfo import SailfishSearch
from .swarm import Box, Swarm, keep_best, sort_by_loss

__all__ = [
    "OPTIMIZERS",
    "AbstractPopulationMinimiser",
    "AdaptiveGenetic",
    "BarnacleMating",
    "Box",
    "CoevolvingSwarm",
    "Ecosystem",
    "GreyWolf",
    "ImprovedGreyWolf",
    "MixedSwarm",
    "OptimizerSummary",
    "ParticleSwarm",
    "SailfishSearch",
    "SeagullSearch",
    "SunflowerSearch",
    "Swarm",
    "WhaleSearch",
    "apso",
    "bmo",
    "evaluations_per_iteration",
    "ibmo",
    "ibmo_centered",
    "ibmo_printed",
    "keep_best",
    "make_optimizer",
    "sort_by_loss",
    "summarize_optimizers",
]

# A new optimizer is one file and one line here.
OPTIMIZERS: Mapping[str, Callable[..., AbstractPopulationMinimiser]] = MappingProxyType(
    {
        "ibmo": ibmo,
        "ibmo-printed": ibmo_printed,
        "ibmo-centered": ibmo_centered,
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


def make_optimizer(name: str, population: int, iterations: int) -> AbstractPopulationMinimiser:
    """The optimizer registered as `name` in `OPTIMIZERS`.

    `population` candidates take part in each of `iterations` generations. Raises `InputError` for
    an unknown name, and for a population or budget that is too small.
    """
    if name not in OPTIMIZERS:
        raise InputError(f"no optimizer is called {name!r}; there are {', '.join(OPTIMIZERS)}")
    if population < 4:
        raise InputError(f"a population needs at least 4 candidates; {population} was given")
    if iterations < 1:
        raise InputError(f"a search needs at least 1 iteration; {iterations} was given")
    return OPTIMIZERS[name](population=population, iterations=iterations)


def evaluations_per_iteration(optimizer: AbstractPopulationMinimiser) -> int:
    """How many candidates the optimizer evaluates in one generation."""

    def first_offspring(key, positions, losses):
        box = Box(positions[0], positions[0] + 1)
        swarm = optimizer.prepare(Swarm(positions, losses), box)
        drawn = optimizer.draw(key, jnp.array(1), box)
        return optimizer.propose(drawn, swarm, jnp.array(1), box)[0]

    population = optimizer.population
    shapes = jax.eval_shape(
        first_offspring, jax.random.key(0), jnp.zeros((population, 2)), jnp.zeros(population)
    )
    return shapes.shape[0]


def summarize_optimizers(population: int = 30) -> list[OptimizerSummary]:
    """Every registered optimizer with its source and what an iteration costs.

    >>> summarize_optimizers()[9].evaluations_per_iteration
    60
    """
    return [
        OptimizerSummary(
            name,
            (inspect.getdoc(make) or "").split("\n")[0].rstrip("."),
            evaluations_per_iteration(make(population=population)),
        )
        for name, make in OPTIMIZERS.items()
    ]

"""Population optimizers as Optimistix minimisers; they know arrays and losses, not batteries."""

from .barnacle import BarnacleMating, bmo, ibmo, ibmo_centered, ibmo_printed
from .gwo import GreyWolf, ImprovedGreyWolf
from .population import AbstractPopulationMinimiser
from .pso import ParticleSwarm
from .registry import (
    OPTIMIZERS,
    OptimizerSummary,
    evaluations_per_iteration,
    make_optimizer,
    summarize_optimizers,
)
from .sfo import SailfishSearch
from .soa import SeagullSearch
from .swarm import Box, Swarm, keep_best, sort_by_loss
from .woa import WhaleSearch

__all__ = [
    "OPTIMIZERS",
    "AbstractPopulationMinimiser",
    "BarnacleMating",
    "Box",
    "GreyWolf",
    "ImprovedGreyWolf",
    "OptimizerSummary",
    "ParticleSwarm",
    "SailfishSearch",
    "SeagullSearch",
    "Swarm",
    "WhaleSearch",
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

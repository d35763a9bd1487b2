"""Population optimizers as Optimistix minimisers; they know arrays and losses, not batteries."""

from .barnacle import BarnacleMating
from .bmo import bmo
from .ibmo import ibmo, ibmo_centered, ibmo_printed
from .population import AbstractPopulationMinimiser, Box, Swarm, keep_best, sort_by_loss
from .registry import OPTIMIZERS, make_optimizer

__all__ = [
    "OPTIMIZERS",
    "AbstractPopulationMinimiser",
    "BarnacleMating",
    "Box",
    "Swarm",
    "bmo",
    "ibmo",
    "ibmo_centered",
    "ibmo_printed",
    "keep_best",
    "make_optimizer",
    "sort_by_loss",
]

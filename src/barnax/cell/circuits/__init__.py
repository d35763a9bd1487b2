"""Circuits: the voltage source behind the RC pairs."""

from .circuit import Circuit
from .registry import CIRCUITS, get_circuit

__all__ = ["CIRCUITS", "Circuit", "get_circuit"]

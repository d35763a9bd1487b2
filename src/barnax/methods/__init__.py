"""Everything that can identify a circuit, population optimizers and others, under one name each."""

from .answer import Answer, MethodFailure, Trajectory

__all__ = ["Answer", "MethodFailure", "Trajectory"]

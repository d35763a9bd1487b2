"""Everything that can identify a circuit, population optimizers and others, under one name each."""

from .method import Answer, Budget, Method, MethodFailure, Trajectory
from .registry import METHODS

__all__ = ["METHODS", "Answer", "Budget", "Method", "MethodFailure", "Trajectory"]

"""Everything that can identify a circuit, population optimizers and others, under one name each."""

from .answer import Answer, MethodFailure, Trajectory
from .method import Budget, Method
from .registry import METHODS

__all__ = ["METHODS", "Answer", "Budget", "Method", "MethodFailure", "Trajectory"]

"""Everything that can identify a circuit, population optimizers and others, under one name each."""

from collections.abc import Mapping
from types import MappingProxyType

from ..optimizers import OPTIMIZERS
from .descent import LM, PSO_LM, population_method
from .differential_evolution import DE
from .method import Answer, Budget, Method, MethodFailure, Trajectory
from .online import DUAL_UKF, RLS_EKF
from .regression import LS, RLS, WRLS
from .subspace import N4SID
from .varpro import VARPRO

__all__ = ["METHODS", "Answer", "Budget", "Method", "MethodFailure", "Trajectory"]

LINEAR = (LS, RLS, WRLS, RLS_EKF, N4SID)
# A new method is one file and one name here.
METHODS: Mapping[str, Method] = MappingProxyType(
    {
        method.name: method
        for method in (LS, RLS, WRLS, RLS_EKF, DUAL_UKF, N4SID, VARPRO, LM, PSO_LM, DE)
    }
    | {name: population_method(name) for name in OPTIMIZERS}
)

"""Every method that can identify a circuit, population optimizers and others, under one name
each."""

from collections.abc import Mapping
from types import MappingProxyType

from ..optimizers import OPTIMIZERS
from .method import Answer, Budget, Method, MethodFailure
from .online import DUAL_UKF, RLS_EKF
from .regression import LS, N4SID, RLS, WRLS
from .searches import DE, LM, PSO_LM, VARPRO, population_method

__all__ = ["METHODS", "Answer", "Budget", "Method", "MethodFailure"]

# A new method is a `Method` in a file of this package and one name here.
BESIDE_OPTIMIZERS = (LS, RLS, WRLS, RLS_EKF, DUAL_UKF, N4SID, VARPRO, LM, PSO_LM, DE)
METHODS: Mapping[str, Method] = MappingProxyType(
    {method.name: method for method in BESIDE_OPTIMIZERS}
    | {name: population_method(name) for name in OPTIMIZERS}
)

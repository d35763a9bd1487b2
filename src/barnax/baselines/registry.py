"""Every method by its name. A new one is one file and one line here."""

from collections.abc import Mapping
from types import MappingProxyType

from ..optimizers import OPTIMIZERS
from .descent import LM, PSO_LM, population_method
from .differential_evolution import DE
from .method import Method
from .regression import LS, RLS
from .varpro import VARPRO

METHODS: Mapping[str, Method] = MappingProxyType(
    {method.name: method for method in (LS, RLS, VARPRO, LM, PSO_LM, DE)}
    | {name: population_method(name) for name in OPTIMIZERS}
)

"""Every method by its name. A new one is one file and one line here."""

from collections.abc import Mapping
from types import MappingProxyType

from ..optimizers import OPTIMIZERS
from .de import DE
from .lm import LM
from .ls import LS
from .method import Method
from .population import population_method
from .pso_lm import PSO_LM
from .rls import RLS
from .varpro import VARPRO

METHODS: Mapping[str, Method] = MappingProxyType(
    {method.name: method for method in (LS, RLS, VARPRO, LM, PSO_LM, DE)}
    | {name: population_method(name) for name in OPTIMIZERS}
)

"""What a fit of tables needs to know of its records beside their columns."""

from typing import Any, Protocol

import numpy as np
from jaxtyping import Bool, Float

from ..cell import Dependence


class Facts(Protocol):
    """Of a prepared record, or of one that was kept."""

    @property
    def circuit(self) -> str: ...
    @property
    def capacity_ah(self) -> float: ...
    @property
    def dependence(self) -> Dependence | None: ...
    @property
    def step_ohm(self) -> float: ...
    @property
    def cell(self) -> Any: ...
    def nearest(self, nodes: Float[np.ndarray, "nodes"]) -> Bool[np.ndarray, "nodes"]: ...

"""What a fit of tables needs to know of its records beside their columns, and how samples count."""

from dataclasses import dataclass
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


@dataclass(frozen=True)
class LowEnd:
    """How samples below 10 % SOC count, where they would decide the time constants of all others.

    Attributes:
        weight: What each of their errors is multiplied by; 1 where all count evenly.
        times: How many times as large as above 10 % SOC they are in a fit that counts them evenly.
        other_tau_s: The time constants of that fit; where all count evenly, of the fit in which
            these count less.
    """

    weight: float
    times: float
    other_tau_s: tuple[float, ...]

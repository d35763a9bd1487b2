"""What a circuit is: the voltage source behind its RC pairs, and how many pairs there are."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..circuit import parameter_names
from ..model import CellModel

Samples = Float[np.ndarray, "samples"]


@dataclass(frozen=True)
class Circuit:
    """RC pairs in series with a voltage source.

    `source_voltage(cell, soc, direction)` is the source in V at each sample, `direction` being
    +1 after charging and -1 after discharging; it is computed once, outside the search.
    `hysteresis_amplitude(cell, soc)`, where given, is the voltage in V that a dynamic hysteresis
    state h in [-1, 1] multiplies; its rate gamma is then one more parameter of the search.
    """

    name: str
    description: str
    source_voltage: Callable[[CellModel, Samples, Samples], Samples]
    pairs: int = 2
    hysteresis_amplitude: Callable[[CellModel, Samples], Samples] | None = None

    @property
    def has_rate(self) -> bool:
        return self.hysteresis_amplitude is not None

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """PyBaMM's names of what is identified."""
        return parameter_names(self.pairs, self.has_rate)

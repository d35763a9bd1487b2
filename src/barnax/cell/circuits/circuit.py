"""What a circuit is: the part of the terminal voltage that no candidate changes."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..model import CellModel

Samples = Float[np.ndarray, "samples"]


@dataclass(frozen=True)
class Circuit:
    """A two-RC circuit around a voltage source.

    `source_voltage(cell, soc, direction)` is the source in V at each sample, `direction` being
    +1 after charging and -1 after discharging; it is computed once, outside the search.
    """

    name: str
    description: str
    source_voltage: Callable[[CellModel, Samples, Samples], Samples]

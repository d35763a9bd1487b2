"""What a method gives back: one answer a seed, or the reason why there is none."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..cell import CircuitParameters


class MethodFailure(Exception):
    """A method that cannot answer on these data; the message says why, in one sentence."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Parameters over time, as an online method saw them; NaN where they are no circuit's.

    Arrays hold one row a time, one column an RC pair, in ohm and seconds.
    """

    time_s: Float[np.ndarray, "times"]
    r0: Float[np.ndarray, "times"]
    r: Float[np.ndarray, "times pairs"]
    tau_s: Float[np.ndarray, "times pairs"]


@dataclass(frozen=True, eq=False)
class Answer:
    """What one run of a method found, by itself: nothing has refined it.

    `evaluations` counts simulations of one candidate, a Jacobian as one per free parameter.
    `history_v` is the best RMSE after every generation, where the method has generations.
    """

    parameters: CircuitParameters
    rmse_v: float
    evaluations: int
    history_v: Float[np.ndarray, "generations"] | None = None
    trajectory: Trajectory | None = None
    notes: tuple[str, ...] = ()

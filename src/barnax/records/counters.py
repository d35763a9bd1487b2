"""The tester's own ampere-hours."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

Charge = Float[np.ndarray, "samples"]


@dataclass(frozen=True, eq=False)
class Counters:
    """The tester's own ampere-hours, as far as the file has them.

    `charged_ah` and `discharged_ah` only grow, but for resets; `net_ah` follows the file's own
    sign of current, or nothing at all: names such as "Capacity" mean many things.
    """

    charged_ah: Charge | None = None
    discharged_ah: Charge | None = None
    net_ah: Charge | None = None

    @property
    def written(self) -> dict[str, Charge]:
        """The counters that the file has, by name."""
        return {name: values for name, values in vars(self).items() if values is not None}

    @property
    def gains_ah(self) -> tuple[float, float] | None:
        """What was counted in and out over the record, resets left out; None without both."""
        if self.charged_ah is None or self.discharged_ah is None:
            return None
        return gain_ah(self.charged_ah), gain_ah(self.discharged_ah)

    @property
    def quantum_ah(self) -> float:
        """What the coarsest counter resolves: the decimal place to which it was printed."""
        return max(map(_decimal_place, self.written.values()), default=0.0)

    def increments_ah(self, *, with_net: bool) -> Float[np.ndarray, "intervals"] | None:
        """Ah counted in each interval, charge positive; zero where a counter was reset.

        None without counters. `with_net` accepts a net counter where the other two are missing;
        its sign is then the file's own.
        """
        parts = []
        if self.charged_ah is not None:
            parts.append(np.maximum(np.diff(self.charged_ah), 0))
        if self.discharged_ah is not None:
            parts.append(-np.maximum(np.diff(self.discharged_ah), 0))
        if not parts and with_net and self.net_ah is not None:
            parts.append(np.diff(self.net_ah))
        return np.sum(parts, axis=0) if parts else None


def gain_ah(counter_ah: Charge) -> float:
    """By how much a counter grew, resets left out."""
    return float(np.sum(np.maximum(np.diff(counter_ah), 0)))


def _decimal_place(values: Charge) -> float:
    """The coarsest power of ten of which all values are multiples, to single precision."""
    for digits in range(9):
        scaled = values * 10.0**digits
        if np.all(np.abs(scaled - np.round(scaled)) <= 1e-6 * (1 + np.abs(scaled))):
            return 10.0**-digits
    return 0.0

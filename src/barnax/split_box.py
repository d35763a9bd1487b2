"""The search box taken apart: time constants outside, resistances inside.

The error is linear in the resistances once the time constants (and gamma) are known, so a method
may search over the latter alone; here is what both may be.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .bounds import PAIRS, RESISTANCES, Bounds
from .cell.circuit import RATE


@dataclass(frozen=True)
class SplitBox:
    """The ranges of tau and gamma, and which resistances are allowed at given time constants."""

    bounds: Bounds

    def tau_range_s(self, pair: int) -> tuple[float, float]:
        """Time constants of a pair that some allowed R and C have."""
        low, high = self.bounds.tau_limits_s
        tau, capacitance = PAIRS[pair]
        if self.bounds.second_name(pair) == tau:
            return self._range(tau)
        r_low, r_high = self._range(RESISTANCES[pair + 1])
        c_low, c_high = self._range(capacitance)
        return max(low, r_low * c_low), min(high, r_high * c_high)

    @property
    def gamma_range(self) -> tuple[float, float] | None:
        return self._range(RATE) if self.bounds.has_rate else None

    def resistance_box(
        self, tau_s: Float[np.ndarray, "pairs *points"]
    ) -> tuple[Float[np.ndarray, "resistances *points"], Float[np.ndarray, "resistances *points"]]:
        """Least and greatest R0, R1, ... at these time constants: a bounded C bounds R too."""
        low, high = (
            np.stack(
                [np.full(tau_s.shape[1:], self._range(name)[end]) for name in self._resistances]
            )
            for end in (0, 1)
        )
        for pair in range(self.bounds.pairs):
            name = self.bounds.second_name(pair)
            if name == PAIRS[pair][1]:
                c_low, c_high = self._range(name)
                low[pair + 1] = np.maximum(low[pair + 1], tau_s[pair] / c_high)
                high[pair + 1] = np.minimum(high[pair + 1], tau_s[pair] / c_low)
        # A fixed C leaves one value, which rounding may turn around.
        return low, np.maximum(low, high)

    @property
    def _resistances(self) -> tuple[str, ...]:
        return RESISTANCES[: self.bounds.pairs + 1]

    def _range(self, name: str) -> tuple[float, float]:
        value = self.bounds.fixed.get(name)
        return self.bounds.ranges[name] if value is None else (value, value)

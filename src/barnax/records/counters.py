"""What the tester's own ampere-hour counters say happened between samples."""

import numpy as np
from jaxtyping import Float

from .samples import Counters


def counted_increments_ah(
    counters: Counters, *, with_net: bool
) -> Float[np.ndarray, "intervals"] | None:
    """Ah counted in each interval, charge positive; zero where a counter was reset.

    None without counters. `with_net` accepts a net counter where the other two are missing; its
    sign is then the file's own.
    """
    parts = []
    if counters.charged_ah is not None:
        parts.append(np.maximum(np.diff(counters.charged_ah), 0))
    if counters.discharged_ah is not None:
        parts.append(-np.maximum(np.diff(counters.discharged_ah), 0))
    if not parts and with_net and counters.net_ah is not None:
        parts.append(np.diff(counters.net_ah))
    return np.sum(parts, axis=0) if parts else None


def counter_quantum_ah(counters: Counters) -> float:
    """What the coarsest counter resolves, in Ah: the decimal place to which it was printed."""
    written = (counters.charged_ah, counters.discharged_ah, counters.net_ah)
    return max((_decimal_place(counter) for counter in written if counter is not None), default=0.0)


def _decimal_place(values: Float[np.ndarray, "samples"]) -> float:
    """The coarsest power of ten of which all values are multiples, to single precision."""
    for digits in range(9):
        scaled = values * 10.0**digits
        if np.all(np.abs(scaled - np.round(scaled)) <= 1e-6 * (1 + np.abs(scaled))):
            return 10.0**-digits
    return 0.0

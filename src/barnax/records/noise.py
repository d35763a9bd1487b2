"""How much a channel moves where nothing happens."""

import numpy as np
from jaxtyping import Bool, Float


def voltage_noise_v(
    step_v: Float[np.ndarray, "intervals"], quiet: Bool[np.ndarray, "intervals"]
) -> float:
    """Robust noise of one voltage step where nothing else happens, in V.

    Never under half of the tester's resolution, which is the smallest such step.
    """
    steps = step_v[quiet]
    moved = np.abs(steps[steps != 0])
    if not len(moved):
        return 0.0
    spread_v = 1.4826 * float(np.median(np.abs(steps - np.median(steps))))
    return max(spread_v, float(moved.min()) / 2)

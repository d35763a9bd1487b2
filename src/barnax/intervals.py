"""A record's clock, prepared once for all candidates: few exponentials for many intervals."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

# Intervals this close together, relative to the shortest time constant, share one exponential.
_NODE_SPACING = 2e-4
# Smaller offsets are rounding of the stored time, not jitter of the clock.
_CLOCK_S = 1e-10


class Intervals(eqx.Module):
    """Sampling intervals, prepared so that a candidate needs few exponentials.

    A measured clock jitters: thousands of intervals differ in the last microsecond. Each is a
    node plus a small offset; one exponential per node and a cubic in offset / tau give
    exp(-interval / tau) to rounding, for any tau from `shortest_tau_s` on.
    """

    node_s: Float[Array, "nodes"]
    node: Int[Array, "samples"]
    offset_s: Float[Array, "samples"]
    is_even: bool = eqx.field(static=True)
    has_offsets: bool = eqx.field(static=True)

    @classmethod
    def measure(cls, time_s: Float[np.ndarray, "samples"], shortest_tau_s: float) -> "Intervals":
        """The intervals of a clock, for time constants from `shortest_tau_s` on.

        The last sample's own interval leads nowhere; it repeats the one before.
        """
        interval_s = np.diff(time_s)
        resolution_s = max(_CLOCK_S, 2 * np.spacing(np.max(np.abs(time_s))))
        return cls.gather(np.append(interval_s, interval_s[-1]), shortest_tau_s, resolution_s)

    @classmethod
    def gather(
        cls, interval_s: Float[np.ndarray, "samples"], shortest_tau_s: float, resolution_s: float
    ) -> "Intervals":
        """Given intervals by nodes and offsets; offsets up to `resolution_s` count as rounding."""
        spacing_s = _NODE_SPACING * shortest_tau_s
        groups, node = np.unique(np.round(interval_s / spacing_s), return_inverse=True)
        totals = np.bincount(node, weights=interval_s, minlength=len(groups))
        node_s = totals / np.bincount(node, minlength=len(groups))
        offset_s = interval_s - node_s[node]
        return cls(
            node_s=jnp.asarray(node_s),
            node=jnp.asarray(node, jnp.int32),
            offset_s=jnp.asarray(offset_s),
            is_even=len(groups) == 1,
            has_offsets=bool(np.max(np.abs(offset_s)) > resolution_s),
        )

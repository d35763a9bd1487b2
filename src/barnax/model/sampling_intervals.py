"""Sampling intervals, prepared so that a candidate needs few exponentials."""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float, Int, Shaped

from ..execution import as_input
from .exponentials import AT_ONCE

# Intervals this close together, relative to the shortest time constant, share one exponential.
_NODE_SPACING = 2e-4
# Smaller offsets are rounding of the stored time, not jitter of the clock.
_CLOCK_S = 1e-10


class Intervals(eqx.Module):
    """Sampling intervals, prepared so that a candidate needs few exponentials.

    A measured clock jitters: thousands of intervals differ by microseconds. Each is a node plus a
    small offset; one exponential per node and a cubic in offset / tau give exp(-interval / tau) to
    rounding, for any tau from `shortest_tau_s` on.
    """

    node_s: Float[Array, "nodes"]
    node: Int[Array, "samples"]
    offset_s: Float[Array, "samples"]
    is_even: bool = eqx.field(static=True)
    has_offsets: bool = eqx.field(static=True)

    @classmethod
    def measure(cls, time_s: Float[np.ndarray, "samples"], shortest_tau_s: float) -> "Intervals":
        """The intervals of a clock, for time constants from `shortest_tau_s` on.

        The last sample's interval is unused; it repeats the one before.
        """
        interval_s = np.diff(time_s)
        # A response that ends within every interval needs no fine ones.
        shortest_tau_s = max(shortest_tau_s, float(np.min(interval_s)) / AT_ONCE)
        resolution_s = max(_CLOCK_S, 2 * np.spacing(np.max(np.abs(time_s))))
        return cls.gather(np.append(interval_s, interval_s[-1]), shortest_tau_s, resolution_s)

    @classmethod
    def gather(
        cls, interval_s: Float[np.ndarray, "samples"], shortest_tau_s: float, resolution_s: float
    ) -> "Intervals":
        """Given intervals as nodes and offsets; offsets up to `resolution_s` count as rounding."""
        spacing_s = _NODE_SPACING * shortest_tau_s
        groups, node = np.unique(np.round(interval_s / spacing_s), return_inverse=True)
        totals = np.bincount(node, weights=interval_s, minlength=len(groups))
        node_s = totals / np.bincount(node, minlength=len(groups))
        offset_s = interval_s - node_s[node]
        return cls(
            node_s=as_input(node_s),
            node=as_input(node.astype(np.int32)),
            offset_s=as_input(offset_s),
            # Without elapsed time, a state cannot be measured in units of its change over one
            # interval.
            is_even=len(groups) == 1 and bool(node_s[0] > 0),
            has_offsets=bool(np.max(np.abs(offset_s)) > resolution_s),
        )

    def sized(self, samples: int, in_one_form: bool) -> "Intervals":
        """A copy with `samples` samples, the last repeated if there are fewer, and with the nodes
        padded to one of a few numbers; no sample uses the added ones. `in_one_form` gives the form
        shared by the blocks of most clocks, and so one program."""
        nodes, offset_s = np.asarray(self.node_s), np.asarray(self.offset_s)
        offset_s = 0 * offset_s if in_one_form and not self.has_offsets else offset_s
        node_s, node = sized(nodes, next_nodes(len(nodes))), sized(np.asarray(self.node), samples)
        arrays = map(as_input, (node_s, node, sized(offset_s, samples)))
        is_even, has_offsets = self.is_even and not in_one_form, self.has_offsets or in_one_form
        return Intervals(*arrays, is_even=is_even, has_offsets=has_offsets)


def sized(values: Shaped[np.ndarray, "some"], size: int) -> Shaped[np.ndarray, "size"]:
    """The first `size` values; if there are fewer, the last is repeated."""
    filled = np.empty(size, values.dtype)
    filled[: len(values)], filled[len(values) :] = values[:size], values[-1]
    return filled


def next_nodes(count: int) -> int:
    """The next of 16, 64, 256 and so on."""
    return 1 << max(4, -(-(count - 1).bit_length() // 2) * 2)


def common_size(samples: int) -> int:
    """The next of 64, 128 and so on to 65,536, then 98,304, 131,072 and so on: a new record seldom
    compiles anything, with one size per octave, two where samples cost more than programs."""
    power = max(6, (samples - 1).bit_length())
    is_between = power > 16 and samples <= 3 << (power - 2)
    return 3 << (power - 2) if is_between else 1 << power

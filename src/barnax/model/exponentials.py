"""Every exponential in a span of time constants, from a few of them.

An RC pair responds to a current with the kernel exp(-s / tau) / tau. In x = log(tau) that kernel is
analytic in a strip, so its values at Chebyshev nodes give it everywhere in between with an error
that can be bounded in advance; and the kernels of those nodes are so similar that about half of
them, the skeleton, give the others. None of this depends on a record.
"""

import functools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import qr, solve_triangular

from ..blas import one_blas_thread
from ..errors import InputError

# Spans are rounded up to quarter decades, so that most records share one table and one program.
_SPAN_STEP = math.log(10) / 4
_NODE_STEP = 8
MAX_NODES = 256
# A pair this many times faster than any interval settles within it, to the last bit.
AT_ONCE = 40.0
# Spacing in log(s) of the grid on which kernels are compared, and its margin beyond them.
_GRID_STEP = 0.1
_GRID_BEFORE, _GRID_AFTER = 36.0, 4.0


class Span(NamedTuple):
    """Nodes in log(tau), which of them form the skeleton, and the matrix from it to all nodes.

    `error` bounds |exact - interpolated| of a pair's response to a current of at most 1 A, in V per
    ohm.
    """

    center: float
    half_width: float
    nodes: Float[np.ndarray, "nodes"]
    weights: Float[np.ndarray, "nodes"]
    slope: Float[np.ndarray, "nodes nodes"]
    skeleton: Int[np.ndarray, "skeleton"]
    from_skeleton: Float[np.ndarray, "skeleton nodes"]
    error: float

    @property
    def skeleton_tau(self) -> Float[np.ndarray, "skeleton"]:
        """The time constants to simulate."""
        return np.exp(self.center + self.half_width * self.nodes[self.skeleton])

    def counts(self, log_tau: Float[np.ndarray, "points"]) -> Float[np.ndarray, "points nodes"]:
        """The weights of the nodes' responses in those of the given tau, as in `Lagrange.at`."""
        gaps = ((log_tau - self.center) / self.half_width)[:, None] - self.nodes
        terms = self.weights / np.where(gaps == 0, np.finfo(float).tiny, gaps)
        return terms / np.sum(terms, axis=1, keepdims=True)


def can_span(lower: float, upper: float, tolerance: float) -> bool:
    """True if `span_of` needs no more than `MAX_NODES` nodes."""
    return interpolation_error(MAX_NODES, _steps(lower, upper) * _SPAN_STEP / 2) <= tolerance / 2


def _steps(lower: float, upper: float) -> int:
    return max(1, math.ceil(math.log(upper / lower) / _SPAN_STEP - 1e-9))


def span_of(lower: float, upper: float, tolerance: float) -> Span:
    """Nodes for time constants from `lower` to `upper`.

    `tolerance` is the largest error of a pair's response, relative to the largest current. Raises
    `InputError` if the span needs more than `MAX_NODES` nodes.
    """
    steps = _steps(lower, upper)
    if not can_span(lower, upper, tolerance):
        raise InputError(
            f"the compressed objective cannot cover {lower:.3g} to {upper:.3g}, {steps / 4:g} "
            "decades, to its stated accuracy; narrow the bounds or use `objective='scan'`"
        )
    center = (math.log(lower) + math.log(upper)) / 2
    half_width = steps * _SPAN_STEP / 2
    counts = range(_NODE_STEP, MAX_NODES + 1, _NODE_STEP)
    count = next(n for n in counts if interpolation_error(n, half_width) <= tolerance / 2)
    # One thread: a library that uses several would change the last bits.
    with one_blas_thread():
        return _table(count, half_width, tolerance / 2)._replace(center=center)


def span_through(log_taus: Sequence[float]) -> Span:
    """The span of just these time constants, with no interpolation between them.

    >>> span_through((math.log(2.0), math.log(50.0))).skeleton_tau.round(9).tolist()
    [2.0, 50.0]
    """
    low = min(log_taus)
    # A single time constant has no width.
    half_width = (max(log_taus) - low) / 2 or 1.0
    center, eye = low + half_width, np.eye(len(log_taus))
    return Span(
        center=center,
        half_width=half_width,
        nodes=(np.array(log_taus) - center) / half_width,
        weights=np.ones(len(eye)),
        slope=np.zeros_like(eye),
        skeleton=np.arange(len(eye)),
        from_skeleton=eye,
        error=0.0,
    )


@functools.cache
def interpolation_error(count: int, half_width: float) -> float:
    """A bound on the error of interpolation between `count` nodes, relative to the current.

    In the strip |Im log(tau)| <= angle the kernel's integral of absolute values is at most
    1 / cos(angle); the rest is the error of Chebyshev interpolation inside a Bernstein ellipse
    (Trefethen, Approximation Theory and Approximation Practice, 2013, Theorem 8.2).
    """
    angle = np.linspace(0.01, 0.999, 400) * math.pi / 2
    semi_axis = angle / half_width
    rho = semi_axis + np.sqrt(semi_axis**2 + 1)
    bounds = 4 / np.cos(angle) * rho ** (1.0 - count) / (rho - 1)
    return float(np.min(bounds))


@functools.lru_cache(maxsize=64)
def _table(count: int, half_width: float, tolerance: float) -> Span:
    angles = (2 * np.arange(count) + 1) * math.pi / (2 * count)
    nodes, weights = np.cos(angles), (-1.0) ** np.arange(count) * np.sin(angles)
    log_s = np.arange(-half_width - _GRID_BEFORE, half_width + _GRID_AFTER, _GRID_STEP)
    reduced = log_s[:, None] - half_width * nodes
    kernels = np.exp(reduced - np.exp(reduced))

    decomposed: Any = qr(kernels, mode="r", pivoting=True)
    factor, order = decomposed[0][:count], decomposed[1]
    # Interpolation between nodes can accumulate their errors, by less than this factor.
    lebesgue = 2 / math.pi * math.log(count) + 1
    pivots = np.abs(np.diag(factor))
    rank = min(count, int(np.count_nonzero(pivots > tolerance * pivots[0])))
    while True:
        solution = solve_triangular(factor[:rank, :rank], factor[:rank])
        missing = kernels[:, order] - kernels[:, order[:rank]] @ solution
        error = lebesgue * _GRID_STEP * float(np.max(np.sum(np.abs(missing), axis=0)))
        if error <= tolerance or rank == count:
            break
        rank = min(count, rank + 2)
    from_skeleton = np.empty((rank, count))
    from_skeleton[:, order] = solution
    return Span(
        center=0.0,
        half_width=half_width,
        nodes=nodes,
        weights=weights,
        slope=_slope(nodes, weights),
        skeleton=order[:rank],
        from_skeleton=from_skeleton,
        error=interpolation_error(count, half_width) + error,
    )


def _slope(nodes: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The matrix from values at the nodes to the interpolant's derivatives there."""
    gaps = nodes[:, None] - nodes
    np.fill_diagonal(gaps, 1.0)
    slope = weights / weights[:, None] / gaps
    np.fill_diagonal(slope, 0.0)
    np.fill_diagonal(slope, -slope.sum(axis=1))
    return slope

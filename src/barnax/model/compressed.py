"""The errors of every circuit of a box from one small factor, whatever the record's length.

For given time constants the error is linear in the resistances, and an RC pair's answer to the
current is a combination of a few answers (`exponentials`). With T the triangular factor of [those
answers, current, base error], a circuit's squared error is |T w|^2 with w from its few numbers:
the sum over all samples, without the samples.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial, reduce
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Scalar
from scipy.linalg import get_lapack_funcs, qr

from ..blas import one_blas_thread
from ..execution import as_input, threads
from .coordinates import Coordinates
from .exponentials import Lagrange, Span, span_of
from .intervals import AT_ONCE, Intervals
from .simulate import AbstractEvaluator, RCParameters, SimulationInput, respond

# Bound on the error of a pair's answer, relative to the largest current.
TOLERANCE = 1e-12
# Samples that are held at a time.
BLOCK = 4096
# Chains of factors that are combined at the end; a fixed number, so that no bit depends on cores.
CHAINS = 2
# Rows that join a factor at a time, as many as stay in a core's cache, and columns of one block
# reflector: measured, a factor joined by whole blocks with LAPACK's plain QR takes three times as
# long.
PANEL = 1024
REFLECTORS = 8
# Time constants are answered in multiples of this, so that spans of many widths share a program.
TAU_STEP = 8
# Rows of the factor that add less than this to any column's RMS, in V, are left out. They are
# orthogonal to the others: an RMSE grows by their square over twice itself.
NEGLIGIBLE_V = 1e-13
# The rows that are left are a multiple of this, so that most records share one program, and as
# wide as a processor's widest registers like them.
ROW_STEP = 16


class Compressed(AbstractEvaluator):
    """A record reduced to its triangular factor, for one box.

    Its errors are the scan's to 1e-9, or 1e-12 V; with the arrays in single precision, which the
    reduction itself never is, to 2e-4, or 1e-5 V.

    The columns of `factor` are those of the nodes' answers, so that `pairs` @ Lagrange
    polynomials is the answer of any RC pair of 1 ohm; the same for a dynamic hysteresis where
    there is one; of the current; and of the base error.
    """

    scored: Scalar
    factor: Float[Array, "rows columns"]
    in_tau: Lagrange
    in_rate: Lagrange | None = None

    @property
    def base(self) -> Float[Array, "rows"]:
        return self.factor[:, -1]

    def errors(self, rc: RCParameters) -> Float[Array, "rows"]:
        # All pairs at once, and counts times the factor rather than the reverse: fewer steps, and
        # nothing to transpose, in a program that spends microseconds on each.
        r, tau = map(jnp.stack, zip(*rc.pairs, strict=True))
        if rc.elements:
            # What is faster answers as what is at its end within every interval.
            tau = jnp.maximum(tau, jnp.exp(self.in_tau.center - self.in_tau.half_width))
        answers = jax.vmap(self.in_tau.at)(tau, r)
        counts = [sum(answers[1:], answers[0])]
        if self.in_rate is not None and rc.gamma is not None:
            counts.append(self.in_rate.at(1 / rc.gamma))
        counts.append(jnp.stack([rc.r0, jnp.ones_like(rc.r0)]))
        return jnp.concatenate(counts) @ self.factor.T

    def squared_error(self, rc: RCParameters) -> Scalar:
        errors_v = self.errors(rc)
        return jnp.sum(errors_v * errors_v)

    def padded_to_multiple(self, step: int) -> "Compressed":
        """The same with rows and nodes filled up to a multiple of `step` by ones without effect."""
        in_tau = self.in_tau.padded_to_multiple(step)
        in_rate = None if self.in_rate is None else self.in_rate.padded_to_multiple(step)
        factor = np.asarray(self.factor)
        rows, nodes = factor.shape[0], len(self.in_tau.nodes)
        filled = np.zeros((-(-rows // step) * step, len(in_tau.nodes) + 2), factor.dtype)
        filled[:rows, :nodes] = factor[:, :nodes]
        if in_rate is not None:
            turns = np.zeros((len(filled), len(in_rate.nodes)), factor.dtype)
            turns[:rows, : factor.shape[1] - nodes - 2] = factor[:, nodes:-2]
            filled = np.insert(filled, [len(in_tau.nodes)], turns, axis=1)
        filled[:rows, -2:] = factor[:, -2:]
        return Compressed(self.scored, as_input(filled), in_tau, in_rate)


def compress(all_inputs: Sequence[SimulationInput], box: Coordinates) -> Compressed:
    """One or several records, reduced together. Call inside float64.

    The samples go through in blocks of `BLOCK`; nothing longer is ever held. Raises `InputError`
    where the box is too wide for the accuracy promised.
    """
    in_tau = span_of_pairs(all_inputs, box)
    in_rate = None
    if box.gamma_limits is not None:
        slowest, fastest = box.gamma_limits
        in_rate = span_of(1 / fastest, 1 / slowest, TOLERANCE)
    # One thread each: what a library does with several would change the last bits.
    with one_blas_thread():
        factor = reduce(extend, [_factor(inputs, in_tau, in_rate) for inputs in all_inputs])
        count = len(in_tau.skeleton)
        columns = [factor[:, :count] @ in_tau.from_skeleton]
        if in_rate is not None:
            columns.append(factor[:, count:-2] @ in_rate.from_skeleton)
        columns.append(factor[:, -2:])
        scored = sum(float(inputs.scored) for inputs in all_inputs)
        factor = shorten(np.concatenate(columns, axis=1), NEGLIGIBLE_V * math.sqrt(scored))
    return Compressed(
        scored=as_input(scored),
        factor=as_input(factor),
        in_tau=Lagrange.of(in_tau),
        in_rate=None if in_rate is None else Lagrange.of(in_rate),
    )


def span_of_pairs(
    all_inputs: Sequence[SimulationInput], box: Coordinates, tolerance: float = TOLERANCE
) -> Span:
    """Nodes for every RC pair in a box, as far as an interval can tell it from a faster one."""
    interval_s = min(float(np.min(np.asarray(each.intervals.node_s))) for each in all_inputs)
    return span_of(max(box.shortest_tau_s, interval_s / AT_ONCE), box.longest_tau_s, tolerance)


def _factor(
    inputs: SimulationInput, in_tau: Span, in_rate: Span | None
) -> Float[np.ndarray, "columns columns"]:
    """The triangular factor of all scored samples of one record."""
    with threads(CHAINS) as pool:
        chains: list = [None] * CHAINS
        for number, block in enumerate(_blocks(inputs, in_tau, in_rate)):
            chain = number % CHAINS
            done = chains[chain]
            start = done.result() if done else np.zeros((block.shape[1],) * 2)
            chains[chain] = pool.submit(extend, start, block)
        return reduce(extend, [chain.result() for chain in chains if chain])


def extend(
    factor: Float[np.ndarray, "columns columns"],
    rows: Float[np.ndarray, "rows columns"],
    reflectors: int = REFLECTORS,
) -> Float[np.ndarray, "columns columns"]:
    """The triangular factor of a triangular factor and more rows."""
    tpqrt: Any = get_lapack_funcs("tpqrt", (factor,))
    width = min(reflectors, len(factor))
    for first in range(0, len(rows), PANEL):
        panel = np.array(rows[first : first + PANEL], order="F")
        factor = tpqrt(0, width, factor, panel, overwrite_b=True)[0]
    return factor


def shorten(
    factor: Float[np.ndarray, "rows columns"], negligible: float
) -> Float[np.ndarray, "fewer columns"]:
    """The same lengths of all combinations of columns with fewer rows, up to `negligible`."""
    decomposed: Any = qr(factor, mode="r", pivoting=True)
    triangle, order = decomposed[0][: min(factor.shape)], decomposed[1]
    lengths = np.sqrt(np.cumsum(triangle[::-1] ** 2, axis=0)[::-1].max(axis=1))
    wanted = int(np.count_nonzero(lengths > negligible))
    shorter = np.zeros((-(-max(wanted, 1) // ROW_STEP) * ROW_STEP, factor.shape[1]))
    kept = triangle[: len(shorter)]
    shorter[: len(kept), order] = kept
    return shorter


def _blocks(
    inputs: SimulationInput, in_tau: Span, in_rate: Span | None
) -> Iterator[Float[np.ndarray, "scored columns"]]:
    """The columns of the problem at the scored samples, block after block."""
    # In few sizes, so that records with other clocks share one program.
    inputs = inputs.map_clocks(
        lambda clock: clock.with_nodes(1 << (len(clock.node_s) - 1).bit_length())
    )
    tau, turn_tau = padded_tau(in_tau), np.empty(0) if in_rate is None else padded_tau(in_rate)
    state, turned = np.zeros(tau.shape), np.zeros(turn_tau.shape)
    for first in range(0, len(inputs.current_a), BLOCK):
        here = slice(first, first + BLOCK)
        # Of NumPy's arrays, where JAX's are declared.
        block: Any = inputs.map_samples(lambda array, here=here: np.asarray(array)[here])
        state, answers = answer_block(tau, state, block.held_a, block.intervals)
        columns, moved = [answers[:, : len(in_tau.skeleton)]], block.hysteresis
        if in_rate is not None and moved is not None:
            turning = moved.hysteresis_input
            turned, turns = answer_block(turn_tau, turned, turning, moved.intervals)
            columns.append(-moved.amplitude_v[:, None] * turns[:, : len(in_rate.skeleton)])
        columns += [block.current_a[:, None], block.base_error_v[:, None]]
        rows = np.concatenate(columns, axis=1)
        yield rows if block.weight is None else rows[block.weight > 0]


def padded_tau(span: Span) -> Float[np.ndarray, "skeleton"]:
    """The skeleton's time constants, filled up by the last one."""
    return np.pad(span.skeleton_tau, (0, -len(span.skeleton_tau) % TAU_STEP), "edge")


def answer_block(
    tau: Float[np.ndarray, "skeleton"],
    state: Float[np.ndarray, "skeleton *channels"],
    held: Float[np.ndarray, "samples *channels"],
    intervals: Intervals,
) -> tuple[
    Float[np.ndarray, "skeleton *channels"], Float[np.ndarray, "samples skeleton *channels"]
]:
    """The state after a block of at most `BLOCK` samples, and the answers at them."""
    # One shape for all: what is added at the end moves no answer, and nothing follows it.
    sampled = (
        as_input(np.pad(each, [(0, BLOCK - len(each))] + [(0, 0)] * (each.ndim - 1)))
        for each in map(np.asarray, (held, intervals.node, intervals.offset_s))
    )
    given, node, offset_s = sampled
    intervals = replace(intervals, node=node, offset_s=offset_s)
    after, answers = _respond(as_input(tau), as_input(state), given, intervals)
    return np.asarray(after), np.asarray(answers)[: len(held)]


@eqx.filter_jit
def _respond(tau, state, held, intervals: Intervals):
    respond_all = jax.vmap(partial(respond, held=held, intervals=intervals), out_axes=(0, 1))
    return respond_all(tau, state)

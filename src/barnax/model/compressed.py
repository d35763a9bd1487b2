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
from typing import Any, NamedTuple

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
from .search_space import Range
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
            responses = np.zeros((len(filled), len(in_rate.nodes)), factor.dtype)
            responses[:rows, : factor.shape[1] - nodes - 2] = factor[:, nodes:-2]
            filled = np.insert(filled, [len(in_tau.nodes)], responses, axis=1)
        filled[:rows, -2:] = factor[:, -2:]
        return Compressed(self.scored, as_input(filled), in_tau, in_rate)


def compress(all_inputs: Sequence[SimulationInput], box: Coordinates) -> Compressed:
    """One or several records, reduced together. Call inside float64.

    The samples go through in blocks of `BLOCK`; nothing longer is ever held. Raises `InputError`
    where the box is too wide for the accuracy promised.
    """
    spans = Spans.of(all_inputs, box)
    # One thread each: what a library does with several would change the last bits.
    with one_blas_thread():
        whole = reduce(update_triangular, [_factor(inputs, spans) for inputs in all_inputs])
        scored = sum(float(inputs.scored) for inputs in all_inputs)
        factor = shorten(spans.to_nodes(whole), NEGLIGIBLE_V * math.sqrt(scored))
    return spans.evaluator(factor, scored)


class Spans(NamedTuple):
    """Nodes for every RC pair of a box, and for a dynamic hysteresis where there is one."""

    in_tau: Span
    in_rate: Span | None

    @classmethod
    def of(
        cls, all_inputs: Sequence[SimulationInput], box: Coordinates, tolerance: float = TOLERANCE
    ) -> "Spans":
        """Those of every circuit in a box."""
        interval_s = min(float(np.min(np.asarray(each.intervals.node_s))) for each in all_inputs)
        taus_s = box.shortest_tau_s, box.longest_tau_s
        return cls.between(taus_s, box.gamma_limits, interval_s, tolerance)

    @classmethod
    def between(
        cls, taus_s: Range, gammas: Range | None, interval_s: float, tolerance: float = TOLERANCE
    ) -> "Spans":
        """Those between some ends, as far as an interval can tell a pair from a faster one.

        Raises `InputError` where these are too far apart.
        """
        in_tau = span_of(max(taus_s[0], interval_s / AT_ONCE), taus_s[1], tolerance)
        in_rate = None if gammas is None else span_of(1 / gammas[1], 1 / gammas[0], tolerance)
        return cls(in_tau, in_rate)

    def to_nodes(
        self, factor: Float[np.ndarray, "rows columns"]
    ) -> Float[np.ndarray, "rows more_columns"]:
        """The columns of all nodes from those of the skeletons; the last two stay."""
        count = len(self.in_tau.skeleton)
        columns = [factor[:, :count] @ self.in_tau.from_skeleton]
        if self.in_rate is not None:
            columns.append(factor[:, count:-2] @ self.in_rate.from_skeleton)
        return np.concatenate([*columns, factor[:, -2:]], axis=1)

    def evaluator(self, factor: Float[np.ndarray, "rows columns"], scored: float) -> Compressed:
        """The objective of a factor with the columns of all nodes. Call inside float64."""
        in_rate = None if self.in_rate is None else Lagrange.of(self.in_rate)
        return Compressed(as_input(scored), as_input(factor), Lagrange.of(self.in_tau), in_rate)


def _factor(inputs: SimulationInput, spans: Spans) -> Float[np.ndarray, "columns columns"]:
    """The triangular factor of all scored samples of one record."""
    with threads(CHAINS) as pool:
        chains: list = [None] * CHAINS
        for number, block in enumerate(scored_rows(inputs, spans)):
            chain = number % CHAINS
            done = chains[chain]
            start = done.result() if done else np.zeros((block.shape[1],) * 2)
            chains[chain] = pool.submit(update_triangular, start, block)
        return reduce(update_triangular, [chain.result() for chain in chains if chain])


def update_triangular(
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


def scored_rows(
    inputs: SimulationInput, spans: Spans
) -> Iterator[Float[np.ndarray, "scored columns"]]:
    """The answers of the skeletons, the current and the base error at the scored samples, block
    after block. Call inside float64."""
    in_tau, in_rate = spans
    # In few sizes, so that records with other clocks share one program.
    inputs = inputs.map_clocks(
        lambda clock: clock.with_nodes(1 << (len(clock.node_s) - 1).bit_length())
    )
    tau, rate_tau = padded_tau(in_tau), np.empty(0) if in_rate is None else padded_tau(in_rate)
    state, hysteresis_state = np.zeros(tau.shape), np.zeros(rate_tau.shape)
    for first in range(0, len(inputs.current_a), BLOCK):
        here = slice(first, first + BLOCK)
        # Of NumPy's arrays, where JAX's are declared.
        block: Any = inputs.map_samples(lambda array, here=here: np.asarray(array)[here])
        state, answers = answer_block(tau, state, block.held_a, block.intervals)
        columns, hysteresis = [answers[:, : len(in_tau.skeleton)]], block.hysteresis
        if in_rate is not None and hysteresis is not None:
            hysteresis_state, response = answer_block(
                rate_tau, hysteresis_state, hysteresis.hysteresis_input, hysteresis.intervals
            )
            columns.append(-hysteresis.amplitude_v[:, None] * response[:, : len(in_rate.skeleton)])
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

"""Records reduced to factors whose size does not depend on their length.

For given time constants the error is linear in every table: its columns are the current weighted by
each node's hat function, low-passed. A constant circuit has one node. The low-passed signals of any
time constant are combinations of those of a few (`exponentials`), so the triangular factor of [few
time constants x nodes, other columns, base error] gives the columns of all.
"""

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from ..cell.tables import hats
from ..execution import as_input, compile_for, in_float64, threads
from .exponentials import Span
from .layout import SETTLED, Layout, by_last_change
from .prepared import BLOCK, PreparedRecord
from .triangles import NEGLIGIBLE_V, append_rows, join_triangles, shorten, update_triangular

if TYPE_CHECKING:
    from .sampling_intervals import Intervals
    from .simulate import SimulationInput

# Chains of factors that are combined at the end; a fixed number, so that no bit depends on the
# number of cores.
CHAINS = 2
# Time constants are simulated in multiples of this, so that spans of many widths share a program.
TAU_STEP = 8
# Nodes whose responses are computed at once.
CHANNELS = 4
# From so many times as many rows as columns, a block is reduced by itself first.
MANY = 2

Columns = Float[np.ndarray, "rows columns"]


@dataclass(frozen=True, eq=False)
class Reduced:
    """e = base + (columns) x, up to a rotation, so that |e|^2 is the mean squared error."""

    layout: Layout
    scored: int
    factor: Columns
    # The columns in the order in which the factor is triangular, if it is.
    order: Int[np.ndarray, "columns"] | None = None

    def part(self, name: str) -> Float[np.ndarray, "few rows width"]:
        """The columns of a part of the layout."""
        scale = 1 / math.sqrt(max(self.scored, 1))
        # Contiguous for the products of a search, which are over the first axis.
        return np.multiply(self._block(name).transpose(1, 0, 2), scale, order="C")

    def _block(self, name: str) -> Float[np.ndarray, "rows few width"]:
        indices = self.layout.columns[name]
        if not indices.size:
            return np.empty((len(self.factor), *indices.shape))
        block = self.factor[:, indices[0, 0] : indices[-1, -1] + 1]
        return block.reshape(len(block), *indices.shape)

    def of_voltage(self, number: int) -> "Reduced":
        """The factor of one of several voltages: the remainder of its base error is one row."""
        indices = self.layout.columns["base"][:, 0]
        columns = np.delete(np.arange(self.layout.width), np.delete(indices, number))
        above, below = np.split(self.factor[:, columns], [indices[0]])
        last = np.zeros((1, len(columns)))
        last[0, -1] = np.linalg.norm(below[:, -1])
        return Reduced(
            replace(self.layout, voltages=(0,)), self.scored, np.concatenate([above, last])
        )

    def coarser(self, layout: Layout) -> "Reduced":
        """The factor of a circuit with a part of these columns: resistances at a subset of the
        nodes, or with one value at every SOC, for coarser hats are sums of finer ones; with or
        without the dynamic hysteresis and the table of the OCV; some of the voltages."""
        if all(
            getattr(layout, n) == getattr(self.layout, n) for n in ("nodes", "sizes", "voltages")
        ):
            # Factors are large: unchanged columns are shared, not copied.
            return replace(self, order=None)
        to_coarser = hats(np.array(self.layout.nodes), layout.nodes)

        def columns(name: str) -> Columns:
            block = self._block(name)
            if name == "base":
                block = block[:, [self.layout.voltages.index(number) for number in layout.voltages]]
            elif name != "correction" and block.shape[2] == len(to_coarser):
                block = block @ to_coarser
            return block.reshape(len(block), -1)

        kept = [name for name, (count, _) in layout.sizes.items() if count]
        return Reduced(layout, self.scored, np.concatenate([columns(n) for n in kept], axis=1))


@in_float64
def reduce_records(
    prepared_records: Sequence[PreparedRecord],
    layout: Layout,
    groups: Sequence[Int[np.ndarray, "simulated"]],
    count: int,
    voltage_offsets_v: Sequence[Float[np.ndarray, "simulated voltages"]] | None = None,
) -> list[Reduced]:
    """The factor of each of `count` groups of samples; `groups` number those of every record, -1
    for samples that are not scored. The columns of one block of samples are in memory at a time.
    `voltage_offsets_v` are several voltages minus the record's, for every record.
    """
    order = by_last_change(prepared_records, layout)
    chains: dict[tuple[int, int], Future] = {}
    scored = np.zeros(count, int)
    with threads(CHAINS) as pool:
        offsets_v = voltage_offsets_v or [None] * len(groups)
        for prepared, group_of_sample, each in zip(
            prepared_records, groups, offsets_v, strict=True
        ):
            for turn, block in enumerate(blocks(prepared, layout, each)):
                numbers = group_of_sample[block.here]
                for group in np.unique(numbers[numbers >= 0]).tolist():
                    is_member = numbers == group
                    scored[group] += np.count_nonzero(is_member)
                    # A single group has two chains, so that two cores share it.
                    chain = group, turn % CHAINS if count == 1 else 0
                    # Waiting here keeps no more blocks in memory than there are chains.
                    done = chains.get(chain)
                    before = done.result() if done else _Triangle.empty(order)
                    chains[chain] = pool.submit(before.joined_by, block, is_member)
        reduced_groups = []
        for group, number in enumerate(scored.tolist()):
            # Each is released once it is put in order: it is as large as the result.
            done = [chains.pop(chain) for chain in sorted(chains) if chain[0] == group]
            parts = [done.pop(0).result().reduced(layout, number) for _ in range(len(done))]
            parts = parts or [_Triangle.empty(order).reduced(layout, number)]
            reduced_groups.append(replace(_joined(parts), scored=number))
        return reduced_groups


@dataclass(eq=False)
class _Triangle:
    """The triangular factor of the samples of one chain so far, with the order of its columns.
    Columns that no sample has changed are empty. It is kept transposed, as LAPACK reads it."""

    order: Int[np.ndarray, "columns"]
    position: Int[np.ndarray, "columns"]
    is_changed: Bool[np.ndarray, "columns"]
    transposed: Float[np.ndarray, "columns columns"]

    @classmethod
    def empty(cls, order: Int[np.ndarray, "columns"]) -> "_Triangle":
        width = len(order)
        return cls(order, np.argsort(order), np.zeros(width, bool), np.zeros((width,) * 2))

    def joined_by(self, block: "ColumnBlock", is_member: Bool[np.ndarray, "_"]) -> "_Triangle":
        """This factor, with the samples of a block that belong to it."""
        changed = self.position[block.changed]
        self.is_changed[changed] = True
        first = int(changed.min())
        used = first + np.flatnonzero(self.is_changed[first:])
        local = block.local_columns if np.all(is_member) else block.local_columns[is_member]
        few = local.shape[1]
        if len(local) > MANY * few and few < len(used):
            local = update_triangular(np.zeros((few, few)), local)
        rows = block.rows(local, self.order[used])
        at = np.ix_(used, used)
        self.transposed[at] = update_triangular(self.transposed[at].T, rows).T
        return self

    def reduced(self, layout: Layout, scored: int) -> Reduced:
        return Reduced(layout, scored, self.transposed[self.position].T, self.order)


def _joined(parts: Sequence[Reduced]) -> Reduced:
    """The factor of the samples of all parts, triangular as theirs."""
    if not parts[1:]:
        return parts[0]
    order = parts[0].order
    assert order is not None
    used = np.flatnonzero(np.any([part.factor.any(axis=0) for part in parts], axis=0)[order])
    at, columns = np.ix_(order[used], used), np.zeros_like(parts[0].factor.T)
    if used.size:
        columns[at] = join_triangles(part.factor.T[at].T for part in parts).T
    return Reduced(parts[0].layout, sum(part.scored for part in parts), columns.T, order)


def combine_factors(parts: Sequence[Reduced]) -> Reduced:
    """All parts as one, without rows that are rounding."""
    first = parts[0]
    if all(part.order is not None and part.order is first.order for part in parts):
        factor = _joined(parts).factor
    else:
        factor = reduce(append_rows, [part.factor for part in parts])
    scored = sum(part.scored for part in parts)
    factor = shorten(factor, NEGLIGIBLE_V * math.sqrt(scored))
    return Reduced(first.layout, scored, factor)


@dataclass(frozen=True, eq=False)
class ColumnBlock:
    """The columns at the samples `here` of a record.

    Samples near only a few nodes change only these `columns`, the last of `local_columns`: all
    others, `far`, are the remainders of earlier responses, which decay alike at every node. The
    first of `local_columns` are those decays, and `left` is the amount of each at every other node.
    """

    here: slice
    local_columns: Float[np.ndarray, "samples few"]
    columns: Int[np.ndarray, "columns"]
    far: Int[np.ndarray, "decays others"]
    left: Float[np.ndarray, "decays others"]

    @property
    def changed(self) -> Int[np.ndarray, "changed"]:
        """The columns that are not zero at these samples."""
        return np.append(self.columns, self.far[self.left != 0])

    def rows(
        self, local: Float[np.ndarray, "rows few"], wanted: Int[np.ndarray, "wanted"]
    ) -> Columns:
        """The wanted columns of some rows of local ones, in Fortran's order."""
        index = np.zeros(np.max(wanted) + 1, int)
        index[wanted] = np.arange(len(wanted))
        few, decaying = np.ascontiguousarray(local.T), local.shape[1] - len(self.columns)
        wide = np.zeros((len(wanted), len(local)))
        wide[index[self.columns]] = few[decaying:]
        decay, node = np.nonzero(self.left)
        wide[index[self.far[decay, node]]] = few[decay] * self.left[decay, node, None]
        return wide.T


def blocks(
    prepared: PreparedRecord,
    layout: Layout,
    voltage_offsets_v: Float[np.ndarray, "simulated voltages"] | None = None,
) -> Iterator[ColumnBlock]:
    """The columns at all samples of a record, block after block. Call inside float64."""
    nodes, rate = np.array(layout.nodes), layout.in_rate
    settled_a = SETTLED * float(np.max(np.abs(prepared.current_a)))
    pairs = _SharedAnswers(layout.in_tau, len(nodes), settled_a)
    rate_tau = np.empty(0) if rate is None else padded_tau(rate)
    hysteresis_state = np.zeros(len(rate_tau))
    highest_gamma = None if rate is None else 1 / float(rate_tau.min())
    start = float(prepared.start.direction)
    fastest_s = float(layout.in_tau.skeleton_tau.min())
    for here, inputs in prepared.input_blocks(BLOCK, fastest_s, highest_gamma):
        hysteresis, size = inputs.hysteresis, here.stop - here.start
        spread = hats(prepared.soc[here], nodes)
        near = np.flatnonzero(np.any(spread, axis=0))
        spread = spread[:, near]
        left, decays, answers = pairs.next_block(inputs, near, spread)
        base = np.asarray(inputs.base_error_v)[:size, None]
        if voltage_offsets_v is not None:
            base = base + voltage_offsets_v[here]

        into, columns = [layout.columns["pairs"][:, near]], [answers]
        if rate is not None and hysteresis is not None:
            turning = np.asarray(hysteresis.hysteresis_input)
            hysteresis_state, response = response_block(
                rate_tau, hysteresis_state, turning, hysteresis.intervals
            )
            response = response[:size, : len(rate.skeleton)]
            amplitude_v = np.asarray(hysteresis.amplitude_v)[:size, None]
            if layout.has_amplitude:
                # Relative to no hysteresis rather than to the measured amplitude.
                base = base + start * amplitude_v
                into += [
                    layout.columns[name][:, near]
                    for name in ("hysteresis_response", "initial_hysteresis")
                ]
                columns += [-response[:, :, None] * spread[:, None], -start * spread]
            else:
                into.append(layout.columns["hysteresis_response"])
                columns.append(-response * amplitude_v)
        into.append(layout.columns["current"][:, near])
        columns.append(np.asarray(inputs.current_a)[:size, None] * spread)
        if layout.has_correction:
            spread = hats(prepared.soc[here], layout.ocv_nodes)
            near = np.flatnonzero(np.any(spread, axis=0))
            into.append(layout.columns["correction"][:, near])
            columns.append(-spread[:, near])
        into.append(layout.columns["base"])
        columns.append(base)
        far = np.flatnonzero(np.any(left, axis=0))
        left = left[: len(far) and len(left), far]
        if len(far):
            columns = [decays, *columns]
        local = np.concatenate([column.reshape(size, -1) for column in columns], axis=1)
        moved = np.concatenate([indices.ravel() for indices in into])
        yield ColumnBlock(here, local, moved, layout.columns["pairs"][: len(left), far], left)


class _SharedAnswers:
    """The skeleton's responses to a current shared among nodes, block by block."""

    def __init__(self, span: Span, nodes: int, settled_a: float):
        self._tau, self._count = padded_tau(span), len(span.skeleton)
        self._settled_a = settled_a
        self._states = np.zeros((len(self._tau), nodes))

    def next_block(
        self, inputs: "SimulationInput", near: Int[np.ndarray, "near"], spread: Columns
    ) -> tuple[
        Float[np.ndarray, "skeleton nodes"],
        Float[np.ndarray, "samples skeleton"],
        Float[np.ndarray, "samples skeleton near"],
    ]:
        """The remainder of earlier responses at nodes that are not near, its decay, and the
        responses at those that are."""
        # If every node is near, no response elsewhere is left that could decay.
        has_far = int(len(near) < self._states.shape[1])
        size, wide = len(spread), has_far + len(near)
        # The first channel, if there is one for decay, starts from one and has no current.
        held = np.zeros((BLOCK, -(-wide // CHANNELS) * CHANNELS if wide > 1 else 1))
        held[:size, has_far:wide] = spread * np.asarray(inputs.held_a)[:size, None]
        states = np.zeros((len(self._tau), held.shape[1]))
        states[:, :has_far], states[:, has_far:wide] = 1.0, self._states[:, near]
        # A few channels at a time, so that one program serves any number of near nodes.
        parts = [
            response_block(
                self._tau,
                states[:, first : first + CHANNELS],
                held[:, first : first + CHANNELS],
                inputs.intervals,
            )
            for first in range(0, held.shape[1], CHANNELS)
        ]
        ends, answers = parts[0]
        if len(parts) > 1:
            ends = np.concatenate([part for part, _ in parts], axis=1)
            answers = np.concatenate([part for _, part in parts], axis=2)
        answers = answers[:size, : self._count]
        left = self._states.copy()
        left[:, near] = 0.0
        left[np.abs(left) < self._settled_a] = 0.0
        self._states = left * ends[:, :1]
        self._states[:, near] = ends[:, has_far:wide]
        return left[: self._count], answers[:, :, 0], answers[:, :, has_far:wide]


def padded_tau(span: Span) -> Float[np.ndarray, "skeleton"]:
    """The skeleton's time constants, padded with the last one."""
    return np.pad(span.skeleton_tau, (0, -len(span.skeleton_tau) % TAU_STEP), "edge")


def response_block(
    tau: Float[np.ndarray, "skeleton"],
    state: Float[np.ndarray, "skeleton *channels"],
    held: Float[np.ndarray, "samples *channels"],
    intervals: "Intervals",
) -> tuple[
    Float[np.ndarray, "skeleton *channels"], Float[np.ndarray, "samples skeleton *channels"]
]:
    """The state after a block of `BLOCK` samples, and the responses at them."""
    from .simulate import respond_all

    clock = np.asarray(intervals.node_s), np.asarray(intervals.node), np.asarray(intervals.offset_s)
    form = intervals.is_even, intervals.has_offsets
    given = as_input(tau), as_input(state), as_input(held), *clock, *form
    after, answers = compile_for(respond_all, *given)(*given)
    return np.asarray(after), np.asarray(answers)

"""Records reduced for tables over SOC, to factors whose size does not depend on their length.

For given time constants the error is linear in every table: its columns are the signals that each
node's hat shares out of the current, low-passed. The low-passed ones of any time constant are
combinations of those of a few (`model.exponentials`), so the triangular factor of [few time
constants x nodes, what else there is, base error] gives the columns of every time constant.
"""

import math
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from jaxtyping import Float, Int

from ..cell.tables import hats
from ..execution import in_float64, one_blas_thread
from ..model.compressed import BLOCK, NEGLIGIBLE_V, TOLERANCE, Answers, extend, shorten
from ..model.exponentials import Span, span_of
from ..model.inputs import PreparedRecord
from ..model.search_space import Range
from .simulate import TableInput

# Columns of one block reflector; there are ten times as many columns as for a constant circuit.
REFLECTORS = 32
CHAINS = 2

Columns = Float[np.ndarray, "rows columns"]


@dataclass(frozen=True, eq=False)
class Layout:
    """Which columns a factor has. `amplitude` says what a dynamic hysteresis has of them: none,
    those of the measured gap, or those of a table."""

    nodes: tuple[float, ...]
    in_tau: Span
    in_rate: Span | None
    has_correction: bool
    has_amplitude: bool

    @property
    def sizes(self) -> tuple[tuple[int, int], ...]:
        """Of pairs, turns, standing hysteresis, current, correction, base: how many of how wide."""
        nodes = len(self.nodes)
        turned = nodes if self.has_amplitude else 1
        return (
            (len(self.in_tau.skeleton), nodes),
            (0 if self.in_rate is None else len(self.in_rate.skeleton), turned),
            (int(self.has_amplitude), nodes),
            (1, nodes),
            (int(self.has_correction), nodes),
            (1, 1),
        )


@dataclass(frozen=True, eq=False)
class Reduced:
    """e = base + (columns) x, up to a rotation, so that |e|^2 is the mean squared error.

    `pairs` and `turns` are those of the skeletons; the others are the columns themselves.
    """

    layout: Layout
    scored: int
    factor: Columns

    def part(self, number: int) -> Float[np.ndarray, "few rows width"]:
        """The columns of the layout's part of that number."""
        starts = np.cumsum([0, *(count * width for count, width in self.layout.sizes)])
        count, width = self.layout.sizes[number]
        block = self.factor[:, starts[number] : starts[number + 1]] / math.sqrt(max(self.scored, 1))
        # Contiguous for the products of a search, which are over the first axis.
        return np.ascontiguousarray(block.reshape(len(block), count, width).transpose(1, 0, 2))

    def constant(self) -> "Reduced":
        """The same for a circuit that does not change with SOC: hats add up to one everywhere."""
        parts = [self.part(number) for number in range(6)]
        summed = [part.sum(axis=2) for part in parts]
        layout = replace(self.layout, nodes=(0.5,), has_correction=False)
        kept = [summed[number] for number in (0, 1, 2, 3, 5)]
        factor = np.concatenate(kept).T * math.sqrt(self.scored)
        return Reduced(layout, self.scored, factor)


@in_float64
def reduce_records(
    prepared_records: Sequence[PreparedRecord],
    layout: Layout,
    groups: Sequence[Int[np.ndarray, "_"]],
    count: int,
) -> list[Reduced]:
    """The factor of each of `count` groups of samples; `groups` number those of every record, -1
    for samples that do not count. Nothing longer than a block is ever held.
    """
    width = sum(count * each for count, each in layout.sizes)
    chains: dict[tuple[int, int], Future] = {}
    scored = [sum(int(np.sum(each == group)) for each in groups) for group in range(count)]
    with one_blas_thread(), ThreadPoolExecutor(CHAINS) as pool:
        for prepared, numbers in zip(prepared_records, groups, strict=True):
            for turn, (here, block) in enumerate(blocks(prepared, layout)):
                for group in np.unique(numbers[here][numbers[here] >= 0]).tolist():
                    # One group alone has two chains, so that two cores share it.
                    chain = group, turn % CHAINS if count == 1 else 0
                    # Waiting here keeps no more blocks than there are chains.
                    done = chains.get(chain)
                    before = done.result() if done else np.zeros((width, width))
                    chains[chain] = pool.submit(join, before, block[numbers[here] == group])
        factors = [
            [done.result() for (own, _), done in chains.items() if own == group]
            for group in range(count)
        ]
        return [
            Reduced(layout, number, reduce(join, own, np.zeros((width, width))))
            for number, own in zip(scored, factors, strict=True)
        ]


def together(parts: Sequence[Reduced]) -> Reduced:
    """All of them as one, without rows that are rounding."""
    with one_blas_thread():
        factor = reduce(join, [part.factor for part in parts])
        scored = sum(part.scored for part in parts)
        factor = shorten(factor, NEGLIGIBLE_V * math.sqrt(scored))
    return Reduced(parts[0].layout, scored, factor)


def join(
    factor: Float[np.ndarray, "columns columns"], rows: Columns
) -> Float[np.ndarray, "columns columns"]:
    """The triangular factor with more rows.

    Nodes that were not visited yet have empty columns, which are left out: half of all on a
    discharge, and so three quarters of the work.
    """
    used = np.flatnonzero(np.any(factor, axis=0) | np.any(rows, axis=0))
    joined = np.zeros_like(factor)
    rows = rows[np.any(rows, axis=1)]
    joined[np.ix_(used, used)] = extend(factor[np.ix_(used, used)], rows[:, used], REFLECTORS)
    return joined


def layout_of(
    nodes: tuple[float, ...],
    tau_range_s: Range,
    gamma_range: Range | None,
    has_correction: bool,
    has_amplitude: bool,
) -> Layout:
    """Columns for time constants and rates of these ranges, to the accuracy of the scan.

    Raises `InputError` where a range is too wide.
    """
    in_rate = None
    if gamma_range is not None:
        in_rate = span_of(1 / gamma_range[1], 1 / gamma_range[0], TOLERANCE)
    in_tau = span_of(*tau_range_s, TOLERANCE)
    return Layout(nodes, in_tau, in_rate, has_correction, has_amplitude)


def blocks(
    prepared: PreparedRecord, layout: Layout
) -> Iterator[tuple[slice, Float[np.ndarray, "samples columns"]]]:
    """The columns at all samples of a record, block after block."""
    nodes, rate = np.array(layout.nodes), layout.in_rate
    slowest_gamma = None if rate is None else 1 / float(rate.skeleton_tau.min())
    given = TableInput.of(prepared, nodes, float(layout.in_tau.skeleton_tau.min()), slowest_gamma)
    inputs, moved = given.inputs, given.inputs.hysteresis

    def shares(here: slice) -> Float[np.ndarray, "samples nodes"]:
        return hats(prepared.soc[here], nodes)

    pairs = Answers(inputs.held_a, inputs.intervals, layout.in_tau, shares)
    turns = None
    if rate is not None and moved is not None:
        turns = Answers(moved.hysteresis_input, moved.intervals, rate)
    current_a, base_v = np.asarray(inputs.current_a), np.asarray(inputs.base_error_v)
    start = float(prepared.start.direction)
    for first in range(0, len(current_a), BLOCK):
        here = slice(first, first + BLOCK)
        spread = shares(here)
        base = base_v[here, None]
        columns = [pairs.next_block(here)]
        if turns is not None and moved is not None:
            amplitude_v = np.asarray(moved.amplitude_v)[here, None]
            amplitude_v = spread if layout.has_amplitude else amplitude_v
            columns.append(-turns.next_block(here)[:, :, None] * amplitude_v[:, None])
            if layout.has_amplitude:
                columns.append(-start * spread)
            else:
                base = base - start * amplitude_v
        columns.append(current_a[here, None] * spread)
        if layout.has_correction:
            columns.append(-spread)
        rows = [each.reshape(len(spread), -1) for each in (*columns, base)]
        yield here, np.concatenate(rows, axis=1)

"""Blocks of samples that are held out of a fit, and the groups of samples that factors are of."""

import math
from collections.abc import Sequence
from functools import partial

import numpy as np
from jaxtyping import Int

from ..cell.soc_axis import ABOVE_SOC, is_above
from ..model.prepared import PreparedRecord
from ..model.reduced import Groups
from ..records.segments import LEAST_REACH, reach_of_steps
from .settings import TableSettings

# Fewest blocks of a record in a fold, unless they would be shorter than the residuals' correlation.
FEWEST_BLOCKS, SHORTEST_BLOCK_S = 5, 30.0
# The lowest SOC of every band in which held-out errors are summed; the last is that above 10 %.
BANDS = (-math.inf, 0.03, ABOVE_SOC)


def block_numbers(
    prepared: PreparedRecord, settings: TableSettings, here: slice = slice(None)
) -> Int[np.ndarray, "samples"]:
    """The block of each of some samples of a record, -1 where one is not scored."""
    scored = prepared.scored[here]
    since_s = prepared.time_s[here] - prepared.time_s[np.argmax(prepared.scored)]
    return np.where(scored, np.floor(since_s / block_length_s(prepared, settings)), -1).astype(int)


def blocks_of(
    prepared_records: Sequence[PreparedRecord], settings: TableSettings
) -> tuple[list[Groups], int]:
    """Functions that number the groups of a record's samples, -1 where one is not scored, and how
    many groups there are.

    A record has two groups a fold, one fold after the other: its samples below 10 % SOC and those
    above, in every `folds`-th block.
    """
    folds = settings.folds
    if not folds:
        return [partial(_all_scored, prepared) for prepared in prepared_records], 1

    def group_of(here: slice, number: int) -> Int[np.ndarray, "samples"]:
        prepared = prepared_records[number]
        block = block_numbers(prepared, settings, here)
        group = 2 * (number * folds + block % folds) + is_above(prepared.soc[here])
        return np.where(block >= 0, group, -1)

    count = len(prepared_records)
    return [partial(group_of, number=n) for n in range(count)], 2 * folds * count


def _all_scored(prepared: PreparedRecord, here: slice) -> Int[np.ndarray, "samples"]:
    return np.where(prepared.scored[here], 0, -1)


def are_left_out_whole(prepared_records: Sequence[PreparedRecord]) -> bool:
    """True where the others tell the circuit without any one of the records: no charge alone
    does."""
    return len(prepared_records) > 1 and sum(map(is_loaded, prepared_records)) > 1


def is_loaded(prepared: PreparedRecord) -> bool:
    """True where the current steps at many states of charge; a charge steps at its ends."""
    scored = prepared.scored
    return reach_of_steps(prepared.held_a[scored], prepared.soc[scored]) > LEAST_REACH


def block_length_s(prepared: PreparedRecord, settings: TableSettings) -> float:
    """The length of a record's blocks: shorter ones where it has room for few in a fold, which
    would each hold out a range of SOC that no other sample visits."""
    room_s = prepared.scored_duration_s / (settings.folds * FEWEST_BLOCKS)
    return min(settings.block_s, max(room_s, SHORTEST_BLOCK_S))


def numbered_blocks(
    prepared_records: Sequence[PreparedRecord], settings: TableSettings
) -> tuple[list[Int[np.ndarray, "simulated"]], int]:
    """The block of every sample, counted over all records, -1 where one is not scored, and how many
    there are. A record's first block is of the first fold, so that each has its number's."""
    numbered, first, folds = [], 0, max(settings.folds, 1)
    for prepared in prepared_records:
        block = block_numbers(prepared, settings)
        numbered.append(np.where(block >= 0, block + first, -1))
        first += math.ceil((int(block.max()) + 1) / folds) * folds
    return numbered, first

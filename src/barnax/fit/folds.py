"""Blocks of samples, the folds in which they are held out, and records left out whole."""

import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Int

from ..cell.soc_axis import ABOVE_SOC, is_above
from ..model.prepared import PreparedRecord
from ..records.record import LEAST_REACH, reach_of_steps
from .settings import TableSettings

# Fewest blocks of a record in a fold, unless they would be shorter than the residuals' correlation
# time.
FEWEST_BLOCKS, SHORTEST_BLOCK_S = 5, 30.0
# The lowest SOC of every band in which held-out errors are summed; the last band is above 10 %.
BANDS = (-math.inf, 0.03, ABOVE_SOC)


def block_numbers(
    prepared: PreparedRecord, settings: TableSettings
) -> Int[np.ndarray, "simulated"]:
    """The block of each sample of a record, -1 where one is not scored."""
    since_s = prepared.time_s - prepared.time_s[np.argmax(prepared.scored)]
    block = np.floor(since_s / block_length_s(prepared, settings)).astype(np.int32)
    return np.where(prepared.scored, block, -1)


def blocks_of(
    prepared_records: Sequence[PreparedRecord], settings: TableSettings
) -> tuple[list[Int[np.ndarray, "simulated"]], int]:
    """The group of each sample of every record, -1 for one that is not scored, and the number of
    groups.

    A record has two groups per fold, one fold after the other: its samples below 10 % SOC and those
    above, in every `folds`-th block.
    """
    folds = settings.folds
    if not folds:
        return [prepared.scored.astype(np.int32) - 1 for prepared in prepared_records], 1
    groups = []
    for number, prepared in enumerate(prepared_records):
        block = block_numbers(prepared, settings)
        group = 2 * (number * folds + block % folds) + is_above(prepared.soc)
        groups.append(np.where(block >= 0, group, -1))
    return groups, 2 * folds * len(groups)


def supports_leave_one_out(prepared_records: Sequence[PreparedRecord]) -> bool:
    """True if the circuit can be identified without any one of the records: a charge alone does not
    suffice."""
    return len(prepared_records) > 1 and sum(map(is_loaded, prepared_records)) > 1


def is_loaded(prepared: PreparedRecord) -> bool:
    """True if the current steps at many states of charge; in a charge it steps at the ends."""
    scored = prepared.scored
    return reach_of_steps(prepared.held_a[scored], prepared.soc[scored]) > LEAST_REACH


def block_length_s(prepared: PreparedRecord, settings: TableSettings) -> float:
    """The length of a record's blocks: shorter if the record has only a few per fold, each of which
    would hold out a range of SOC that no other sample visits."""
    room_s = prepared.scored_duration_s / (settings.folds * FEWEST_BLOCKS)
    return min(settings.block_s, max(room_s, SHORTEST_BLOCK_S))


def numbered_blocks(
    prepared_records: Sequence[PreparedRecord], settings: TableSettings
) -> tuple[list[Int[np.ndarray, "simulated"]], int]:
    """The block of every sample, counted over all records, -1 for one that is not scored, and the
    number of blocks. A record's first block belongs to the first fold, so that a block's number
    gives its fold."""
    numbered, first, folds = [], 0, max(settings.folds, 1)
    for prepared in prepared_records:
        block = block_numbers(prepared, settings)
        numbered.append(np.where(block >= 0, block + first, -1))
        first += math.ceil((int(block.max()) + 1) / folds) * folds
    return numbered, first

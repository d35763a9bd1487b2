"""A stored comparison as a report asks for it: by record, and with differences either way round."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..comparison import ComparisonResult
    from ..comparison.parts import OverSeedsPart, RecordErrorsPart, RowPart

# Rows whose RMSE agree this closely, relative, found the same answer.
SAME_RMSE = 1e-5


@dataclass(frozen=True)
class Contrast:
    """The first row's RMSE minus the second's on one record, in V, with a 95 % interval.

    Where `is_narrow`, errors stay alike for longer than the bootstrap's blocks, and the interval
    is narrower than it should be. `seeds` are the wins and losses of the first row, seed by seed,
    and Wilcoxon's p-value.
    """

    difference_v: float
    interval_v: tuple[float, float]
    is_real: bool
    is_narrow: bool
    seeds: tuple[int, int, float] | None


def answered(result: "ComparisonResult") -> "list[RowPart]":
    """The rows that have an answer."""
    return [row for row in result.rows if row.identification is not None]


def records(result: "ComparisonResult") -> list[str]:
    """The names of the records: the identification record, then those for validation."""
    rows = answered(result)
    if not rows:
        return []
    return [errors.metrics.record for errors in _every(rows[0])]


def errors_on(row: "RowPart", record: int) -> "RecordErrorsPart":
    """A row's errors on a record by its place in `records`."""
    return _every(row)[record]


def rmse_on(row: "RowPart", record: int) -> float:
    """A row's RMSE in V on a record by its place in `records`."""
    return errors_on(row, record).metrics.rmse_v


def ranked(rows: "Sequence[RowPart]", record: int) -> "list[RowPart]":
    """Rows with the lowest RMSE on a record first."""
    return sorted(rows, key=lambda row: rmse_on(row, record))


def leaders(rows: "Sequence[RowPart]", record: int) -> "list[RowPart]":
    """The row with the lowest RMSE on a record, and those that found the same."""
    best_v = rmse_on(ranked(rows, record)[0], record)
    return [row for row in ranked(rows, record) if rmse_on(row, record) <= best_v * (1 + SAME_RMSE)]


def contrast(
    result: "ComparisonResult", first: "RowPart", second: "RowPart", record: int
) -> Contrast | None:
    """How two rows differ on a record, or None where that was not compared."""
    name = records(result)[record]
    for each in result.differences:
        is_there = each.record == name and each.is_validation == (record > 0)
        if not is_there or {each.first, each.second} != {first.name, second.name}:
            continue
        over_time, seeds = each.over_time, _seeds(each.over_seeds)
        low_v, high_v = over_time.interval_v
        found = Contrast(
            over_time.difference_v,
            (low_v, high_v),
            over_time.is_real,
            over_time.is_block_capped,
            seeds,
        )
        if each.first == first.name:
            return found
        return replace(
            found,
            difference_v=-found.difference_v,
            interval_v=(-high_v, -low_v),
            seeds=seeds and (seeds[1], seeds[0], seeds[2]),
        )
    return None


def _every(row: "RowPart") -> "list[RecordErrorsPart]":
    return [*([row.identification] if row.identification else []), *row.validation]


def _seeds(part: "OverSeedsPart | None") -> tuple[int, int, float] | None:
    return None if part is None else (part.wins, part.losses, part.p_value)

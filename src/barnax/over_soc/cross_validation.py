"""Errors of tables over SOC on blocks of samples that were held out of their fit."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from scipy.special import stdtrit

from ..cell.parameters import ANYWHERE
from ..cell.soc_axis import is_above
from ..model.box_least_squares import least_in_box
from ..model.prepared import PreparedRecord
from ..model.reduced import Groups, Reduced
from ..records.segments import LEAST_REACH, reach_of_steps
from ..uncertainty.covariance import CONFIDENCE
from .intervals import NodeInterval
from .objective import Solution, TableObjective
from .search import find_best
from .settings import TableSettings

# Fewest blocks of a record in a fold, unless they would be shorter than the residuals' correlation.
FEWEST_BLOCKS, SHORTEST_BLOCK_S = 5, 30.0
# An extra is worth its parameters where it lowers both held-out errors by more than this share.
WORTHWHILE = 0.1
# Fewer records tell no spread.
FEWEST_RECORDS = 3
# And by more than this: what voltmeters cannot resolve is no reason for another circuit.
LEAST_GAIN_V = 1e-4


@dataclass(frozen=True)
class SocErrors:
    """RMSE over all samples that count, and over those above 10 % SOC; None without such."""

    rmse_v: float
    above_v: float | None

    @classmethod
    def of(cls, parts: Iterable[tuple[Float[np.ndarray, "_"], Float[np.ndarray, "_"]]]):
        """The RMSE of errors at states of charge, part after part."""
        squares_v2, counts = np.zeros(2), np.zeros(2, int)
        for error_v, soc in parts:
            group = is_above(soc).astype(int)
            squares_v2 += np.bincount(group, error_v**2, minlength=2)
            counts += np.bincount(group, minlength=2)
        return cls.of_squares(squares_v2, counts)

    @classmethod
    def of_squares(cls, squares_v2: Float[np.ndarray, "2"], counts: Int[np.ndarray, "2"]):
        """The RMSE of sums of squares below 10 % SOC and above, of so many samples."""
        above_v = float(np.sqrt(squares_v2[1] / counts[1])) if counts[1] else None
        return cls(float(np.sqrt(squares_v2.sum() / counts.sum())), above_v)

    def is_worth(self, simpler: "SocErrors") -> bool:
        """True where both are below a simpler circuit's by more than `WORTHWHILE`."""

        def falls(own_v: float | None, other_v: float | None) -> bool:
            if own_v is None or other_v is None:
                return True
            return own_v < min((1 - WORTHWHILE) * other_v, other_v - LEAST_GAIN_V)

        return falls(self.rmse_v, simpler.rmse_v) and falls(self.above_v, simpler.above_v)

    def is_close_to(self, other: "SocErrors") -> bool:
        """True where neither is higher than another's by more than `WORTHWHILE`."""
        near = (1 - WORTHWHILE) * self.rmse_v, self.above_v and (1 - WORTHWHILE) * self.above_v
        return SocErrors(*near).is_no_worse(other)

    def is_no_worse(self, other: "SocErrors") -> bool:
        """True where neither is higher than another's."""
        pairs = (self.rmse_v, other.rmse_v), (self.above_v, other.above_v)
        return all(own is None or it is None or own <= it for own, it in pairs)


@dataclass(frozen=True)
class CrossValidation:
    """Errors on samples that were held out of the fit, of the tables and of the constant circuit.

    Of one record under load, with or without charges beside it, each of the `folds` holds every
    `folds`-th block of each, the first one's of `block_s` seconds. Several under load are left out
    whole, one after another: `block_s` is None, and `by_record` has the tables' errors on each,
    from the start that is told of it, and `registered` those from the start and capacity that it
    has among the others. Time constants are those of all samples; what is linear is fitted in each
    fold anew. The constant circuit is the same one with one value for every SOC and no OCV
    correction. Where resistances follow more than SOC, `by_soc_alone` is of tables that do not.
    Where one value for every SOC predicts as well as tables, and is the answer, `over_soc` is of
    those.
    """

    folds: int
    block_s: float | None
    tables: SocErrors
    constant: SocErrors
    by_record: tuple[SocErrors, ...] = ()
    registered: tuple[SocErrors, ...] = ()
    by_soc_alone: SocErrors | None = None
    over_soc: SocErrors | None = None


def blocks_of(
    prepared_records: Sequence[PreparedRecord], settings: TableSettings
) -> tuple[list[Groups], int]:
    """Functions that number the groups of a record's samples, -1 where one is not scored, and how
    many groups there are.

    Two groups a fold: the samples below and above 10 % SOC. Several records are a fold each.
    """
    are_several = are_left_out_whole(prepared_records)

    def group(here: slice, number: int) -> Int[np.ndarray, "samples"]:
        prepared = prepared_records[number]
        if not settings.folds:
            return np.where(prepared.scored[here], 0, -1)
        fold = np.full(here.stop - here.start, number)
        if not are_several:
            start_s = prepared.time_s[np.argmax(prepared.scored)]
            block = np.floor(
                (prepared.time_s[here] - start_s) / _block_s(prepared, settings)
            ).astype(int)
            fold = block % settings.folds
        return np.where(prepared.scored[here], 2 * fold + is_above(prepared.soc[here]), -1)

    groups: list[Groups] = [partial(group, number=n) for n in range(len(prepared_records))]
    folds = len(prepared_records) if are_several and settings.folds else settings.folds
    return groups, 2 * folds or 1


def are_left_out_whole(prepared_records: Sequence[PreparedRecord]) -> bool:
    """True where the others tell the circuit without any one of the records: no charge alone
    does."""
    return len(prepared_records) > 1 and sum(map(is_loaded, prepared_records)) > 1


def is_loaded(prepared: PreparedRecord) -> bool:
    """True where the current steps at many states of charge; a charge steps at its ends."""
    scored = prepared.scored
    return reach_of_steps(prepared.held_a[scored], prepared.soc[scored]) > LEAST_REACH


def _block_s(prepared: PreparedRecord, settings: TableSettings) -> float:
    """The length of a record's blocks: shorter ones where it has room for few in a fold, which
    would each hold out a range of SOC that no other sample visits."""
    room_s = prepared.scored_duration_s / (settings.folds * FEWEST_BLOCKS)
    return min(settings.block_s, max(room_s, SHORTEST_BLOCK_S))


def cross_validate(objective: TableObjective, best: Solution) -> CrossValidation | None:
    """The held-out errors of a circuit.

    None where nothing is held out, or where all samples lie in one fold.
    """
    settings, parts, told = objective.settings, objective.parts, objective.told or objective.parts
    if not _has_folds(objective):
        return None
    by_record = len(objective.kept) > 1 or are_left_out_whole(objective.prepared_records)
    by_fold = constant = _held_out(objective, best, parts, told)
    registered = _held_out(objective, best, parts, parts) if objective.told else []
    if objective.tables > 1 + objective.pairs or objective.nodes > 1:
        plain = replace(settings, nodes=ANYWHERE, ocv_correction=False)
        at_every_soc = objective.reduced.constant()
        whole = replace(objective, reduced=at_every_soc, settings=plain, low_end=None)
        flat, flat_told = ([part.constant() for part in groups] for groups in (parts, told))
        constant = _held_out(whole, find_best(whole), flat, flat_told)
    return CrossValidation(
        len(parts) // 2,
        None if by_record else _block_s(objective.prepared_records[0], settings),
        _together(by_fold),
        _together(constant),
        tuple(map(_errors_of, by_fold)) if by_record else (),
        tuple(map(_errors_of, registered)),
    )


def held_out_errors(objective: TableObjective, best: Solution) -> SocErrors | None:
    """The errors on what is held out alone; None as `cross_validate` has it."""
    if not _has_folds(objective):
        return None
    told = objective.told or objective.parts
    return _together(_held_out(objective, best, objective.parts, told))


def record_errors(objective: TableObjective, best: Solution) -> tuple[SocErrors, ...]:
    """The errors on each record."""
    return tuple(map(_errors_of, zip(*squared_errors(objective, best), strict=True)))


def squared_errors(
    objective: TableObjective, best: Solution
) -> tuple[Float[np.ndarray, "groups 2"], Int[np.ndarray, "groups 2"]]:
    """Sums of squared errors in V^2 of every fold or record, and how many there are, below and
    above 10 % SOC."""
    groups = zip(objective.parts, *_at(objective, best, objective.parts), strict=True)
    squares = [
        part.scored * np.sum((base + columns @ best.unknowns) ** 2)
        for part, columns, base in groups
    ]
    counts = np.array([part.scored for part in objective.parts])
    return np.reshape(squares, (-1, 2)), counts.reshape(-1, 2)


def _has_folds(objective: TableObjective) -> bool:
    if not objective.settings.folds:
        return False
    scored = np.reshape([part.scored for part in objective.parts], (-1, 2)).sum(axis=1)
    return bool(np.count_nonzero(scored) > 1)


# Sums of squared errors in V^2, and how many there are, below and above 10 % SOC.
Sums = tuple[Float[np.ndarray, "2"], Int[np.ndarray, "2"]]


def _errors_of(sums: Sums) -> SocErrors:
    return SocErrors.of_squares(*sums)


def _together(folds: Sequence[Sums]) -> SocErrors:
    squares_v2, counts = (np.sum(sums, axis=0) for sums in zip(*folds, strict=True))
    return SocErrors.of_squares(squares_v2, counts)


def _held_out(
    objective: TableObjective, best: Solution, parts: Sequence[Reduced], told: Sequence[Reduced]
) -> list[Sums]:
    """Squared errors of every fold's samples, as they are told, by the tables of the others."""
    folds = len(parts) // 2
    # Of every group's factor only the columns at some scales are wanted.
    columns, bases = _at(objective, best, parts)
    told_columns, told_bases = (columns, bases) if told is parts else _at(objective, best, told)
    scored, counts = (np.array([part.scored for part in groups]) for groups in (parts, told))
    squares = np.zeros(len(parts))
    for fold in range(folds):
        is_rest = np.arange(len(parts)) // 2 != fold
        x = _fitted_to(objective, best, columns, bases, np.where(is_rest, scored, 0))
        for at in np.flatnonzero(~is_rest):
            squares[at] = counts[at] * np.sum((told_bases[at] + told_columns[at] @ x) ** 2)
    return list(zip(squares.reshape(-1, 2), counts.reshape(-1, 2), strict=True))


def _at(objective: TableObjective, best: Solution, parts: Sequence[Reduced]):
    """Every group's columns at the best time constants, and its base errors."""
    layout = objective.reduced.layout
    # From those of the factor, each of which adds to few: by one sparse product for each group.
    own = Reduced(layout, 1, np.eye(layout.width))
    columns, base = replace(objective, reduced=own, low_end=None).columns(best.log_scales)
    few = csr_array(np.column_stack([columns, base]).T)
    found = [(few @ part.factor.T).T / math.sqrt(max(part.scored, 1)) for part in parts]
    return [both[:, :-1] for both in found], [both[:, -1] for both in found]


def _fitted_to(
    objective: TableObjective,
    best: Solution,
    columns: Sequence[Float[np.ndarray, "_ columns"]],
    bases: Sequence[Float[np.ndarray, "_"]],
    scored: Int[np.ndarray, "groups"],
) -> Float[np.ndarray, "unknowns"]:
    """The unknowns that fit some groups of samples best, at the time constants of all."""
    normal, gradient = objective.penalty_normal.copy(), np.zeros(len(objective.penalty_normal))
    for at in np.flatnonzero(scored).tolist():
        share = scored[at] / scored.sum() * (1.0 if at % 2 else objective.weight_below**2)
        normal += share * columns[at].T @ columns[at]
        gradient += share * columns[at].T @ bases[at]
    return least_in_box(normal, gradient, *objective.box, best.sides)[0]


def with_spread(
    objective: TableObjective, best: Solution, intervals: Sequence[NodeInterval]
) -> tuple[NodeInterval, ...]:
    """The intervals of nodes with those of what another record of the cell would show.

    They follow from the spread of the records' own tables, at the time constants of all: the mean
    and t s sqrt(1 + 1 / n) of at least three records that visit a node, and at least as far as the
    joint interval. A record's own interval is far narrower than what another load of the same cell
    shows.
    """
    records, parts = objective.facts, objective.parts
    by_record = objective.kept or are_left_out_whole(objective.prepared_records)
    if len(records) < FEWEST_RECORDS or len(parts) != 2 * len(records) or not by_record:
        return tuple(intervals)
    columns, bases = _at(objective, best, parts)
    scored = np.array([part.scored for part in parts])
    rows, visits = [], []
    for number in range(len(records)):
        is_own = np.arange(len(parts)) // 2 == number
        x = _fitted_to(objective, best, columns, bases, np.where(is_own, scored, 0))
        alone = objective.alone(number)
        rows.append(objective.to_tables @ x)
        visits.append(np.concatenate([alone.visited_of(n) for n in range(objective.tables)]))
    values, is_there = np.array(rows), np.array(visits)

    def spread(interval: NodeInterval) -> NodeInterval:
        at = objective.visited_rows.get((interval.name, interval.soc))
        own = values[is_there[:, at], at] if at is not None else []
        if len(own) < FEWEST_RECORDS:
            return interval
        reach = stdtrit(len(own) - 1, (1 + CONFIDENCE) / 2) * np.std(own, ddof=1)
        reach = float(reach * np.sqrt(1 + 1 / len(own)))
        middle, least = float(np.mean(own)), 0.0 if interval.name.startswith("R") else -np.inf
        low, high = max(middle - reach, least), middle + reach
        if objective.kept:
            # Nothing else is known of the joint value than what the records make of it.
            error, both = (
                float(np.std(own, ddof=1)) / len(own) ** 0.5,
                reach / (len(own) + 1) ** 0.5,
            )
            ends = float(max(interval.value - both, least)), float(interval.value + both)
            interval = replace(interval, standard_error=error, low=ends[0], high=ends[1])
        if interval.low is not None and interval.high is not None:
            # What all records leave open, another one can show too.
            low, high = min(low, interval.low), max(high, interval.high)
        return replace(interval, record_low=low, record_high=high)

    return tuple(map(spread, intervals))

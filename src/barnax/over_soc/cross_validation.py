"""Errors of tables over SOC on blocks or whole records that were held out of their fit."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from scipy.special import stdtrit

from ..cell.parameters import ANYWHERE, OCV
from ..cell.soc_axis import is_above
from ..model.box_least_squares import least_in_box
from ..model.prepared import PreparedRecord
from ..model.reduced import Groups, Reduced
from ..records.segments import LEAST_REACH, reach_of_steps
from ..uncertainty.covariance import CONFIDENCE
from .means import mean_weights, parts_of
from .node_interval import NodeInterval
from .objective import Solution, TableObjective
from .search import find_best
from .settings import TableSettings

# Fewest blocks of a record in a fold, unless they would be shorter than the residuals' correlation.
FEWEST_BLOCKS, SHORTEST_BLOCK_S = 5, 30.0
# Fewer records tell no spread.
FEWEST_RECORDS = 3


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


@dataclass(frozen=True)
class CrossValidation:
    """Errors on samples that were held out of the fit, at the time constants of all samples.

    Attributes:
        folds: Folds of the blocks.
        block_s: Length of the blocks of the first record; None of kept records, which are left out
            whole.
        tables: Errors of the tables on blocks that were held out of them.
        constant: Those of the same circuit with one value for every SOC and no OCV correction.
        by_record: Errors of the tables on each record under load, left out whole: every record,
            the others too, from its start as given.
    """

    folds: int
    block_s: float | None
    tables: SocErrors
    constant: SocErrors
    by_record: tuple[SocErrors, ...] = ()

    @property
    def whole(self) -> SocErrors:
        """The errors to expect on another record of the cell, as far as there is one to tell."""
        return self.tables if not self.by_record else _pooled(self.by_record)


def _pooled(errors: Sequence[SocErrors]) -> SocErrors:
    """Errors of several records together, each counting alike."""
    above_v = [own.above_v for own in errors if own.above_v is not None]
    rms_v = [
        float(np.sqrt(np.mean(np.square(v)))) for v in ([e.rmse_v for e in errors], above_v) if v
    ]
    return SocErrors(rms_v[0], rms_v[1] if above_v else None)


def block_numbers(
    prepared: PreparedRecord, settings: TableSettings, here: slice = slice(None)
) -> Int[np.ndarray, "samples"]:
    """The block of each of some samples of a record, -1 where one is not scored."""
    scored = prepared.scored[here]
    since_s = prepared.time_s[here] - prepared.time_s[np.argmax(prepared.scored)]
    return np.where(scored, np.floor(since_s / _block_s(prepared, settings)), -1).astype(int)


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

    def group(here: slice, number: int) -> Int[np.ndarray, "samples"]:
        prepared = prepared_records[number]
        block = block_numbers(prepared, settings, here)
        own = 2 * (number * folds + block % folds) + is_above(prepared.soc[here])
        return np.where(block >= 0, own, -1)

    count = len(prepared_records)
    return [partial(group, number=n) for n in range(count)], 2 * folds * count


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


def _block_s(prepared: PreparedRecord, settings: TableSettings) -> float:
    """The length of a record's blocks: shorter ones where it has room for few in a fold, which
    would each hold out a range of SOC that no other sample visits."""
    room_s = prepared.scored_duration_s / (settings.folds * FEWEST_BLOCKS)
    return min(settings.block_s, max(room_s, SHORTEST_BLOCK_S))


def fold_of(objective: TableObjective) -> Int[np.ndarray, "groups"]:
    """The fold of every group of samples."""
    return np.arange(len(objective.parts)) // 2 % objective.folds


def record_of(objective: TableObjective) -> Int[np.ndarray, "groups"]:
    """The record of every group of samples."""
    return np.arange(len(objective.parts)) // (2 * objective.folds)


def cross_validate(objective: TableObjective, best: Solution) -> CrossValidation | None:
    """The held-out errors of a circuit.

    None where nothing is held out, or where all samples lie in one fold.
    """
    settings, parts = objective.settings, objective.parts
    are_kept = bool(objective.kept)
    labels = record_of(objective) if are_kept else fold_of(objective)
    if not _has_folds(objective, labels):
        return None
    held = constant = _held_out(objective, best, parts, labels, not are_kept)
    if objective.tables > 1 + objective.pairs or objective.nodes > 1:
        plain = replace(settings, nodes=ANYWHERE, ocv_correction=False)
        whole = replace(objective, reduced=objective.reduced.coarser(), settings=plain)
        flat = [part.coarser() for part in parts]
        constant = _held_out(whole, find_best(whole), flat, labels, not are_kept)
    by_record = held if are_kept else []
    if not are_kept and are_left_out_whole(objective.prepared_records):
        as_given = objective.given or parts
        by_record = _held_out(objective, best, as_given, record_of(objective), False)
    return CrossValidation(
        settings.folds,
        None if are_kept else _block_s(objective.prepared_records[0], settings),
        _together(held),
        _together(constant),
        tuple(SocErrors.of_squares(*sums) for sums in by_record),
    )


def held_out_errors(objective: TableObjective, best: Solution) -> SocErrors | None:
    """The errors on blocks that are held out; None as `cross_validate` has it."""
    labels = (
        fold_of(objective) if objective.settings.folds and objective.parts else np.empty(0, int)
    )
    if not _has_folds(objective, labels):
        return None
    return _together(_held_out(objective, best, objective.parts, labels, True))


def record_errors(objective: TableObjective, best: Solution) -> tuple[SocErrors, ...]:
    """The errors on each record."""
    groups = zip(objective.parts, *_at(objective, best, objective.parts), strict=True)
    squares_v2 = [
        part.scored * np.sum((base + columns @ best.unknowns) ** 2)
        for part, columns, base in groups
    ]
    counts = [part.scored for part in objective.parts]
    shape = (-1, objective.folds, 2)
    sums = (np.reshape(values, shape).sum(axis=1) for values in (squares_v2, counts))
    return tuple(SocErrors.of_squares(*own) for own in zip(*sums, strict=True))


def _has_folds(objective: TableObjective, labels: Int[np.ndarray, "groups"]) -> bool:
    scored = np.array([part.scored for part in objective.parts])
    return bool(objective.settings.folds) and len(np.unique(labels[scored > 0])) > 1


# Sums of squared errors in V^2, and how many there are, below and above 10 % SOC.
Sums = tuple[Float[np.ndarray, "2"], Int[np.ndarray, "2"]]


def _together(held: Sequence[Sums]) -> SocErrors:
    squares_v2, counts = (np.sum(sums, axis=0) for sums in zip(*held, strict=True))
    return SocErrors.of_squares(squares_v2, counts)


def tables_without(
    objective: TableObjective,
    best: Solution,
    labels: Int[np.ndarray, "groups"],
    parts: Sequence[Reduced],
    are_blocks: bool = True,
) -> "list[tuple[int, Float[np.ndarray, 'unknowns']]]":
    """Each label, and the unknowns that fit the groups of all others best, at the time constants
    of all.

    Where labels are of blocks, an OCV of the records' own is fitted to all samples: of a record
    that is alone nothing else visits the SOC of a block, and the OCV is no question of the circuit.
    """
    columns, bases = _at(objective, best, parts)
    scored = np.array([part.scored for part in parts])
    everywhere = _normal(objective, columns, bases, scored)
    without = []
    for label in np.unique(labels).tolist():
        x = _fitted_to(objective, best, columns, bases, np.where(labels != label, scored, 0))
        if are_blocks and OCV in objective.names:
            x = _with_ocv_of_all(objective, best, everywhere, x)
        without.append((label, x))
    return without


def _with_ocv_of_all(
    objective: TableObjective,
    best: Solution,
    everywhere: tuple[Float[np.ndarray, "unknowns unknowns"], Float[np.ndarray, "unknowns"]],
    x: Float[np.ndarray, "unknowns"],
) -> Float[np.ndarray, "unknowns"]:
    """The unknowns with the OCV that fits all samples best beside these resistances."""
    (normal, gradient), (low, high) = everywhere, objective.box
    ocv = objective.block(objective.names.index(OCV))
    x = x.copy()
    x[ocv] = 0.0
    pushed = (gradient + normal @ x)[ocv]
    own = normal[ocv, ocv], pushed, low[ocv], high[ocv], best.sides[ocv]
    x[ocv] = least_in_box(*own)[0]
    return x


def _held_out(
    objective: TableObjective,
    best: Solution,
    parts: Sequence[Reduced],
    labels: Int[np.ndarray, "groups"],
    are_blocks: bool,
) -> list[Sums]:
    """Squared errors of every label's samples by the tables of the others."""
    columns, bases = _at(objective, best, parts)
    sums = []
    for label, x in tables_without(objective, best, labels, parts, are_blocks):
        squares_v2, counts = np.zeros(2), np.zeros(2, int)
        for at in np.flatnonzero(labels == label).tolist():
            counts[at % 2] += parts[at].scored
            squares_v2[at % 2] += parts[at].scored * np.sum((bases[at] + columns[at] @ x) ** 2)
        sums.append((squares_v2, counts))
    return sums


def _at(objective: TableObjective, best: Solution, parts: Sequence[Reduced]):
    """Every group's columns at the best time constants, and its base errors."""
    layout = objective.reduced.layout
    # From those of the factor, each of which adds to few: by one sparse product for each group.
    own = Reduced(layout, 1, np.eye(layout.width))
    columns, base = replace(objective, reduced=own).columns(best.log_scales)
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
    normal, gradient = _normal(objective, columns, bases, scored)
    return least_in_box(normal, gradient, *objective.box, best.sides)[0]


def _normal(
    objective: TableObjective,
    columns: Sequence[Float[np.ndarray, "_ columns"]],
    bases: Sequence[Float[np.ndarray, "_"]],
    scored: Int[np.ndarray, "groups"],
) -> tuple[Float[np.ndarray, "unknowns unknowns"], Float[np.ndarray, "unknowns"]]:
    """The normal equations of some groups of samples."""
    normal, gradient = objective.penalty_normal.copy(), np.zeros(len(objective.penalty_normal))
    for at in np.flatnonzero(scored).tolist():
        share = scored[at] / scored.sum()
        normal += share * columns[at].T @ columns[at]
        gradient += share * columns[at].T @ bases[at]
    return normal, gradient


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
    if len(records) < FEWEST_RECORDS or not objective.settings.folds or not by_record:
        return tuple(intervals)
    columns, bases = _at(objective, best, parts)
    scored = np.array([part.scored for part in parts])
    rows, visits = [], []
    for number in range(len(records)):
        is_own = record_of(objective) == number
        x = _fitted_to(objective, best, columns, bases, np.where(is_own, scored, 0))
        alone = objective.alone(number)
        rows.append(objective.to_tables @ x)
        visits.append(np.concatenate([alone.visited_of(n) for n in range(objective.tables)]))
    values, is_there = np.array(rows), np.array(visits)
    joint = np.concatenate(best.values)

    def spread(interval: NodeInterval) -> NodeInterval:
        if interval.soc is not None:
            weights = np.zeros(len(joint))
            weights[objective.visited_rows[interval.name, interval.soc]] = 1.0
        elif parts_of(interval.name)[0] in objective.names:
            weights = mean_weights(objective, interval.name)
        else:
            return interval
        # A mean is moved as far as over the nodes that the record visits.
        seen = weights * is_there
        shares = seen.sum(axis=1) / weights.sum()
        moved = np.sum(seen * (values - joint), axis=1)[shares > 0] / shares[shares > 0]
        own = weights @ joint + moved
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
        # What all records leave open, another one can show too.
        low = min(low, low if interval.low is None else interval.low)
        high = max(high, high if interval.high is None else interval.high)
        return replace(interval, record_low=low, record_high=high)

    return tuple(map(spread, intervals))

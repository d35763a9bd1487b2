"""Errors of tables over SOC on blocks or whole records held out of their fit."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array

from ..cell.elements import is_resistance
from ..cell.parameters import OCV
from ..cell.soc_axis import is_above
from ..execution import in_float64
from ..metrics import t_quantile
from ..model.box_least_squares import least_in_box
from ..model.reduced import Reduced
from ..model.reference import error_blocks_of
from .folds import BANDS, block_length_s, numbered_blocks, supports_leave_one_out
from .node_interval import NodeInterval, mean_weights, parts_of
from .objective import Solution, TableObjective
from .table_problem import held_at, reduced_objective

# Fewer records give no spread.
FEWEST_RECORDS = 3


@dataclass(frozen=True)
class SocErrors:
    """RMSE over all scored samples, and over those above 10 % SOC; None if there are none."""

    rmse_v: float
    above_v: float | None

    @classmethod
    def of(cls, parts: Iterable[tuple[Float[np.ndarray, "_"], Float[np.ndarray, "_"]]]):
        """The RMSE of the errors at their states of charge, over all parts."""
        squares_v2, counts = np.zeros(2), np.zeros(2, int)
        for error_v, soc in parts:
            group = is_above(soc).astype(int)
            squares_v2 += np.bincount(group, error_v**2, minlength=2)
            counts += np.bincount(group, minlength=2)
        return cls.of_squares(squares_v2, counts)

    @classmethod
    def of_squares(cls, squares_v2: Float[np.ndarray, "2"], counts: Int[np.ndarray, "2"]):
        """The RMSE from sums of squares below 10 % SOC and above, and their numbers of samples."""
        above_v = float(np.sqrt(squares_v2[1] / counts[1])) if counts[1] else None
        return cls(float(np.sqrt(squares_v2.sum() / counts.sum())), above_v)


@dataclass(frozen=True)
class CrossValidation:
    """Errors on samples held out of the fit, at the time constants fitted to all samples.

    Attributes:
        folds: Folds of the blocks.
        block_s: Length of the blocks of the first record; None for records stored as factors, which
            are left out whole.
        tables: Errors of the tables on blocks held out of them.
        by_record: Errors of the tables on each record under load, left out whole: each record,
            including the others, from its start as given.
    """

    folds: int
    block_s: float | None
    tables: SocErrors
    by_record: tuple[SocErrors, ...] = ()

    @property
    def whole(self) -> SocErrors:
        """The errors to expect on another record of the cell, if there are records to estimate them
        from."""
        if not self.by_record:
            return self.tables
        # Each record has the same weight.
        above_v = [each.above_v for each in self.by_record if each.above_v is not None]
        rmse_v, *above = (
            float(np.sqrt(np.mean(np.square(errors_v))))
            for errors_v in ([each.rmse_v for each in self.by_record], above_v)
            if errors_v
        )
        return SocErrors(rmse_v, above[0] if above else None)


@dataclass(frozen=True)
class HeldOut:
    """Sums of squared held-out errors of every block in V^2 by band, and their numbers of
    samples."""

    squares_v2: Float[np.ndarray, "blocks bands"]
    counts: Int[np.ndarray, "blocks bands"]

    @property
    def errors(self) -> SocErrors:
        """The errors over all samples, and over the highest band."""
        sums, counts = self.squares_v2.sum(axis=0), self.counts.sum(axis=0)
        whole_v, *_, above_v = np.sqrt(sums / np.maximum(counts, 1)).tolist()
        return SocErrors(whole_v, above_v if counts[-1] else None)


def cross_validate(objective: TableObjective, best: Solution) -> CrossValidation | None:
    """The held-out errors of a circuit: of records stored as factors, on each record left out
    whole.

    None if nothing is held out, or if all samples lie in one fold.
    """
    groups = _Groups.of(objective, best)
    labels = groups.record if objective.is_of_factors else groups.fold
    if not groups.are_apart(labels):
        return None
    # There are several records, so the OCV of one that is left out comes from the others.
    squares_v2, counts = groups.held_out(labels, has_ocv_of_all=not objective.is_of_factors)
    tables = SocErrors.of_squares(squares_v2.sum(axis=0), counts.sum(axis=0))
    records, block_s, by_record = objective.prepared_records, None, ()
    if not objective.is_of_factors:
        block_s = block_length_s(records[0], objective.settings)
    if objective.is_of_factors or supports_leave_one_out(records):
        groups = _Groups.of(_as_given(objective, best), best)
        by_record = _by_record(groups.held_out(groups.record))
    return CrossValidation(objective.settings.folds, block_s, tables, by_record)


def _as_given(objective: TableObjective, best: Solution) -> TableObjective:
    """A copy at the time constants of all records, with starts and capacities as they were
    given."""
    records, settings = objective.prepared_records, objective.settings
    if objective.is_of_factors or not any(prepared.window.registration for prepared in records):
        return objective
    held = held_at(objective.ranges, best.log_scales)
    given = reduced_objective([prepared.unregistered for prepared in records], settings, held)
    return replace(objective, reduced=given.reduced, parts=given.parts, ranges=held)


@in_float64
def held_out(
    objective: TableObjective,
    best: Solution,
    numbered: tuple[Sequence[Int[np.ndarray, "simulated"]], int] | None = None,
) -> HeldOut | None:
    """The errors on every block, numbered as in `numbered_blocks`, by simulation with the tables of
    the other folds, at the time constants of all; None as in `cross_validate`.

    An OCV fitted to the records is fitted to all samples: with a single record nothing else visits
    the SOC of a block, and the OCV is not part of the choice of circuit.
    """
    records, folds = objective.prepared_records, objective.folds
    groups = _Groups.of(objective, best)
    if not groups.are_apart(groups.fold):
        return None
    solutions = [
        replace(best, values=objective.values_of(x), unknowns=x)
        for x in groups.without(groups.fold, has_ocv_of_all=True)
    ]
    tables = [objective.tables_at(solution) for solution in solutions]
    blocks, count = numbered or numbered_blocks(records, objective.settings)
    squares_v2, counts = np.zeros((len(BANDS), count)), np.zeros((len(BANDS), count), int)
    for prepared, block in zip(records, blocks, strict=True):
        alike = [objective.with_ocv(prepared, solution) for solution in solutions]
        for here, errors_v in error_blocks_of(alike, tables):
            number, soc = block[here], prepared.soc[here]
            error_v = errors_v[number % folds, np.arange(len(number))]
            for band, low_soc in enumerate(BANDS):
                in_band = (number >= 0) & (soc >= low_soc)
                squares_v2[band] += np.bincount(number[in_band], error_v[in_band] ** 2, count)
                counts[band] += np.bincount(number[in_band], minlength=count)
    return HeldOut(squares_v2.T, counts.T)


def record_errors(objective: TableObjective, best: Solution) -> tuple[SocErrors, ...]:
    """The errors on each record."""
    return _by_record(_Groups.of(objective, best).sums([best.unknowns] * len(objective.parts)))


def _by_record(sums: "Sums") -> tuple[SocErrors, ...]:
    return tuple(SocErrors.of_squares(*record) for record in zip(*sums, strict=True))


# Sums of squared errors in V^2 of every record below and above 10 % SOC, and their numbers of
# samples.
Sums = tuple[Float[np.ndarray, "records two"], Int[np.ndarray, "records two"]]


@dataclass(frozen=True, eq=False)
class _Groups:
    """The columns and base errors of the groups of samples, at the time constants fitted to all."""

    objective: TableObjective
    best: Solution
    columns: Sequence[Float[np.ndarray, "_ columns"]]
    bases: Sequence[Float[np.ndarray, "_"]]
    scored: Int[np.ndarray, "groups"]

    @classmethod
    def of(cls, objective: TableObjective, best: Solution) -> "_Groups":
        layout, parts = objective.reduced.layout, objective.parts
        # Built from the groups of the factor, each of which adds to few of these: one sparse
        # product per group.
        finest = parts[0].layout
        unit = Reduced(finest, 1, np.eye(finest.width)).coarser(layout)
        columns, base = replace(objective, reduced=unit).columns(best.log_scales)
        few = csr_array(np.column_stack([columns, base]).T)
        rows = [(few @ part.factor.T).T / math.sqrt(max(part.scored, 1)) for part in parts]
        scored = np.array([part.scored for part in parts])
        return cls(objective, best, [f[:, :-1] for f in rows], [f[:, -1] for f in rows], scored)

    @property
    def record(self) -> Int[np.ndarray, "groups"]:
        """The record of every group."""
        return np.arange(len(self.scored)) // (2 * self.objective.folds)

    @property
    def fold(self) -> Int[np.ndarray, "groups"]:
        """The fold of every group."""
        return np.arange(len(self.scored)) // 2 % self.objective.folds

    def are_apart(self, labels: Int[np.ndarray, "groups"]) -> bool:
        """True if something can be held out: samples are in groups with several labels."""
        return bool(self.objective.settings.folds) and len(np.unique(labels[self.scored > 0])) > 1

    def normal(
        self, scored: Int[np.ndarray, "groups"]
    ) -> tuple[Float[np.ndarray, "unknowns unknowns"], Float[np.ndarray, "unknowns"]]:
        """The normal equations of groups with these numbers of samples."""
        normal = self.objective.penalty_normal.copy()
        gradient = np.zeros(len(normal))
        for at in np.flatnonzero(scored).tolist():
            share = scored[at] / scored.sum()
            normal += share * self.columns[at].T @ self.columns[at]
            gradient += share * self.columns[at].T @ self.bases[at]
        return normal, gradient

    def fitted_to(self, is_in: Bool[np.ndarray, "groups"]) -> Float[np.ndarray, "unknowns"]:
        """The unknowns that fit the selected groups best."""
        equations = self.normal(np.where(is_in, self.scored, 0))
        return least_in_box(*equations, *self.objective.box, self.best.active_set)[0]

    def without(
        self, labels: Int[np.ndarray, "groups"], has_ocv_of_all: bool = False
    ) -> Iterator[Float[np.ndarray, "unknowns"]]:
        """For every label, the unknowns that fit the groups of all other labels best; optionally
        with an OCV fitted to all groups."""
        for label in range(int(labels.max()) + 1):
            x = self.fitted_to(labels != label)
            is_of_all = has_ocv_of_all and OCV in self.objective.names
            yield self._with_ocv_of_all(x) if is_of_all else x

    def _with_ocv_of_all(self, x: Float[np.ndarray, "unknowns"]) -> Float[np.ndarray, "unknowns"]:
        """The unknowns with the OCV that fits all samples best with these resistances."""
        objective = self.objective
        (normal, gradient), (low, high) = self.normal(self.scored), objective.box
        ocv = objective.block(objective.names.index(OCV))
        x = x.copy()
        x[ocv] = 0.0
        pushed = (gradient + normal @ x)[ocv]
        equations = normal[ocv, ocv], pushed, low[ocv], high[ocv], self.best.active_set[ocv]
        x[ocv] = least_in_box(*equations)[0]
        return x

    def held_out(self, labels: Int[np.ndarray, "groups"], has_ocv_of_all: bool = False) -> "Sums":
        """The `sums` by the unknowns that fit the groups of all other labels best."""
        others = [*self.without(labels, has_ocv_of_all)]
        return self.sums(others[label] for label in labels.tolist())

    def sums(self, unknowns: Iterable[Float[np.ndarray, "unknowns"]]) -> Sums:
        """The squared errors of every record below and above 10 % SOC, by the unknowns of every
        group."""
        groups = zip(self.scored, self.columns, self.bases, unknowns, strict=True)
        squares_v2 = [
            scored * np.sum((base + columns @ x) ** 2) for scored, columns, base, x in groups
        ]
        shape = (-1, self.objective.folds, 2)
        return np.reshape(squares_v2, shape).sum(axis=1), self.scored.reshape(shape).sum(axis=1)


def with_spread(
    objective: TableObjective, best: Solution, intervals: Sequence[NodeInterval]
) -> tuple[NodeInterval, ...]:
    """The intervals of nodes, extended to what another record of the cell would give.

    They come from the spread of tables fitted to each record, at the time constants of all: the
    mean and t s sqrt(1 + 1 / n) of at least three records that visit a node, and never narrower
    than the joint interval. The interval from a single record is far narrower than the difference
    between loads of the same cell.
    """
    records = objective.prepared_records
    by_record = objective.is_of_factors or supports_leave_one_out(objective.prepared_records)
    if len(records) < FEWEST_RECORDS or not objective.settings.folds or not by_record:
        return tuple(intervals)
    groups, rows, visits = _Groups.of(objective, best), [], []
    for number in range(len(records)):
        alone = replace(objective, prepared_records=[records[number]])
        rows.append(objective.to_tables @ groups.fitted_to(groups.record == number))
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
        # A mean over SOC moves as it does over the nodes that the record visits.
        seen = weights * is_there
        shares = seen.sum(axis=1) / weights.sum()
        moved = np.sum(seen * (values - joint), axis=1)[shares > 0] / shares[shares > 0]
        separate = weights @ joint + moved
        if len(separate) < FEWEST_RECORDS:
            return interval
        reach = t_quantile(len(separate) - 1) * np.std(separate, ddof=1)
        reach = float(reach * np.sqrt(1 + 1 / len(separate)))
        middle, least = float(np.mean(separate)), 0.0 if is_resistance(interval.name) else -np.inf
        low, high = max(middle - reach, least), middle + reach
        if objective.is_of_factors:
            # Nothing else is known about the joint value than the records' own values.
            error = float(np.std(separate, ddof=1)) / len(separate) ** 0.5
            both = reach / (len(separate) + 1) ** 0.5
            ends = float(max(interval.value - both, least)), float(interval.value + both)
            interval = replace(interval, standard_error=error, low=ends[0], high=ends[1])
        # What all records leave open, another record may have too.
        low = min(low, low if interval.low is None else interval.low)
        high = max(high, high if interval.high is None else interval.high)
        return replace(interval, record_low=low, record_high=high)

    return tuple(map(spread, intervals))

"""Tables identified from prepared records, with their intervals, errors and warnings."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress
from typing import Any, Literal

import numpy as np

from ..cell import CircuitParameters
from ..cell.parameters import HALF_HYSTERESIS, OCV, OHMIC, RATE
from ..cell.soc_axis import ABOVE_SOC, is_above
from ..cell.tables import LEAST_OHM
from ..display import Brief
from ..execution import in_float64
from ..global_optimum.proof import Proof
from ..model.prepared import PreparedRecord
from ..model.reference import error_blocks
from ..notices import Notice
from ..schema import NoticeField
from ..search.answers import AtBound, near_ends
from ..uncertainty.covariance import named_values
from .certificate import certify
from .cross_validation import CrossValidation, SocErrors, cross_validate, with_spread
from .current_offset import OffsetEffect
from .dependence import with_requested_dependence
from .intervals import intervals_of
from .node_interval import Fact, NodeInterval, parts_of
from .objective import TableObjective
from .settings import TableSettings
from .table_problem import BOTH_WAYS_SOC, HELD_GAMMA, find_best, least_travel_soc, reduced_objective

Status = Literal["certified", "grid-verified", "unverified"]
# A table with a larger share of its nodes unvisited than this is mostly extrapolated.
MOSTLY = 0.5
# If the error of all samples exceeds that above 10 % SOC by more than this factor, most of it is
# below 10 %.
LEFT_BELOW = math.sqrt(2)


@dataclass(frozen=True)
class OcvCompared:
    """An OCV fitted to the records compared with an OCV test, at the same time constants.

    Attributes:
        median_v: Median distance from the test's OCV, from 10 to 90 % SOC where visited.
        largest_v: Fitted minus test OCV where the difference is largest.
        largest_soc: SOC of that difference.
    """

    median_v: float
    largest_v: float
    largest_soc: float


@dataclass(frozen=True, repr=False)
class TableFit(Brief):
    """Tables over SOC, with their proof, intervals and errors.

    Attributes:
        tables: The tables.
        objective_v: sqrt(J), the penalties included.
        errors: Errors on each record, by scan.
        tau_ranges_s: The box of time constants.
        lower_bound_v: No tables with time constants in the box have a smaller sqrt(J).
        status: "certified" if that is within the requested share, else "grid-verified", as for
            resistances that depend on more than SOC, since nothing is proved about the numbers of
            the law; "unverified" if the bounds are too wide for a grid.
        boxes: Boxes of time constants in the proof.
        at_bound: Time constants at a bound.
        parameters: Number of visited values and of searched constants.
        intervals: 95 % intervals of visited nodes, then of searched constants.
        cross_validation: Errors on blocks held out.
        warnings: Doubtful results, each with a remedy.
        ocv_compared: An OCV fitted to the records compared with that of an OCV test.
        means: The mean of every table except an OCV over the visited SOC above 10 %, weighted by
            length of SOC, with its 95 % interval; then sums such as "R1 + R2" of pairs with nearly
            the same time constant.
        of_offset: Effect of an offset of the current that one record cannot distinguish from its
            fitted OCV.
    """

    tables: CircuitParameters
    objective_v: float
    errors: tuple[SocErrors, ...]
    tau_ranges_s: tuple[tuple[float, float], ...]
    lower_bound_v: float
    status: Status
    boxes: int
    at_bound: tuple[AtBound, ...]
    parameters: int
    intervals: tuple[NodeInterval, ...]
    cross_validation: CrossValidation | None
    warnings: tuple[NoticeField, ...]
    ocv_compared: OcvCompared | None = None
    of_offset: OffsetEffect | None = None
    means: tuple[NodeInterval, ...] = ()

    @property
    def proved_gap(self) -> float:
        """The largest share of sqrt(J) that other tables could save."""
        return max(0.0, 1 - self.lower_bound_v / self.objective_v) if self.objective_v else 0.0

    @property
    def is_over_soc(self) -> bool:
        """False if resistances have one value at every SOC: at most the OCV is a table."""
        return len(self.tables.nodes) > 1 or not (self.tables.is_constant or self.of_table(OCV))

    @property
    def determines_rate(self) -> bool:
        """True if the records determine the rate of a hysteresis, with an interval."""
        return any(one.name == RATE and one.low is not None for one in self.intervals)

    def of_table(self, name: str) -> tuple[NodeInterval, ...]:
        """The intervals of one table, in order of rising SOC."""
        return tuple(node for node in self.intervals if node.name == name and node.soc is not None)

    @cached_property
    def are_of_another_record(self) -> bool:
        """True if intervals are those to expect on another record of the cell."""
        return any(one.record_low is not None for one in (*self.intervals, *self.means))

    @cached_property
    def facts(self) -> tuple[Fact, ...]:
        """Every number of the fit once: the nodes of its tables, constants that have one value at
        every SOC, with the capacitances of a constant circuit, the means, and the nodes of a fitted
        OCV.

        Numbers over SOC have the interval that every output shows: the one to expect on another
        record of the cell, if there are enough records for it."""
        intervals = {(one.name, one.soc): one for one in self.intervals}
        tables = self.tables
        visited = tables.visited or (True,) * len(tables.nodes)
        numbers = [
            (name, *node)
            for name, row in tables.tables.items()
            for node in zip(tables.nodes, row, visited, strict=True)
        ]
        numbers += [(name, None, value, True) for name, value in tables.constants.items()]
        if tables.is_constant:
            values = named_values(tables).items()
            soc = dict.fromkeys(tables.tables, tables.nodes[0])
            numbers = [(name, soc.get(name), value, True) for name, value in values]
        facts = [
            self._fact(
                intervals.get((name, soc)) or NodeInterval(name, soc, value, 0.0, 0.0, None, None),
                value=value,
                soc=soc if self.is_over_soc else None,
                is_assessed=(name, soc) in intervals,
                is_visited=is_visited,
            )
            for name, soc, value, is_visited in numbers
        ]
        means = (self._fact(mean, is_mean=True) for mean in self.means)
        return (*facts, *means, *map(self._fact, self.of_table(OCV)))

    @property
    def visited_nodes(self) -> list[float]:
        """The nodes of tables that samples visit; without tables, those of a fitted OCV."""
        tables = self.tables
        if not self.is_over_soc:
            return [node.soc or 0.0 for node in self.of_table(OCV)]
        return [*compress(tables.nodes, tables.visited)]

    @property
    def mean_soc(self) -> tuple[float, float] | None:
        """The range of SOC that means are taken over; None for a constant circuit."""
        soc = self.visited_nodes
        return (max(soc[0], min(ABOVE_SOC, soc[-1])), soc[-1]) if soc else None

    @property
    def constant_facts(self) -> list[Fact]:
        """The facts that do not depend on SOC, except the numbers of a resistance law."""
        law = self.tables.dependence
        numbers = set() if law is None else set(law.numbers)
        constants = (fact for fact in self.facts if fact.soc is None and not fact.is_mean)
        return [fact for fact in constants if fact.name not in numbers]

    def _fact(self, node: NodeInterval, is_assessed: bool = True, **changed: Any) -> Fact:
        if self.tables.is_constant:
            # A held value has neither an error nor an interval.
            is_assessed = node.standard_error > 0 or node.high is not None
        is_over_soc = node.soc is not None or "is_mean" in changed
        shown = node.on_another_record if self.are_of_another_record and is_over_soc else node
        return Fact(**vars(shown) | changed, is_assessed=is_assessed)


@in_float64
def fit_tables(
    prepared_records: Sequence[PreparedRecord], settings: TableSettings | None = None
) -> TableFit:
    """The best tables over SOC for one or more prepared records of one cell and circuit.

    The time constants are searched; for each candidate, all tables are the exact optimum of a
    bounded least-squares problem. The source voltage is that of the circuit: the average OCV for
    `so-rc`, with switched hysteresis for `iso-rc`, and with dynamic hysteresis for `esc`, whose
    amplitude is half the hysteresis voltage unless it is fitted.

    Args:
        prepared_records: The records in their windows, such as those of a problem.
        settings: Nodes, weights, bounds, proof and cross-validation.

    Raises `InputError` if the box of time constants is empty or too wide, and for `half_hysteresis`
    without a dynamic hysteresis.
    """
    settings = settings or TableSettings()
    objective = reduced_objective(prepared_records, settings)
    objective, best = with_requested_dependence(objective, find_best(objective))
    return assemble_fit(objective, certify(objective, best))


def assemble_fit(
    objective: TableObjective,
    proof: Proof,
    prepared_records: Sequence[PreparedRecord] | None = None,
    *,
    intervals: Sequence[NodeInterval] | None = None,
    errors: tuple[SocErrors, ...] | None = None,
) -> TableFit:
    """The fit of proved tables, with errors, intervals and warnings. Errors are computed on
    `prepared_records` if these differ from the objective's by their OCV; for records stored as
    factors, `intervals` and `errors` are given."""
    settings, best = objective.settings, proof.best
    tables = objective.tables_at(best)
    nodes = intervals_of(objective, best) if intervals is None else intervals
    if errors is None:
        judged = prepared_records or objective.prepared_records
        errors = tuple(pooled_errors([prepared], tables) for prepared in judged)
        undetermined = _undetermined(objective, errors)
        nodes = [
            one.as_undetermined() if (one.name, one.soc) in undetermined else one for one in nodes
        ]
    intervals = with_spread(objective, best, nodes)
    means = tuple(
        one for one in intervals if one.soc is None and parts_of(one.name)[0] in tables.tables
    )
    at_nodes = intervals[: len(intervals) - len(means)]
    intervals = tuple(_as_stored(objective, tables, at_nodes))
    held_out = cross_validate(objective, best)
    searched_axes = zip(objective.axes, best.log_scales, strict=True)
    at_bound = near_ends(
        (axis.name, scale, axis.low, axis.high)
        for axis, scale in searched_axes
        if axis.high > axis.low
    )
    taus_s = tuple(limits for name, limits in objective.ranges.items() if name != RATE)
    # The proof's box does not include the numbers of a resistance law.
    is_enough = proof.lower_bound_v >= (1 - settings.proved_share) * best.rms_v
    is_certified = is_enough and tables.dependence is None
    fit = TableFit(
        tables=tables,
        objective_v=best.rms_v,
        errors=errors,
        tau_ranges_s=taus_s,
        lower_bound_v=proof.lower_bound_v,
        status="certified" if is_certified else "grid-verified",
        boxes=proof.boxes,
        at_bound=at_bound,
        parameters=sum(int(np.sum(objective.visited_of(n))) for n in range(objective.tables))
        + sum(axis.high > axis.low for axis in objective.axes),
        intervals=intervals,
        cross_validation=held_out,
        warnings=(),
        means=means,
    )
    return replace(fit, warnings=_warnings(objective, fit))


def _undetermined(objective: TableObjective, errors: Sequence[SocErrors]) -> set[tuple[str, float]]:
    """The nodes of a nearly empty cell, by table, whose values are determined only by smoothing and
    the circuit: for R0, those without a current step nearby; for a fitted OCV, those without a long
    rest, where the circuit does not model the loads, and the next one above, half of whose samples
    are below it."""
    undetermined, judged = set(), {OHMIC}
    if any(one.above_v and one.rmse_v > LEFT_BELOW * one.above_v for one in errors):
        judged.add(OCV)
    for name in judged & set(objective.names):
        nodes = objective.nodes_of[objective.names.index(name)]
        is_determined = is_above(nodes if name == OHMIC else np.append(nodes[:1], nodes[:-1]))
        for prepared in objective.prepared_records:
            is_judged = prepared.is_step if name == OHMIC else prepared.is_at_ocv
            part = replace(prepared, scored=prepared.scored & is_judged)
            is_determined |= part.nearest(nodes)
        undetermined |= {(name, soc) for soc in nodes[~is_determined].tolist()}
    return undetermined


def _as_stored(
    objective: TableObjective, tables: CircuitParameters, intervals: Sequence[NodeInterval]
) -> Iterator[NodeInterval]:
    """The intervals: for resistances also at stored nodes between those of the fit, and for a
    fitted OCV in volts, not relative to the objective's cell."""
    level_v = {}
    if OCV in objective.names:
        nodes = objective.nodes_of[objective.names.index(OCV)]
        cell_v = objective.prepared_records[0].cell.average_ocv_v(nodes)
        level_v = dict(zip(nodes.tolist(), cell_v.tolist(), strict=True))
    for before, node in zip([None, *intervals], intervals, strict=False):
        if before is not None and before.name == node.name and node.name in tables.resistances:
            low, high = before.soc or 0.0, node.soc or 0.0
            between = (soc for soc in tables.nodes if low < soc < high)
            yield from (before.between(node, soc) for soc in between)
        yield node.moved(level_v[node.soc]) if node.name == OCV else node


def with_level_ends(fit: TableFit, prepared_records: Sequence[PreparedRecord]) -> TableFit:
    """The fit with tables and intervals that are constant beyond the nodes next to scored samples:
    there, the penalty alone would extrapolate them linearly."""
    nodes, span = np.array(fit.tables.nodes), visited_soc(prepared_records)
    beside = nodes[fit.tables.nodes_beside(*span)]
    last = dict(zip(nodes.tolist(), beside.tolist(), strict=True))
    at_nodes = {(one.name, one.soc): one for one in fit.intervals}
    intervals = tuple(
        replace(at_nodes.get((one.name, last.get(one.soc, one.soc)), one), soc=one.soc)
        for one in fit.intervals
    )
    return replace(fit, tables=fit.tables.level_beyond(*span), intervals=intervals)


def visited_soc(prepared_records: Sequence[PreparedRecord]) -> tuple[float, float]:
    soc = np.concatenate([prepared.soc[prepared.scored] for prepared in prepared_records])
    return float(soc.min()), float(soc.max())


@in_float64
def pooled_errors(
    prepared_records: Sequence[PreparedRecord], tables: CircuitParameters
) -> SocErrors:
    """The errors of tables on all records together, by scan."""
    return SocErrors.of(
        (error_v[prepared.scored[here]], prepared.soc[here][prepared.scored[here]])
        for prepared in prepared_records
        for here, error_v in error_blocks(prepared, tables)
    )


def _warnings(objective: TableObjective, fit: TableFit) -> tuple[Notice, ...]:
    tables = fit.tables
    notices = [
        _bound_warning(bound, tables.constants[bound.name], objective.settings)
        for bound in fit.at_bound
    ]
    nodes = objective.nodes_of[0]
    resistances_ohm = np.array([tables.at(name, nodes) for name in tables.resistances])
    visited, seen_soc, whose = objective.visited, nodes[objective.visited], None
    if not fit.is_over_soc:
        table, whose = objective.names.index(OCV), "ocv"
        visited = objective.visited_of(table)
        seen_soc = np.array(objective.nodes_of[table])[visited]
    unvisited = 1 - float(np.mean(visited))
    if unvisited > MOSTLY:
        values = {"share": unvisited, "whose": whose}
        values |= {"low_soc": float(min(seen_soc)), "high_soc": float(max(seen_soc))}
        notices.append(Notice("tables.mostly-unvisited", values))
    if fit.is_over_soc:
        bare = nodes[objective.visited & (resistances_ohm.sum(axis=0) < LEAST_OHM)]
        notices += [Notice("tables.no-resistance", {"soc": soc}) for soc in bare.tolist()]
    if not np.any(resistances_ohm[0][objective.visited] >= LEAST_OHM):
        notices.append(Notice("tables.no-r0"))
    floor_ohm = objective.least_r0_ohm
    held = nodes[objective.visited & (resistances_ohm[0] <= floor_ohm)]
    if floor_ohm and len(held):
        percent = ", ".join(f"{100 * soc:g}" for soc in held)
        where = None if fit.is_over_soc else "everywhere"
        values = {"floor_ohm": floor_ohm, "percent": percent}
        values |= dict.fromkeys(("where", "whose", "instead"), where)
        notices.append(Notice("tables.r0-at-floor", values))
    is_fitted = HALF_HYSTERESIS in tables.tables
    if not is_fitted and tables.gamma is None:
        return tuple(notices)
    moved, ranges = least_travel_soc(objective.prepared_records), objective.settings.ranges
    if moved < BOTH_WAYS_SOC and is_fitted and OCV not in objective.names:
        notices.append(Notice("tables.one-direction", {"moved_soc": moved}))
    elif moved < BOTH_WAYS_SOC and tables.gamma is not None and RATE not in ranges:
        notices.append(Notice("tables.one-direction", {"moved_soc": moved, "gamma": HELD_GAMMA}))
    return tuple(notices)


def _bound_warning(bound: AtBound, value: float, settings: TableSettings) -> Notice:
    """The notice for a constant at a bound."""
    side = bound.side if bound.name.startswith("tau") else None
    # A capacity only scales the axis of a fitted OCV.
    is_fitted = settings.ocv_nodes is not None
    correction = "true" if settings.ocv_correction and not is_fitted else None
    words = {"side": side, "correction": correction, "check": "own" if is_fitted else None}
    name = "value_s" if side else "value"
    return Notice("tables.at-bound", {"name": bound.name, name: value, **words})

"""The objective of some tables, and its least value for given time constants."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import block_diag

from ..cell import CircuitParameters
from ..cell.circuits import get_circuit
from ..cell.elements import alike, names_of
from ..cell.parameters import HALF_HYSTERESIS, OCV, OCV_CORRECTION, OHMIC, RATE
from ..cell.tables import hats
from ..model.axes import Axis, axes_of
from ..model.box_least_squares import (
    Sides,
    errors_of,
    least_in_box,
    least_in_boxes,
    least_squares_in_box,
    normal_equations,
)
from ..model.descent import LogScales, Solved
from ..model.prepared import PreparedRecord
from ..model.reduced import Columns, Reduced
from ..model.search_space import Range
from .settings import TableSettings

# Of the voltage step at a current step, R0 is at least this share: what a sampling interval lets
# the fastest pair add is less, even of a minute. Only where nothing else tells R0 is it that low.
LEAST_SHARE = 1 / 3
# A hysteresis beside an OCV that is fitted with it is measured from none: one that turns slowly
# can be any part of the OCV.
GAP_RIDGE = 1e-6


@dataclass(frozen=True, eq=False)
class Solution(Solved):
    """The best tables at some scales: rows of R0, every pair's R, then what else is tabulated.

    `unknowns` are the same as the problem in a box has them (`TableObjective.to_tables`).
    """

    values: tuple[Float[np.ndarray, "nodes"], ...]
    unknowns: Float[np.ndarray, "unknowns"]
    error: Float[np.ndarray, "rows"]


@dataclass(frozen=True, eq=False)
class TableObjective:
    """J of `settings` over some records of a cell, for circuits with so many pairs.

    `ranges` are those of every pair's time constant in s, then of gamma where there is one, by
    name; `LogScales` are the logarithms of these. `reduced` is the factor of all scored samples,
    `parts` those of the groups of `blocks_of`; `smoothing_scale` scales all smoothing weights.
    Records that were `kept` are without samples, and stand in place of prepared ones.
    """

    prepared_records: Sequence[PreparedRecord]
    settings: TableSettings
    ranges: Mapping[str, Range]
    reduced: Reduced
    parts: Sequence[Reduced] = ()
    smoothing_scale: float = 1.0
    kept: Sequence[Any] = ()

    @property
    def facts(self) -> Sequence[Any]:
        """The records, prepared or kept, for all but their factors: circuit, cell, capacity, and so
        on."""
        return self.kept or self.prepared_records

    def alone(self, place: int) -> "TableObjective":
        """The same of one record, but for the factors."""
        own = slice(place, place + 1)
        records, kept = self.prepared_records[own], self.kept[own]
        return replace(self, prepared_records=records, kept=kept)

    @property
    def numbers(self) -> dict[str, float]:
        """The numbers of what resistances follow."""
        dependence = self.facts[0].dependence
        return {} if dependence is None else dependence.numbers

    @property
    def elements(self) -> tuple[str, ...]:
        return get_circuit(self.facts[0].circuit).elements

    @property
    def pairs(self) -> int:
        """Number of elements, RC pairs mostly."""
        return len(self.ranges) - (RATE in self.ranges)

    @property
    def folds(self) -> int:
        """Folds into which the samples of every record are grouped."""
        return max(len(self.parts) // (2 * len(self.facts)), 1)

    @property
    def nodes(self) -> int:
        """Number of nodes of all tables but an OCV correction."""
        return len(self.reduced.layout.nodes)

    @cached_property
    def nodes_of(self) -> tuple[Float[np.ndarray, "nodes"], ...]:
        """Every table's nodes."""
        layout = self.reduced.layout
        found = [np.array(layout.nodes)] * self.tables
        if layout.has_correction:
            found[1 + self.pairs] = np.array(layout.ocv_nodes)
        return tuple(found)

    @cached_property
    def visited(self) -> Bool[np.ndarray, "nodes"]:
        """True at the nodes of a resistance that are nearest to some scored sample."""
        return self._nearest(self.nodes_of[0])

    def visited_of(self, table: int) -> Bool[np.ndarray, "nodes"]:
        """The same of any table."""
        return self._visited_ocv if len(self.nodes_of[table]) != self.nodes else self.visited

    @cached_property
    def _visited_ocv(self) -> Bool[np.ndarray, "nodes"]:
        return self._nearest(np.array(self.reduced.layout.ocv_nodes))

    def _nearest(self, nodes: Float[np.ndarray, "nodes"]) -> Bool[np.ndarray, "nodes"]:
        return np.any([record.nearest(nodes) for record in self.facts], axis=0)

    @cached_property
    def visited_rows(self) -> dict[tuple[str, float | None], int]:
        """The rows of all tables' values at visited nodes, by table and SOC."""
        return {
            (name, float(self.nodes_of[table][node])): self.block(table).start + int(node)
            for table, name in enumerate(self.names)
            for node in np.flatnonzero(self.visited_of(table))
        }

    def block(self, table: int) -> slice:
        """The unknowns of a table."""
        first = sum(len(nodes) for nodes in self.nodes_of[:table])
        return slice(first, first + len(self.nodes_of[table]))

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        """The searched coordinates."""
        return axes_of(self.reduced, self.elements, self.ranges)

    def parts_at(self, found: Solution) -> list[tuple[float, "TableObjective", Solution]]:
        return [(1.0, self, found)]

    @property
    def interchangeable(self) -> int:
        """Number of RC pairs that can change places: all where they have one box, else none."""
        pairs = alike(self.elements)
        boxes = {(axis.low, axis.high) for axis in self.axes[:pairs]}
        return pairs if len(boxes) == 1 else 0

    @property
    def tables(self) -> int:
        layout = self.reduced.layout
        return 1 + self.pairs + layout.has_correction + layout.has_amplitude

    @cached_property
    def fixed_columns(self) -> dict[int, Columns]:
        """The columns of tables that no axis changes, and what an axis adds to."""
        layout = self.reduced.layout
        own = {0: self.reduced.part("current")[0]}
        if layout.has_correction:
            own[1 + self.pairs] = self.reduced.part("correction")[0] @ self._to_correction
        if layout.has_amplitude:
            own[self.tables - 1] = self.reduced.part("initial_hysteresis")[0]
        return own

    @cached_property
    def base(self) -> Float[np.ndarray, "rows"]:
        return self.reduced.part("base")[0][:, 0]

    @cached_property
    def weights(self) -> list[tuple[float, float]]:
        """Every table's w, of resistances the capacity in Ah over 1 h, and its ridge."""
        settings, layout = self.settings, self.reduced.layout
        resistance = self.facts[0].capacity_ah, settings.resistance_ridge
        ocv, gap = (1.0, settings.voltage_ridge), (1.0, max(settings.voltage_ridge, GAP_RIDGE))
        gaps = [gap if OCV in self.names else ocv] * layout.has_amplitude
        return [resistance] * (self.pairs + 1) + [ocv] * layout.has_correction + gaps

    @cached_property
    def _to_correction(self) -> Float[np.ndarray, "nodes nodes"]:
        """The OCV correction at every node from its unknowns: its value at the first node and the
        steps from node to node, each with a bound of its own, where the OCV is to rise."""
        count = len(self.reduced.layout.ocv_nodes)
        return np.tril(np.ones((count, count))) if self.settings.rising_ocv else np.eye(count)

    @cached_property
    def to_tables(self) -> Float[np.ndarray, "values unknowns"]:
        """All tables' values from the unknowns."""
        blocks = [np.eye(len(nodes)) for nodes in self.nodes_of]
        if self.reduced.layout.has_correction:
            blocks[1 + self.pairs] = self._to_correction
        return np.asarray(block_diag(*blocks))

    @cached_property
    def penalty(self) -> Float[np.ndarray, "penalties unknowns"]:
        """The rows whose squares are added to the mean squared error."""
        return self.table_penalty @ self.to_tables

    @cached_property
    def table_penalty(self) -> Float[np.ndarray, "penalties values"]:
        """The same by the tables' values."""
        blocks = []
        for nodes, (weight, ridge) in zip(self.nodes_of, self.weights, strict=True):
            eye = np.eye(len(nodes))
            bent = math.sqrt(self.settings.roughness) * np.diff(eye, 2, axis=0)
            rows = np.concatenate([bent, math.sqrt(ridge) * eye])
            blocks.append(weight * math.sqrt(self.smoothing_scale) * rows)
        return np.asarray(block_diag(*blocks))

    @cached_property
    def penalty_normal(self) -> Float[np.ndarray, "unknowns unknowns"]:
        return self.penalty.T @ self.penalty

    @cached_property
    def least_r0_ohm(self) -> float:
        """A floor of R0 at every node by the current steps of all records, for no cell is without:
        an OCV that is wrong would be fitted with none. Zero where they do not tell it."""
        if OHMIC in self.settings.ranges:
            return 0.0
        return LEAST_SHARE * min(record.step_ohm for record in self.facts)

    @cached_property
    def box(self) -> tuple[Float[np.ndarray, "unknowns"], Float[np.ndarray, "unknowns"]]:
        """Lowest and highest value of every unknown. From node to node, a correction of an OCV that
        is to rise may fall by as much as the known OCV rises at least; else it is free."""
        low = [np.zeros(len(nodes)) for nodes in self.nodes_of]
        high = [np.full(len(nodes), np.inf) for nodes in self.nodes_of]
        low[0][:] = self.least_r0_ohm
        ranges = self.settings.ranges
        names = (OHMIC, *(element.resistance for element in names_of(self.elements)))
        for table, name in enumerate(names):
            if name in ranges:
                low[table][:], high[table][:] = ranges[name]
        if self.reduced.layout.has_correction:
            low[self.pairs + 1][:] = -np.inf
            if self.settings.rising_ocv:
                nodes = self.nodes_of[self.pairs + 1]
                slopes = [record.cell.least_ocv_slopes(nodes) for record in self.facts]
                low[self.pairs + 1][1:] = -np.diff(nodes) * np.min(slopes, axis=0)
        return np.concatenate(low), np.concatenate(high)

    def columns(self, log_scales: LogScales) -> tuple[Columns, Float[np.ndarray, "rows"]]:
        """Columns of all unknowns at some scales, and the base error there."""
        blocks, base = dict(self.fixed_columns), self.base
        for axis, where in zip(self.axes, log_scales, strict=True):
            if axis.table is None:
                base = base + axis.columns_at(where)[:, 0]
            else:
                blocks[axis.table] = blocks.get(axis.table, 0.0) + axis.columns_at(where)
        return np.concatenate([blocks[table] for table in range(self.tables)], axis=1), base

    def solve(
        self, log_scales: LogScales, sides: Sides | None = None, exact: bool = False
    ) -> Solution:
        """The best tables at some scales; `exact` takes the orthogonal factorization's digits."""
        columns, base = self.columns(log_scales)
        low, high = self.box
        if exact:
            whole = np.concatenate([columns, self.penalty])
            longer = np.append(base, np.zeros(len(self.penalty)))
            x, sides = least_squares_in_box(whole, longer, low, high, sides)
        else:
            normal = columns.T @ columns + self.penalty_normal
            x, sides = least_in_box(normal, columns.T @ base, low, high, sides)
        error = base + columns @ x
        bent = self.penalty @ x
        objective_v2 = float(error @ error + bent @ bent)
        return Solution(log_scales, sides, objective_v2, self.values_of(x), x, error)

    def values_of(self, x: Float[np.ndarray, "unknowns"]) -> tuple[Float[np.ndarray, "nodes"], ...]:
        """Every table's values from the unknowns."""
        rows = self.to_tables @ x
        return tuple(rows[self.block(table)] for table in range(self.tables))

    def least_v2(self, log_scales: Float[np.ndarray, "axes points"]) -> Float[np.ndarray, "points"]:
        """The least J at many scales: of a constant circuit all at once, of tables, whose problems
        are large, each from the active set of the one before."""
        if len(self.penalty_normal) > self.tables:
            found, sides = np.empty(log_scales.shape[1]), None
            for place, scales in enumerate(log_scales.T.tolist()):
                solution = self.solve(tuple(scales), sides)
                found[place], sides = solution.objective_v2, solution.sides
            return found
        blocks, base = dict(self.fixed_columns), self.base
        for axis, own in zip(self.axes, log_scales, strict=True):
            places, at = np.unique(own, return_inverse=True)
            answers = axis.columns(places)[at]
            if axis.table is None:
                base = base + answers[:, :, 0]
            else:
                blocks[axis.table] = blocks.get(axis.table, 0.0) + answers
        shape = (log_scales.shape[1], len(self.base))
        base = np.broadcast_to(base, shape)
        columns = [np.broadcast_to(blocks[table][..., 0], shape) for table in range(self.tables)]
        normal, gradient = normal_equations(columns, base)
        low, high = (np.repeat(end[:, None], shape[0], axis=1) for end in self.box)
        x = least_in_boxes(normal + self.penalty_normal[:, :, None], gradient, low, high)
        error = errors_of(columns, base, x)
        return np.sum(error**2, axis=1) + np.sum((self.penalty @ x) ** 2, axis=0)

    def ways(self, found: Solution) -> Float[np.ndarray, "values ways"]:
        """The ways in which tables can move within their bounds, unless no sample is near.

        Values at a bound stay. The OCV correction of nodes that a bound ties together moves as one.
        """
        blocks = []
        for table in range(self.tables):
            is_free = found.sides[self.block(table)] == 0
            eye = np.eye(len(is_free))
            own = eye[is_free]
            if self.reduced.layout.has_correction and table == self.pairs + 1:
                tied = np.cumsum(is_free) - 1
                own = eye[: tied[-1] + 1, tied] if self.settings.rising_ocv else own
            blocks.append(own[own @ self.visited_of(table) > 0].T)
        return np.asarray(block_diag(*blocks))

    def slope(self, found: Solution) -> Float[np.ndarray, "axes"]:
        """The derivative of the least J by the scales: that at fixed tables, which are optimal."""
        slopes = [
            axis.slopes_at(where) @ (np.ones(1) if axis.table is None else found.values[axis.table])
            for axis, where in zip(self.axes, found.log_scales, strict=True)
        ]
        return np.array([2 * float(found.error @ slope) for slope in slopes])

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the tables."""
        layout = self.reduced.layout
        names = [OHMIC, *(element.resistance for element in names_of(self.elements))]
        if layout.has_correction:
            names.append(OCV_CORRECTION if self.settings.ocv_nodes is None else OCV)
        return (*names, HALF_HYSTERESIS) if layout.has_amplitude else tuple(names)

    def ocv_at(
        self, found: Solution
    ) -> tuple[Float[np.ndarray, "nodes"], Float[np.ndarray, "nodes"]]:
        """Nodes and OCV in V of a solution that has one of its own."""
        place = self.names.index(OCV)
        nodes = self.nodes_of[place]
        return nodes, self.facts[0].cell.average_ocv_v(nodes) + found.values[place]

    def with_ocv(self, prepared: PreparedRecord, found: Solution) -> PreparedRecord:
        """A record with the OCV of a solution that has one of its own."""
        if OCV not in self.names:
            return prepared
        place = self.names.index(OCV)
        added_v = hats(prepared.soc, self.nodes_of[place]) @ found.values[place]
        return replace(prepared, source_v=prepared.source_v + added_v)

    def with_unknowns(self, found: Solution, x: Float[np.ndarray, "unknowns"]) -> Solution:
        """A solution with other tables at the same scales."""
        return replace(found, values=self.values_of(x), unknowns=x)

    def tables_at(self, found: Solution) -> CircuitParameters:
        """A solution as stored, pairs from fast to slow; an OCV of its own is left out. Where the
        OCV's correction has more nodes than resistances, all are written down at its nodes."""
        layout = self.reduced.layout
        nodes = layout.ocv_nodes if OCV_CORRECTION in self.names else layout.nodes
        values = {
            name: tuple((hats(np.array(nodes), own) @ row).tolist())
            for name, own, row in zip(self.names, self.nodes_of, found.values, strict=True)
            if name != OCV
        }
        scales = np.exp(found.log_scales).tolist()
        return CircuitParameters(
            tables=values,
            scales={axis.name: scale for axis, scale in zip(self.axes, scales, strict=True)},
            nodes=nodes,
            visited=tuple(self._nearest(np.array(nodes)).tolist()),
            dependence=self.facts[0].dependence,
        )

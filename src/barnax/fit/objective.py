"""The objective of tables over SOC, and its minimum for given time constants."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import takewhile
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import block_diag

from ..cell import CircuitParameters
from ..cell.circuits import get_circuit
from ..cell.elements import RC, alike, get_element, names_of
from ..cell.parameters import HALF_HYSTERESIS, OCV, OCV_CORRECTION, OHMIC, RATE
from ..cell.tables import hats
from ..global_optimum.objective import Box, LinearObjective, Solution
from ..model.descent import Axis
from ..model.other_sampling import LEAST_SHARE
from ..model.prepared import PreparedRecord
from ..model.reduced import Columns, Reduced
from ..model.search_space import Range
from .settings import TableSettings

# A hysteresis fitted together with an OCV is penalized relative to none: one that turns slowly can
# be any part of the OCV.
GAP_RIDGE = 1e-6
# The columns of a layout that do not depend on an axis, by what is tabulated.
FIXED = {
    OHMIC: "current",
    OCV: "correction",
    OCV_CORRECTION: "correction",
    HALF_HYSTERESIS: "initial_hysteresis",
}


class FittedTable(NamedTuple):
    """A table to fit: its name and nodes, the weight w and ridge of its penalty, and the lowest and
    highest values of its unknowns. If it `rises`, the unknowns are its value at the first node and
    the steps from node to node, each with its own bound."""

    name: str
    nodes: Float[np.ndarray, "nodes"]
    weight: float
    ridge: float
    low: Float[np.ndarray, "nodes"]
    high: Float[np.ndarray, "nodes"]
    rises: bool = False


@dataclass(frozen=True, eq=False)
class TableObjective(LinearObjective):
    """J of `settings` over records of one cell, for circuits with the same elements.

    `ranges` are the ranges of every pair's time constant in s, then of gamma if there is one, by
    name; `LogScales` are the logarithms of these. `reduced` is the factor of all scored samples,
    `parts` those of the groups of `blocks_of`, whose nodes may be finer; `smoothing_scale` scales
    all smoothing weights. Stored factors of records (`is_of_factors`) have no samples, and replace
    prepared records.
    """

    prepared_records: Sequence[Any]
    settings: TableSettings
    ranges: Mapping[str, Range]
    reduced: Reduced
    parts: Sequence[Reduced] = ()
    smoothing_scale: float = 1.0
    is_of_factors: bool = False

    @property
    def numbers(self) -> dict[str, float]:
        """The numbers of the resistance law."""
        dependence = self.prepared_records[0].dependence
        return {} if dependence is None else dependence.numbers

    @property
    def elements(self) -> tuple[str, ...]:
        return get_circuit(self.prepared_records[0].circuit).elements

    @property
    def pairs(self) -> int:
        """Number of elements, RC pairs mostly."""
        return len(self.ranges) - (RATE in self.ranges)

    @property
    def folds(self) -> int:
        """Folds into which the samples of every record are grouped."""
        return max(len(self.parts) // (2 * len(self.prepared_records)), 1)

    @property
    def nodes(self) -> int:
        """Number of nodes of all tables except an OCV correction."""
        return len(self.reduced.layout.nodes)

    @cached_property
    def _tables(self) -> tuple[FittedTable, ...]:
        """R0, the resistance of every pair, then the OCV or its correction, then the amplitude of a
        dynamic hysteresis, where these are tabulated.

        The weight of resistances is the capacity in Ah over 1 h. If the OCV is to rise, its
        correction may fall from node to node by at most the least rise of the known OCV; otherwise
        it is free.
        """
        settings, layout, records = self.settings, self.reduced.layout, self.prepared_records
        nodes, ridge = np.array(layout.nodes), settings.voltage_ridge
        zero, infinite = np.zeros(len(nodes)), np.full(len(nodes), np.inf)
        limits = {OHMIC: (self.least_r0_ohm, np.inf)} | settings.ranges
        given = records[0].capacity_ah, settings.resistance_ridge
        tables = []
        for name in (OHMIC, *(element.resistance for element in names_of(self.elements))):
            low, high = limits.get(name, (0.0, np.inf))
            tables.append(FittedTable(name, nodes, *given, zero + low, zero + high))
        is_fitted = layout.has_correction and settings.ocv_nodes is not None
        if layout.has_correction:
            at = np.array(layout.ocv_nodes)
            low, high = np.full(len(at), -np.inf), np.full(len(at), np.inf)
            if settings.rising_ocv:
                slopes = [record.cell.least_ocv_slopes(at) for record in records]
                low[1:] = -np.diff(at) * np.min(slopes, axis=0)
            name = OCV if is_fitted else OCV_CORRECTION
            tables.append(FittedTable(name, at, 1.0, ridge, low, high, settings.rising_ocv))
        if layout.has_amplitude:
            ridge = max(ridge, GAP_RIDGE) if is_fitted else ridge
            tables.append(FittedTable(HALF_HYSTERESIS, nodes, 1.0, ridge, zero, infinite))
        return tuple(tables)

    @property
    def tables(self) -> int:
        return len(self._tables)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of the tables."""
        return tuple(table.name for table in self._tables)

    @cached_property
    def nodes_of(self) -> tuple[Float[np.ndarray, "nodes"], ...]:
        """Every table's nodes."""
        return tuple(table.nodes for table in self._tables)

    @property
    def visited(self) -> Bool[np.ndarray, "nodes"]:
        """True at the nodes of a resistance that are nearest to some scored sample."""
        return self.visited_of(0)

    def visited_of(self, table: int) -> Bool[np.ndarray, "nodes"]:
        """True at the nodes of a table that are nearest to some scored sample."""
        return self._visits[len(self.nodes_of[table])]

    @cached_property
    def _visits(self) -> dict[int, Bool[np.ndarray, "nodes"]]:
        """The visited nodes by the number of nodes."""
        nodes = {len(nodes): nodes for nodes in reversed(self.nodes_of)}
        return {count: self._nearest(of_table) for count, of_table in nodes.items()}

    def _nearest(self, nodes: Float[np.ndarray, "nodes"]) -> Bool[np.ndarray, "nodes"]:
        return np.any([record.nearest(nodes) for record in self.prepared_records], axis=0)

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
        """The searched coordinates: the time constant of every element, whose table is the next
        after R0, then gamma if there is one, whose table is the last."""
        layout, axes = self.reduced.layout, list[Axis]()
        parts = {name: self.reduced.part(name) for name in ("pairs", "hysteresis_response")}

        def add(name, table, part, span, sign, element):
            low, high = np.log(self.ranges[name]).tolist()
            answers = parts[part], span.from_skeleton
            axes.append(Axis(name, low, high, table, *answers, span, sign, element))

        names = zip(names_of(self.elements), self.elements, strict=True)
        for table, (pair, element) in enumerate(names, 1):
            add(pair.tau, table, "pairs", layout.in_tau, 1, get_element(element))
        if layout.in_rate is not None:
            table = 1 + self.pairs + layout.has_correction if layout.has_amplitude else None
            add(RATE, table, "hysteresis_response", layout.in_rate, -1, RC)
        return tuple(axes)

    def parts_at(self, best: Solution) -> list[tuple[float, "TableObjective", Solution]]:
        return [(1.0, self, best)]

    @property
    def interchangeable(self) -> int:
        """Number of RC pairs, the first ones, that can be interchanged: those with the same box."""
        names, limits = names_of(self.elements)[: alike(self.elements)], self.settings.ranges
        boxes = [
            (axis.low, axis.high, limits.get(of_pair.resistance))
            for axis, of_pair in zip(self.axes, names, strict=False)
        ]
        return len([*takewhile(boxes[0].__eq__, boxes)]) if boxes[:1] == boxes[1:2] else 0

    @cached_property
    def fixed_columns(self) -> dict[int, Columns]:
        return {
            number: part @ _unit(table) if table.rises else part
            for number, table in enumerate(self._tables)
            if table.name in FIXED
            for part in self.reduced.part(FIXED[table.name])
        }

    @cached_property
    def base(self) -> Float[np.ndarray, "rows"]:
        return self.reduced.part("base")[0][:, 0]

    @cached_property
    def to_tables(self) -> Float[np.ndarray, "values unknowns"]:
        """The matrix from the unknowns to all tables' values."""
        return np.asarray(block_diag(*map(_unit, self._tables)))

    @cached_property
    def penalty(self) -> Float[np.ndarray, "penalties unknowns"]:
        return self.table_penalty @ self.to_tables

    @cached_property
    def table_penalty(self) -> Float[np.ndarray, "penalties values"]:
        """The rows of the penalty, by the tables' values."""
        scale = math.sqrt(self.smoothing_scale)
        blocks = (
            smoothing_rows(self.settings, len(table.nodes), table.weight * scale, table.ridge)
            for table in self._tables
        )
        return np.asarray(block_diag(*blocks))

    def furthest(self, objective_v2: float) -> Float[np.ndarray, "unknowns"]:
        """The largest magnitude of every unknown of tables with at most this J, from their
        ridges."""
        values = [
            np.full(len(table.nodes), np.sqrt(objective_v2 / (table.ridge * self.smoothing_scale)))
            / table.weight
            for table in self._tables
        ]
        # A step from node to node is at most the sum of both values.
        return np.abs(np.linalg.inv(self.to_tables)) @ np.concatenate(values)

    @cached_property
    def least_r0_ohm(self) -> float:
        """A lower limit of R0 at every node from the current steps of all records, because every
        cell has some: with a wrong OCV it would be fitted as zero. Zero if they do not determine
        it."""
        if OHMIC in self.settings.ranges:
            return 0.0
        return LEAST_SHARE * min(record.step_ohm for record in self.prepared_records)

    @cached_property
    def box(self) -> tuple[Float[np.ndarray, "unknowns"], Float[np.ndarray, "unknowns"]]:
        """Lowest and highest value of every unknown."""
        ends = zip(*((table.low, table.high) for table in self._tables), strict=True)
        low, high = map(np.concatenate, ends)
        return low, high

    def box_at(self, log_scales: Float[np.ndarray, "axes points"]) -> Box:
        low, high = (np.repeat(end[:, None], log_scales.shape[1], axis=1) for end in self.box)
        return low, high

    def values_of(self, x: Float[np.ndarray, "unknowns"]) -> tuple[Float[np.ndarray, "nodes"], ...]:
        rows = self.to_tables @ x
        return tuple(rows[self.block(table)] for table in range(self.tables))

    def free_directions(self, best: Solution) -> Float[np.ndarray, "values directions"]:
        """The directions in which tables can move within their bounds; those without a sample
        nearby are left out.

        Values at a bound stay. Nodes of the OCV correction that a bound ties together move as one.
        """
        blocks = []
        for number, table in enumerate(self._tables):
            is_free = best.active_set[self.block(number)] == 0
            eye, tied = np.eye(len(is_free)), np.cumsum(is_free) - 1
            moves = eye[: tied[-1] + 1, tied] if table.rises else eye[is_free]
            blocks.append(moves[moves @ self.visited_of(number) > 0].T)
        return np.asarray(block_diag(*blocks))

    def ocv_at(
        self, best: Solution
    ) -> tuple[Float[np.ndarray, "nodes"], Float[np.ndarray, "nodes"]]:
        """Nodes and OCV in V of a solution with a fitted OCV."""
        table = self.names.index(OCV)
        nodes = self.nodes_of[table]
        return nodes, self.prepared_records[0].cell.average_ocv_v(nodes) + best.values[table]

    def with_ocv(self, prepared: PreparedRecord, best: Solution) -> PreparedRecord:
        """A record with the fitted OCV of a solution."""
        if OCV not in self.names:
            return prepared
        table = self.names.index(OCV)
        added_v = hats(prepared.soc, self.nodes_of[table]) @ best.values[table]
        return replace(prepared, source_v=prepared.source_v + added_v)

    def tables_at(self, best: Solution) -> CircuitParameters:
        """A solution as stored, pairs from fast to slow, without a fitted OCV. If the OCV's
        correction has more nodes than resistances, all tables are stored at its nodes."""
        layout = self.reduced.layout
        nodes = layout.ocv_nodes if OCV_CORRECTION in self.names else layout.nodes
        values = {
            name: tuple((hats(np.array(nodes), of_table) @ row).tolist())
            for name, of_table, row in zip(self.names, self.nodes_of, best.values, strict=True)
            if name != OCV
        }
        scales = np.exp(best.log_scales).tolist()
        return CircuitParameters(
            tables=values,
            scales={axis.name: scale for axis, scale in zip(self.axes, scales, strict=True)},
            nodes=nodes,
            visited=tuple(self._nearest(np.array(nodes)).tolist()),
            dependence=self.prepared_records[0].dependence,
        )


def _unit(table: FittedTable) -> Float[np.ndarray, "nodes nodes"]:
    """The matrix from a table's unknowns to its values."""
    count = len(table.nodes)
    return np.tril(np.ones((count, count))) if table.rises else np.eye(count)


def smoothing_rows(
    settings: TableSettings, nodes: int, weight: float, ridge: float
) -> Float[np.ndarray, "penalties nodes"]:
    """The rows whose squares penalize one table: its bends, and its values themselves."""
    eye = np.eye(nodes)
    bent = math.sqrt(settings.roughness) * np.diff(eye, 2, axis=0)
    return weight * np.concatenate([bent, math.sqrt(ridge) * eye])

"""Records stored as their factors: all that a fit of any group of them needs, without their
samples.

A factor here is for one grid of time constants for all records, so that any of them can be joined:
the triangular factor of two records is that of their rows together. The grid represents every time
constant between its ends to 1e-7 of the largest current.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from ..cell import get_circuit
from ..cell.parameters import ANYWHERE
from ..cell.soc_axis import is_above
from ..errors import InputError
from ..execution import in_float64
from ..global_optimum.proof import Proof
from ..model.exponentials import Span, span_of
from ..model.layout import Layout
from ..model.prepared import PreparedRecord, prepare_record
from ..model.reduced import Reduced, combine_factors, reduce_records
from ..model.triangles import shorten
from .cross_validation import record_errors
from .flat_ocv import OCV_NODES, with_fitted_ocv, with_flat_ocv
from .node_interval import NodeInterval, mean_weights
from .objective import Solution, TableObjective
from .settings import TableSettings
from .table_fit import TableFit, assemble_fit
from .table_problem import find_best, search_ranges

# Bound on the error of a pair's response between the grid's ends, relative to the largest current.
TOLERANCE = 1e-7
# Rows of a factor that add less than this to any column's RMS, in V, are left out.
NEGLIGIBLE_V = 1e-9
OcvSource = Literal["OCV test", "own"]
# What a fit needs of a record, as in `PreparedRecord`.
INTERVALS = ("median_interval_s", "dense_interval_s")
FACTS = ("capacity_ah", "step_ohm", *INTERVALS, "scored_duration_s")


@dataclass(frozen=True)
class Grid:
    """The stored columns: one choice for all records that are to be fitted together.

    Args:
        low_s: Fastest time constant that a fit may try.
        high_s: Slowest time constant that a fit may try.
        circuit: Name of the circuit, without dynamic hysteresis.
        nodes: States of charge of the resistances' tables; a single one is a constant circuit, with
            the OCV of the test unchanged.
        ocv: Whether the OCV is that of a test, with a correction, or is fitted to the records.
    """

    low_s: float = 1.0
    high_s: float = 1000.0
    circuit: str = "so-rc"
    nodes: tuple[float, ...] = TableSettings().nodes
    ocv: OcvSource = "OCV test"

    def __post_init__(self) -> None:
        if not 0 < self.low_s < self.high_s < np.inf:
            raise InputError(
                f"a grid of time constants from {self.low_s:g} to {self.high_s:g} s is none; the "
                "faster one comes first, as in 1,1000"
            )
        if get_circuit(self.circuit).has_rate:
            raise InputError(
                f"the circuit {self.circuit} has a dynamic hysteresis, of which no factors are "
                "kept; use so-rc or iso-rc, or keep none"
            )

    def __str__(self) -> str:
        nodes = ", ".join(f"{node:g}" for node in self.nodes)
        return f"{self.low_s:g} to {self.high_s:g} s, {self.circuit}, {self.ocv}, nodes {nodes}"

    @property
    def is_constant(self) -> bool:
        return len(self.nodes) == 1

    @property
    def span(self) -> Span:
        return span_of(self.low_s, self.high_s, TOLERANCE)

    @property
    def layout(self) -> Layout:
        ocv_nodes = OCV_NODES if self.ocv == "own" else self.nodes
        has_correction = self.ocv == "own" or not self.is_constant
        return Layout(self.nodes, ocv_nodes, self.span, None, has_correction, False)


@dataclass(frozen=True, eq=False)
class NodeOcv:
    """The OCV relative to which a record's errors are stored: in V and its least slopes, at the
    nodes."""

    ocv_v: Float[np.ndarray, "nodes"]
    slopes_v: Float[np.ndarray, "intervals"]

    def average_ocv_v(self, nodes: Float[np.ndarray, "nodes"]) -> Float[np.ndarray, "nodes"]:
        """At the nodes, the only points where it is defined."""
        del nodes
        return self.ocv_v

    def least_ocv_slopes(self, nodes: Float[np.ndarray, "nodes"]) -> Float[np.ndarray, "_"]:
        """Between the nodes."""
        del nodes
        return self.slopes_v


@dataclass(frozen=True, eq=False)
class RecordFactors:
    """A record's factors and everything else a fit needs of it: all work that depends on its
    length.

    `parts` are for the samples below and above 10 % SOC, whose errors are reported separately.
    `visited` and `visited_ocv` are True at the nodes nearest to some sample, and the numbers are
    those of `PreparedRecord`.
    """

    name: str
    grid: Grid
    capacity_ah: float
    step_ohm: float
    median_interval_s: float
    dense_interval_s: float
    scored_duration_s: float
    visited: Bool[np.ndarray, "nodes"]
    visited_ocv: Bool[np.ndarray, "ocv_nodes"]
    cell: NodeOcv
    parts: tuple[Reduced, Reduced]
    dependence: None = None

    @property
    def circuit(self) -> str:
        return self.grid.circuit

    @property
    def scored(self) -> int:
        """Number of scored samples."""
        return sum(part.scored for part in self.parts)

    def nearest(self, nodes: Float[np.ndarray, "nodes"]) -> Bool[np.ndarray, "nodes"]:
        """True at the nodes of its tables that are nearest to some sample."""
        return self.visited if np.array_equal(nodes, self.grid.nodes) else self.visited_ocv

    def constant(self) -> "RecordFactors":
        """A copy for a circuit with one value of each resistance at every SOC, and a fitted OCV if
        it has one."""
        grid = replace(self.grid, nodes=ANYWHERE)
        parts = tuple(part.coarser(grid.layout) for part in self.parts)
        return replace(self, grid=grid, visited=np.array([True]), parts=parts)

    def counted_from(self, ocv: NodeOcv) -> "RecordFactors":
        """A copy with errors relative to another OCV, which differs by straight lines between
        nodes."""
        apart_v = self.cell.ocv_v - ocv.ocv_v
        if not np.any(apart_v):
            return self

        def moved(part: Reduced) -> Reduced:
            indices, factor = part.layout.columns, part.factor.copy()
            factor[:, indices["base"][0]] -= factor[:, indices["correction"][0]] @ apart_v[:, None]
            return replace(part, factor=factor)

        return replace(self, cell=ocv, parts=tuple(map(moved, self.parts)))


def factors_of(prepared: PreparedRecord, grid: Grid | None = None) -> RecordFactors:
    """A record's factors on a grid; for a cell without an OCV test the OCV is among the columns.
    Raises `InputError` if the grid's circuit does not fit the cell."""
    (record,) = factors_of_cells(prepared, grid or Grid())
    return record


@in_float64
def factors_of_cells(
    prepared: PreparedRecord,
    grid: Grid,
    voltage_offsets_v: Float[np.ndarray, "simulated cells"] | None = None,
    names: Sequence[str] = (),
) -> list[RecordFactors]:
    """The factors of every cell of a pack, whose voltages are above the record's by
    `voltage_offsets_v`."""
    cell = prepared.cell
    simulated = prepare_record(prepared.record, cell, grid.circuit, prepared.window)
    if cell.ocv_is_fitted:
        grid = replace(grid, ocv="own")
        (simulated,) = with_flat_ocv([simulated], prepared)
    record = prepared.record.name
    named = [f"{record} {name}" for name in names] or [record]
    layout = replace(grid.layout, voltages=tuple(range(len(named))))
    nodes, ocv_nodes = np.array(layout.nodes), np.array(layout.ocv_nodes)
    band = np.where(simulated.scored, is_above(simulated.soc), -1)
    offsets_v = None if voltage_offsets_v is None else [voltage_offsets_v]
    below, above = reduce_records([simulated], layout, [band], 2, offsets_v)
    has_slopes = layout.has_correction
    slopes_v = simulated.cell.least_ocv_slopes(ocv_nodes) if has_slopes else np.empty(0)
    facts = {name: getattr(simulated, name) for name in FACTS}
    facts |= {"visited": simulated.nearest(nodes), "visited_ocv": simulated.nearest(ocv_nodes)}
    ocv = NodeOcv(simulated.cell.average_ocv_v(ocv_nodes), slopes_v)
    return [
        RecordFactors(name=name, grid=grid, cell=ocv, **facts,
             parts=(_shortened(below.of_voltage(number)), _shortened(above.of_voltage(number))))
        for number, name in enumerate(named)
    ]  # fmt: skip


def _shortened(part: Reduced) -> Reduced:
    factor = shorten(part.factor, NEGLIGIBLE_V * np.sqrt(max(part.scored, 1)))
    # A factor of fewer rows than the padded multiple was filled up.
    filled = max(1, int(np.count_nonzero(np.any(factor, axis=1))))
    return replace(part, factor=factor[:filled])


@in_float64
def fit_factors(
    records: Sequence[RecordFactors], settings: TableSettings | None = None
) -> TableFit:
    """The best tables for several records together, as `fit_tables` computes them from samples.

    There is no proof. Intervals come from the spread of the fits to at least three single records,
    because the correlation within a record is not stored.

    Args:
        records: Their factors on one grid, whose states of charge are on one axis.
        settings: Weights, bounds and fixed values; the nodes are the grid's.

    Raises `InputError` if records are on different grids.
    """
    first = records[0]
    for record in records:
        if record.grid != first.grid:
            raise InputError(
                f"{record.name}: its factor is on another grid than that of {first.name}: "
                f"{record.grid} instead of {first.grid}; keep factors of all records with the same "
                "options"
            )
    objective = objective_of(records, settings or TableSettings())
    best = find_best(objective)
    return assemble_fit(
        objective,
        Proof(0.0, 0, best),
        intervals=_without_noise(objective, best),
        errors=record_errors(objective, best),
    )


def objective_of(records: Sequence[RecordFactors], settings: TableSettings) -> TableObjective:
    """The objective; time constants are limited to the range of the grid."""
    grid = records[0].grid
    layout = grid.layout
    settings = replace(
        settings,
        nodes=grid.nodes,
        ocv_nodes=None,
        ocv_correction=layout.has_correction,
        rising_ocv=settings.rising_ocv and layout.has_correction,
        half_hysteresis=False,
        resistances_follow="none",
    )
    if grid.ocv == "own":
        settings = with_fitted_ocv(settings)
        records = [record.counted_from(records[0].cell) for record in records]
    ranges = {
        name: (min(max(low, grid.low_s), grid.high_s), max(min(high, grid.high_s), grid.low_s))
        for name, (low, high) in search_ranges(records, settings).items()
    }
    parts = [part for record in records for part in record.parts]
    # Factors with few rows are joined to one without samples.
    none = Reduced(layout, 0, np.zeros((layout.width, layout.width)))
    joined = combine_factors([none, *parts])
    return TableObjective(records, settings, ranges, joined, parts, is_of_factors=True)


def _without_noise(objective: TableObjective, best: Solution) -> tuple[NodeInterval, ...]:
    """The values of visited nodes, time constants and means, without intervals."""
    rows, scales = np.concatenate(best.values), np.exp(best.log_scales)
    values = {key: float(rows[row]) for key, row in objective.visited_rows.items()}
    names = [(axis.name, None) for axis in objective.axes]
    values |= dict(zip(names, scales.tolist(), strict=True))
    for name in objective.names[: 1 + objective.pairs]:
        values[name, None] = float(mean_weights(objective, name) @ rows)
    return tuple(NodeInterval(*key, value, 0.0, 0.0, None, None) for key, value in values.items())

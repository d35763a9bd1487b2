"""The OCV of a cell without an OCV test: one more table, fitted to the records with all others.

The voltage is linear in the OCV's table too, so time constants, resistances and OCV are one search
with one proof. A record cannot determine the position of its charge on the SOC axis: capacity and
start only define the axis, and are taken from given values, from a full charge in the record, or
from its span of charge.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..cell import CellModel, get_circuit
from ..cell.characterize import over_temperatures
from ..cell.elements import names_of
from ..cell.parameters import HALF_HYSTERESIS, OCV, RATE
from ..display import Brief
from ..execution import in_float64
from ..model.prepared import PreparedRecord, prepare_record
from ..model.window import Window
from ..notices import Notice
from .certificate import certify
from .current_offset import offset_effect
from .flat_ocv import cell_with_fitted_ocv, with_fitted_ocv, with_flat_ocv
from .node_interval import parts_of
from .objective import Solution, TableObjective
from .settings import TableSettings
from .starts import RecordsWithoutOcvTest, Starts, windows_of_records
from .table_fit import OcvCompared, TableFit, assemble_fit
from .table_problem import search_ranges, solve_at
from .temperature import TableFits, fit_temperatures, group_by_temperature


@dataclass(frozen=True, eq=False, repr=False)
class FittedOcv(Brief):
    """A cell whose OCV was fitted to the records, and the tables fitted with it.

    Attributes:
        cell: The cell, with both branches if a hysteresis was identified. At several temperatures,
            one for each.
        windows: The windows of the records, each with its start on the axis.
        fits: The tables over SOC, with the OCV among their intervals.
        circuit: Name of their circuit.
        warnings: Evidence against the starts.
        directions: For records whose direction before the start was determined by the fit, the RMSE
            in V with the other direction.
        tried: The circuits that were tried, if there was a choice.
    """

    cell: CellModel
    windows: Mapping[str, Window]
    fits: TableFits
    circuit: str
    warnings: tuple[Notice, ...] = ()
    directions: Mapping[str, float] = field(default_factory=dict)
    tried: tuple[Any, ...] = ()

    @property
    def fit(self) -> TableFit:
        """The tables; at several temperatures those nearest to 25 degC."""
        return self.fits.reference


def prove_with_ocv(
    untested: RecordsWithoutOcvTest, objective: TableObjective, best: Solution, starts: Starts
) -> FittedOcv:
    """The best tables with their OCV, proved, with all intervals and errors."""
    records = objective.prepared_records
    circuit = records[0].circuit
    proof = certify(objective, best)
    # Several records at different rates would determine the offset.
    effect = offset_effect(objective, proof.best) if len(records) == 1 else None
    cell = cell_with_fitted_ocv(
        objective, proof.best, untested.capacity_ah, untested.capacity_origin
    )
    fit = assemble_fit(objective, proof, _with_cell(objective, cell))
    # If a pair's time constant is at the slowest bound, the OCV absorbs whatever is slower.
    slowest = {hit.name for hit in fit.at_bound if hit.side == "upper"}
    pairs = names_of(get_circuit(circuit).elements)
    is_open = {pair.resistance for pair in pairs if pair.tau in slowest}
    if any(hit.name == RATE and hit.side == "lower" for hit in fit.at_bound):
        # A hysteresis that hardly reverses and the OCV compensate each other.
        is_open |= {HALF_HYSTERESIS, OCV}
    intervals, means = (
        tuple(
            node if is_open.isdisjoint(parts_of(node.name)) else node.as_undetermined()
            for node in given
        )
        for given in (fit.intervals, fit.means)
    )
    fit = replace(fit, of_offset=effect, intervals=intervals, means=means)
    fits = TableFits((fit,), settings=objective.settings)
    return FittedOcv(
        cell, windows_of_records(records), fits, circuit, starts.warnings, starts.directions
    )


def fit_temperatures_with_ocv(untested: RecordsWithoutOcvTest, circuit: str) -> FittedOcv:
    """Tables over SOC and an OCV for each temperature, on one axis, with shared time constants;
    already proved."""
    starts, settings = untested.starts_by_temperature(circuit), untested.settings_of(circuit)
    prepared, cells = untested.prepared(circuit, starts.windows), list[CellModel]()

    def records_with_ocv(objective: TableObjective, best: Solution) -> list[PreparedRecord]:
        cells.append(
            cell_with_fitted_ocv(objective, best, untested.capacity_ah, untested.capacity_origin)
        )
        return _with_cell(objective, cells[-1])

    groups = group_by_temperature(prepared)
    fits = fit_temperatures(groups, settings, records_with_ocv)
    cell = over_temperatures(dict(zip(groups, cells, strict=True)))
    return FittedOcv(
        cell, windows_of_records(prepared), fits, circuit, starts.warnings, starts.directions
    )


def _with_cell(objective: TableObjective, cell: CellModel) -> list[PreparedRecord]:
    """The objective's records with the fitted OCV."""
    return [
        prepare_record(prepared.record, cell, prepared.circuit, prepared.window)
        for prepared in objective.prepared_records
    ]


COMPARED_SOC = np.linspace(0.1, 0.9, 81)


@in_float64
def compare_ocv(
    prepared_records: Sequence[PreparedRecord], fit: TableFit, settings: TableSettings
) -> OcvCompared | None:
    """The distance of a fitted OCV from the cell's, at the time constants of tables fitted to the
    records; None if they visit too little of it."""
    first = prepared_records[0]
    names = search_ranges(prepared_records, settings)
    log_scales = tuple(math.log(fit.tables.constants[name]) for name in names)
    settings = with_fitted_ocv(replace(settings, folds=0))
    records = [
        one.with_dependence(fit.tables.dependence) for one in with_flat_ocv(prepared_records)
    ]
    objective, best = solve_at(records, settings, names, log_scales, exact=True)
    nodes, fitted_v = objective.ocv_at(best)
    seen = nodes[objective.visited_of(objective.names.index(OCV))]
    soc = COMPARED_SOC[(seen.min() <= COMPARED_SOC) & (seen.max() >= COMPARED_SOC)]
    if not len(soc):
        return None
    apart_v = np.interp(soc, nodes, fitted_v) - first.cell.average_ocv_v(soc)
    largest = int(np.argmax(np.abs(apart_v)))
    return OcvCompared(
        median_v=float(np.median(np.abs(apart_v))),
        largest_v=float(apart_v[largest]),
        largest_soc=float(soc[largest]),
    )

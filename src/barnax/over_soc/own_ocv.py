"""The OCV of a cell without an OCV test: one more table, fitted to the records with all others.

The voltage is linear in the OCV's table too, so time constants, resistances and OCV are one search
with one proof. What one record cannot tell is where its charge stands on the axis of SOC: its
capacity and its start only name the axis, and are taken from what is given, from a full charge that
the record holds, or from its own span.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np

from ..blas import one_blas_thread
from ..cell import CellModel, OcvPoint, OcvTable, characterize, get_circuit
from ..cell.characterize import over_temperatures
from ..cell.elements import names_of
from ..cell.model import group_near
from ..cell.ocv_table import EITHER
from ..cell.parameters import HALF_HYSTERESIS, OCV
from ..cell.soc_axis import CHARGE, DISCHARGE
from ..display import Brief
from ..errors import InputError
from ..global_optimum.proof import Proof
from ..model.prepared import PreparedRecord, prepare_record
from ..model.start import find_start, require_whole_log
from ..model.temperature import temperature_of
from ..model.window import Window, first_sample
from ..notices import Notice, notice
from ..records import Record, rest_current_a
from ..records.record import in_means
from .certificate import certify
from .cross_validation import held_out_errors
from .current_offset import offset_effect
from .dependence import searched
from .fit import TableFit, constant_with_ocv_held_out, fit_of
from .further_terms import directed, is_supported, shows_more, turning_at_once
from .intervals import NodeInterval
from .level import level_cell, with_own_ocv
from .objective import Solution, TableObjective
from .own_axis import Axis, axis_capacity, axis_of, require_on_axis, span_ah_of
from .registration import MEANS_S, register
from .settings import TableSettings
from .temperature import TableFits, fit_temperatures, group_by_temperature

# Between two nodes the OCV is a straight line: so many points of it make a curve of that.
POINTS_A_NODE = 8


@dataclass(frozen=True, eq=False, repr=False)
class OwnOcv(Brief):
    """A cell whose OCV the records themselves show, and the tables that were fitted with it.

    Attributes:
        cell: The cell; one OCV for both directions, no hysteresis. Over temperature, one for each.
        windows: The windows of the records, each with its start on the axis.
        found: The tables over SOC, and the OCV among their intervals.
        settings: How they were fitted.
        circuit: Name of the circuit that they are of.
        warnings: What speaks against the starts.
        unproved: The objective and its best tables; None once that is proved.
        directions: Of the records whose direction before the start was found by the fit, the RMSE
            in V with the other one.
    """

    cell: CellModel
    windows: Mapping[str, Window]
    found: TableFits
    settings: TableSettings
    circuit: str
    warnings: tuple[Notice, ...] = ()
    unproved: tuple[TableObjective, Solution] | None = None
    directions: Mapping[str, float] = field(default_factory=dict)

    @property
    def fit(self) -> TableFit:
        """The tables, of several temperatures those nearest to 25 degC."""
        return self.found.reference


def search_with_ocv(
    records: Sequence[Record],
    circuit: str,
    windows: Mapping[str, Window],
    settings: TableSettings,
    capacity_ah: float | None = None,
    over_temperature: bool = False,
    beside: Sequence[str] = (),
) -> OwnOcv:
    """Tables over SOC and the OCV that fit some records of one cell best, together.

    `proved` proves them; those over temperature are proved already. Records without a known start
    take theirs from a rest, on the OCV that the others show. Over temperature, each one has its own
    OCV and tables, on one axis with one set of time constants.

    Args:
        records: The records.
        circuit: Name of the circuit. A dynamic hysteresis is one more table; of a switched one such
            records tell nothing.
        windows: The window of each record by its name.
        settings: How tables are fitted; the OCV stands at `ocv_nodes`, by default closer ones.
        capacity_ah: The capacity; None takes what the records span.
        over_temperature: Whether records of each temperature are fitted by themselves.
        beside: Circuits of which the best takes the other's place where the records speak for it,
            at the same starts; a record that is too short for one leaves it out.

    Raises `InputError` where a start or a temperature is not known, and as `fit_tables` and
    `fit_temperatures` do.
    """
    axis_ah, origin = axis_capacity(records, windows, capacity_ah)
    own = with_own_ocv(settings, circuit)
    groups: list[Sequence[Record]] = [records]
    if over_temperature:
        known: list[tuple[float, Record]] = []
        for record in records:
            if (degc := temperature_of(record, windows[record.name])) is None:
                raise notice("temperature.unknown", record.name).error()
            known.append((degc, record))
        groups = list(group_near(known).values())
    started: dict[str, Window] = {}
    told: list[Notice] = []
    for alike in groups:
        of_group, against = _started(alike, circuit, windows, own, axis_ah, origin)
        started, told = started | of_group, told + against
    found = _fitted(records, circuit, started, own, axis_ah, origin, over_temperature, beside)
    return replace(found, warnings=(*told, *found.warnings))


def _started(
    records: Sequence[Record],
    circuit: str,
    windows: Mapping[str, Window],
    own: TableSettings,
    axis_ah: float,
    origin: str,
) -> tuple[dict[str, Window], list[Notice]]:
    """The windows of records of one temperature with their starts, and what speaks against them."""
    axes = {record.name: axis_of(record, windows[record.name], axis_ah) for record in records}
    known = [record for record in records if axes[record.name].source != "own span"]
    known = known or [max(records, key=span_ah_of)]
    for record in known:
        require_on_axis(record, windows[record.name], axes[record.name].initial_soc, axis_ah)
    quick, told = replace(own, folds=0, max_boxes=0), list[Notice]()
    if len(known) < len(records):
        at_axes = _on_axes(known, windows, axes, axis_ah)
        cell = _cell_found(known, circuit, at_axes, quick, axis_ah, origin)
        for record in records:
            if record not in known:
                window = replace(windows[record.name], capacity_ah=axis_ah)
                rest_a = window.rest_current_a or rest_current_a(record, axis_ah)
                given = window, axis_ah, first_sample(record, window, rest_a), rest_a
                try:
                    start, _, against = find_start(record, cell, *given)
                except InputError as unknown:
                    require_whole_log(record, records, unknown)
                    raise
                told += against
                axes[record.name] = Axis(start.soc, "rest elsewhere")
    found = _on_axes(records, windows, axes, axis_ah)
    if len(records) > 1 and not own.keep_starts:
        cell = _cell_found(records, circuit, found, quick, axis_ah, origin)
        alone = [prepare_record(record, cell, circuit, found[record.name]) for record in records]
        found = {prepared.record.name: prepared.window for prepared in register(alone, own)}
    return found, told


def _on_axes(
    records: Sequence[Record],
    windows: Mapping[str, Window],
    axes: Mapping[str, Axis],
    capacity_ah: float,
) -> dict[str, Window]:
    """The windows of records with their starts on the axis."""
    return {
        record.name: replace(
            windows[record.name],
            initial_soc=axis.initial_soc,
            soc_source=None if axis.source == "given" else axis.source,
            capacity_ah=capacity_ah,
        )
        for record in records
        for axis in [axes[record.name]]
    }


def _cell_found(
    records: Sequence[Record],
    circuit: str,
    windows: Mapping[str, Window],
    settings: TableSettings,
    capacity_ah: float,
    origin: str,
) -> CellModel:
    """The cell of records, before anything else is asked of their tables."""
    level = level_cell(capacity_ah, float(np.median(records[0].voltage_v)))
    means = [in_means(record, MEANS_S) for record in records]
    prepared = [prepare_record(record, level, circuit, windows[record.name]) for record in means]
    with one_blas_thread():
        return _cell_of(*searched(prepared, settings), capacity_ah, origin)


def _fitted(
    records: Sequence[Record],
    circuit: str,
    windows: Mapping[str, Window],
    settings: TableSettings,
    capacity_ah: float,
    origin: str,
    over_temperature: bool = False,
    beside: Sequence[str] = (),
) -> OwnOcv:
    level = level_cell(capacity_ah, float(np.median(records[0].voltage_v)))

    def prepared_for(circuit: str) -> list[PreparedRecord]:
        return [prepare_record(record, level, circuit, windows[record.name]) for record in records]

    prepared = prepared_for(circuit)
    if not over_temperature:
        with one_blas_thread():
            objective, best = searched(prepared, settings)
            directions: Mapping[str, float] = {}
            if get_circuit(circuit).has_rate:
                turned, directions = directed(prepared, settings, best.log_scales)
                if any(one is not other for one, other in zip(turned, prepared, strict=True)):
                    objective, best = searched(turned, settings)
            supported, warnings = [], list[Notice]()
            for other in beside:
                own = with_own_ocv(settings, other)
                if not shows_more(other, objective, best, own):
                    continue
                # A fast log may be too short for a further pair.
                with suppress(InputError):
                    further, others = prepared_for(other), {}
                    if get_circuit(other).has_rate:
                        further, others = directed(further, own, best.log_scales)
                    tried = _worth_more(further, own, objective, best)
                    against = list(turning_at_once(*tried)) if tried is not None else []
                    warnings += against
                    if tried is not None and not against:
                        supported.append((*tried, other, others))
            if supported:
                # A further pair and a hysteresis can each imitate the other.
                found = min(supported, key=lambda more: more[1].rms_v)
                objective, best, circuit, directions = found
        cell = _cell_of(objective, best, capacity_ah, origin)
        windows = {prepared.record.name: prepared.window for prepared in objective.prepared_records}
        told = _told(objective, Proof(0.0, 0, best), cell, windows, circuit)
        return replace(told, directions=directions, warnings=() if supported else tuple(warnings))
    cells: list[CellModel] = []

    def at_home(objective: TableObjective, best: Solution) -> list[PreparedRecord]:
        cells.append(_cell_of(objective, best, capacity_ah, origin))
        return _at_home(objective, cells[-1])

    groups = group_by_temperature(prepared)
    found = fit_temperatures(groups, settings, at_home)
    cell = over_temperatures(dict(zip(groups, cells, strict=True)))
    fits = tuple(
        _of_ocv(fit, own, settings, level)
        for fit, own in zip(found.fits, groups.values(), strict=True)
    )
    return OwnOcv(cell, windows, replace(found, fits=fits), settings, circuit)


def _worth_more(
    prepared: Sequence[PreparedRecord],
    settings: TableSettings,
    objective: TableObjective,
    best: Solution,
) -> tuple[TableObjective, Solution] | None:
    """The best tables of a circuit with a further pair, where what is held out speaks for it."""
    held_out = held_out_errors(objective, best)
    if held_out is None:
        return None
    tried = searched(prepared, settings, objective)
    errors = held_out_errors(*tried)
    return tried if is_supported(tried, errors, (objective, best), held_out) else None


def proved(own: OwnOcv) -> OwnOcv:
    """The same with a bound on how much better others could be."""
    if own.unproved is None:
        return own
    objective, best = own.unproved
    with one_blas_thread():
        proof = certify(objective, best)
    if proof.best is best:
        fits = (own.fit.proved(proof, own.settings.proved_share),)
        return replace(own, found=replace(own.found, fits=fits), unproved=None)
    # A better circuit was met on the way.
    cell = _cell_of(objective, proof.best, own.cell.capacity_ah, own.cell.capacity_origin)
    better = _told(objective, proof, cell, own.windows, own.circuit)
    return replace(better, warnings=own.warnings, unproved=None, directions=own.directions)


def _told(
    objective: TableObjective,
    proof: Proof[Solution],
    cell: CellModel,
    windows: Mapping[str, Window],
    circuit: str,
) -> OwnOcv:
    """All that is known of tables with their OCV, which is that of the cell."""
    prepared, best = objective.prepared_records, proof.best
    with one_blas_thread():
        # Several records whose rates differ would tell it.
        effect = offset_effect(objective, best) if len(prepared) == 1 else None
    fit = replace(fit_of(objective, proof, _at_home(objective, cell)), of_offset=effect)
    plain = [record.following(None) for record in prepared]
    fit = _of_ocv(fit, plain, objective.settings, prepared[0].cell)
    fit = replace(fit, intervals=tuple(_with_open_pairs(fit, circuit)))
    unproved = objective, best
    return OwnOcv(cell, windows, TableFits((fit,)), objective.settings, circuit, (), unproved)


def _with_open_pairs(fit: TableFit, circuit: str) -> Iterator[NodeInterval]:
    """The intervals; resistances of a pair whose time constant ended at the slowest have none, for
    the OCV takes up what is slower still."""
    slowest = {hit.name for hit in fit.at_bound if hit.side == "upper"}
    pairs = names_of(get_circuit(circuit).elements)
    is_open = {pair.resistance for pair in pairs if pair.tau in slowest}
    for node in fit.intervals:
        yield node.opened() if node.name in is_open else node


def _at_home(objective: TableObjective, cell: CellModel) -> list[PreparedRecord]:
    """The objective's records with the OCV that was found."""
    return [
        prepare_record(prepared.record, cell, prepared.circuit, prepared.window)
        for prepared in objective.prepared_records
    ]


def _of_ocv(
    fit: TableFit, prepared: Sequence[PreparedRecord], settings: TableSettings, level: CellModel
) -> TableFit:
    """A fit whose OCV is told as such, and whose constant circuit has an OCV of its own too, which
    in each fold knows no more than the tables' does."""
    if fit.cross_validation is not None:
        constant = constant_with_ocv_held_out(prepared, settings)
        if constant is not None:
            crossed = replace(fit.cross_validation, constant=constant)
            fit = replace(fit, cross_validation=crossed)
    intervals = tuple(
        interval.moved(float(level.average_ocv_v(np.array(interval.soc))))
        if interval.name == OCV
        else interval
        for interval in fit.intervals
    )
    return replace(fit, intervals=intervals)


def _cell_of(
    objective: TableObjective, best: Solution, capacity_ah: float, origin: str
) -> CellModel:
    """The cell with the OCV of a solution, as far as samples go."""
    nodes, ocv_v = objective.ocv_at(best)
    soc = np.concatenate([prepared.soc[prepared.scored] for prepared in objective.prepared_records])
    # Straight lines between nodes are the fit; a cubic through the nodes would be another one.
    low, high = max(nodes[0], float(soc.min())), min(nodes[-1], float(soc.max()))
    fine = np.interp(
        np.arange(POINTS_A_NODE * (len(nodes) - 1) + 1) / POINTS_A_NODE,
        np.arange(len(nodes)),
        nodes,
    )
    at = np.unique([low, *fine[(fine > low) & (fine < high)], high])
    name = " + ".join(prepared.record.name for prepared in objective.prepared_records)
    ocv_v, half_v = np.interp(at, nodes, ocv_v), 0.0
    if HALF_HYSTERESIS in objective.names:
        place = objective.names.index(HALF_HYSTERESIS)
        half_v = np.interp(at, objective.nodes_of[place], best.values[place])
    directions = (DISCHARGE, CHARGE) if np.any(half_v) else (EITHER,)
    branches = {
        direction: tuple(
            OcvPoint(*pair, name, row=0, rest_s=0.0)
            for pair in zip(at.tolist(), (ocv_v + direction * half_v).tolist(), strict=True)
        )
        for direction in directions
    }
    table = OcvTable(name, branches, sha256="")
    cell = characterize([table], capacity_ah=capacity_ah, ocv_fit="interpolated")
    # What a table of a measured OCV would be asked is not asked.
    return replace(cell, capacity_origin=origin, warnings=())

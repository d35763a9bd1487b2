"""The OCV of a cell without an OCV test: one more table, fitted to the records with all others.

The voltage is linear in the OCV's table too, so time constants, resistances and OCV are one search
with one proof. What one record cannot tell is where its charge stands on the axis of SOC: its
capacity and its start only name the axis, and are taken from what is given, from a full charge that
the record holds, or from its own span.
"""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ..blas import one_blas_thread
from ..cell import CellModel, OcvPoint, OcvTable, characterize
from ..cell.characterize import over_temperatures
from ..cell.model import group_near
from ..cell.parameters import OCV
from ..cell.soc_axis import GIVEN
from ..display import Brief
from ..errors import InputError
from ..execution import in_float64
from ..model.prepared import OCV_MARGIN, PreparedRecord, prepare_record, soc_along
from ..model.start import find_start
from ..model.temperature import temperature_of
from ..model.window import Window, first_sample, scored_samples
from ..notices import notice
from ..records import Record, rest_current_a
from ..records.record import in_means
from ..records.segments import FULL_CHARGE, held_charges
from .certificate import certify
from .cross_validation import held_out_errors
from .current_offset import offset_effect
from .dependence import searched
from .fit import OcvCompared, TableFit, constant_with_ocv_held_out, fit_of
from .level import level_cell, leveled, with_own_ocv
from .objective import Solution, TableObjective
from .problem import box_of, reduced_objective
from .registration import MEANS_S, register
from .settings import TableSettings
from .temperature import TableFits, fit_temperatures, group_by_temperature

# Between two nodes the OCV is a straight line: so many points of it make a curve of that.
POINTS_A_NODE = 8
# Where it is compared with that of an OCV test.
COMPARED_SOC = np.linspace(0.1, 0.9, 81)

AxisSource = Literal["given", "own full charge", "own span", "rest elsewhere"]
# A start lies so far outside 0 to 1 where another full charge was a little fuller.
NEARLY_SOC = 0.02
# A usual cell under load is never empty above this.
NEVER_EMPTY_V = 3.4


@dataclass(frozen=True)
class Axis:
    """The place of a record's charge on the axis of SOC, and its source."""

    initial_soc: float
    source: AxisSource


@dataclass(frozen=True, eq=False, repr=False)
class OwnOcv(Brief):
    """A cell whose OCV the records themselves show, and the tables that were fitted with it.

    Attributes:
        cell: The cell; one OCV for both directions, no hysteresis. Over temperature, one for each.
        windows: The windows of the records, each with its start on the axis.
        found: The tables over SOC, and the OCV among their intervals.
        settings: How they were fitted.
        circuit: Name of the circuit that they are of.
    """

    cell: CellModel
    windows: Mapping[str, Window]
    found: TableFits
    settings: TableSettings
    circuit: str

    @property
    def fit(self) -> TableFit:
        """The tables, of several temperatures those nearest to 25 degC."""
        return self.found.reference


def fit_with_ocv(
    records: Sequence[Record],
    circuit: str,
    windows: Mapping[str, Window],
    settings: TableSettings,
    capacity_ah: float | None = None,
    over_temperature: bool = False,
    beside: str | None = None,
) -> OwnOcv:
    """Tables over SOC and the OCV that fit some records of one cell best, together.

    Records without a known start take theirs from a rest, on the OCV that the others show. Over
    temperature, each one has its own OCV and tables, on one axis with one set of time constants.

    Args:
        records: The records.
        circuit: Name of the circuit; one without hysteresis, of which such records tell nothing.
        windows: The window of each record by its name.
        settings: How tables are fitted; the OCV stands at `ocv_nodes`, by default closer ones.
        capacity_ah: The capacity; None takes what the records span.
        over_temperature: Whether records of each temperature are fitted by themselves.
        beside: A circuit that takes the other's place where what is held out speaks for it, at the
            same starts; a record that is too short for it leaves the other.

    Raises `InputError` where a start or a temperature is not known, and as `fit_tables` and
    `fit_temperatures` do.
    """
    axis_ah, origin = _capacity(records, windows, capacity_ah)
    own = with_own_ocv(settings)
    groups: list[Sequence[Record]] = [records]
    if over_temperature:
        known: list[tuple[float, Record]] = []
        for record in records:
            if (degc := temperature_of(record, windows[record.name])) is None:
                raise notice("temperature.unknown", record.name).error()
            known.append((degc, record))
        groups = list(group_near(known).values())
    started: dict[str, Window] = {}
    for alike in groups:
        started |= _started(alike, circuit, windows, own, axis_ah, origin)
    return _fitted(records, circuit, started, own, axis_ah, origin, over_temperature, beside)


def _started(
    records: Sequence[Record],
    circuit: str,
    windows: Mapping[str, Window],
    own: TableSettings,
    axis_ah: float,
    origin: str,
) -> dict[str, Window]:
    """The windows of records of one temperature with their starts."""
    axes = {record.name: _axis(record, windows[record.name], axis_ah) for record in records}
    known = [record for record in records if axes[record.name].source != "own span"]
    known = known or [max(records, key=_span_ah)]
    for record in known:
        _require_on_axis(record, windows[record.name], axes[record.name].initial_soc, axis_ah)
    quick = replace(own, folds=0, max_boxes=0)
    if len(known) < len(records):
        at_axes = _on_axes(known, windows, axes, axis_ah)
        cell = _cell_found(known, circuit, at_axes, quick, axis_ah, origin)
        for record in records:
            if record not in known:
                window = replace(windows[record.name], capacity_ah=axis_ah)
                rest_a = window.rest_current_a or rest_current_a(record, axis_ah)
                given = window, axis_ah, first_sample(record, window), rest_a
                start, *_ = find_start(record, cell, *given)
                axes[record.name] = Axis(start.soc, "rest elsewhere")
    found = _on_axes(records, windows, axes, axis_ah)
    if len(records) > 1 and not own.keep_starts:
        cell = _cell_found(records, circuit, found, quick, axis_ah, origin)
        told = [prepare_record(record, cell, circuit, found[record.name]) for record in records]
        found = {prepared.record.name: prepared.window for prepared in register(told, own)}
    return found


@in_float64
def compare_with_own(
    prepared_records: Sequence[PreparedRecord], fit: TableFit, settings: TableSettings
) -> OcvCompared | None:
    """The errors with an OCV of the records' own in place of their cell's, at the time constants of
    tables that were fitted to them, without search or proof; None where they visit too little."""
    first = prepared_records[0]
    level = level_cell(first.capacity_ah, float(np.median(first.voltage_v)))
    found = fit.tables.constants
    ranges = {name: (found[name], found[name]) for name in box_of(prepared_records, settings)}

    def without_ocv(prepared: PreparedRecord) -> PreparedRecord:
        return leveled(prepared, level).following(fit.tables.dependence)

    objective = reduced_objective(prepared_records, with_own_ocv(settings), ranges, without_ocv)
    with one_blas_thread():
        log_scales = tuple(math.log(low) for low, _ in ranges.values())
        best = objective.solve(log_scales, exact=True)
        held_out = held_out_errors(objective, best)
    nodes, own_v = objective.ocv_at(best)
    seen = nodes[objective.visited_of(objective.names.index(OCV))]
    soc = COMPARED_SOC[(seen.min() <= COMPARED_SOC) & (seen.max() >= COMPARED_SOC)]
    if not len(soc):
        return None
    apart_v = np.interp(soc, nodes, own_v) - first.cell.average_ocv_v(soc)
    largest = int(np.argmax(np.abs(apart_v)))
    return OcvCompared(
        own_v=float(np.sqrt(best.error @ best.error)),
        held_out=held_out,
        median_v=float(np.median(np.abs(apart_v))),
        largest_v=float(apart_v[largest]),
        largest_soc=float(soc[largest]),
    )


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
    beside: str | None = None,
) -> OwnOcv:
    level = level_cell(capacity_ah, float(np.median(records[0].voltage_v)))

    def prepared_for(circuit: str) -> list[PreparedRecord]:
        return [prepare_record(record, level, circuit, windows[record.name]) for record in records]

    prepared = prepared_for(circuit)
    cells: list[CellModel] = []

    def at_home(objective: TableObjective, best: Solution) -> list[PreparedRecord]:
        """The objective's records with the OCV that was found."""
        cells.append(_cell_of(objective, best, capacity_ah, origin))
        own = [prepared.record for prepared in objective.prepared_records]
        return [prepare_record(record, cells[-1], circuit, windows[record.name]) for record in own]

    if over_temperature:
        groups = group_by_temperature(prepared)
        found = fit_temperatures(groups, settings, at_home)
        cell = over_temperatures(dict(zip(groups, cells, strict=True)))
    else:
        groups = {0.0: prepared}
        with one_blas_thread():
            objective, best = searched(prepared, settings)
            held_out = held_out_errors(objective, best) if beside else None
            if beside is not None and held_out is not None:
                with suppress(InputError):
                    # A trial that is not worth its pair is not proved either.
                    tried = searched(prepared_for(beside), settings, objective)
                    errors = held_out_errors(*tried)
                    if errors is not None and errors.is_worth(held_out):
                        (objective, best), circuit = tried, beside
            proof = certify(objective, best)
            # Several records whose rates differ would tell it.
            effect = offset_effect(objective, proof.best) if len(records) == 1 else None
        fit = fit_of(objective, proof, at_home(objective, proof.best))
        found, cell = TableFits((replace(fit, of_offset=effect),)), cells[0]
    fits = tuple(
        _of_ocv(fit, own, settings, level)
        for fit, own in zip(found.fits, groups.values(), strict=True)
    )
    return OwnOcv(cell, windows, replace(found, fits=fits), settings, circuit)


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
    voltage_v = np.interp(at, nodes, ocv_v)
    points = tuple(
        OcvPoint(*pair, name, row=0, rest_s=0.0)
        for pair in zip(at.tolist(), voltage_v.tolist(), strict=True)
    )
    table = OcvTable(name, {0: points}, sha256="")
    cell = characterize([table], capacity_ah=capacity_ah, ocv_fit="interpolated")
    # What a table of a measured OCV would be asked is not asked.
    return replace(cell, capacity_origin=origin, warnings=())


def _capacity(
    records: Sequence[Record], windows: Mapping[str, Window], given_ah: float | None
) -> tuple[float, str]:
    """One capacity for the axis, given or the widest span, and where it comes from."""
    own = {windows[record.name].capacity_ah for record in records} - {None}
    if len(own) > 1:
        raise InputError(
            "records of one cell without an OCV test need one `capacity`; they were given "
            f"{', '.join(f'{own_ah:g}' for own_ah in sorted(filter(None, own)))} Ah"
        )
    given_ah = next(iter(own), None) or given_ah
    if given_ah is not None:
        return given_ah, GIVEN
    widest = max(records, key=_span_ah)
    span_ah = _span_ah(widest)
    if not span_ah > 0:
        raise InputError(
            f"{records[0].name}: its current moves no charge, so nothing tells the OCV; give a "
            "record that goes over much of the state of charge"
        )
    lowest_v, more = float(widest.voltage_v.min()), ""
    if lowest_v > NEVER_EMPTY_V:
        more = f" (never below {lowest_v:.2f} V, so the cell holds more)"
    return span_ah, f"the charge that {widest.name} spans{more}"


def _require_on_axis(record: Record, window: Window, initial_soc: float, capacity_ah: float):
    """Raise `InputError` where a record that starts there leaves the axis of SOC."""
    first = first_sample(record, window)
    soc = soc_along(record, capacity_ah, first, initial_soc)
    soc = soc[scored_samples(record, window, first, soc)]
    low, high = float(soc.min()), float(soc.max())
    if low < -OCV_MARGIN or high > 1 + OCV_MARGIN:
        raise InputError(
            f"{record.name}: from a state of charge of {initial_soc:.4g} at its start, over a "
            f"capacity of {capacity_ah:.4g} Ah, its charge takes the cell from {low:.3f} to "
            f"{high:.3f}; give a larger `capacity` (the record spans {_span_ah(record):.4g} Ah), "
            "or another `initial_soc`"
        )


def _span_ah(record: Record) -> float:
    return float(np.ptp(record.discharged_ah))


def _axis(record: Record, window: Window, capacity_ah: float) -> Axis:
    """The start of a record on the axis: as given, by a full charge, or with its fullest sample as
    full."""
    if window.initial_soc is not None:
        return Axis(window.initial_soc, "given")
    first = first_sample(record, window)
    rest_a = window.rest_current_a or rest_current_a(record, capacity_ah)
    highest_v = float(record.voltage_v.max())
    full = [
        last
        for last in held_charges(record, capacity_ah, rest_a)
        if record.voltage_v[last] >= highest_v - FULL_CHARGE.held_near_v
    ]
    fullest = int(np.argmin(record.discharged_ah))
    at = min(full, key=lambda sample: abs(sample - first)) if full else fullest
    out_ah = float(record.discharged_ah[first] - record.discharged_ah[at])
    soc = 1 - out_ah / capacity_ah
    if not -NEARLY_SOC <= soc <= 1 + NEARLY_SOC:
        raise InputError(
            f"{record.name}: from its fullest sample to the start it loses {out_ah:.4g} Ah, more "
            f"than the capacity of {capacity_ah:.4g} Ah; give a larger `capacity`, or `initial_soc`"
        )
    return Axis(soc, "own full charge" if full else "own span")

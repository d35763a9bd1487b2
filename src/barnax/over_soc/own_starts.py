"""Where records without an OCV test start on the axis of SOC, and from which direction."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..blas import one_blas_thread
from ..cell import CellModel, get_circuit
from ..cell.model import group_near
from ..errors import InputError
from ..model.prepared import PreparedRecord, prepare_record
from ..model.start import find_start, require_whole_log
from ..model.temperature import temperature_of
from ..model.window import Window, first_sample
from ..notices import Notice, notice
from ..records import Record, rest_current_a
from ..records.record import in_means
from .directions import WithDirections, best_tables
from .level import cell_of, level_cell
from .own_axis import Axis, axis_of, require_on_axis, span_ah_of
from .registration import MEANS_S, ROUNDS, register
from .settings import TableSettings


class Starts(NamedTuple):
    """The windows of records with their starts, what speaks against them, and the RMSE in V with
    the other direction of records whose direction before the start was found."""

    windows: dict[str, Window]
    warnings: tuple[Notice, ...] = ()
    directions: Mapping[str, float] = {}

    def together(self, other: "Starts") -> "Starts":
        """These and those of other records."""
        return Starts(
            self.windows | other.windows,
            (*self.warnings, *other.warnings),
            {**self.directions, **other.directions},
        )


def find_starts(
    records: Sequence[Record],
    circuit: str,
    windows: Mapping[str, Window],
    settings: TableSettings,
    capacity_ah: float,
    origin: str,
    over_temperature: bool = False,
    simpler: Mapping[str, Window] | None = None,
) -> Starts:
    """The starts of records of one cell, over temperature by the OCV of each temperature.

    Args:
        records: The records.
        circuit: Name of the circuit, with which several are registered.
        windows: The window of each record by its name.
        settings: How tables are fitted, with those of the OCV.
        capacity_ah: The capacity of the axis.
        origin: Where it comes from.
        over_temperature: Whether records of each temperature are taken by themselves.
        simpler: The windows with the starts of a simpler circuit, where these are known.

    Raises `InputError` where a start or a temperature is not known.
    """
    groups: list[Sequence[Record]] = [records]
    if over_temperature:
        known: list[tuple[float, Record]] = []
        for record in records:
            if (degc := temperature_of(record, windows[record.name])) is None:
                raise notice("temperature.unknown", record.name).error()
            known.append((degc, record))
        groups = list(group_near(known).values())
    found = Starts({})
    for alike in groups:
        own = _starts_of(alike, circuit, windows, settings, capacity_ah, origin, simpler)
        found = found.together(own)
    return found


def _starts_of(
    records: Sequence[Record],
    circuit: str,
    windows: Mapping[str, Window],
    own: TableSettings,
    axis_ah: float,
    origin: str,
    simpler: Mapping[str, Window] | None,
) -> Starts:
    """The starts of records of one temperature."""
    axes = {record.name: axis_of(record, windows[record.name], axis_ah) for record in records}
    known = [record for record in records if axes[record.name].source != "own span"]
    known = known or [max(records, key=span_ah_of)]
    for record in known:
        require_on_axis(record, windows[record.name], axes[record.name].initial_soc, axis_ah)
    quick, warnings = replace(own, folds=0, max_boxes=0), list[Notice]()
    turned = dict[str, Window]()
    if len(known) < len(records):
        at_axes = _on_axes(known, windows, axes, axis_ah)
        cell, _ = _cell_found(known, circuit, at_axes, quick, axis_ah, origin)
        for record in records:
            if record not in known:
                window = replace(windows[record.name], capacity_ah=axis_ah)
                rest_a = window.rest_current_a or rest_current_a(record, axis_ah)
                given = axis_ah, first_sample(record, window, rest_a), rest_a
                try:
                    start, _, against = find_start(record, cell, window, *given)
                except InputError as unknown:
                    require_whole_log(record, records, unknown)
                    raise
                warnings += against
                axes[record.name] = Axis(start.soc, "rest elsewhere")
                if not get_circuit(circuit).has_rate or start.direction_source != "assumed":
                    continue
                window = replace(window, initial_direction=-start.direction)
                with suppress(InputError):
                    axis = Axis(find_start(record, cell, window, *given)[0].soc, "rest elsewhere")
                    turned |= _on_axes(
                        [record], {record.name: window}, {record.name: axis}, axis_ah
                    )
    told, directions = _on_axes(records, windows, axes, axis_ah), dict[str, float]()
    is_registered = len(records) > 1 and not own.keep_starts
    if turned or (is_registered and _has_open_directions(records, circuit, told)):
        # A start would move to make up for a direction that is wrong.
        _, fitted = _cell_found(records, circuit, told, quick, axis_ah, origin, turned)
        directions = {**fitted.directions}
        told = {
            one.record.name: replace(one.window, initial_direction=one.start.direction)
            if one.record.name in directions
            else one.window
            for one in fitted.objective.prepared_records
        }
    if is_registered:
        told = _registered(records, circuit, told, own, axis_ah, origin, simpler)
    return Starts(told, tuple(warnings), directions)


def _registered(
    records: Sequence[Record],
    circuit: str,
    told: Mapping[str, Window],
    settings: TableSettings,
    capacity_ah: float,
    origin: str,
    simpler: Mapping[str, Window] | None,
) -> dict[str, Window]:
    """The windows with starts and capacities that the records tell each other."""
    quick, found = replace(settings, folds=0, max_boxes=0), dict(told)
    for name, window in (simpler or {}).items():
        found[name] = replace(window, initial_direction=told[name].initial_direction)
    # An OCV of starts that differ is less steep than any record's.
    for rounds in (ROUNDS,) if simpler else (1, ROUNDS):
        cell, fitted = _cell_found(records, circuit, found, quick, capacity_ah, origin)
        prepared = _prepared(records, cell, circuit, told)
        found = windows_of(register(prepared, settings, rounds, fitted.best.log_scales))
    return found


def _has_open_directions(
    records: Sequence[Record], circuit: str, windows: Mapping[str, Window]
) -> bool:
    """True where a dynamic hysteresis starts from a direction that is not known."""
    if not get_circuit(circuit).has_rate:
        return False
    level = level_cell(1.0, float(records[0].voltage_v[0]))
    return any(
        one.start.direction_source == "assumed"
        for one in _prepared(records, level, circuit, windows)
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


def windows_of(prepared_records: Sequence[PreparedRecord]) -> dict[str, Window]:
    """The windows of records by their names."""
    return {prepared.record.name: prepared.window for prepared in prepared_records}


def _prepared(
    records: Sequence[Record], cell: CellModel, circuit: str, windows: Mapping[str, Window]
) -> list[PreparedRecord]:
    return [prepare_record(record, cell, circuit, windows[record.name]) for record in records]


def _cell_found(
    records: Sequence[Record],
    circuit: str,
    windows: Mapping[str, Window],
    settings: TableSettings,
    capacity_ah: float,
    origin: str,
    turned: Mapping[str, Window] | None = None,
) -> tuple[CellModel, WithDirections]:
    """The cell of records, and its tables before anything else is asked of them."""
    level = level_cell(capacity_ah, float(np.median(records[0].voltage_v)))
    means = [in_means(record, MEANS_S) for record in records]
    prepared = _prepared(means, level, circuit, windows)
    with one_blas_thread():
        found = best_tables(prepared, settings, turned=turned)
    return cell_of(found.objective, found.best, capacity_ah, origin), found

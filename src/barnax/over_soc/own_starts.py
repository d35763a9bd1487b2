"""Records of a cell without an OCV test: where they start on the axis of SOC, and from which
direction."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..blas import one_blas_thread
from ..cell import CellModel, get_circuit
from ..cell.model import group_near
from ..cell.parameters import RATE
from ..errors import InputError
from ..model.descent import LogScales
from ..model.prepared import PreparedRecord, prepare_record
from ..model.start import find_start, require_whole_log
from ..model.temperature import temperature_of
from ..model.window import Window, first_sample
from ..notices import Notice, notice
from ..records import Record, rest_current_a
from ..records.record import in_means
from .level import cell_of, level_cell, with_own_ocv
from .objective import Solution, TableObjective
from .own_axis import Axis, axis_capacity, axis_of, require_on_axis, span_ah_of
from .problem import box_of, find_best, reduced_objective
from .registration import MEANS_S, ROUNDS, register
from .settings import TableSettings

# Rates of a hysteresis that are tried: it is told nearly as well at half or twice its own.
TRIED_RATES = (20.0, 60.0, 200.0)


class WithDirections(NamedTuple):
    """The best tables of some records' circuit, and the RMSE in V with the other direction of
    records whose direction before the start was found with them."""

    objective: TableObjective
    best: Solution
    directions: Mapping[str, float] = {}


def best_tables(
    prepared_records: Sequence[PreparedRecord],
    settings: TableSettings,
    turned: Mapping[str, Window] | None = None,
) -> WithDirections:
    """The best tables of some records, with the directions before the start that fit better where
    the circuit has a dynamic hysteresis; `turned` as `directed` has it."""
    objective = reduced_objective(prepared_records, settings)
    best = find_best(objective)
    if not get_circuit(prepared_records[0].circuit).has_rate:
        return WithDirections(objective, best)
    found, directions = directed(prepared_records, settings, best.log_scales, turned)
    if any(one is not other for one, other in zip(found, prepared_records, strict=True)):
        objective = reduced_objective(found, settings)
        best = find_best(objective)
    return WithDirections(objective, best, directions)


def directed(
    prepared_records: Sequence[PreparedRecord],
    settings: TableSettings,
    log_scales: LogScales,
    turned: Mapping[str, Window] | None = None,
) -> tuple[list[PreparedRecord], dict[str, float]]:
    """Records made ready for a circuit with a hysteresis, those whose direction before the start is
    not known with the one that fits better at some scales; and the RMSE in V, by name, with the
    other one. Their windows with the other direction may be known, by name."""
    found, others = list(prepared_records), dict[str, float]()

    def left_v(records: Sequence[PreparedRecord]) -> float:
        tried = at_rates(records, settings, log_scales)
        return min(float(np.linalg.norm(solution.error)) for solution in tried)

    for place, one in enumerate(prepared_records):
        if one.start.direction_source != "assumed":
            continue
        window = replace(one.window, initial_direction=-one.start.direction)
        window = (turned or {}).get(one.record.name, window)
        other = prepare_record(one.record, one.cell, one.circuit, window)
        tried = [*found[:place], other.following(one.dependence), *found[place + 1 :]]
        own_v, other_v = left_v(found), left_v(tried)
        if other_v < own_v:
            found, other_v = tried, own_v
        others[one.record.name] = other_v
    return found, others


def at_rates(
    records: Sequence[PreparedRecord],
    settings: TableSettings,
    log_scales: LogScales,
) -> Iterator[Solution]:
    """The best tables at known scales, without a known rate at each of those that are tried."""
    quick = replace(settings, folds=0)
    names = list(box_of(records, quick))
    known = dict(zip(names, map(math.exp, log_scales), strict=False))
    for rate in [known[RATE]] if RATE in known else TRIED_RATES:
        scales = {**known, RATE: rate}
        held = {name: (scales[name], scales[name]) for name in names}
        tried = reduced_objective(records, quick, held)
        yield tried.solve(tuple(math.log(scales[name]) for name in names), exact=True)


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


@dataclass(frozen=True, eq=False)
class OwnRecords:
    """Records of one cell without an OCV test, and where they start on the axis of its SOC.

    Attributes:
        records: The records.
        windows: Their windows, as given.
        settings: How tables are fitted.
        capacity_ah: The capacity of the axis.
        capacity_origin: Where that comes from.
        over_temperature: Whether records of each temperature are taken by themselves.
    """

    records: Sequence[Record]
    windows: Mapping[str, Window]
    settings: TableSettings
    capacity_ah: float
    capacity_origin: str
    over_temperature: bool = False

    @classmethod
    def of(
        cls,
        records: Sequence[Record],
        windows: Mapping[str, Window],
        settings: TableSettings,
        capacity_ah: float | None = None,
        over_temperature: bool = False,
    ) -> "OwnRecords":
        """The records on the axis of a capacity; None takes what the records span.

        Raises `InputError` where the axis is not known.
        """
        axis = axis_capacity(records, windows, capacity_ah)
        return cls(records, windows, settings, *axis, over_temperature)

    @property
    def level(self) -> CellModel:
        """A cell whose OCV says nothing."""
        return level_cell(self.capacity_ah, float(np.median(self.records[0].voltage_v)))

    def settings_of(self, circuit: str) -> TableSettings:
        """The settings with a table of the OCV, and one of a dynamic hysteresis."""
        return with_own_ocv(self.settings, circuit)

    def prepared(
        self, circuit: str, windows: Mapping[str, Window], cell: CellModel | None = None
    ) -> list[PreparedRecord]:
        """The records in these windows, made ready for a circuit, with a cell that is known."""
        cell = cell or self.level
        return [
            prepare_record(record, cell, circuit, windows[record.name]) for record in self.records
        ]

    def starts(self, circuit: str, simpler: Starts | None = None) -> Starts:
        """Where the records start, by the best tables of a circuit, over temperature by the OCV of
        each temperature; the starts of a simpler circuit may be known. Raises `InputError` where a
        start or a temperature is not known."""
        if not self.over_temperature:
            return self._starts(circuit, simpler)
        known: list[tuple[float, Record]] = []
        for record in self.records:
            if (degc := temperature_of(record, self.windows[record.name])) is None:
                raise notice("temperature.unknown", record.name).error()
            known.append((degc, record))
        found = Starts({})
        for alike in group_near(known).values():
            found = found.together(replace(self, records=alike)._starts(circuit, simpler))
        return found

    def _starts(self, circuit: str, simpler: Starts | None) -> Starts:
        """The starts of records of one temperature."""
        axes = {
            record.name: axis_of(record, self.windows[record.name], self.capacity_ah)
            for record in self.records
        }
        known = [record for record in self.records if axes[record.name].source != "own span"]
        known = known or [max(self.records, key=span_ah_of)]
        for record in known:
            begun = axes[record.name].initial_soc
            require_on_axis(record, self.windows[record.name], begun, self.capacity_ah)
        warnings, turned = list[Notice](), dict[str, Window]()
        if len(known) < len(self.records):
            cell, _ = replace(self, records=known)._fitted(circuit, self._on_axes(axes))
            for record in self.records:
                if record not in known:
                    warnings += self._by_rest(record, cell, circuit, axes, turned)
        told, directions = self._on_axes(axes), dict[str, float]()
        is_registered = len(self.records) > 1 and not self.settings.keep_starts
        if turned or (is_registered and self._has_open_directions(circuit, told)):
            # A start would move to make up for a direction that is wrong.
            _, fitted = self._fitted(circuit, told, turned)
            directions = {**fitted.directions}
            told = {
                one.record.name: replace(one.window, initial_direction=one.start.direction)
                if one.record.name in directions
                else one.window
                for one in fitted.objective.prepared_records
            }
        if is_registered:
            told = self._registered(circuit, told, simpler)
        return Starts(told, tuple(warnings), directions)

    def _by_rest(
        self,
        record: Record,
        cell: CellModel,
        circuit: str,
        axes: dict[str, Axis],
        turned: dict[str, Window],
    ) -> list[Notice]:
        """What speaks against the start that a rest on the cell's OCV tells, which is added to
        `axes`; to `turned` the window with the other direction, where that is open."""
        window = replace(self.windows[record.name], capacity_ah=self.capacity_ah)
        rest_a = window.rest_current_a or rest_current_a(record, self.capacity_ah)
        given = self.capacity_ah, first_sample(record, window, rest_a), rest_a
        try:
            start, _, against = find_start(record, cell, window, *given)
        except InputError as unknown:
            require_whole_log(record, self.records, unknown)
            raise
        axes[record.name] = Axis(start.soc, "rest elsewhere")
        if get_circuit(circuit).has_rate and start.direction_source == "assumed":
            window = replace(window, initial_direction=-start.direction)
            with suppress(InputError):
                axis = Axis(find_start(record, cell, window, *given)[0].soc, "rest elsewhere")
                turned[record.name] = self._on_axis(window, axis)
        return against

    def _registered(
        self, circuit: str, told: Mapping[str, Window], simpler: Starts | None
    ) -> dict[str, Window]:
        """The windows with starts and capacities that the records tell each other."""
        found = dict(told)
        for name, window in (simpler.windows if simpler else {}).items():
            found[name] = replace(window, initial_direction=told[name].initial_direction)
        # An OCV of starts that differ is less steep than any record's.
        for rounds in (ROUNDS,) if simpler else (1, ROUNDS):
            cell, fitted = self._fitted(circuit, found)
            prepared = self.prepared(circuit, told, cell)
            settings, log_scales = self.settings_of(circuit), fitted.best.log_scales
            found = windows_of(register(prepared, settings, rounds, log_scales))
        return found

    def _has_open_directions(self, circuit: str, windows: Mapping[str, Window]) -> bool:
        """True where a dynamic hysteresis starts from a direction that is not known."""
        return get_circuit(circuit).has_rate and any(
            one.start.direction_source == "assumed" for one in self.prepared(circuit, windows)
        )

    def _on_axes(self, axes: Mapping[str, Axis]) -> dict[str, Window]:
        """The windows of records with their starts on the axis."""
        return {name: self._on_axis(self.windows[name], axis) for name, axis in axes.items()}

    def _on_axis(self, window: Window, axis: Axis) -> Window:
        source = None if axis.source == "given" else axis.source
        start = {"initial_soc": axis.initial_soc, "soc_source": source}
        return replace(window, **start, capacity_ah=self.capacity_ah)

    def _fitted(
        self,
        circuit: str,
        windows: Mapping[str, Window],
        turned: Mapping[str, Window] | None = None,
    ) -> tuple[CellModel, WithDirections]:
        """The cell of the records, and its tables before anything else is asked of them."""
        means = [in_means(record, MEANS_S) for record in self.records]
        prepared = replace(self, records=means).prepared(circuit, windows, self.level)
        quick = replace(self.settings_of(circuit), folds=0, max_boxes=0)
        with one_blas_thread():
            found = best_tables(prepared, quick, turned=turned)
        axis = self.capacity_ah, self.capacity_origin
        return cell_of(found.objective, found.best, *axis), found


def windows_of(prepared_records: Sequence[PreparedRecord]) -> dict[str, Window]:
    """The windows of records by their names."""
    return {prepared.record.name: prepared.window for prepared in prepared_records}

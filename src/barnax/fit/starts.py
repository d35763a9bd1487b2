"""Records of a cell without an OCV test: their starts on the SOC axis, the capacity of the axis,
and the direction of the current before each start."""

from collections import ChainMap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from ..cell import CellModel, get_circuit
from ..cell.model import group_near
from ..cell.soc_axis import GIVEN
from ..errors import InputError
from ..model.prepared import PreparedRecord, prepare_record, soc_along
from ..model.start import find_start, require_whole_log
from ..model.window import (
    OCV_MARGIN,
    Window,
    scored_samples,
    soc_from_rest,
    start_of,
    temperature_of,
)
from ..notices import Notice
from ..records import Record
from ..records.log import in_means
from .flat_ocv import cell_with_fitted_ocv, flat_ocv_cell, with_fitted_ocv
from .objective import Solution, TableObjective
from .registration import MEANS_S, ROUNDS, register
from .settings import TableSettings
from .table_problem import find_best, reduced_objective, solve_at

# A start may lie this far outside 0 to 1, because another full charge was a little fuller.
NEARLY_SOC = 0.02
# Usual cells under load are never empty above this.
NEVER_EMPTY_V = 3.4


def require_on_axis(record: Record, window: Window, capacity_ah: float):
    """Raise `InputError` if a record in its window of `axis_of` leaves the SOC axis."""
    initial_soc = window.initial_soc or 0.0
    first, _ = start_of(record, window, capacity_ah)
    soc = soc_along(record, capacity_ah, first, initial_soc)
    soc = soc[scored_samples(record, window, first, soc)]
    low, high = float(soc.min()), float(soc.max())
    if low < -OCV_MARGIN or high > 1 + OCV_MARGIN:
        raise InputError(
            f"{record.name}: from a state of charge of {initial_soc:.4g} at its start, over a "
            f"capacity of {capacity_ah:.4g} Ah, its charge takes the cell from {low:.3f} to "
            f"{high:.3f}; give a larger `capacity` (the record spans {record.span_ah:.4g} Ah), "
            "or another `initial_soc`"
        )


def axis_of(record: Record, window: Window, capacity_ah: float) -> Window:
    """The window of a record with its start on the axis: as given, from a full charge, or with its
    fullest sample taken as full."""
    if window.initial_soc is not None:
        return replace(window, soc_source=None, capacity_ah=capacity_ah)
    first, rest_a = start_of(record, window, capacity_ah)
    full = record.segments(rest_a).full_charges(capacity_ah)
    fullest = int(np.argmin(record.discharged_ah))
    at = min(full, key=lambda sample: abs(sample - first)) if full else fullest
    out_ah = float(record.discharged_ah[first] - record.discharged_ah[at])
    soc = 1 - out_ah / capacity_ah
    if not -NEARLY_SOC <= soc <= 1 + NEARLY_SOC:
        raise InputError(
            f"{record.name}: from its fullest sample to the start it loses {out_ah:.4g} Ah, more "
            f"than the capacity of {capacity_ah:.4g} Ah; give a larger `capacity`, or `initial_soc`"
        )
    source = "own full charge" if full else "own span"
    return replace(window, initial_soc=soc, soc_source=source, capacity_ah=capacity_ah)


class Starts(NamedTuple):
    """The windows of records with their starts, the evidence against these, and, for records whose
    direction before the start was determined by the fit, the RMSE in V with the other direction."""

    windows: dict[str, Window]
    warnings: tuple[Notice, ...] = ()
    directions: Mapping[str, float] = {}


@dataclass(frozen=True, eq=False)
class RecordsWithoutOcvTest:
    """Records of one cell without an OCV test, and their starts on its SOC axis.

    Attributes:
        records: The records.
        windows: Their windows, as given.
        settings: Settings of the fit.
        capacity_ah: The capacity of the axis.
        capacity_origin: Source of that capacity.
    """

    records: Sequence[Record]
    windows: Mapping[str, Window]
    settings: TableSettings
    capacity_ah: float
    capacity_origin: str

    @classmethod
    def of(
        cls,
        records: Sequence[Record],
        windows: Mapping[str, Window],
        settings: TableSettings,
        capacity_ah: float | None = None,
    ) -> "RecordsWithoutOcvTest":
        """The records on the axis of one capacity: the given one, or the widest span of a record.

        Raises `InputError` if it is missing.
        """
        given = {windows[record.name].capacity_ah for record in records} - {None}
        if len(given) > 1:
            raise InputError(
                "records of one cell without an OCV test need one `capacity`; they were given "
                f"{', '.join(f'{ah:g}' for ah in sorted(filter(None, given)))} Ah"
            )
        capacity_ah = next(iter(given), None) or capacity_ah
        if capacity_ah is not None:
            return cls(records, windows, settings, capacity_ah, GIVEN)
        widest = max(records, key=attrgetter("span_ah"))
        if not widest.span_ah > 0:
            raise InputError(
                f"{records[0].name}: its current moves no charge, so nothing tells the OCV; give a "
                "record that goes over much of the state of charge"
            )
        lowest_v, more = float(widest.voltage_v.min()), ""
        if lowest_v > NEVER_EMPTY_V:
            more = f", never below {lowest_v:.2f} V, so the cell holds more"
        return cls(
            records, windows, settings, widest.span_ah, f"the charge that {widest.name} spans{more}"
        )

    @property
    def level(self) -> CellModel:
        """A cell with a constant OCV."""
        return flat_ocv_cell(self.capacity_ah, float(np.median(self.records[0].voltage_v)))

    def settings_of(self, circuit: str) -> TableSettings:
        """The settings with a table of the OCV, and one of a dynamic hysteresis if the circuit has
        it."""
        return with_fitted_ocv(self.settings, circuit)

    def prepared(
        self, circuit: str, windows: Mapping[str, Window], cell: CellModel | None = None
    ) -> list[PreparedRecord]:
        """The records in these windows, prepared for a circuit, with the given cell or a constant
        OCV."""
        cell = cell or self.level
        return [
            prepare_record(record, cell, circuit, windows[record.name]) for record in self.records
        ]

    def starts_by_temperature(self, circuit: str) -> Starts:
        """The starts of the records from the OCV at each temperature. Raises `InputError` if a
        start or a temperature is missing."""
        measured: list[tuple[float, Record]] = []
        for record in self.records:
            if (degc := temperature_of(record, self.windows[record.name])) is None:
                raise Notice("temperature.unknown", subject=record.name).error()
            measured.append((degc, record))
        groups = group_near(measured).values()
        starts = [replace(self, records=alike).starts(circuit) for alike in groups]
        windows, warnings, directions = zip(*starts, strict=True)
        return Starts(
            dict(ChainMap(*windows)), tuple(chain(*warnings)), dict(ChainMap(*directions))
        )

    def starts(self, circuit: str, simpler: Starts | None = None) -> Starts:
        """The starts of the records from the best tables of a circuit, given those of a simpler one
        if there are any. Raises `InputError` if a start is missing."""
        windows = {
            record.name: axis_of(record, self.windows[record.name], self.capacity_ah)
            for record in self.records
        }
        fixed = [record for record in self.records if windows[record.name].soc_source != "own span"]
        fixed = fixed or [max(self.records, key=attrgetter("span_ah"))]
        for record in fixed:
            require_on_axis(record, windows[record.name], self.capacity_ah)
        warnings, turned, directions = list[Notice](), dict[str, Window](), dict[str, float]()
        if len(fixed) < len(self.records):
            cell, *_ = replace(self, records=fixed)._fitted(circuit, windows)
            for record in self.records:
                if record not in fixed:
                    name = record.name
                    windows[name], opposite, against = self._by_rest(record, cell, circuit)
                    warnings += against
                    turned |= {} if opposite is None else {name: opposite}
        is_open = get_circuit(circuit).has_rate and any(
            prepared.start.direction_source == "assumed"
            for prepared in self.prepared(circuit, windows)
        )
        if turned or is_open:
            # A start would move to compensate a wrong direction.
            _, objective, _, directions = self._fitted(circuit, windows, turned)
            windows = windows_of_records(objective.prepared_records)
            for one in objective.prepared_records:
                if (name := one.record.name) in directions:
                    windows[name] = replace(one.window, initial_direction=one.start.direction)
        if len(self.records) > 1 and not self.settings.keep_starts:
            windows = self._registered(circuit, windows, simpler)
        return Starts(windows, tuple(warnings), directions)

    def _by_rest(
        self, record: Record, cell: CellModel, circuit: str
    ) -> tuple[Window, Window | None, list[Notice]]:
        """The window of a record with the start derived from a rest on the cell's OCV, the same
        with the other direction if that is open, and the evidence against the start."""
        window = replace(self.windows[record.name], capacity_ah=self.capacity_ah)
        first, rest_a = start_of(record, window, self.capacity_ah)
        given = self.capacity_ah, first, rest_a
        try:
            start, _, against = find_start(record, cell, window, *given)
        except InputError as unknown:
            require_whole_log(record, self.records, unknown)
            raise
        start_window = replace(window, soc_source="rest elsewhere", initial_soc=start.soc)
        if get_circuit(circuit).has_rate and start.direction_source == "assumed":
            opposite = -start.direction
            is_rested = start.soc_source == "rested voltage"
            at_rest = record.segments(rest_a), cell, first, opposite
            # The voltage may lie beyond the OCV of the other direction.
            if not is_rested or soc_from_rest(*at_rest) is not None:
                window = replace(window, initial_direction=opposite)
                other, *_ = find_start(record, cell, window, *given)
                opposite_window = replace(
                    start_window, initial_direction=opposite, initial_soc=other.soc
                )
                return start_window, opposite_window, against
        return start_window, None, against

    def _registered(
        self, circuit: str, windows: Mapping[str, Window], simpler: Starts | None
    ) -> dict[str, Window]:
        """The windows with starts and capacities registered on each other."""
        registered = dict(windows)
        for name, window in (simpler.windows if simpler else {}).items():
            registered[name] = replace(window, initial_direction=windows[name].initial_direction)
        settings = self.settings_of(circuit)
        # With inconsistent starts the joint OCV is less steep than any record's, and its time
        # constants differ.
        for rounds in (1, ROUNDS):
            cell, _, best, _ = self._fitted(circuit, registered)
            prepared = self.prepared(circuit, windows, cell)
            registered = windows_of_records(register(prepared, settings, rounds, best.log_scales))
        return registered

    def _fitted(
        self,
        circuit: str,
        windows: Mapping[str, Window],
        turned: Mapping[str, Window] | None = None,
    ) -> tuple[CellModel, TableObjective, Solution, dict[str, float]]:
        """The cell of the records, and its best tables before anything else is estimated. If the
        circuit has a dynamic hysteresis, records with an unknown direction before the start take
        the one that fits better at the same scales, and the RMSE in V with the other one is
        returned; their windows with that direction may be given, by name."""
        means = [in_means(record, MEANS_S) for record in self.records]
        prepared = replace(self, records=means).prepared(circuit, windows, self.level)
        quick = replace(self.settings_of(circuit), folds=0, max_boxes=0)
        better, others, has_rate = [*prepared], dict[str, float](), get_circuit(circuit).has_rate

        def left_v(records: Sequence[PreparedRecord]) -> float:
            at = objective.ranges, best.log_scales
            return float(np.linalg.norm(solve_at(records, quick, *at, exact=True)[1].error))

        objective = reduced_objective(prepared, quick)
        best = find_best(objective)
        for index, one in enumerate(prepared):
            if not has_rate or one.start.direction_source != "assumed":
                continue
            window = replace(one.window, initial_direction=-one.start.direction)
            window = (turned or {}).get(one.record.name, window)
            other = prepare_record(one.record, one.cell, circuit, window)
            tried = [*better[:index], other, *better[index + 1 :]]
            before_v, other_v = left_v(better), left_v(tried)
            if other_v < before_v:
                better, other_v = tried, before_v
            others[one.record.name] = other_v
        if any(one is not other for one, other in zip(better, prepared, strict=True)):
            objective = reduced_objective(better, quick)
            best = find_best(objective)
        cell = cell_with_fitted_ocv(objective, best, self.capacity_ah, self.capacity_origin)
        return cell, objective, best, others


def windows_of_records(prepared_records: Sequence[PreparedRecord]) -> dict[str, Window]:
    """The windows of records by their names."""
    return {prepared.record.name: prepared.window for prepared in prepared_records}

"""The OCV of a cell without an OCV test: one more table, fitted to the records with all others.

The voltage is linear in the OCV's table too, so time constants, resistances and OCV are one search
with one proof. What one record cannot tell is where its charge stands on the axis of SOC: its
capacity and its start only name the axis, and are taken from what is given, from a full charge that
the record holds, or from its own span.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..blas import one_blas_thread
from ..cell import CellModel, get_circuit
from ..cell.characterize import over_temperatures
from ..cell.elements import names_of
from ..cell.parameters import OCV
from ..display import Brief
from ..global_optimum.proof import Proof
from ..model.prepared import PreparedRecord, prepare_record
from ..model.window import Window
from ..notices import Notice
from ..records import Record
from .certificate import certify
from .current_offset import offset_effect
from .dependence import with_asked
from .directions import best_tables
from .fit import TableFit, fit_of
from .intervals import NodeInterval
from .level import cell_of, level_cell, with_own_ocv
from .means import parts_of
from .objective import Solution, TableObjective
from .own_axis import axis_capacity
from .own_starts import Starts, find_starts, windows_of
from .settings import TableSettings
from .temperature import TableFits, fit_temperatures, group_by_temperature


@dataclass(frozen=True, eq=False, repr=False)
class OwnOcv(Brief):
    """A cell whose OCV the records themselves show, and the tables that were fitted with it.

    Attributes:
        cell: The cell, with the branches of a hysteresis that was found. Over temperature, one for
            each.
        windows: The windows of the records, each with its start on the axis.
        found: The tables over SOC, and the OCV among their intervals.
        settings: How they were fitted.
        circuit: Name of the circuit that they are of.
        warnings: What speaks against the starts.
        directions: Of the records whose direction before the start was found by the fit, the RMSE
            in V with the other one.
        tried: The circuits that were tried, where there was a choice.
    """

    cell: CellModel
    windows: Mapping[str, Window]
    found: TableFits
    settings: TableSettings
    circuit: str
    warnings: tuple[Notice, ...] = ()
    directions: Mapping[str, float] = field(default_factory=dict)
    tried: tuple[Any, ...] = ()

    @property
    def fit(self) -> TableFit:
        """The tables, of several temperatures those nearest to 25 degC."""
        return self.found.reference


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

    def starts(self, circuit: str, simpler: Starts | None = None) -> Starts:
        """Where the records start, by the best tables of a circuit; those of a simpler one may be
        known. Raises `InputError` where a start or a temperature is not known."""
        axis = self.capacity_ah, self.capacity_origin, self.over_temperature
        given = self.windows, self.settings_of(circuit), *axis
        return find_starts(self.records, circuit, *given, simpler and simpler.windows)

    def prepared(self, circuit: str, starts: Starts) -> list[PreparedRecord]:
        """The records with their starts, made ready for a circuit."""
        windows, level = starts.windows, self.level
        return [
            prepare_record(record, level, circuit, windows[record.name]) for record in self.records
        ]

    def proved(self, objective: TableObjective, best: Solution, starts: Starts) -> OwnOcv:
        """The best tables with their OCV, proved, and all that is known of them."""
        with one_blas_thread():
            proof = certify(objective, best)
        cell = cell_of(objective, proof.best, self.capacity_ah, self.capacity_origin)
        own = _own_ocv_of(objective, proof, cell)
        return replace(own, warnings=starts.warnings, directions=starts.directions)

    def by_temperature(self, circuit: str) -> OwnOcv:
        """Tables over SOC and an OCV of each temperature, on one axis, with one set of time
        constants; proved already."""
        starts = self.starts(circuit)
        axis = self.capacity_ah, self.capacity_origin
        prepared = self.prepared(circuit, starts)
        own = _over_temperature(prepared, self.settings_of(circuit), *axis)
        return replace(own, warnings=starts.warnings, directions=starts.directions)


def fit_with_ocv(
    records: Sequence[Record],
    circuit: str,
    windows: Mapping[str, Window],
    settings: TableSettings,
    capacity_ah: float | None = None,
) -> OwnOcv:
    """The tables of one circuit and the OCV that fit some records of one cell best, together.

    Args:
        records: The records; one without a known start takes it from a rest, on the OCV that the
            others show.
        circuit: Name of the circuit. A dynamic hysteresis is one more table; of a switched one such
            records tell nothing.
        windows: The window of each record by its name.
        settings: How tables are fitted; the OCV stands at `ocv_nodes`, by default closer ones.
        capacity_ah: The capacity; None takes what the records span.

    Raises `InputError` where a start is not known, and as `fit_tables` does.
    """
    own = OwnRecords.of(records, windows, settings, capacity_ah)
    starts = own.starts(circuit)
    with one_blas_thread():
        objective, best, _ = best_tables(own.prepared(circuit, starts), own.settings_of(circuit))
        objective, best = with_asked(objective, best)
    return own.proved(objective, best, starts)


def _over_temperature(
    prepared: Sequence[PreparedRecord], settings: TableSettings, capacity_ah: float, origin: str
) -> OwnOcv:
    """Tables over SOC and an OCV of each temperature."""
    cells: list[CellModel] = []

    def at_home(objective: TableObjective, best: Solution) -> list[PreparedRecord]:
        cells.append(cell_of(objective, best, capacity_ah, origin))
        return _at_home(objective, cells[-1])

    groups = group_by_temperature(prepared)
    found = fit_temperatures(groups, settings, at_home)
    cell = over_temperatures(dict(zip(groups, cells, strict=True)))
    fits = tuple(_of_ocv(fit, prepared[0].cell) for fit in found.fits)
    found = replace(found, fits=fits)
    return OwnOcv(cell, windows_of(prepared), found, settings, prepared[0].circuit)


def _own_ocv_of(objective: TableObjective, proof: Proof[Solution], cell: CellModel) -> OwnOcv:
    """All that is known of tables with their OCV, which is that of the cell."""
    prepared, best = objective.prepared_records, proof.best
    circuit, windows = prepared[0].circuit, windows_of(prepared)
    with one_blas_thread():
        # Several records whose rates differ would tell it.
        effect = offset_effect(objective, best) if len(prepared) == 1 else None
    fit = replace(fit_of(objective, proof, _at_home(objective, cell)), of_offset=effect)
    fit = _of_ocv(fit, prepared[0].cell)
    intervals, means = (
        tuple(_with_open_pairs(fit, own, circuit)) for own in (fit.intervals, fit.means)
    )
    fit = replace(fit, intervals=intervals, means=means)
    return OwnOcv(cell, windows, TableFits((fit,)), objective.settings, circuit)


def _with_open_pairs(
    fit: TableFit, intervals: Sequence[NodeInterval], circuit: str
) -> Iterator[NodeInterval]:
    """The intervals; resistances of a pair whose time constant ended at the slowest have none, for
    the OCV takes up what is slower still."""
    slowest = {hit.name for hit in fit.at_bound if hit.side == "upper"}
    pairs = names_of(get_circuit(circuit).elements)
    is_open = {pair.resistance for pair in pairs if pair.tau in slowest}
    for one in intervals:
        yield one if is_open.isdisjoint(parts_of(one.name)) else one.opened()


def _at_home(objective: TableObjective, cell: CellModel) -> list[PreparedRecord]:
    """The objective's records with the OCV that was found."""
    return [
        prepare_record(prepared.record, cell, prepared.circuit, prepared.window)
        for prepared in objective.prepared_records
    ]


def _of_ocv(fit: TableFit, level: CellModel) -> TableFit:
    """A fit whose OCV is counted from zero."""
    intervals = tuple(
        interval.moved(float(level.average_ocv_v(np.array(interval.soc))))
        if interval.name == OCV
        else interval
        for interval in fit.intervals
    )
    return replace(fit, intervals=intervals)

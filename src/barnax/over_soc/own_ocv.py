"""The OCV of a cell without an OCV test: one more table, fitted to the records with all others.

The voltage is linear in the OCV's table too, so time constants, resistances and OCV are one search
with one proof. What one record cannot tell is where its charge stands on the axis of SOC: its
capacity and its start only name the axis, and are taken from what is given, from a full charge that
the record holds, or from its own span.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

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
from .fit import TableFit, constant_with_ocv_held_out, fit_of
from .further_terms import Fitted, best_tables, with_further
from .intervals import NodeInterval
from .level import cell_of, level_cell, with_own_ocv
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
    unproved: Fitted | None = None
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
    beside: Mapping[str, Sequence[str]] | None = None,
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
        beside: By circuit, others of which the best takes its place where the records speak for
            it; a record that is too short for one leaves it out.

    Raises `InputError` where a start or a temperature is not known, and as `fit_tables` and
    `fit_temperatures` do.
    """
    axis = axis_capacity(records, windows, capacity_ah)
    level = level_cell(axis[0], float(np.median(records[0].voltage_v)))
    starts = dict[str, Starts]()

    def begun(
        circuit: str, settings: TableSettings, simpler: Fitted | None = None
    ) -> list[PreparedRecord]:
        if simpler is None or len(records) > 1:
            # Starts of several records are found with each circuit: at those of two pairs a third
            # one is not worth what it is at its own.
            given = windows, settings, *axis, over_temperature
            starts[circuit] = find_starts(records, circuit, *given)
        else:
            turned = windows_of(simpler.objective.prepared_records)
            starts[circuit] = starts[simpler.circuit]._replace(windows=turned)
        own = starts[circuit].windows
        return [prepare_record(record, level, circuit, own[record.name]) for record in records]

    own = with_own_ocv(settings, circuit)
    prepared = begun(circuit, own)
    if over_temperature:
        found = _over_temperature(prepared, own, *axis)
        begun_so = starts[circuit]
        return replace(found, warnings=begun_so.warnings, directions=begun_so.directions)
    with one_blas_thread():
        found, against = with_further(best_tables(prepared, own), own, beside or {}, begun)
    own_starts = starts[found.circuit]
    objective, best, _ = found
    return replace(
        _told(objective, Proof(0.0, 0, best), cell_of(objective, best, *axis)),
        directions={**found.directions, **own_starts.directions},
        warnings=(*own_starts.warnings, *against),
    )


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
    fits = tuple(
        _of_ocv(fit, own, settings, prepared[0].cell)
        for fit, own in zip(found.fits, groups.values(), strict=True)
    )
    found = replace(found, fits=fits)
    return OwnOcv(cell, windows_of(prepared), found, settings, prepared[0].circuit)


def proved(own: OwnOcv) -> OwnOcv:
    """The same with a bound on how much better others could be."""
    if own.unproved is None:
        return own
    objective, best, _ = own.unproved
    with one_blas_thread():
        proof = certify(objective, best)
    if proof.best is best:
        fits = (own.fit.proved(proof, own.settings.proved_share),)
        return replace(own, found=replace(own.found, fits=fits), unproved=None)
    # A better circuit was met on the way.
    cell = cell_of(objective, proof.best, own.cell.capacity_ah, own.cell.capacity_origin)
    better = _told(objective, proof, cell)
    return replace(better, warnings=own.warnings, unproved=None, directions=own.directions)


def _told(objective: TableObjective, proof: Proof[Solution], cell: CellModel) -> OwnOcv:
    """All that is known of tables with their OCV, which is that of the cell."""
    prepared, best = objective.prepared_records, proof.best
    circuit, windows = prepared[0].circuit, windows_of(prepared)
    with one_blas_thread():
        # Several records whose rates differ would tell it.
        effect = offset_effect(objective, best) if len(prepared) == 1 else None
    fit = replace(fit_of(objective, proof, _at_home(objective, cell)), of_offset=effect)
    plain = [record.following(None) for record in prepared]
    fit = _of_ocv(fit, plain, objective.settings, prepared[0].cell)
    fit = replace(fit, intervals=tuple(_with_open_pairs(fit, circuit)))
    unproved = Fitted(objective, best)
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

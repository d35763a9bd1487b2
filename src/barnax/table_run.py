"""Tables over SOC, and over temperature, of a run: fitted, evaluated, and what to beware of."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .cell import CellModel
from .cell.dependence import BETA
from .cell.parameters import OCV_CORRECTION
from .display import Brief
from .model.prepared import PreparedRecord
from .model.sampling import ocv_shift_ohm, other_sampling, resistance_shares, shift_ohm
from .model.window import SAME_FULL
from .notices import Notice, notice
from .over_soc import (
    NodeInterval,
    Reversal,
    TableFits,
    TableSettings,
    table_name,
)
from .over_soc.node_interval import parts_of
from .search.evaluate import Evaluation, evaluate_from_either, with_registered

# The OCV of a test and that of records lie apart by 3 to 20 mV at 25 degC; a capacity 10 % off, or
# another cell's test, makes it 32 to 77. In the cold it is up to 40 with the right test, for no OCV
# tells what relaxes slower than the time constants reach: 12 to 17 % of the drop over all
# resistances, of which a wrong test makes 24 to 68 %.
# A correction that is not determined is said from the last on.
DISAGREES_V, DISAGREES_SHARE, OVERRULED_V = 0.03, 0.2, 0.05
R0 = "R0 [Ohm]"
# What stands for a table where there is room for one value.
MIDDLE_SOC = 0.5


@dataclass(frozen=True, eq=False, repr=False)
class TableRun(Brief):
    """Tables over SOC fitted to the records of a run, and their evaluations."""

    settings: TableSettings
    found: TableFits
    identification: list[Evaluation]
    validation: list[Evaluation]

    @property
    def model(self) -> str:
        """The circuit that the tables are of."""
        return self.identification[0].prepared.circuit

    @classmethod
    def of(
        cls,
        settings: TableSettings,
        found: TableFits,
        identified: Sequence[PreparedRecord],
        validated: Sequence[PreparedRecord],
        cell: CellModel,
    ) -> "TableRun":
        """The tables on every record, each at its own temperature."""
        own = [found.evaluate(prepared) for prepared in identified]
        others = [
            with_registered(evaluate_from_either(prepared, cell, found.evaluate), found.evaluate)
            for prepared in validated
        ]
        return cls(settings, found, own, others)

    def mean_ohm(self, name: str) -> float:
        """The mean of a resistance over the visited SOC above 10 %, and over temperatures."""
        means = [mean for fit in self.found.fits for mean in fit.means if mean.name == name]
        return float(np.mean([mean.value for mean in means]))

    @property
    def mean_drop_v(self) -> float:
        """The voltage over all resistances at the mean current under load."""
        prepared = [evaluation.prepared for evaluation in self.identification]
        current_a = np.concatenate([np.abs(own.current_a[own.scored]) for own in prepared])
        is_loaded = current_a >= max(own.rest_current_a for own in prepared)
        mean_a = float(np.mean(current_a[is_loaded])) if is_loaded.any() else 0.0
        names = self.found.reference.tables.named_ohm
        return mean_a * sum(map(self.mean_ohm, names))

    @property
    def hold_shift_ohm(self) -> float:
        """By how much R0 would be another with the other sampling that is tried."""
        other = other_sampling(self._sampling)
        return self._shift_ohm(other) + ocv_shift_ohm(self._sampling, other, self._assumed)

    @property
    def hold_shares(self) -> dict[str, float]:
        """By what share of itself the resistance of every RC pair would be more with that."""
        given = self.found.fits[0].tables, self._interval_s
        return resistance_shares(self._sampling, other_sampling(self._sampling), *given)

    @property
    def means_shifts_ohm(self) -> tuple[float, ...]:
        """Possible errors of R0 where rows are taken for means, whose current is half that of the
        interval before and half that of the one after: as it would be for a current that stood
        still in each of them, to either side, for what it does in them is not known."""
        if self._sampling != "centered":
            return ()
        moved_ohm = self._shift_ohm("means")
        return moved_ohm, -moved_ohm

    def _shift_ohm(self, other: str) -> float:
        tables = self.found.fits[0].tables
        ohm = {own.resistance: self.mean_ohm(own.resistance) for own in tables.names}
        return shift_ohm(self._sampling, other, tables, ohm, self._interval_s)

    @property
    def _assumed(self) -> PreparedRecord:
        """The first record whose sampling is only assumed."""
        records = [evaluation.prepared for evaluation in self.identification]
        assumed = [one for one in records if one.record.hold.strength == "assumed"]
        return (assumed or records)[0]

    @property
    def _sampling(self) -> str:
        return self._assumed.record.hold.value

    @property
    def _interval_s(self) -> float:
        return self._assumed.median_interval_s

    def spanning(
        self, shifts_ohm: Sequence[float], shares: Mapping[str, float] | None = None
    ) -> "TableRun":
        """The same with intervals that reach over what else may be true: R0 so far off, and other
        resistances by shares of themselves."""

        def reaching(own: NodeInterval) -> NodeInterval:
            if own.name == R0:
                return own.spanning(shifts_ohm)
            told = [(shares or {}).get(part) for part in parts_of(own.name)]
            # Of a sum, that of the pair that is moved most.
            share = max((share for share in told if share is not None), key=abs, default=None)
            return own if share is None else own.spanning([share * own.value])

        fits = tuple(
            replace(
                fit,
                intervals=tuple(map(reaching, fit.intervals)),
                means=tuple(map(reaching, fit.means)),
            )
            for fit in self.found.fits
        )
        return replace(self, found=replace(self.found, fits=fits))


def table_warnings(run: TableRun) -> Iterator[Notice]:
    """Notices that a user of tables over SOC should know."""
    over = run.found.over_temperature
    degc = [""] if over is None else [f" at {degc:.3g} degC" for degc in over.temperatures_degc]
    told: dict[str, list[Notice]] = {}
    what = "tables over SOC" if run.found.reference.is_over_soc else table_name(run.model, "ocv")
    for where, fit in zip(degc, run.found.fits, strict=True):
        for warning in fit.warnings:
            told.setdefault(str(warning), []).append(warning.about(f"{what}{where}"))
    for found in told.values():
        # What is so at every temperature is said once.
        yield from found if len(found) < len(degc) else [found[0].about(what)]
    for fit in run.found.fits:
        own = fit.own_ocv
        usual_v = max(DISAGREES_V, DISAGREES_SHARE * run.mean_drop_v)
        if own is not None and own.median_v > usual_v:
            where = {"largest_v": own.largest_v, "soc": own.largest_soc}
            yield notice("ocv-test.disagrees", median_v=own.median_v, **where)
        corrections = [node for node in fit.of_table(OCV_CORRECTION) if node.low is None]
        moved = max(corrections, key=lambda node: abs(node.value), default=None)
        if moved is not None and abs(moved.value) > OVERRULED_V:
            yield notice("ocv-test.overruled", moved_v=moved.value, soc=moved.soc)
    yield from _offset_warnings(run)
    yield from _reversal_warnings(run)
    yield from _outside_warnings(run)
    for evaluation in run.validation:
        yield from no_temperature(evaluation.prepared, run.found)


def no_temperature(prepared: PreparedRecord, found: TableFits) -> Iterator[Notice]:
    """That a record has no temperature that the resistances could follow."""
    known = found.of(prepared).dependence
    if known is not None and BETA in known.numbers and prepared.known_degc is None:
        yield notice(
            "tables.no-temperature", prepared.record.name, reference_degc=known.reference_degc
        )


def _offset_warnings(run: TableRun) -> Iterator[Notice]:
    """That the records agree far better without an offset of their current, which moves R."""
    prepared = [evaluation.prepared for evaluation in run.identification]
    known = prepared[0].window.registration
    if known is None or known.offset_a is None or known.offset_error_a is None:
        return
    # As the files have it.
    is_turned = {record.record.sign.value for record in prepared} == {"charge-positive"}
    offset_a = -known.offset_a if is_turned else known.offset_a
    told = {"offset_a": offset_a, "error_a": 2 * known.offset_error_a}
    names = ", ".join(record.record.name for record in prepared)
    hours = known.told_capacity_ah / abs(offset_a)
    yield notice("answer.current-offset", names, **told, hours=hours)


def _reversal_warnings(run: TableRun) -> Iterator[Notice]:
    """One notice of each resistance that both falls and rises from cold to warm."""
    over = run.found.over_temperature
    if over is None:
        return
    by_name: dict[str, list[Reversal]] = {}
    for reversal in over.reversals:
        by_name.setdefault(reversal.name, []).append(reversal)
    degc = ", ".join(f"{degc:.3g}" for degc in over.temperatures_degc)
    for name, found in by_name.items():
        reversal = found[len(found) // 2]
        values = ", ".join(f"{1e3 * value:.3g}" for value in reversal.values_ohm)
        yield notice(
            "tables.not-monotone",
            name=name.partition(" ")[0],
            nodes=len(found),
            all_nodes=len(run.found.fits[0].tables.nodes),
            values_mohm=values,
            temperatures_degc=degc,
            soc=reversal.soc,
        )


def _outside_warnings(run: TableRun) -> Iterator[Notice]:
    if not run.found.reference.is_over_soc:
        # There is no table but the OCV, whose own notice says it.
        return
    for evaluation in run.validation:
        own = [other for other in run.identification if _is_alike(run, evaluation, other)]
        low, high = (
            bound([bound(other.prepared.soc[other.prepared.scored]) for other in own])
            for bound in (min, max)
        )
        soc = evaluation.prepared.soc[evaluation.prepared.scored]
        outside = int(np.count_nonzero((soc < low - SAME_FULL) | (soc > high + SAME_FULL)))
        if outside:
            told = {"outside": outside, "samples": len(soc)}
            told |= {"low_percent": 100 * low, "high_percent": 100 * high}
            yield notice("soc.outside-tables", evaluation.prepared.record.name, **told)


def _is_alike(run: TableRun, evaluation: Evaluation, other: Evaluation) -> bool:
    """True if the tables of one record were identified on another: not those of another
    measured temperature; between temperatures all of them count."""
    over = run.found.over_temperature
    if over is None:
        return True
    near = over.measured_near(evaluation.prepared.temperature_degc or 0.0)
    return near in (None, over.measured_near(other.prepared.temperature_degc or 0.0))

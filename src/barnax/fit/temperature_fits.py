"""Tables over SOC as stored in results, at one temperature or several, and their warnings."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from ..cell import CircuitParameters, TemperatureTables
from ..cell.dependence import BETA
from ..cell.model import REFERENCE_DEGC, SAME_DEGC
from ..cell.parameters import OCV_CORRECTION, OHMIC
from ..errors import InputError
from ..model.other_sampling import Resampling, least_r0_share, resampling
from ..model.prepared import PreparedRecord
from ..model.window import SAME_FULL
from ..notices import Notice
from ..search.evaluate import Evaluation, Evaluations, evaluate
from ..settings import is_temperature
from ..uncertainty import Band
from .cross_validation import SocErrors
from .node_interval import NodeInterval, parts_of
from .settings import TableSettings, table_name
from .table_fit import TableFit, visited_soc

# The OCV of a test and that fitted to records differ by 3 to 20 mV at 25 degC; a capacity 10 % off,
# or another cell's test, makes it 32 to 77. In the cold the difference reaches 40 with the right
# test, because a fitted OCV absorbs whatever relaxes more slowly than the slowest time constant: 12
# to 17 % of the drop over all resistances; with a wrong test it is 24 to 68 %. Above the last limit
# a correction that is not determined is reported.
DISAGREES_V, DISAGREES_SHARE, OVERRULED_V = 0.03, 0.2, 0.05
R0 = OHMIC
# SOC at which a table is shown if there is room for one value only.
MIDDLE_SOC = 0.5


@dataclass(frozen=True)
class LeftOut:
    """Errors at one temperature, predicted from the tables of the others.

    `errors` are those of the prediction, `identified` those of the tables identified there.
    `is_between` is True if the temperature lies between others; otherwise the nearest one's tables
    are used.
    """

    temperature_degc: float
    is_between: bool
    errors: SocErrors
    identified: SocErrors


@dataclass(frozen=True)
class Reversal:
    """A node at which a resistance significantly falls from one temperature to the next, and
    significantly rises elsewhere; `values_ohm` are its values at every temperature, from cold to
    warm."""

    name: str
    soc: float
    values_ohm: tuple[float, ...]


@dataclass(frozen=True)
class OverTemperature:
    """Tables at several temperatures fitted together, from cold to warm.

    J is the mean of the temperatures' objectives, weighted by scored samples; `objective_v` is
    sqrt(J). `separate_v` is the value with separate time constants for each temperature, and
    `lower_bound_v` a lower bound for shared ones.
    """

    temperatures_degc: tuple[float, ...]
    objective_v: float
    separate_v: float
    lower_bound_v: float
    left_out: tuple[LeftOut, ...]
    reversals: tuple[Reversal, ...]

    @property
    def proved_gap(self) -> float:
        """The largest share of sqrt(J) that other tables could save."""
        return max(0.0, 1 - self.lower_bound_v / self.objective_v) if self.objective_v else 0.0

    def measured_near(self, temperature_degc: float) -> float | None:
        """The measured temperature within `SAME_DEGC` of one; None if there is none."""
        nearest = min(self.temperatures_degc, key=lambda degc: abs(degc - temperature_degc))
        return nearest if abs(nearest - temperature_degc) <= SAME_DEGC else None

    def like(self, temperature_degc: float) -> tuple[LeftOut, ...]:
        """The left-out temperatures predicted in the same way as this one: from both sides, or from
        one; all of them if there are none."""
        ends = self.temperatures_degc[0], self.temperatures_degc[-1]
        is_between = ends[0] < temperature_degc < ends[1]
        alike = tuple(left for left in self.left_out if left.is_between == is_between)
        return alike or self.left_out


@dataclass(frozen=True)
class TableFits:
    """Tables over SOC: at one temperature, or from cold to warm at several; a constant circuit is a
    table with one node.

    Tables at several temperatures share their time constants; each one's proof is against separate
    time constants.

    Attributes:
        fits: The tables, one set for each temperature, from cold to warm.
        over_temperature: Results over all temperatures; None for a single set of tables.
        settings: Settings of the fit.
        by_soc: Errors of the tables by SOC.
        hold_shift_ohm: The increase of every R0 if a sample's current flowed on its other side,
            where the side is assumed.
    """

    fits: Annotated[tuple[TableFit, ...], Field(min_length=1)]
    over_temperature: OverTemperature | None = None
    settings: TableSettings = field(default_factory=TableSettings)
    by_soc: tuple[Band, ...] = ()
    hold_shift_ohm: float | None = None

    def __iter__(self) -> Iterator[TableFit]:
        return iter(self.fits)

    @property
    def over(self) -> Literal["ocv", "soc", "soc,temperature"] | None:
        """The coordinates of the tables, "ocv" if only the OCV is tabulated; None for a constant
        circuit.
        """
        if self.over_temperature is not None:
            return "soc,temperature"
        if self.reference.tables.is_constant:
            return None
        return "soc" if self.reference.is_over_soc else "ocv"

    @property
    def proved_gap(self) -> float | None:
        """The largest share of the error that another fit could save; None without a proof."""
        fit = self.over_temperature or self.reference
        return None if self.reference.status == "unverified" else fit.proved_gap

    @property
    def held(self) -> set[str]:
        """The names of parameters held at a value."""
        return {name for name, ends in self.settings.ranges.items() if ends[0] == ends[1]}

    @property
    def reference(self) -> TableFit:
        """The fit of `reference_degc`."""
        return dict(self.by_degc)[self.reference_degc]

    @property
    def temperatures_degc(self) -> tuple[float, ...]:
        """The temperatures from cold to warm; empty if there is only one."""
        return self.over_temperature.temperatures_degc if self.over_temperature else ()

    @property
    def reference_degc(self) -> float | None:
        """The temperature nearest to `REFERENCE_DEGC`; None if there is only one."""
        nearest = sorted(self.temperatures_degc, key=lambda degc: abs(degc - REFERENCE_DEGC))
        return nearest[0] if nearest else None

    @property
    def by_degc(self) -> list[tuple[float | None, TableFit]]:
        """Every temperature with its tables; the temperature is None if there is only one set."""
        return [*zip(self.temperatures_degc or (None,), self.fits, strict=True)]

    @cached_property
    def tables(self) -> TemperatureTables | None:
        """The tables over temperature; None if they are for one temperature."""
        degc, tables = self.temperatures_degc, tuple(fit.tables for fit in self.fits)
        return TemperatureTables(degc, tables) if degc else None

    def at(self, temperature_degc: float) -> CircuitParameters:
        """The tables at a temperature: the measured ones within `SAME_DEGC`, otherwise
        interpolated; the only ones if there is one temperature."""
        if self.over_temperature is None or self.tables is None:
            return self.fits[0].tables
        near = self.over_temperature.measured_near(temperature_degc)
        return self.tables.at(temperature_degc if near is None else near)

    def evaluate(self, prepared: PreparedRecord) -> Evaluation:
        """The tables at a record's temperature, simulated on it."""
        return evaluate(prepared, self.of(prepared))

    def of(self, prepared: PreparedRecord) -> CircuitParameters:
        """The tables at a record's temperature. Raises `InputError` if that is needed and
        missing."""
        if self.over_temperature is None:
            return self.fits[0].tables
        return self.at(require_temperature(prepared))

    @property
    def named_ohm(self) -> dict[str, float]:
        """The mean of every pair's resistance, as in `mean_ohm`."""
        pairs = self.fits[0].tables.resistances[1:]
        return {name: self.mean_ohm(name) for name in pairs}

    def mean_ohm(self, name: str) -> float:
        """The mean of a resistance over the visited SOC above 10 %, and over temperatures."""
        means = [mean for fit in self.fits for mean in fit.means if mean.name == name]
        return float(np.mean([mean.value for mean in means]))

    def other_sampling(self, records: Sequence[PreparedRecord]) -> Resampling | None:
        """The change of the mean resistances under the other sampling of the current, if that is
        undetermined in the records that the tables were fitted to."""
        return resampling(records, self.fits[0].tables, self.named_ohm)

    def least_r0_shares(self, records: Sequence[PreparedRecord]) -> dict[str, float]:
        """The share by which R0 may be smaller, if it contains a pair too fast for the samples to
        resolve; empty if the user gave bounds of R0."""
        return {} if R0 in self.settings.ranges else {R0: least_r0_share(records) - 1}

    def spanning(
        self, shifts_ohm: Sequence[float], shares: Mapping[str, float] | None = None
    ) -> "TableFits":
        """A copy with intervals extended by shifts of R0 in ohms, and by relative shifts of
        resistances, all equally possible."""
        shares = shares or {}

        def reaching(interval: NodeInterval) -> NodeInterval:
            of_parts = [shares[part] for part in parts_of(interval.name) if part in shares]
            # For a sum, the shift of the pair that moves most.
            shifts = [max(of_parts, key=abs) * interval.value] if of_parts else []
            if interval.name == R0:
                shifts += shifts_ohm
            return interval.spanning(shifts) if shifts else interval

        fits = tuple(
            replace(
                fit,
                intervals=tuple(map(reaching, fit.intervals)),
                means=tuple(map(reaching, fit.means)),
            )
            for fit in self.fits
        )
        return replace(self, fits=fits)


def require_temperature(prepared: PreparedRecord) -> float:
    """A record's temperature in degC. Raises `InputError` if it is missing or impossible for a
    cell."""
    degc, name = prepared.temperature_degc, prepared.record.name
    if degc is None:
        raise Notice("temperature.unknown", subject=name).error()
    if not is_temperature(degc):
        raise InputError(
            f"{name}: no cell is measured at {degc:.4g} degC; give it with `temperature`, or "
            "rename a column in kelvin to 'Temperature / K'"
        )
    return degc


def fit_warnings(fits: TableFits, evaluations: Evaluations) -> Iterator[Notice]:
    """Notices that a user of the answer should know; `evaluations` are of the answer."""
    if fits.over is None:
        for hit in fits.reference.at_bound:
            yield Notice("answer.at-bound", {"name": hit.name, "side": hit.side})
        return
    identified = evaluations.identification
    degc = [f" at {degc:.3g} degC" for degc in fits.temperatures_degc] or [""]
    what = "tables over SOC"
    if not fits.reference.is_over_soc:
        what = table_name(identified[0].prepared.circuit, "ocv")
    by_text: dict[str, list[Notice]] = {}
    for where, fit in zip(degc, fits, strict=True):
        for warning in fit.warnings:
            by_text.setdefault(str(warning), []).append(warning.about(f"{what}{where}"))
    for alike in by_text.values():
        # Notices that apply at every temperature are given once.
        yield from alike if len(alike) < len(degc) else [alike[0].about(what)]
    usual_v = max(DISAGREES_V, DISAGREES_SHARE * _mean_drop_v(fits, identified))
    for fit in fits:
        fitted_ocv = fit.ocv_compared
        if fitted_ocv is not None and fitted_ocv.median_v > usual_v:
            where = {"largest_v": fitted_ocv.largest_v, "soc": fitted_ocv.largest_soc}
            yield Notice("ocv-test.disagrees", {"median_v": fitted_ocv.median_v, **where})
        corrections = [node for node in fit.of_table(OCV_CORRECTION) if node.low is None]
        moved = max(corrections, key=lambda node: abs(node.value), default=None)
        if moved is not None and abs(moved.value) > OVERRULED_V:
            yield Notice("ocv-test.overruled", {"moved_v": moved.value, "soc": moved.soc})
    yield from _offset_warnings([evaluation.prepared for evaluation in identified])
    yield from _reversal_warnings(fits)
    if fits.reference.is_over_soc:
        # Otherwise the OCV is the only table, and has its own notice.
        yield from _outside_warnings(fits, evaluations)
    for evaluation in evaluations.validation:
        yield from no_temperature(evaluation.prepared, fits)


def _mean_drop_v(fits: TableFits, identified: Sequence[Evaluation]) -> float:
    """The voltage over all resistances at the mean current under load."""
    records = [evaluation.prepared for evaluation in identified]
    current_a = np.concatenate([np.abs(record.current_a[record.scored]) for record in records])
    is_loaded = current_a >= max(record.rest_current_a for record in records)
    mean_a = float(np.mean(current_a[is_loaded])) if is_loaded.any() else 0.0
    return mean_a * sum(map(fits.mean_ohm, fits.reference.tables.named_ohm))


def no_temperature(prepared: PreparedRecord, fits: TableFits) -> Iterator[Notice]:
    """The notice that a record lacks the temperature on which the resistances depend."""
    law = fits.of(prepared).dependence
    if law is not None and BETA in law.numbers and prepared.sample_degc is None:
        values = {"reference_degc": law.reference_degc}
        yield Notice("tables.no-temperature", values, prepared.record.name)


def _offset_warnings(records: Sequence[PreparedRecord]) -> Iterator[Notice]:
    """The notice that the records agree far better without an offset of their current, which moves
    R.
    """
    level = records[0].window.registration
    if level is None or level.offset_a is None or level.offset_error_a is None:
        return
    # With the sign used in the files.
    is_turned = {record.record.sign.value for record in records} == {"charge-positive"}
    offset_a = -level.offset_a if is_turned else level.offset_a
    names = ", ".join(record.record.name for record in records)
    values = {"offset_a": offset_a, "error_a": 2 * level.offset_error_a}
    values |= {"hours": level.given_capacity_ah / abs(offset_a)}
    yield Notice("answer.current-offset", values, names)


def _reversal_warnings(fits: TableFits) -> Iterator[Notice]:
    """One notice for each resistance that both falls and rises from cold to warm."""
    over = fits.over_temperature
    if over is None:
        return
    by_name: dict[str, list[Reversal]] = {}
    for reversal in over.reversals:
        by_name.setdefault(reversal.name, []).append(reversal)
    degc = ", ".join(f"{degc:.3g}" for degc in over.temperatures_degc)
    for name, reversals in by_name.items():
        reversal = reversals[len(reversals) // 2]
        values = ", ".join(f"{1e3 * value:.3g}" for value in reversal.values_ohm)
        yield Notice(
            "tables.not-monotone",
            {
                "name": name.partition(" ")[0],
                "nodes": len(reversals),
                "all_nodes": len(fits.fits[0].tables.nodes),
                "values_mohm": values,
                "temperatures_degc": degc,
                "soc": reversal.soc,
            },
        )


def _outside_warnings(fits: TableFits, evaluations: Evaluations) -> Iterator[Notice]:
    """Notices for validation records that reach an SOC at which no table was identified."""
    for evaluation in evaluations.validation:
        low, high = visited_soc(
            [
                other.prepared
                for other in evaluations.identification
                if _is_alike(fits, evaluation, other)
            ]
        )
        soc = evaluation.prepared.soc[evaluation.prepared.scored]
        outside = int(np.count_nonzero((soc < low - SAME_FULL) | (soc > high + SAME_FULL)))
        if outside:
            values = {"outside": outside, "samples": len(soc)}
            values |= {"low_percent": 100 * low, "high_percent": 100 * high}
            yield Notice("soc.outside-tables", values, evaluation.prepared.record.name)


def _is_alike(fits: TableFits, evaluation: Evaluation, other: Evaluation) -> bool:
    """True if the tables of one record apply to another: not those of another measured temperature;
    between temperatures all of them count."""
    over = fits.over_temperature
    if over is None:
        return True
    near = over.measured_near(evaluation.prepared.temperature_degc or 0.0)
    return near in (None, over.measured_near(other.prepared.temperature_degc or 0.0))

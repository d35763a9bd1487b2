"""The parts of `result.json` without a dataclass in the numerics: errors, inputs, candidates, and
the best constant circuit with its assessment."""

import functools
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, ValidationInfo, field_validator, model_validator

from .cell import CircuitParameters, OcvTable, get_circuit
from .cell.model import SAME_DEGC
from .errors import choices_in
from .fit.cross_validation import SocErrors
from .fit.node_interval import NodeInterval
from .fit.settings import TableSettings, table_name
from .fit.table_fit import TableFit
from .fit.temperature_fits import TableFits
from .global_optimum.certificate import CERTIFIED_GAP
from .global_optimum.search import GlobalOptimum
from .metrics import Count, Metrics
from .model.other_sampling import resampled_share
from .model.start import Start
from .model.window import Window
from .records import Decision, Record, Source
from .records.fingerprint import Content, read_fingerprint
from .schema import Parameters, Part
from .search.answers import AtBound, Refinement, Search
from .search.evaluate import Evaluation, Evaluations, pooled
from .settings import AutoHold, AutoSign
from .uncertainty import Assessment, Band, Estimate
from .uncertainty.assessment import soc_bands

VERSIONED = ("barnax", "jax", "jaxlib", "numpy", "optimistix", "equinox", "scipy", "polars")
# A state of charge; a record may run beyond full and empty, but not far.
Soc = Annotated[float, Field(ge=-10, le=10)]
CircuitName = Annotated[str, AfterValidator(lambda name: get_circuit(name).name)]


def soc_errors(metrics: Metrics) -> SocErrors:
    """The RMSE, and that above 10 % SOC."""
    return SocErrors(metrics.rmse_v, metrics.rmse_above_10_soc_v)


class MetricsBlock(Part):
    """Errors of the answer.

    Attributes:
        identification: Over all samples identified on.
        jointly: Errors on each record, if several were identified on together.
        validation: On each record validated on.
    """

    identification: Metrics
    jointly: tuple[Metrics, ...] = ()
    validation: tuple[Metrics, ...]

    @classmethod
    def of(cls, name: str, evaluations: Evaluations) -> Self:
        """The errors of a circuit on its records, those identified on together under one name."""
        identified = evaluations.identification
        return cls(
            identification=pooled(identified, name),
            jointly=tuple(one.metrics for one in identified) if len(identified) > 1 else (),
            validation=tuple(one.metrics for one in evaluations.validation),
        )


@dataclass(frozen=True)
class Candidate:
    """A circuit with its errors on fitted records, and on others.

    Attributes:
        model: Name of the circuit.
        over: "soc" or "soc,temperature" for tables, "ocv" for one value of each resistance at every
            SOC with a table of the OCV, None for a constant circuit.
        identification: Errors on all records identified on together.
        validation_v: RMSE on each record validated on.
        held_out: Errors on blocks held out of the fit; None if there were none.
        proved_gap: The largest share of its error that a better circuit of its kind could save;
            None without a proof.
        is_answer: True for the answer of the result.
    """

    model: str
    over: str | None
    identification: SocErrors
    validation_v: tuple[float, ...]
    held_out: SocErrors | None
    proved_gap: float | None = None
    is_answer: bool = False

    @property
    def name(self) -> str:
        """The circuit as named in tables and screens."""
        return table_name(self.model, self.over)

    @classmethod
    def of(cls, answer: Any, held_out: SocErrors | None, is_answer: bool) -> "Candidate":
        """The candidate of a result."""
        metrics, fits = answer.metrics, answer.fits
        validation_v = tuple(errors.rmse_v for errors in metrics.validation)
        errors = soc_errors(metrics.identification), validation_v, held_out
        return cls(answer.model, fits.over, *errors, fits.proved_gap, is_answer)


class InputPart(Part):
    """One input file, with the decisions about it, and for a record the settings of its simulation.

    Attributes:
        role: Its role.
        name: Its name.
        sha256: Its digest.
        fingerprint: Some of a record's samples, to recognize it in any file: its first and last
            time, and after semicolons runs of samples, each with its time, current (discharge
            positive) and voltage, in s, A and V.
        sign: Sign of its current, with the reason.
        hold: When a sample's current flows, with the reason.
        resampled_share: If that is merely assumed, the charge that the simulated part would span
            with the other sampling, as a share of its actual span.
        voltage_lag_s: Lag of its voltage behind the current in its row.
        window: The part that was simulated.
        start: Position and SOC of the start, with the reason.
        rest_current_a: Current below which the cell rests.
        capacity_ah: Capacity in the simulation.
        duration_s: Length of the simulation.
        samples: Number of scored samples.
        soc_range: Lowest and highest SOC.
        temperature_degc: Temperature of the record.
        peak_current_a: The largest current of the simulation, in either direction.
    """

    role: Literal["identification", "validation", "ocv"]
    name: str
    sha256: str
    fingerprint: str = ""
    sign: Decision | None = None
    hold: Decision | None = None
    resampled_share: float | None = None
    voltage_lag_s: float = 0.0
    window: Window | None = None
    start: Start | None = None
    rest_current_a: float | None = None
    capacity_ah: float | None = None
    duration_s: float | None = None
    samples: Count | None = None
    soc_range: tuple[float, float] | None = None
    temperature_degc: float | None = None
    peak_current_a: float | None = None

    @classmethod
    def of(cls, role: Any, record: Record | OcvTable) -> Self:
        """A file that was read, with the decisions about it."""
        if isinstance(record, OcvTable):
            return cls(role=role, name=record.name, sha256=record.sha256)
        how = {"sign": record.sign, "hold": record.hold, "voltage_lag_s": record.voltage_lag_s}
        return cls(role=role, name=record.name, sha256=record.sha256, **how)

    @classmethod
    def simulated(cls, role: Any, evaluation: Evaluation) -> Self:
        """A record that was simulated."""
        prepared = evaluation.prepared
        soc = prepared.soc[prepared.scored]
        return cls.of(role, prepared.record).model_copy(
            update={
                "fingerprint": Content(prepared.record).fingerprint,
                "window": prepared.window,
                "start": prepared.start,
                "rest_current_a": float(prepared.rest_current_a),
                "capacity_ah": float(prepared.capacity_ah),
                "duration_s": prepared.scored_duration_s,
                "samples": int(np.count_nonzero(prepared.scored)),
                "soc_range": (float(soc.min()), float(soc.max())),
                "temperature_degc": prepared.temperature_degc,
                "peak_current_a": float(np.abs(prepared.current_a).max()),
                "resampled_share": resampled_share(prepared),
            }
        )

    @field_validator("sign", "hold")
    @classmethod
    def _be_decided(cls, decision: Decision | None, info: ValidationInfo) -> Decision | None:
        values = choices_in(AutoSign if info.field_name == "sign" else AutoHold)[1:]
        if decision is not None and decision.value not in values:
            raise ValueError(f"{decision.value!r} is none of {', '.join(values)}")
        return decision

    @field_validator("fingerprint")
    @classmethod
    def _hold_samples(cls, text: str) -> str:
        if text:
            read_fingerprint(text)
        return text

    def is_of(self, record: Record | Source) -> bool:
        """True for the same samples; for a source, for the same whole file."""
        if isinstance(record, Record) and self.fingerprint:
            return Content(record).fingerprint == self.fingerprint
        return self.sha256 == record.sha256 != "" and "#" not in self.name

    @property
    def start_source(self) -> str:
        """The source of the SOC at its start, before registration; empty for an OCV test."""
        if self.window and (registration := self.window.registration):
            return registration.origin.given_source
        return self.start.soc_source if self.start else ""

    @property
    def initial_capacity_ah(self) -> float | None:
        """The given capacity, or that from the OCV test, before registration on other records of
        the cell."""
        registration = self.window and self.window.registration
        is_moved = registration and registration.by == "records"
        return registration.given_capacity_ah if registration and is_moved else self.capacity_ah

    def is_at(self, temperature_degc: float) -> bool:
        """True for a record at this temperature, within the difference that separates two."""
        degc = self.temperature_degc
        return degc is not None and abs(degc - temperature_degc) <= SAME_DEGC


class ConstantPart(Part):
    """The best constant circuit known: the answer itself, or in addition to tables.

    Attributes:
        model: Name of the circuit.
        parameters: Its parameters, under PyBaMM's names in SI units.
        source: Its origin.
        at_bound: Parameters at a bound.
        metrics: Its errors.
        global_optimum: The best circuit in the bounds; None if they are too wide to search.
        assessment: Intervals and diagnostics, None if skipped or failed.
        hold_shift_ohm: Increase of R0 if a sample's current flowed on its other side, if the side
            is assumed.
        search: The answers of the seeds; None without seeds.
        refined: Their answers after Levenberg-Marquardt.
        bounds: Lowest and highest value of each parameter.
        fixed: Held parameters.
    """

    model: CircuitName
    parameters: CircuitParameters
    source: Literal["seeds", "global optimum"]
    at_bound: tuple[AtBound, ...]
    metrics: MetricsBlock
    global_optimum: GlobalOptimum | None = None
    assessment: Assessment | None = None
    hold_shift_ohm: float | None = None
    search: Search | None = None
    refined: Refinement | None = None
    bounds: dict[str, tuple[float, float]]
    fixed: Parameters

    @property
    def fits(self) -> TableFits:
        """The circuit as tables of one node. Its box is `bounds`, and it has no `tau_ranges_s`."""
        optimum, circuit, errors = self.global_optimum, self.parameters, self.metrics.identification
        best = optimum if optimum and self.source == "global optimum" else errors
        bands, estimates, findings = (), (), ()
        if self.assessment is not None:
            bands = self.assessment.diagnostics.by_soc
            estimates = self.assessment.uncertainty.estimates
            findings = self.assessment.identifiability.findings
        at = dict.fromkeys(circuit.tables, circuit.nodes[0])
        intervals = {one.name: _interval(one, at.get(one.name)) for one in estimates}
        # Resistances are their own means; for pairs that the data do not separate, so are sums.
        alike = [one.combined for one in findings if one.kind == "alike" and one.combined]
        means = [
            replace(intervals.get(name) or _interval(Estimate(name, ohm)), soc=None)
            for name, ohm in circuit.named_ohm.items()
        ]
        fit = TableFit(
            tables=circuit,
            objective_v=best.rmse_v,
            errors=tuple(map(soc_errors, self.metrics.jointly or (errors,))),
            tau_ranges_s=(),
            lower_bound_v=optimum.lower_bound_v if optimum else 0.0,
            status=optimum.status if optimum else "unverified",
            boxes=(optimum and optimum.boxes) or 0,
            at_bound=self.at_bound,
            parameters=len(self.bounds),
            intervals=tuple(intervals.values()),
            cross_validation=None,
            warnings=(),
            means=(*means, *map(_interval, alike)),
        )
        # A capacitance is not a number of tables.
        fixed = {name: value for name, value in self.fixed.items() if not name.endswith("[F]")}
        settings = TableSettings(nodes=circuit.nodes, fixed=fixed, proved_share=CERTIFIED_GAP)
        return TableFits((fit,), None, settings, bands, self.hold_shift_ohm)

    @model_validator(mode="after")
    def _hold_what_the_circuit_has(self) -> Self:
        wanted, values = get_circuit(self.model).parameter_names, self.parameters.to_dict()
        if values.keys() != set(wanted):
            raise ValueError(
                f"the circuit {self.model} has the parameters {', '.join(wanted)}, not "
                f"{', '.join(values)}"
            )
        return self


def _interval(estimate: Estimate, soc: float | None = None) -> NodeInterval:
    error = estimate.standard_error or 0.0
    return NodeInterval(estimate.name, soc, estimate.value, error, 0.0, estimate.low, estimate.high)


def bands_by_soc(evaluations: Sequence[Evaluation]) -> tuple[Band, ...]:
    """The errors of several records together in each tenth of the state of charge."""
    scored = [(one, one.prepared.scored) for one in evaluations]
    soc = np.concatenate([one.prepared.soc[here] for one, here in scored])
    return soc_bands(soc, np.concatenate([one.error_v[here] for one, here in scored]))


@functools.cache
def versions() -> dict[str, str]:
    """The versions that can change a result's digits."""
    return {"python": sys.version.split()[0]} | {name: version(name) for name in VERSIONED}

"""The parts of `result.json`: what is stored of the search, the answer, its errors and inputs."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, ValidationInfo, field_validator, model_validator

from .cell import CircuitParameters, get_circuit
from .cell.model import SAME_DEGC
from .model.problem import Kind
from .model.start import Start
from .model.window import Window
from .over_soc import (
    NodeInterval,
    OverTemperature,
    SocErrors,
    TableFit,
    TableSettings,
)
from .records import Decision, Record, Source
from .records.fingerprint import Content, read_fingerprint
from .schema import Count, MaybeInfinite, Parameters, Part, Volts
from .search.refine import AtBound, Optimum, RefinedSeed
from .search.seeds import SeedAnswer
from .settings import AutoHold, AutoSign, choices_in
from .uncertainty import Band, Diagnostics, Estimate, Examination, Identifiability, Uncertainty

SCHEMA_VERSION = 6
Key = Annotated[int, Field(ge=0, lt=2**64)]
# A state of charge; a record may run beyond full and empty, but not far.
Soc = Annotated[float, Field(ge=-10, le=10)]
CircuitName = Annotated[str, AfterValidator(lambda name: get_circuit(name).name)]
# What a file of a folder serves for.
Use = Literal["identification", "OCV test", "validation", "not used"]
Setting = bool | int | float | str


class SearchPart(Part):
    """The search as it was set up, and what each seed found before refinement.

    Attributes:
        method: The optimizer.
        settings: Its own settings.
        coordinates: Search coordinates: "rc", or logarithms of R and tau.
        objective: How errors were computed: by "scan" or "compressed".
        population: Candidates of a generation.
        iterations: Generations of a run.
        key: The key of all random numbers.
        evaluations: Simulated candidates of all seeds.
        seeds: Each seed's answer.
    """

    method: str
    settings: dict[str, Setting]
    coordinates: Literal["rc", "log"]
    objective: Kind
    population: Count
    iterations: Count
    key: Key
    evaluations: Count
    seeds: tuple[SeedAnswer, ...] = Field(min_length=1)


class RefinedPart(Part):
    """The seeds after Levenberg-Marquardt, and the distinct optima they ended in.

    Attributes:
        rmse_v: The best, by scan.
        objective: How errors were computed on the way.
        evaluations: Simulations, a Jacobian as one per free parameter.
        at_bound: Parameters of the best at a bound.
        optima: The distinct optima, the best first.
        seeds: Each seed's answer.
    """

    rmse_v: Volts
    objective: Kind
    evaluations: Count
    at_bound: tuple[AtBound, ...]
    optima: tuple[Optimum, ...] = Field(min_length=1)
    seeds: tuple[RefinedSeed, ...] = Field(min_length=1)


class GlobalPart(Part):
    """The best circuit in the box, how sure that is, and how far the seeds stayed from it.

    An optimality gap is an RMSE over the optimum's, minus one; without seeds it is infinite.

    Attributes:
        rmse_v: The optimum's RMSE.
        parameters: The optimum.
        status: "certified" by branch and bound, or "grid-verified".
        lower_bound_v: No circuit in the box has a lower RMSE.
        proved_gap: The largest share of the RMSE that a better circuit could save.
        boxes: Boxes of time constants that the proof took.
        local_optima: The other optima.
        at_bound: Parameters at a bound.
        median_gap: Optimality gap of the median seed before refinement.
        best_gap: That of the best seed before refinement.
        refined_gap: That of the best refined seed.
        seeds_there: Refined seeds that reached the optimum.
    """

    rmse_v: Volts
    parameters: CircuitParameters
    status: Literal["certified", "grid-verified"]
    lower_bound_v: Volts
    proved_gap: float
    boxes: Count | None
    local_optima: tuple[Optimum, ...]
    at_bound: tuple[AtBound, ...]
    median_gap: MaybeInfinite = math.inf
    best_gap: MaybeInfinite = math.inf
    refined_gap: MaybeInfinite = math.inf
    seeds_there: Count = 0


class MetricsPart(Part):
    """Errors on one record over its counted samples.

    Attributes:
        record: Name of the record.
        rmse_v: Root of the mean squared error.
        r2: One minus the squared error over the squared deviation of the voltage from its mean.
        r2_paper: The same as printed in Li et al. (2023).
        mape_percent: Mean absolute error, relative to the measured voltage.
        ce_v: Sum of the absolute errors.
        max_v: The largest error.
        samples: Number of counted samples.
        rmse_above_10_soc_v: RMSE above 10 % SOC.
        registered_v: RMSE with its start moved to where it is least, of a record to validate on.
        start_moved_soc: By how much SOC that start is moved.
    """

    record: str
    rmse_v: Volts
    r2: float
    r2_paper: float
    mape_percent: float
    ce_v: Volts
    max_v: Volts
    samples: Count
    rmse_above_10_soc_v: Volts | None = None
    registered_v: Volts | None = None
    start_moved_soc: float | None = None

    @property
    def soc_errors(self) -> SocErrors:
        """The RMSE, and that above 10 % SOC."""
        return SocErrors(self.rmse_v, self.rmse_above_10_soc_v)


class MetricsBlock(Part):
    """Errors of the answer.

    Attributes:
        identification: Over all samples identified on.
        jointly: Where these are of several records, on each of them.
        validation: On each record validated on.
    """

    identification: MetricsPart
    jointly: tuple[MetricsPart, ...] = ()
    validation: tuple[MetricsPart, ...]


class InputPart(Part):
    """One file that was read, what was decided about it, and for a record how it was simulated.

    Attributes:
        role: What it served as.
        name: Its name.
        sha256: Its digest.
        fingerprint: Some of a record's samples, to tell it again in whatever file: its first and
            last time, and behind semicolons runs of samples, each with its time, current
            (discharge positive) and voltage, in s, A and V.
        sign: The sign of its current, and why.
        hold: When a sample's current flows, and why.
        voltage_lag_s: By how much its voltage is older than the current in its row.
        window: The part that was simulated.
        start: Where and from which SOC, and why.
        rest_current_a: The cell rests below this current.
        capacity_ah: Capacity in the simulation.
        duration_s: Length of the simulation.
        samples: Number of counted samples.
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
        """True for the same samples; of a source, for the same file as a whole."""
        if isinstance(record, Record) and self.fingerprint:
            return Content(record).fingerprint == self.fingerprint
        return self.sha256 == record.sha256 != "" and "#" not in self.name

    @property
    def start_source(self) -> str:
        """What told the SOC at its start, before it was registered; empty of an OCV test."""
        if self.window and (known := self.window.registration):
            return known.origin.told_source
        return self.start.soc_source if self.start else ""

    @property
    def told_capacity_ah(self) -> float | None:
        """The capacity that was told, or that the OCV test tells, before other records of the cell
        moved it."""
        known = self.window and self.window.registration
        return known.told_capacity_ah if known and known.by == "records" else self.capacity_ah

    def is_at(self, temperature_degc: float) -> bool:
        """True for a record of this temperature, as far as one is told from another."""
        own_degc = self.temperature_degc
        return own_degc is not None and abs(own_degc - temperature_degc) <= SAME_DEGC


class PlannedFile(Part):
    """A file of a folder, what a plan found it to be, what it serves for, and why; `plans_soc` says
    that its SOC at the start is the plan's own, and not given."""

    name: str
    role: Use
    kind: str
    reason: str
    temperature_degc: float | None = None
    plans_soc: bool = False


class AssessmentPart(Part):
    """Intervals of the answer, what the data do not determine, and residuals.

    Attributes:
        uncertainty: Intervals of all parameters.
        identifiability: What the data cannot determine.
        diagnostics: Residuals over time, SOC, current and temperature.
        examination: What further fits add.
    """

    uncertainty: Uncertainty
    identifiability: Identifiability
    diagnostics: Diagnostics
    examination: Examination | None = None


class TablesPart(Part):
    """Tables over SOC that are the answer, and how they were fitted.

    Attributes:
        settings: How they were fitted.
        fits: The tables, one set for each temperature, from cold to warm.
        over_temperature: The temperatures, None for a single set.
        by_soc: Their errors by SOC.
        hold_shift_ohm: How much more every R0 would be if a sample's current flowed on its other
            side, where that is assumed.
    """

    settings: TableSettings
    fits: tuple[TableFit, ...] = Field(min_length=1)
    over_temperature: OverTemperature | None = None
    by_soc: tuple[Band, ...]
    hold_shift_ohm: float | None = None


class ConstantPart(Part):
    """The best constant circuit known: the answer itself, or what stands beside tables.

    Attributes:
        model: Name of the circuit.
        parameters: Its parameters, under PyBaMM's names in SI units.
        source: Where it comes from.
        at_bound: Parameters that ended at a bound.
        metrics: Its errors.
        global_optimum: The best circuit in the bounds, None if they are too wide to look for it.
        assessment: Intervals and diagnostics, None if skipped or failed.
        hold_shift_ohm: How much more R0 would be if a sample's current flowed on its other side,
            where that is assumed.
        search: What the seeds found, None without seeds.
        refined: Where Levenberg-Marquardt took them.
        bounds: Lowest and highest value of each parameter.
        fixed: Parameters that were held.
    """

    model: CircuitName
    parameters: CircuitParameters
    source: Literal["seeds", "global optimum"]
    at_bound: tuple[AtBound, ...]
    metrics: MetricsBlock
    global_optimum: GlobalPart | None = None
    assessment: AssessmentPart | None = None
    hold_shift_ohm: float | None = None
    search: SearchPart | None = None
    refined: RefinedPart | None = None
    bounds: dict[str, tuple[float, float]]
    fixed: Parameters

    @property
    def estimates(self) -> dict[str, Estimate]:
        """The parameters with their intervals, by name; none where the assessment was skipped."""
        found = () if self.assessment is None else self.assessment.uncertainty.estimates
        return {estimate.name: estimate for estimate in found}

    @property
    def fit(self) -> TableFit:
        """The circuit as tables of one node, for whoever asks what either kind of answer has.

        Its box is `bounds`, and it has no `tau_ranges_s`.
        """
        optimum, errors = self.global_optimum, self.metrics.identification
        return TableFit(
            tables=self.parameters,
            objective_v=errors.rmse_v,
            errors=tuple(part.soc_errors for part in self.metrics.jointly or (errors,)),
            tau_ranges_s=(),
            lower_bound_v=optimum.lower_bound_v if optimum else 0.0,
            status=optimum.status if optimum else "unverified",
            boxes=(optimum and optimum.boxes) or 0,
            at_bound=self.at_bound,
            parameters=len(self.bounds),
            intervals=tuple(map(self._interval, self.estimates.values())),
            cross_validation=None,
            warnings=(),
            means=tuple(self._means()),
        )

    def _means(self) -> Iterator[NodeInterval]:
        """The resistances, each its own mean, and sums of pairs that the data do not tell apart."""
        for name, value in self.parameters.named_ohm.items():
            own = self.estimates.get(name, Estimate(name, value))
            yield replace(self._interval(own), soc=None)
        findings = () if self.assessment is None else self.assessment.identifiability.findings
        for finding in findings:
            if finding.kind == "alike" and finding.combined is not None:
                yield self._interval(finding.combined)

    def _interval(self, own: Estimate) -> NodeInterval:
        soc = self.parameters.nodes[0] if own.name in self.parameters.tables else None
        error = own.standard_error or 0.0
        return NodeInterval(own.name, soc, own.value, error, 0.0, own.low, own.high)

    @model_validator(mode="after")
    def _hold_what_the_circuit_has(self) -> Self:
        wanted, found = get_circuit(self.model).parameter_names, self.parameters.to_dict()
        if found.keys() != set(wanted):
            raise ValueError(
                f"the circuit {self.model} has the parameters {', '.join(wanted)}, not "
                f"{', '.join(found)}"
            )
        return self

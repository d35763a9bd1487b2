"""`result.json`: what an identification found, and all that is needed to use or repeat it."""

import json
import math
import sys
from collections.abc import Sequence
from dataclasses import asdict, fields
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    PlainSerializer,
    ValidationError,
    field_validator,
    model_validator,
)

from .cell import CellModel, CircuitParameters, get_circuit
from .errors import InputError, cut
from .global_optimum import GlobalOptimum, optimality_gap
from .metrics import Metrics
from .model.inputs import Window
from .model.problem import Kind
from .optimizers import OPTIMIZERS, AbstractPopulationMinimiser
from .records import Record
from .search.evaluate import Evaluation, pooled
from .search.refine import Optimum, Refinement
from .uncertainty import Assessment, Examination

Stored = TypeVar("Stored", bound=BaseModel)

# A smaller regret is rounding.
NO_GAP = 1e-7
LARGEST_FILE = 200_000_000
# No part has so many; each one unknown would be an error of its own.
MOST_KEYS = 1000
LONGEST_REASON = 500

Volts = Annotated[float, Field(ge=0)]
# An error that may be infinite, where nothing could be simulated; JSON has null for that.
Loss = Annotated[
    float,
    Field(ge=0, allow_inf_nan=True),
    BeforeValidator(lambda value: math.inf if value is None else value),
    PlainSerializer(lambda value: None if math.isinf(value) else value, when_used="json"),
]
# A state of charge; a record may run beyond full and empty, but not far.
Soc = Annotated[float, Field(ge=-10, le=10)]
Count = Annotated[int, Field(ge=0, lt=2**63)]
Key = Annotated[int, Field(ge=0, lt=2**64)]
Setting = bool | int | float | str
Parameters = dict[str, float]

# Keys with units, by the field's name.
KEYS = {
    "rmse_v": "rmse [V]",
    "lower_bound_v": "lower_bound [V]",
    "history_v": "history",
    "mape_percent": "mape [%]",
    "ce_v": "ce [V]",
    "max_v": "max [V]",
    "mean_v": "mean [V]",
    "sd_v": "sd [V]",
    "threshold_v": "threshold [V]",
    "correlation_s": "correlation [s]",
    "lags_s": "lags [s]",
    "integrated_time_s": "integrated_time [s]",
    "block_s": "block [s]",
    "rest_current_a": "rest_current [A]",
}


def _fail_fast(schema: Any) -> None:
    if isinstance(schema, dict):
        if schema.get("type") == "tuple":
            schema["fail_fast"] = True
        for each in schema.values():
            _fail_fast(each)
    elif isinstance(schema, list | tuple):
        for each in schema:
            _fail_fast(each)


class Part(BaseModel):
    """A part of the file: immutable, nothing unknown, nothing infinite."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        allow_inf_nan=False,
        alias_generator=lambda name: KEYS.get(name, name),
        populate_by_name=True,
    )

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: type[BaseModel], handler: GetCoreSchemaHandler
    ) -> Any:
        """The type's schema, but that the first bad item of a list is the last looked at.

        A million bad ones would otherwise be a million errors of half a kilobyte.
        """
        schema = handler(source)
        _fail_fast(schema)
        return schema


class SeedPart(Part):
    """One seed of the search, before refinement."""

    rmse_v: Loss
    parameters: Parameters
    evaluations: Count
    failures: Count
    history_v: tuple[Loss, ...]


class SearchPart(Part):
    """The search as it was set up, and what each seed found."""

    method: str
    settings: dict[str, Setting]
    coordinates: Literal["rc", "log"]
    objective: Kind
    population: Count
    iterations: Count
    key: Key
    evaluations: Count
    seeds: tuple[SeedPart, ...] = Field(min_length=1)


class OptimumPart(Part):
    """A distinct place where refined seeds ended."""

    rmse_v: Volts
    parameters: Parameters
    seeds: Count
    is_family: bool


class RefinedPart(Part):
    """The Levenberg-Marquardt cross-check.

    `moved` is each seed's largest relative change, `converged` whether it stood still at the end.
    `objective` says how it computed errors on its way; `rmse_v` is the scan's. `evaluations`
    counts simulations, a Jacobian as one per free parameter.
    """

    rmse_v: Volts
    objective: Kind
    evaluations: Count
    at_bound: tuple[str, ...]
    optima: tuple[OptimumPart, ...] = Field(min_length=1)
    moved: tuple[float, ...]
    converged: tuple[bool, ...]
    verdict: str


class MetricsPart(Part):
    """Errors on one record over its scored samples."""

    record: str
    rmse_v: Volts
    r2: float
    r2_paper: float
    mape_percent: float
    ce_v: Volts
    max_v: Volts
    samples: Count


class GlobalPart(Part):
    """The best circuit there is in the box, and how far the search and its refinement are from it.

    A regret is an RMSE over the optimum's, minus one: of the median and of the best seed before
    refinement, and of the refined answer.
    """

    rmse_v: Volts
    parameters: Parameters
    status: Literal["certified", "grid-verified"]
    lower_bound_v: Volts
    local_optima: tuple[OptimumPart, ...]
    at_bound: tuple[str, ...]
    median_gap: float
    best_gap: float
    refined_gap: float
    verdict: str

    @property
    def words(self) -> str:
        """What the optimum is, how sure that is, and how far the answers are from it."""
        before = {"best seed": self.best_gap, "median seed": self.median_gap}
        shares = ", ".join(
            f"{name} {_share(optimality_gap)}" for name, optimality_gap in before.items()
        )
        return (
            f"{self.verdict} Regret, the RMSE above that: refined {_share(self.refined_gap)}; "
            f"before refinement {shares}."
        )


def _share(optimality_gap: float) -> str:
    return f"{100 * optimality_gap:.2g} %" if optimality_gap > NO_GAP else "none"


class JointPart(Part):
    """One of several records that were identified together."""

    initial_soc: Soc
    initial_soc_reason: str
    metrics: MetricsPart


class MetricsBlock(Part):
    """Errors of the refined parameters; of several records together, over all their samples."""

    identification: MetricsPart
    validation: tuple[MetricsPart, ...]


class DecisionPart(Part):
    """What was decided about a file, and why."""

    value: str
    strength: Literal["given", "strong", "weak", "assumed"]
    reason: str


class InputPart(Part):
    """One file that was read."""

    role: Literal["identification", "validation", "ocv"]
    name: str
    sha256: str
    sign: DecisionPart
    hold: DecisionPart


def read_stored(kind: type[Stored], path: Path, remedy: str) -> Stored:
    """What was stored in a file. Raises `InputError` that names what is wrong with it."""
    try:
        with path.open("rb") as file:
            content = file.read(LARGEST_FILE + 1)
        text = content.decode("utf-8")
    except (OSError, ValueError) as problem:
        reason = getattr(problem, "strerror", None) or cut(str(problem), LONGEST_REASON)
        raise InputError(f"{path}: cannot be read ({reason}); {remedy}") from problem
    if len(content) > LARGEST_FILE:
        raise InputError(f"{path}: too large for a result (over {LARGEST_FILE} bytes); {remedy}")
    try:
        _require_few_keys(text)
        return kind.model_validate_json(text)
    except ValidationError as problem:
        first = problem.errors(include_url=False, include_input=False)[0]
        place = ".".join(str(step) for step in first["loc"]) or "the file"
        reason = f"{cut(place, 200)}: {cut(first['msg'], LONGEST_REASON)}"
        raise InputError(f"{path}: is not a barnax result: {reason}; {remedy}") from problem
    except InputError as problem:
        reason = cut(str(problem), LONGEST_REASON)
        raise InputError(f"{path}: is not a barnax result: {reason}; {remedy}") from problem


def _require_few_keys(text: str) -> None:
    """Raise `InputError` where an object has more keys than any part. What is no JSON passes."""

    def look(pairs: list[tuple[str, Any]]) -> None:
        if len(pairs) > MOST_KEYS:
            raise InputError(f"a part has {len(pairs)} keys, and none has over {MOST_KEYS}")

    try:
        # Nothing is kept, and numbers are not worked out.
        json.loads(text, object_pairs_hook=look, parse_int=len, parse_float=len, parse_constant=len)
    except InputError:
        raise
    except (ValueError, RecursionError):
        return


class EstimatePart(Part):
    """One parameter, in the unit of its name.

    Without errors where it was `held`; `low` and `high` are null where the data leave them open.
    """

    value: float
    held: str | None
    standard_error: float | None
    white_noise_standard_error: float | None
    inflation: float | None
    degrees_of_freedom: float | None
    low: float | None
    high: float | None


class NoisePart(Part):
    """The noise behind the errors: parts by their correlation time, 0 for the white one."""

    correlation_s: tuple[float, ...]
    sd_v: tuple[float, ...]


class UncertaintyPart(Part):
    """Standard errors and intervals that reckon with correlated errors, beside the plain ones.

    `correlation` is that of the logarithms of the parameters in `free`.
    """

    confidence: float
    words: str
    parameters: dict[str, EstimatePart]
    free: tuple[str, ...]
    correlation: tuple[tuple[float, ...], ...]
    noise: NoisePart


class FindingPart(Part):
    """One thing that the data do not determine."""

    kind: str
    parameters: tuple[str, ...]
    text: str


class IdentifiabilityPart(Part):
    """How well the free parameters can be told apart (Brun et al., 2001)."""

    collinearity_index: float
    condition_number: float
    collinear_pairs: tuple[tuple[str, str, float], ...]
    findings: tuple[FindingPart, ...]


class BandPart(Part):
    """Errors of the samples in one band; `share` is of the summed squared error."""

    label: str
    samples: Count
    rmse_v: Volts
    mean_v: float
    share: float


class DiagnosticsPart(Part):
    """How the errors hang together and where they are large."""

    lags_s: tuple[float, ...]
    autocorrelation: tuple[float, ...]
    integrated_time_s: float
    effective_samples: float
    by_soc: tuple[BandPart, ...]
    by_current: tuple[BandPart, ...]
    by_temperature: tuple[BandPart, ...] | None
    words: str


class ProfilePart(Part):
    """The smallest RMSE for values of one parameter, the others refitted."""

    value: float
    values: tuple[float, ...]
    rmse_v: tuple[Volts, ...]
    threshold_v: Volts
    low: float | None
    high: float | None


class ResampledPart(Part):
    """One parameter over the replicates of the block bootstrap."""

    standard_error: float
    low: float
    high: float


class BootstrapPart(Part):
    """Refits to records with resampled errors."""

    block_s: float
    is_cut: bool
    replicates: Count
    converged: Count
    parameters: dict[str, ResampledPart]


class SuggestionPart(Part):
    """A change that was tried, and the error it reaches."""

    name: str
    text: str
    rmse_v: Volts
    added: Count


class ExaminationPart(Part):
    """What `--trust full` adds."""

    profiles: dict[str, ProfilePart]
    bootstrap: BootstrapPart
    suggestions: tuple[SuggestionPart, ...]
    words: str


class TrustPart(Part):
    """How far the answer can be trusted. `examination` is null unless it was asked for."""

    uncertainty: UncertaintyPart
    identifiability: IdentifiabilityPart
    diagnostics: DiagnosticsPart
    examination: ExaminationPart | None


def trust_part(assessment: Assessment, examination: Examination | None) -> TrustPart:
    """An assessment as it is stored."""
    deeper = None if examination is None else examination.to_dict()
    return TrustPart.model_validate(assessment.to_dict() | {"examination": deeper})


SCHEMA_VERSION = 1
REMEDY = "give the result.json that barnax identify wrote"


class Result(Part):
    """The whole of `result.json`. Equal runs give equal bytes: no times, dates or folders.

    `global_optimum` is None where it was not looked for, or the box is too wide for that; `trust`
    where the answer was not assessed. `jointly`
    holds every record where several were identified together; `initial_soc` is then
    that of the first, like `initial_direction`, the hysteresis' direction at the first simulated
    sample (+1 after charging), and `rest_current_a`, below which nothing turns it. Results of
    versions that did not store these two have None: `start_direction` is then the window's.

    >>> Result.from_json("missing.json")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    barnax.errors.InputError: missing.json: cannot be read (No such file or directory); ...
    """

    schema_version: Literal[1] = SCHEMA_VERSION
    model: str
    parameters: Parameters
    search: SearchPart
    refined: RefinedPart
    global_optimum: GlobalPart | None = None
    trust: TrustPart | None = None
    metrics: MetricsBlock
    cell: dict[str, Any]
    bounds: dict[str, tuple[float, float]]
    fixed: Parameters
    window: Window
    initial_soc: Soc
    initial_soc_reason: str
    initial_direction: Literal[-1, 1] | None = None
    rest_current_a: Annotated[float, Field(ge=0)] | None = None
    jointly: tuple[JointPart, ...] = ()
    inputs: tuple[InputPart, ...]
    warnings: tuple[str, ...]
    command: tuple[str, ...]
    versions: dict[str, str]

    @field_validator("model")
    @classmethod
    def _name_a_known_circuit(cls, name: str) -> str:
        return get_circuit(name).name

    @field_validator("parameters")
    @classmethod
    def _name_a_circuit(cls, values: Parameters) -> Parameters:
        return CircuitParameters.from_dict(values).to_dict()

    @model_validator(mode="after")
    def _hold_what_the_circuit_has(self) -> Self:
        wanted = get_circuit(self.model).parameter_names
        if set(self.parameters) != set(wanted):
            raise ValueError(
                f"the circuit {self.model} has the parameters {', '.join(wanted)}, not "
                f"{', '.join(self.parameters)}"
            )
        return self

    @field_validator("cell")
    @classmethod
    def _hold_a_cell(cls, cell: dict[str, Any]) -> dict[str, Any]:
        CellModel.from_dict(cell)
        return cell

    @property
    def circuit_parameters(self) -> CircuitParameters:
        return CircuitParameters.from_dict(self.parameters)

    @property
    def cell_model(self) -> CellModel:
        return CellModel.from_dict(self.cell)

    @property
    def start_direction(self) -> int:
        """+1 where the simulation starts with a charging cell's hysteresis, else -1.

        Of a result that does not store it, the window's, which is the direction before the record:
        wrong where the simulation starts later and the current has turned until then.
        """
        if self.initial_direction is None:
            return self.window.initial_direction
        return self.initial_direction

    @property
    def start_rest_current_a(self) -> float:
        """The current in A below which a hysteresis keeps its direction.

        Of a result that does not store it, the given one or C/100, its least.
        """
        if self.rest_current_a is not None:
            return self.rest_current_a
        return self.window.rest_current_a or self.cell_model.capacity_ah / 100

    def to_dict(self) -> dict[str, Any]:
        """The file's content as plain Python values, units in the keys."""
        return self.model_dump(mode="json", by_alias=True)

    def to_json(self) -> str:
        return self.model_dump_json(by_alias=True, indent=1) + "\n"

    @classmethod
    def from_json(cls, path: str | Path) -> "Result":
        """The result in a file. Raises `InputError` that names what is wrong with it."""
        return read_stored(cls, Path(path), REMEDY)


VERSIONED = ("barnax", "jax", "jaxlib", "numpy", "optimistix", "equinox", "scipy", "polars")
# An answer further above the global optimum than this is warned about.
NOTABLE_GAP = 1e-3


def make_result(
    refinement: Refinement,
    identification: Sequence[Evaluation],
    validation: Sequence[Evaluation] = (),
    *,
    optimum: GlobalOptimum | None = None,
    assessment: Assessment | None = None,
    examination: Examination | None = None,
    ocv: Sequence[Record] = (),
    command: Sequence[str] = (),
) -> Result:
    """Everything an identification found, as one value that can be stored.

    `identification` has an evaluation for every record the circuit was identified on, `ocv` the
    records the cell was characterized from; `optimum` is the problem's global one, `assessment` and
    `examination` say how far the answer can be trusted, `command` what was run.
    """
    found, problem = refinement.search, refinement.search.problem
    method, settings = describe(found.optimizer)
    records = [("identification", prepared.record) for prepared in problem.prepared_records]
    records += [("validation", each.prepared.record) for each in validation]
    records += [("ocv", record) for record in ocv]
    return Result(
        model=problem.circuit,
        parameters=refinement.parameters.to_dict(),
        search=SearchPart(
            method=method,
            settings=settings,
            coordinates=problem.scale,
            objective=problem.kind,
            population=found.optimizer.population,
            iterations=found.optimizer.iterations,
            key=found.key,
            evaluations=found.evaluations,
            seeds=tuple(
                SeedPart(
                    rmse_v=seed.rmse_v,
                    parameters=seed.parameters.to_dict(),
                    evaluations=seed.evaluations,
                    failures=seed.failures,
                    history_v=tuple(seed.history_v.tolist()),
                )
                for seed in found.seeds
            ),
        ),
        refined=RefinedPart(
            rmse_v=refinement.rmse_v,
            objective=refinement.objective,
            evaluations=refinement.evaluations,
            at_bound=refinement.at_bound,
            optima=tuple(_optimum_part(each) for each in refinement.optima),
            moved=tuple(seed.moved for seed in refinement.refined),
            converged=tuple(seed.has_converged for seed in refinement.refined),
            verdict=refinement.verdict,
        ),
        global_optimum=None if optimum is None else global_part(refinement, optimum),
        trust=None if assessment is None else trust_part(assessment, examination),
        metrics=MetricsBlock(
            identification=joint_metrics(problem.name, identification),
            validation=tuple(metrics_part(each) for each in validation),
        ),
        cell=problem.cell.to_dict(),
        bounds=dict(problem.bounds.ranges),
        fixed=dict(problem.bounds.fixed),
        window=problem.window,
        initial_soc=problem.prepared.initial_soc,
        initial_soc_reason=problem.prepared.initial_soc_reason,
        initial_direction=1 if problem.prepared.direction[0] > 0 else -1,
        rest_current_a=float(problem.prepared.rest_current_a),
        jointly=tuple(
            JointPart(
                initial_soc=each.prepared.initial_soc,
                initial_soc_reason=each.prepared.initial_soc_reason,
                metrics=metrics_part(each),
            )
            for each in identification
            if len(identification) > 1
        ),
        inputs=tuple(input_part(role, record) for role, record in records),
        warnings=all_warnings(refinement, optimum, identification, validation, ocv),
        command=tuple(command),
        versions=all_versions(),
    )


def global_part(refinement: Refinement, optimum: GlobalOptimum) -> GlobalPart:
    """The global optimum as it is stored, with the regret of every answer."""
    optimality_gaps = [
        optimality_gap(seed.rmse_v, optimum.rmse_v) for seed in refinement.search.seeds
    ]
    return GlobalPart(
        rmse_v=optimum.rmse_v,
        parameters=optimum.parameters.to_dict(),
        status=optimum.status,
        lower_bound_v=optimum.lower_bound_v,
        local_optima=tuple(_optimum_part(each) for each in optimum.local_optima),
        at_bound=optimum.at_bound,
        median_gap=float(np.median(optimality_gaps)),
        best_gap=min(optimality_gaps),
        refined_gap=optimality_gap(refinement.rmse_v, optimum.rmse_v),
        verdict=optimum.verdict,
    )


def _optimum_part(optimum: Optimum) -> OptimumPart:
    return OptimumPart(
        rmse_v=optimum.rmse_v,
        parameters=optimum.parameters.to_dict(),
        seeds=optimum.seeds,
        is_family=optimum.is_family,
    )


def joint_metrics(name: str, evaluations: Sequence[Evaluation]) -> MetricsPart:
    """The metrics of several records together, under one name."""
    return MetricsPart(record=name, **asdict(pooled(evaluations)))


def metrics_part(evaluation: Evaluation) -> MetricsPart:
    """The metrics of one record under its name."""
    metrics: Metrics = evaluation.metrics
    return MetricsPart(record=evaluation.prepared.record.name, **asdict(metrics))


def describe(optimizer: AbstractPopulationMinimiser) -> tuple[str, dict[str, Any]]:
    """An optimizer's registered name, or its class's, and its settings."""
    settings = {
        field.name: getattr(optimizer, field.name)
        for field in fields(optimizer)
        if isinstance(getattr(optimizer, field.name), bool | int | float | str)
    }
    budget = {"population": optimizer.population, "iterations": optimizer.iterations}
    for name, make in OPTIMIZERS.items():
        if make(**budget) == optimizer:
            return name, settings
    return type(optimizer).__name__, settings


def all_warnings(
    refinement: Refinement,
    optimum: GlobalOptimum | None,
    identification: Sequence[Evaluation],
    validation: Sequence[Evaluation],
    ocv: Sequence[Record],
) -> tuple[str, ...]:
    """Every warning of a run once, in the order of the flow."""
    problem = refinement.search.problem
    texts = [*(text for record in ocv for text in record.warnings), *problem.warnings]
    texts += [
        f"{each.prepared.record.name}: the circuit does worse than a constant voltage would (R2 "
        f"{each.metrics.r2:.3g}); look for a wrong sign or unit with barnax check, and at what "
        "--fix and --bounds hold"
        for each in identification
        if each.metrics.r2 < 0
    ]
    for each in validation:
        texts += [*each.prepared.record.warnings, *each.prepared.warnings]
    excess = 0.0 if optimum is None else optimality_gap(refinement.rmse_v, optimum.rmse_v)
    if excess > NOTABLE_GAP:
        other = "another --method" if problem.scale == "log" else "--coordinates log"
        texts.append(
            f"the answer's RMSE is {100 * excess:.2g} % above the global optimum's; search with "
            f"more --seeds or with {other}"
        )
    return tuple(dict.fromkeys(texts))


def all_versions() -> dict[str, str]:
    """The versions that can change a result's digits."""
    return {"python": sys.version.split()[0]} | {name: version(name) for name in VERSIONED}


def input_part(role: Any, record: Record) -> InputPart:
    """A file that was read, with what was decided about it."""
    return InputPart(
        role=role,
        name=record.name,
        sha256=record.sha256,
        sign=DecisionPart(**asdict(record.sign)),
        hold=DecisionPart(**asdict(record.hold)),
    )

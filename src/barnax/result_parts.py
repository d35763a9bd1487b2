"""The parts of `result.json`: what each holds, and under which keys."""

import json
import math
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    PlainSerializer,
    ValidationError,
)

from .errors import InputError
from .problem import Kind
from .records.limits import cut

Stored = TypeVar("Stored", bound=BaseModel)

# A smaller regret is rounding.
NO_REGRET = 1e-7
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
    median_regret: float
    best_regret: float
    refined_regret: float
    verdict: str

    @property
    def words(self) -> str:
        """What the optimum is, how sure that is, and how far the answers are from it."""
        before = {"best seed": self.best_regret, "median seed": self.median_regret}
        shares = ", ".join(f"{name} {_share(regret)}" for name, regret in before.items())
        return (
            f"{self.verdict} Regret, the RMSE above that: refined {_share(self.refined_regret)}; "
            f"before refinement {shares}."
        )


def _share(regret: float) -> str:
    return f"{100 * regret:.2g} %" if regret > NO_REGRET else "none"


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

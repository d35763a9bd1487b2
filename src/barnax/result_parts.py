"""The parts of `result.json`: what each holds, and under which keys."""

import math
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    ValidationError,
)

from .errors import InputError
from .problem import Kind

Stored = TypeVar("Stored", bound=BaseModel)

# A smaller regret is rounding.
NO_REGRET = 1e-7
LARGEST_FILE = 200_000_000

Volts = Annotated[float, Field(ge=0)]
# An error that may be infinite, where nothing could be simulated; JSON has null for that.
Loss = Annotated[
    float,
    Field(ge=0, allow_inf_nan=True),
    BeforeValidator(lambda value: math.inf if value is None else value),
    PlainSerializer(lambda value: None if math.isinf(value) else value, when_used="json"),
]
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


class Part(BaseModel):
    """A part of the file: immutable, nothing unknown, nothing infinite."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        allow_inf_nan=False,
        alias_generator=lambda name: KEYS.get(name, name),
        populate_by_name=True,
    )


class SeedPart(Part):
    """One seed of the search, before refinement."""

    rmse_v: Loss
    parameters: Parameters
    evaluations: int
    failures: int
    history_v: tuple[Loss, ...]


class SearchPart(Part):
    """The search as it was set up, and what each seed found."""

    method: str
    settings: dict[str, Any]
    coordinates: Literal["rc", "log"]
    objective: Kind
    population: int
    iterations: int
    key: int
    evaluations: int
    seeds: tuple[SeedPart, ...] = Field(min_length=1)


class OptimumPart(Part):
    """A distinct place where refined seeds ended."""

    rmse_v: Volts
    parameters: Parameters
    seeds: int
    is_family: bool


class RefinedPart(Part):
    """The Levenberg-Marquardt cross-check.

    `moved` is each seed's largest relative change, `converged` whether it stood still at the end.
    `objective` says how it computed errors on its way; `rmse_v` is the scan's. `evaluations`
    counts simulations, a Jacobian as one per free parameter.
    """

    rmse_v: Volts
    objective: Kind
    evaluations: int
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
    samples: int


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

    initial_soc: float
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
        if path.stat().st_size > LARGEST_FILE:
            raise InputError(f"{path}: too large for a result ({path.stat().st_size} bytes)")
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as problem:
        reason = getattr(problem, "strerror", None) or problem
        raise InputError(f"{path}: cannot be read ({reason}); {remedy}") from problem
    try:
        return kind.model_validate_json(text)
    except ValidationError as problem:
        first = problem.errors()[0]
        place = ".".join(str(step) for step in first["loc"]) or "the file"
        raise InputError(
            f"{path}: is not a barnax result: {place}: {first['msg']}; {remedy}"
        ) from problem
    except InputError as problem:
        raise InputError(f"{path}: is not a barnax result: {problem}; {remedy}") from problem

"""`comparison.json`: what a comparison found."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Self

import numpy as np
from jaxtyping import Float
from pydantic import model_validator

from ..baselines import Answer, Budget
from ..cell import CellModel
from ..display import Brief
from ..global_optimum.search import GlobalOptimum
from ..model.search_space import Kind, Scale
from ..result_parts import Candidate, InputPart, MetricsPart
from ..schema import Document, NoticeField, Parameters, Part, Unstored
from ..search.answers import AtBound, RefinedSeed
from ..search.evaluate import Evaluation
from .statistics import BandError, Resampled, SeedPairs, errors_by_soc


@dataclass(frozen=True)
class RecordErrors:
    """Errors of a row's own answer on one record, in all and by SOC."""

    metrics: MetricsPart
    bands: tuple[BandError, ...]

    @classmethod
    def of(cls, evaluation: Evaluation) -> Self:
        """The errors of an evaluation."""
        prepared = evaluation.prepared
        bands = errors_by_soc(evaluation.error_v, prepared.soc, prepared.scored)
        return cls(MetricsPart.of(evaluation), bands)


@dataclass(frozen=True, eq=False, repr=False)
class Row(Brief):
    """One method on one model. Everything but `refined` is of the method's own answers.

    Attributes:
        model: Name of the circuit.
        method: One of `METHODS`.
        source: Where the method comes from.
        is_deterministic: True for a method that draws nothing.
        answers: One a seed, a single one where the method draws nothing, and none where it failed.
        failure: Why there is no answer.
        errors: Those of the median seed on the identification record, then on each validation
            record.
        at_bound: Its parameters that are at an end of the box.
        refined: What Levenberg-Marquardt makes of it.
        optimality_gap: Its RMSE over the global optimum's, minus one.
        problem: What was identified; None of a stored row.
        evaluations: What `errors` are of; none likewise.
    """

    model: str
    method: str
    source: str
    is_deterministic: bool
    answers: tuple[Answer, ...] = ()
    failure: str | None = None
    errors: tuple[RecordErrors, ...] = ()
    at_bound: tuple[AtBound, ...] = ()
    refined: RefinedSeed | None = None
    optimality_gap: float | None = None
    problem: Unstored[Any] = None
    evaluations: Unstored[tuple[Evaluation, ...]] = ()

    @property
    def name(self) -> str:
        return f"{self.method} {self.model}"

    @property
    def median(self) -> Answer:
        """The seed whose RMSE is the median; of an even number, the better of the middle two."""
        ranked = sorted(self.answers, key=lambda answer: answer.rmse_v)
        return ranked[(len(ranked) - 1) // 2]

    @property
    def errors_v(self) -> Float[np.ndarray, "seeds"]:
        """RMSE of every seed, in V, in the order of the seeds."""
        return np.array([answer.rmse_v for answer in self.answers])

    @property
    def spread_v(self) -> tuple[float, float, float] | None:
        """The best and the worst RMSE of the seeds and their standard deviation, in V; None of a
        method that draws nothing. A seed that failed altogether is infinitely far away."""
        if self.is_deterministic:
            return None
        errors_v = self.errors_v
        deviation_v = 0.0 if len(errors_v) == 1 else math.inf
        if len(errors_v) > 1 and np.isfinite(errors_v).all():
            deviation_v = float(np.std(errors_v, ddof=1))
        return float(errors_v.min()), float(errors_v.max()), deviation_v


@dataclass(frozen=True)
class Difference:
    """The error of one row minus another's, on one record, and whether it is more than chance.

    `first` and `second` are row names. `over_time` resamples blocks of samples; `over_seeds`
    pairs the seeds on the identification record, and is None elsewhere and where neither row
    draws anything.
    """

    first: str
    second: str
    record: str
    is_validation: bool
    over_time: Resampled
    over_seeds: SeedPairs | None


class ModelPart(Part):
    """The search box of one model, and its global optimum where that is known."""

    bounds: dict[str, tuple[float, float]]
    fixed: Parameters
    optimum: GlobalOptimum | None = None


class ComparisonResult(Document):
    """The contents of `comparison.json`. Equal runs give equal bytes: no times, dates or folders.

    Times are in `timings.json`; reports take them separately, in s by the name of the row.

    Attributes:
        schema_version: Version of the schema.
        rows: One method on one model each.
        differences: Differences between rows, and their significance.
        candidates: The usual circuits, each the best of its kind, and tables over SOC.
        models: Box and global optimum of each model.
        budget: What every method could spend.
        coordinates: Search coordinates: "rc", or logarithms of R and tau.
        objective: How errors were computed: by "scan" or "compressed".
        cell: OCV, hysteresis voltage and capacity.
        inputs: Every file, with its digest and what was decided about it.
        warnings: What is doubtful, with what to do.
        versions: Versions of barnax and of what it computes with.
    """

    schema_version: Literal[7] = 7
    rows: tuple[Row, ...]
    differences: tuple[Difference, ...]
    candidates: tuple[Candidate, ...] = ()
    models: dict[str, ModelPart]
    budget: Budget
    coordinates: Scale
    objective: Kind
    cell: CellModel
    inputs: tuple[InputPart, ...]
    warnings: tuple[NoticeField, ...]
    versions: dict[str, str]

    @model_validator(mode="after")
    def _be_whole(self) -> Self:
        for row in self.answered:
            if not row.answers or len(row.errors) != len(self.answered[0].errors):
                raise ValueError(f"{row.name} lacks answers, or errors on some record")
        if unknown := {row.model for row in self.rows} - self.models.keys():
            raise ValueError(f"there is no box of {', '.join(sorted(unknown))}")
        return self

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ComparisonResult) and self.to_json() == other.to_json()

    @property
    def answered(self) -> tuple[Row, ...]:
        """The rows that have an answer."""
        return tuple(row for row in self.rows if row.failure is None)

    what: ClassVar[str] = "barnax comparison"
    remedy: ClassVar[str] = "give the comparison.json that barnax compare wrote"

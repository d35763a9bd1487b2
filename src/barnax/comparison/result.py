"""`comparison.json`: the results of a comparison, errors by state of charge, and whether a
difference between two rows is more than chance."""

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Self

import numpy as np
from jaxtyping import Float
from pydantic import model_validator
from scipy import stats

from ..baselines import Answer, Budget
from ..cell import CellModel
from ..display import Brief
from ..global_optimum.search import GlobalOptimum
from ..metrics import CONFIDENCE, Metrics
from ..model.search_space import Kind, Scale
from ..result_parts import Candidate, InputPart
from ..schema import Document, NoticeField, Parameters, Part, Unstored
from ..search.answers import SAME_RMSE, AtBound, RefinedSeed
from ..search.evaluate import Evaluation
from ..uncertainty.assessment import Band, soc_bands
from .bootstrap import block_length, resampled_means

Samples = Float[np.ndarray, "samples"]

# Edges of bands of SOC: the paper's own errors are below 0.2.
SOC_EDGES = np.array([0.0, 0.1, 0.2, 1.0])


@dataclass(frozen=True)
class Resampled:
    """Two rows' errors over time, with 95 % intervals of a moving-block bootstrap.

    `difference_v2` is the mean of the first row's squared errors minus the second's; `difference_v`
    the same as a difference of RMSE. Negative: the first row is better. If `is_block_capped`, the
    errors' autocorrelation outlasts the longest block that the rule allows, and the intervals are
    too narrow. `is_real` is True if the interval excludes zero, and the two RMSE differ by more
    than `SAME_RMSE`.
    """

    difference_v2: float
    interval_v2: tuple[float, float]
    difference_v: float
    interval_v: tuple[float, float]
    block_samples: int
    is_block_capped: bool
    is_real: bool


@dataclass(frozen=True)
class SeedPairs:
    """Two rows' RMSE paired seed by seed, in V; negative: the first row is better.

    `wins` counts the seeds with the first row better by more than `SAME_RMSE`, `losses` those with
    the second better. `p_value` is that of Wilcoxon's signed-rank test (Biometrics Bulletin 1
    (1945) 80), two-sided; 1 if no seed differs.
    """

    median_v: float
    wins: int
    losses: int
    p_value: float


def compare_over_time(first_error_v: Samples, second_error_v: Samples, seed: int = 0) -> Resampled:
    """Two rows' errors at the same samples, resampled in blocks (Kuensch, Ann. Stat. 17 (1989)
    1217).

    The block length is the one for the difference of their squared errors; `seed` is the random
    seed of the resampling. The interval is that of the percentiles.
    """
    squares = np.stack([first_error_v**2, second_error_v**2])
    length, is_capped = block_length(squares[0] - squares[1])
    means = resampled_means(squares, length, np.random.default_rng(seed))
    tail = 100 * (1 - CONFIDENCE) / 2
    mean = np.mean(squares, axis=1)
    first_v, second_v = np.sqrt(mean)
    ends = [tail, 100 - tail]
    low_v2, high_v2 = np.percentile(means[0] - means[1], ends).tolist()
    low_v, high_v = np.percentile(np.sqrt(means[0]) - np.sqrt(means[1]), ends).tolist()
    return Resampled(
        difference_v2=float(mean[0] - mean[1]),
        interval_v2=(low_v2, high_v2),
        difference_v=float(first_v - second_v),
        interval_v=(low_v, high_v),
        block_samples=length,
        is_block_capped=is_capped,
        is_real=bool((low_v2 > 0 or high_v2 < 0) and _differ(first_v, second_v)),
    )


def compare_over_seeds(
    first_v: Float[np.ndarray, "..."], second_v: Float[np.ndarray, "..."]
) -> SeedPairs | None:
    """Two rows' RMSE in V, seed by seed; a single value is paired with every seed.

    None if neither row has seeds to pair, or their numbers differ.

    >>> compare_over_seeds(np.array([1.0, 2.0]), np.array([3.0])).wins
    2
    """
    sizes = {len(first_v), len(second_v)} - {1}
    if len(sizes) != 1:
        return None
    difference_v = first_v - second_v
    is_different = _differ(first_v, second_v)
    p_value = 1.0
    if np.any(is_different):
        tested: Any = stats.wilcoxon(difference_v[is_different])
        p_value = tested.pvalue
    return SeedPairs(
        median_v=float(np.median(difference_v)),
        wins=int(np.count_nonzero(is_different & (difference_v < 0))),
        losses=int(np.count_nonzero(is_different & (difference_v > 0))),
        p_value=float(p_value),
    )


def _differ(
    first_v: Float[np.ndarray, "..."] | float, second_v: Float[np.ndarray, "..."] | float
) -> Any:
    """True where two RMSE differ, apart from rounding and unfinished descents."""
    return np.abs(first_v - second_v) > SAME_RMSE * np.minimum(first_v, second_v)


@dataclass(frozen=True)
class RecordErrors:
    """Errors of a row's answer on one record, overall and by SOC."""

    metrics: Metrics
    bands: tuple[Band, ...]

    @classmethod
    def of(cls, evaluation: Evaluation) -> Self:
        """The errors of an evaluation."""
        scored = evaluation.prepared.scored
        soc, error_v = evaluation.prepared.soc[scored], evaluation.error_v[scored]
        return cls(evaluation.metrics, soc_bands(soc, error_v, SOC_EDGES))


@dataclass(frozen=True, eq=False, repr=False)
class Row(Brief):
    """One method on one model. Everything except `refined` refers to the method's own answers.

    Attributes:
        model: Name of the circuit.
        method: One of `METHODS`.
        source: Source of the method.
        is_deterministic: True for a method that draws nothing.
        answers: One per seed, a single one if the method draws nothing, and none if it failed.
        failure: Reason why there is no answer.
        errors: Errors of the median seed on the identification record, then on each validation
            record.
        at_bound: Its parameters that are at an end of the box.
        refined: Its refinement by Levenberg-Marquardt.
        optimality_gap: Its RMSE over the global optimum's, minus one.
        problem: The problem; None for a stored row.
        evaluations: Evaluations behind `errors`; None for a stored row.
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
        """The seed whose RMSE is the median; for an even number, the better of the middle two."""
        ranked = sorted(self.answers, key=lambda answer: answer.rmse_v)
        return ranked[(len(ranked) - 1) // 2]

    @property
    def errors_v(self) -> Float[np.ndarray, "seeds"]:
        """RMSE of every seed, in V, in the order of the seeds."""
        return np.array([answer.rmse_v for answer in self.answers])

    @property
    def spread_v(self) -> tuple[float, float, float] | None:
        """The best and the worst RMSE of the seeds and their standard deviation, in V; None for a
        method that draws nothing. A failed seed counts as infinite."""
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

    `first` and `second` are row names. `over_time` resamples blocks of samples; `over_seeds` pairs
    the seeds on the identification record, and is None on other records and if neither row draws
    anything.
    """

    first: str
    second: str
    record: str
    is_validation: bool
    over_time: Resampled
    over_seeds: SeedPairs | None


class ModelPart(Part):
    """The search box of one model, and its global optimum if that is known."""

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
        budget: The budget of every method.
        coordinates: Search coordinates: "rc", or logarithms of R and tau.
        objective: How errors were computed: by "scan" or "compressed".
        cell: OCV, hysteresis voltage and capacity.
        inputs: Every file, with its digest and the decisions about it.
        warnings: Doubtful results, each with a remedy.
        versions: Versions of barnax and of its numerical packages.
    """

    schema_version: Literal[8] = 8
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

"""The parts of `comparison.json`: what each holds, and under which keys."""

from typing import Literal

from pydantic import ConfigDict

from ..result_parts import KEYS, Count, Key, Loss, MetricsPart, Parameters, Part, Volts

# Keys with units, by the field's name, beyond those of `result.json`.
OWN_KEYS = {
    "best_rmse_v": "best rmse [V]",
    "worst_rmse_v": "worst rmse [V]",
    "deviation_v": "standard deviation [V]",
    "refined_rmse_v": "refined rmse [V]",
    "optimum_rmse_v": "optimum rmse [V]",
    "mean_v": "mean [V]",
    "difference_v": "rmse difference [V]",
    "interval_v": "rmse difference interval [V]",
    "difference_v2": "squared error difference [V^2]",
    "interval_v2": "squared error difference interval [V^2]",
    "median_v": "median rmse difference [V]",
    "low_soc": "from SOC",
    "high_soc": "to SOC",
}


class ComparisonPart(Part):
    """A part of the file, with the keys of a comparison."""

    model_config = ConfigDict(
        alias_generator=lambda name: {**KEYS, **OWN_KEYS}.get(name, name),
    )


class SeedAnswerPart(ComparisonPart):
    """One seed's own answer."""

    rmse_v: Loss
    parameters: Parameters
    evaluations: Count
    history_v: tuple[Loss, ...] | None


class SpreadPart(ComparisonPart):
    """How the seeds of one row differ."""

    best_rmse_v: Volts
    worst_rmse_v: Loss
    deviation_v: Loss


class BandPart(ComparisonPart):
    """Errors in one band of SOC; None where it holds no sample."""

    low_soc: float
    high_soc: float
    samples: Count
    rmse_v: Volts | None
    mean_v: float | None
    max_v: Volts | None


class RecordErrorsPart(ComparisonPart):
    """Errors of a row's own answer on one record, in all and by SOC."""

    metrics: MetricsPart
    bands: tuple[BandPart, ...]


class RowPart(ComparisonPart):
    """One method on one model: its own answer is the median seed's, unrefined.

    `failure` says why there is no answer; then all that follows it is empty or None.
    `spread` is None for a method that draws nothing. `evaluations` are the median seed's, and
    `at_bound` names which of its parameters are at an end of the box. `regret` is the RMSE over
    the global optimum's, minus one. `source` says where the method comes from.
    """

    model: str
    method: str
    source: str
    is_deterministic: bool
    failure: str | None = None
    notes: tuple[str, ...] = ()
    parameters: Parameters | None = None
    time_constants: Parameters | None = None
    evaluations: Count | None = None
    at_bound: tuple[str, ...] = ()
    spread: SpreadPart | None = None
    identification: RecordErrorsPart | None = None
    validation: tuple[RecordErrorsPart, ...] = ()
    refined_rmse_v: Volts | None = None
    refined_parameters: Parameters | None = None
    regret: float | None = None
    seeds: tuple[SeedAnswerPart, ...] = ()

    @property
    def name(self) -> str:
        return f"{self.method} {self.model}"


class OverTimePart(ComparisonPart):
    """Moving-block bootstrap over time: 95 % intervals, negative where the first row is better.

    Where `is_block_capped` the errors stay alike for longer than the blocks may be, and the
    intervals are narrower than they should be.
    """

    difference_v2: float
    interval_v2: tuple[float, float]
    difference_v: float
    interval_v: tuple[float, float]
    block_samples: Count
    is_block_capped: bool
    is_real: bool


class OverSeedsPart(ComparisonPart):
    """The rows' seeds in pairs; `p_value` is of Wilcoxon's signed-rank test."""

    median_v: float
    wins: Count
    losses: Count
    p_value: float


class DifferencePart(ComparisonPart):
    """One row's error minus another's on one record; rows by name, such as `bmo so-rc`."""

    first: str
    second: str
    record: str
    is_validation: bool
    over_time: OverTimePart
    over_seeds: OverSeedsPart | None


class ModelPart(ComparisonPart):
    """The search box of one model, and its global optimum where that is known.

    `optimum_status` says whether it is proved ("certified") or found on a grid, `optimum_verdict`
    the same in sentences.
    """

    bounds: dict[str, tuple[float, float]]
    fixed: Parameters
    optimum_rmse_v: Volts | None = None
    optimum_parameters: Parameters | None = None
    optimum_status: Literal["certified", "grid-verified"] | None = None
    optimum_verdict: str | None = None


class BudgetPart(ComparisonPart):
    """What every method could spend: `evaluations` a seed."""

    population: Count
    iterations: Count
    seeds: Count
    key: Key
    evaluations: Count
    coordinates: Literal["rc", "log"]
    objective: Literal["scan", "compressed"]

"""`comparison.json`: what a comparison found, and from files to it."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, ClassVar, Literal, Self

import numpy as np
from pydantic import ConfigDict

from ..baselines import METHODS, Budget
from ..cell import CellModel, OcvTable
from ..errors import InputError
from ..global_optimum.search import GlobalOptimum
from ..identification import search_and_assess
from ..inputs import listed, read_inputs, unwatched, windows_of
from ..job import Job, takes_options
from ..model.problem import Problem
from ..model.search_space import ranges_of
from ..notices import Notice
from ..records import Record
from ..result_parts import Candidate, InputPart, MetricsPart, all_versions
from ..run_setup import first_problem, set_up
from ..schema import Count, Document, Key, Loss, Parameters, Part, Told, Volts, key_of
from ..search.evaluate import Evaluation
from ..search.refine import AtBound
from ..settings import TableOptions
from .run import PAPER_ROWS, Comparison, Difference, Row, compare
from .statistics import BandError, errors_by_soc

# Options of one circuit, or of its tables.
_OF_ONE = {*vars(TableOptions()), *("model", "method", "over", "trust", "cell", "tables")}
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

    model_config = ConfigDict(alias_generator=lambda name: OWN_KEYS.get(name) or key_of(name))


class SeedAnswerPart(ComparisonPart):
    """One seed's own answer."""

    rmse_v: Loss
    parameters: Parameters
    evaluations: Count
    history_v: tuple[Loss, ...] | None


class SpreadPart(ComparisonPart):
    """The spread of the seeds of one row."""

    best_rmse_v: Volts
    worst_rmse_v: Loss
    deviation_v: Loss


class RecordErrorsPart(ComparisonPart):
    """Errors of a row's own answer on one record, in all and by SOC."""

    metrics: MetricsPart
    bands: tuple[BandError, ...]

    @classmethod
    def of(cls, evaluation: Evaluation) -> Self:
        """The errors of an evaluation."""
        prepared = evaluation.prepared
        bands = errors_by_soc(evaluation.error_v, prepared.soc, prepared.scored)
        return cls(metrics=MetricsPart.of(evaluation), bands=bands)


class RowPart(ComparisonPart):
    """One method on one model: its own answer is the median seed's, unrefined.

    `failure` says why there is no answer; then all that follows it is empty or None.
    `spread` is None for a method that draws nothing. `evaluations` are the median seed's, and
    `at_bound` names which of its parameters are at an end of the box. `optimality_gap` is the
    RMSE over the global optimum's, minus one. `source` says where the method comes from.
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
    at_bound: tuple[AtBound, ...] = ()
    spread: SpreadPart | None = None
    identification: RecordErrorsPart | None = None
    validation: tuple[RecordErrorsPart, ...] = ()
    refined_rmse_v: Volts | None = None
    refined_parameters: Parameters | None = None
    optimality_gap: float | None = None
    seeds: tuple[SeedAnswerPart, ...] = ()

    @property
    def name(self) -> str:
        return f"{self.method} {self.model}"


class ModelPart(ComparisonPart):
    """The search box of one model, and its global optimum where that is known.

    `optimum_status` says whether it is proved ("certified") or the best of a grid.
    """

    bounds: dict[str, tuple[float, float]]
    fixed: Parameters
    optimum_rmse_v: Volts | None = None
    optimum_parameters: Parameters | None = None
    optimum_status: Literal["certified", "grid-verified"] | None = None
    optimum_proved_gap: float | None = None


class BudgetPart(ComparisonPart):
    """The budget of every method: `evaluations` a seed."""

    population: Count
    iterations: Count
    seeds: Count
    key: Key
    evaluations: Count
    coordinates: Literal["rc", "log"]
    objective: Literal["scan", "compressed"]


SCHEMA_VERSION = 5


class ComparisonResult(Document, ComparisonPart):
    """The contents of `comparison.json`. Equal runs give equal bytes: no times, dates or folders.

    Times are in `timings.json`; reports take them separately, in s by the name of the row.

    Attributes:
        schema_version: Version of the schema.
        rows: One method on one model each.
        differences: Differences between rows, and their significance.
        candidates: The usual circuits, each the best of its kind, and tables over SOC.
        models: Box and global optimum of each model.
        budget: What every method could spend.
        cell: OCV, hysteresis voltage and capacity.
        inputs: Every file, with its digest and what was decided about it.
        warnings: What is doubtful, with what to do.
        versions: Versions of barnax and of what it computes with.
    """

    schema_version: Literal[5] = SCHEMA_VERSION
    rows: tuple[RowPart, ...]
    differences: tuple[Difference, ...]
    candidates: tuple[Candidate, ...] = ()
    models: dict[str, ModelPart]
    budget: BudgetPart
    cell: CellModel
    inputs: tuple[InputPart, ...]
    warnings: tuple[Told, ...]
    versions: dict[str, str]

    @property
    def cell_model(self) -> CellModel:
        return self.cell

    what: ClassVar[str] = "barnax comparison"
    remedy: ClassVar[str] = "give the comparison.json that barnax compare wrote"


def make_comparison_result(
    comparison: Comparison,
    candidates: Sequence[Candidate] = (),
    *,
    ocv: Sequence[Record | OcvTable] = (),
    warnings: Sequence[Notice] = (),
) -> ComparisonResult:
    """A comparison as a `ComparisonResult`, which can be stored.

    Args:
        comparison: A comparison from `compare`.
        candidates: The circuit that held-out blocks choose, and a constant one.
        ocv: The OCV tests of the cell.
        warnings: Those of the inputs.
    """
    problems = {row.model: row.problem for row in comparison.rows}
    first, budget = next(iter(problems.values())), comparison.budget
    inputs = [InputPart.of("identification", first.prepared.record)]
    if comparison.answered:
        own, *others = comparison.answered[0].evaluations
        inputs = [InputPart.simulated("identification", own)]
        inputs += [InputPart.simulated("validation", record) for record in others]
    inputs += [InputPart.of("ocv", test) for test in ocv]
    told = [warning for test in ocv for warning in test.warnings] + list(warnings)
    told += [warning for problem in problems.values() for warning in problem.warnings]
    for tried in (evaluation for row in comparison.rows for evaluation in row.evaluations):
        told += [*tried.prepared.record.warnings, *tried.prepared.warnings]
    return ComparisonResult(
        rows=tuple(_row_part(row) for row in comparison.rows),
        differences=comparison.differences,
        candidates=tuple(candidates),
        models={
            model: _model_part(problem, comparison.optima.get(model))
            for model, problem in problems.items()
        },
        budget=BudgetPart(
            **asdict(budget),
            evaluations=budget.evaluations,
            coordinates=first.scale,
            objective=first.kind,
        ),
        cell=first.cell,
        inputs=tuple(inputs),
        warnings=tuple(dict.fromkeys(told)),
        versions=all_versions(),
    )


def _model_part(problem: Problem, optimum: GlobalOptimum | None) -> ModelPart:
    known: dict[str, Any] = (
        {}
        if optimum is None
        else {
            "optimum_rmse_v": optimum.rmse_v,
            "optimum_parameters": optimum.parameters.to_dict(),
            "optimum_status": optimum.status,
            "optimum_proved_gap": optimum.proved_gap,
        }
    )
    box = problem.bounds
    return ModelPart(bounds=dict(box.ranges), fixed=dict(box.fixed), **known or {})


def _row_part(row: Row) -> RowPart:
    method = METHODS[row.method]
    known: dict[str, Any] = {
        "model": row.model,
        "method": row.method,
        "source": method.source,
        "is_deterministic": method.is_deterministic,
    }
    if row.failure is not None:
        return RowPart(**known, failure=row.failure)
    identification, *validation = map(RecordErrorsPart.of, row.evaluations)
    return RowPart(
        **known,
        notes=row.median.notes,
        parameters=row.median.parameters.to_dict(),
        time_constants=row.median.parameters.named_tau_s,
        evaluations=row.median.evaluations,
        at_bound=row.at_bound,
        spread=None if method.is_deterministic else _spread_part(row.errors_v),
        identification=identification,
        validation=tuple(validation),
        refined_rmse_v=row.refined.rmse_v if row.refined else None,
        refined_parameters=row.refined.parameters.to_dict() if row.refined else None,
        optimality_gap=row.optimality_gap,
        seeds=tuple(
            SeedAnswerPart(
                rmse_v=answer.rmse_v,
                parameters=answer.parameters.to_dict(),
                evaluations=answer.evaluations,
                history_v=None if answer.history_v is None else tuple(answer.history_v.tolist()),
            )
            for answer in row.answers
        ),
    )


def _spread_part(errors_v: np.ndarray) -> SpreadPart:
    """The spread of the seeds; one that failed altogether is infinitely far away."""
    deviation_v = 0.0 if len(errors_v) == 1 else math.inf
    if len(errors_v) > 1 and np.isfinite(errors_v).all():
        deviation_v = float(np.std(errors_v, ddof=1))
    best_v, worst_v = float(errors_v.min()), float(errors_v.max())
    return SpreadPart(best_rmse_v=best_v, worst_rmse_v=worst_v, deviation_v=deviation_v)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ComparisonJob(Job):
    """A job whose circuits and methods are `rows`."""

    rows: Sequence[tuple[str, str]] = PAPER_ROWS

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in self.chosen.keys() & _OF_ONE:
            raise InputError(f"`{name}` is of one circuit; a comparison has `models` and `methods`")


@takes_options(ComparisonJob)
def compare_files(job: ComparisonJob) -> tuple[Comparison, ComparisonResult]:
    """Models and methods compared on one record, as objects and as a result that can be stored.

    All other options are those of `identify`, but for what is of one circuit: `model`, `method`,
    `trust`, `cell` and all of tables.

    Args:
        records: The file, `Record` or data frame to identify on. None: the bundled cell.
        ocv: The OCV test of the same cell.
        validate: Files, records or data frames to validate on.
        rows: Pairs of a circuit and a method of `METHODS`, by default those of the paper.
        setup: "li2023" for the OCV polynomial of Li et al. (2023), whose rows are the default.
        watch: Called for every row, as in `compare`.

    Raises `InputError` if an input cannot be used, or more than one record is given.
    """
    records, watch = listed(job.records), job.watch
    if len(records) > 1:
        raise InputError(
            f"a comparison uses one record, but {len(records)} were given; give the others with "
            "`validate`"
        )
    inputs = read_inputs(
        records, job.ocv, job.validate, job, job,
        capacity=job.capacity, window=job.window, watch=watch,
    )  # fmt: skip
    windows = windows_of(inputs, job.window, job.capacity)
    source, ranges = ranges_of(job.bounds)
    comparison = compare(
        inputs.records[0],
        inputs.cell,
        job.rows,
        validation=inputs.validation,
        window=windows[inputs.records[0].name],
        validation_windows=[windows[record.name] for record in inputs.validation],
        bounds=ranges,
        fixed=job.fix,
        coordinates=job.coordinates,
        objective="scan" if job.objective == "auto" else job.objective,
        budget=Budget(job.population, job.iterations, job.seeds, job.key),
        source=source,
        watch=watch,
    )
    with watch("Circuits", 0):
        alone = Job(seeds=0, bounds=job.bounds, fix=job.fix, tables=job.table_settings)
        setup = set_up(first_problem(inputs, windows, alone), inputs, windows, alone)
        usual = search_and_assess(setup, None, alone, "none", unwatched, advise=False)
    result = make_comparison_result(
        comparison, usual.candidates, ocv=inputs.ocv, warnings=inputs.warnings
    )
    return comparison, result

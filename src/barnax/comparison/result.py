"""`comparison.json`: what a comparison found, as it is stored."""

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import field_validator

from ..cell import CellModel, CircuitParameters
from ..methods import METHODS
from ..optimum import GlobalOptimum
from ..problem import Problem
from ..records import Record
from ..result_making import all_versions, input_part, metrics_part
from ..result_parts import InputPart, Soc, read_stored
from ..window import Window
from .parts import (
    BandPart,
    BudgetPart,
    ComparisonPart,
    DifferencePart,
    ModelPart,
    OverSeedsPart,
    OverTimePart,
    RecordErrorsPart,
    RowPart,
    SeedAnswerPart,
    SpreadPart,
)
from .rows import Comparison, Difference, Row

SCHEMA_VERSION = 1
REMEDY = "give the comparison.json that barnax compare wrote"


class ComparisonResult(ComparisonPart):
    """The whole of `comparison.json`. Equal runs give equal bytes: no times, dates or folders.

    Seconds stand in `timings.json`; reports take them beside this as a mapping of row names.
    """

    schema_version: Literal[1] = SCHEMA_VERSION
    rows: tuple[RowPart, ...]
    differences: tuple[DifferencePart, ...]
    models: dict[str, ModelPart]
    budget: BudgetPart
    cell: dict[str, Any]
    window: Window
    initial_soc: Soc
    initial_soc_reason: str
    inputs: tuple[InputPart, ...]
    warnings: tuple[str, ...]
    command: tuple[str, ...]
    versions: dict[str, str]

    @field_validator("cell")
    @classmethod
    def _hold_a_cell(cls, cell: dict[str, Any]) -> dict[str, Any]:
        CellModel.from_dict(cell)
        return cell

    @property
    def cell_model(self) -> CellModel:
        return CellModel.from_dict(self.cell)

    def to_json(self) -> str:
        return self.model_dump_json(by_alias=True, indent=1) + "\n"

    @classmethod
    def from_json(cls, path: str | Path) -> "ComparisonResult":
        """The comparison in a file. Raises `InputError` that names what is wrong with it."""
        return read_stored(cls, Path(path), REMEDY)


def make_comparison_result(
    comparison: Comparison,
    validation: Sequence[Record] = (),
    *,
    ocv: Sequence[Record] = (),
    command: Sequence[str] = (),
) -> ComparisonResult:
    """Everything a comparison found, as one value that can be stored.

    `ocv` are the records the cell was characterized from; `command` what was run.
    """
    problems = {row.model: row.problem for row in comparison.rows}
    first = next(iter(problems.values()))
    budget = comparison.budget
    records = [("identification", first.course.record)]
    records += [("validation", record) for record in validation]
    records += [("ocv", record) for record in ocv]
    return ComparisonResult(
        rows=tuple(_row_part(row) for row in comparison.rows),
        differences=tuple(_difference_part(each) for each in comparison.differences),
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
        cell=first.cell.to_dict(),
        window=first.window,
        initial_soc=first.course.initial_soc,
        initial_soc_reason=first.course.initial_soc_reason,
        inputs=tuple(input_part(role, record) for role, record in records),
        warnings=comparison_warnings(comparison, [*ocv, *validation]),
        command=tuple(command),
        versions=all_versions(),
    )


def comparison_warnings(comparison: Comparison, others: Sequence[Record]) -> tuple[str, ...]:
    """Every warning of a comparison once; `others` are the records beside the first."""
    texts = [text for record in others for text in record.warnings]
    problems: dict[str, Problem] = {row.model: row.problem for row in comparison.rows}
    texts += [text for problem in problems.values() for text in problem.warnings]
    texts += [
        text for row in comparison.rows for each in row.evaluations for text in each.course.warnings
    ]
    return tuple(dict.fromkeys(texts))


def _model_part(problem: Problem, optimum: GlobalOptimum | None) -> ModelPart:
    known = (
        {}
        if optimum is None
        else {
            "optimum_rmse_v": optimum.rmse_v,
            "optimum_parameters": optimum.parameters.to_dict(),
            "optimum_status": optimum.status,
            "optimum_verdict": optimum.verdict,
        }
    )
    return ModelPart(bounds=dict(problem.bounds.ranges), fixed=dict(problem.bounds.fixed), **known)


def _row_part(row: Row) -> RowPart:
    source = METHODS[row.method].source
    if row.failure is not None:
        return RowPart(
            model=row.model,
            method=row.method,
            source=source,
            is_deterministic=row.is_deterministic,
            failure=row.failure,
        )
    identification, *validation = (
        RecordErrorsPart(
            metrics=metrics_part(evaluation),
            bands=tuple(BandPart(**asdict(band)) for band in bands),
        )
        for evaluation, bands in zip(row.evaluations, row.bands, strict=True)
    )
    errors_v = row.errors_v
    return RowPart(
        model=row.model,
        method=row.method,
        source=source,
        is_deterministic=row.is_deterministic,
        notes=row.notes,
        parameters=row.median.parameters.to_dict(),
        time_constants=time_constants(row.median.parameters),
        evaluations=row.median.evaluations,
        at_bound=row.at_bound,
        spread=None
        if row.is_deterministic
        else SpreadPart(
            best_rmse_v=float(errors_v.min()),
            worst_rmse_v=float(errors_v.max()),
            deviation_v=_deviation_v(errors_v),
        ),
        identification=identification,
        validation=tuple(validation),
        refined_rmse_v=row.refined.rmse_v if row.refined else None,
        refined_parameters=row.refined.parameters.to_dict() if row.refined else None,
        regret=row.regret,
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


def _deviation_v(errors_v: np.ndarray) -> float:
    """The standard deviation over seeds; one that failed altogether is infinitely far away."""
    if len(errors_v) == 1:
        return 0.0
    return float(np.std(errors_v, ddof=1)) if np.isfinite(errors_v).all() else math.inf


def time_constants(parameters: CircuitParameters) -> dict[str, float]:
    """The time constants in s under their names, such as `tau1 [s]`."""
    return {f"tau{pair} [s]": tau for pair, tau in enumerate(parameters.tau_s, 1)}


def _difference_part(difference: Difference) -> DifferencePart:
    over_time, over_seeds = difference.over_time, difference.over_seeds
    return DifferencePart(
        first=difference.first,
        second=difference.second,
        record=difference.record,
        is_validation=difference.is_validation,
        over_time=OverTimePart(
            difference_v2=over_time.difference_v2,
            interval_v2=(over_time.low_v2, over_time.high_v2),
            difference_v=over_time.difference_v,
            interval_v=(over_time.low_v, over_time.high_v),
            block_samples=over_time.block_samples,
            is_block_capped=over_time.is_block_capped,
            is_real=over_time.is_real,
        ),
        over_seeds=OverSeedsPart(**asdict(over_seeds)) if over_seeds else None,
    )

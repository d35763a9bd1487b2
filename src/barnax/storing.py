"""A `Run` as a `Result`, to be stored, and its parts."""

import functools
import sys
from collections.abc import Sequence
from dataclasses import fields
from importlib.metadata import version
from typing import Any

import numpy as np

from .cell import OcvTable
from .cell.soc_axis import is_above
from .global_optimum import GlobalOptimum, optimality_gap
from .metrics import Metrics
from .model.problem import Problem
from .optimizers import OPTIMIZERS, AbstractPopulationMinimiser
from .pulses import pulses_of
from .records import Record
from .records.fingerprint import Content
from .result_parts import (
    SCHEMA_VERSION,
    AssessmentPart,
    ConstantPart,
    GlobalPart,
    InputPart,
    MetricsBlock,
    MetricsPart,
    RefinedPart,
    SearchPart,
    TablesPart,
)
from .results import Result
from .run import Run
from .search.evaluate import Evaluation, pooled
from .search.refine import SAME_RMSE, Refinement
from .search.seeds import Search
from .uncertainty.assessment import Band, soc_bands

VERSIONED = ("barnax", "jax", "jaxlib", "numpy", "optimistix", "equinox", "scipy", "polars")


def make_result(run: Run) -> Result:
    """A run as a `Result`, which can be stored.

    Args:
        run: The objects.
    """
    problem = run.problem
    constant = ConstantPart(
        model=problem.circuit,
        parameters=run.answer.parameters,
        source=run.answer.source,
        at_bound=run.answer.at_bound,
        metrics=_metrics_block(problem.name, run.identification, run.validation),
        global_optimum=_global_part(run.refinement, run.optimum) if run.optimum else None,
        assessment=run.assessment
        and AssessmentPart.model_validate(run.assessment, from_attributes=True).model_copy(
            update={"examination": run.examination}
        ),
        hold_shift_ohm=run.hold_shift_ohm,
        search=search_part(run.search) if run.search else None,
        refined=run.refinement and RefinedPart.model_validate(run.refinement, from_attributes=True),
        bounds=dict(problem.bounds.ranges),
        fixed=dict(problem.bounds.fixed),
    )
    tables, model, metrics = None, constant.model, constant.metrics
    if run.tables is not None:
        model = run.tables.model
        metrics = _metrics_block(problem.name, run.tables.identification, run.tables.validation)
        tables = TablesPart(
            settings=run.tables.settings,
            fits=run.tables.found.fits,
            over_temperature=run.tables.found.over_temperature,
            by_soc=bands_by_soc(run.tables.identification),
            hold_shift_ohm=None if run.hold_shift_ohm is None else run.tables.hold_shift_ohm,
        )
    result = Result(
        schema_version=SCHEMA_VERSION,
        model=model,
        metrics=metrics,
        candidates=run.candidates,
        tried=run.tried,
        tables=tables,
        constant=constant,
        pulses=tuple(
            pulse for evaluation in run.identification for pulse in pulses_of(evaluation.prepared)
        ),
        cell=problem.cell,
        inputs=(
            *(record_part("identification", evaluation) for evaluation in run.identification),
            *(record_part("validation", evaluation) for evaluation in run.validation),
            *(input_part("ocv", record) for record in run.ocv),
        ),
        notes=run.notes,
        warnings=run.warnings,
        versions=all_versions(),
    )
    result._run = run
    return result


def _metrics_block(
    name: str, identified: Sequence[Evaluation], validated: Sequence[Evaluation]
) -> MetricsBlock:
    return MetricsBlock(
        identification=joint_metrics(name, identified),
        jointly=tuple(metrics_part(evaluation) for evaluation in identified if len(identified) > 1),
        validation=tuple(metrics_part(evaluation) for evaluation in validated),
    )


def bands_by_soc(evaluations: Sequence[Evaluation]) -> tuple[Band, ...]:
    """The errors of several records together in each tenth of the state of charge."""
    scored = [evaluation.prepared.scored for evaluation in evaluations]
    soc = [evaluation.prepared.soc[s] for evaluation, s in zip(evaluations, scored, strict=True)]
    error_v = [evaluation.error_v[s] for evaluation, s in zip(evaluations, scored, strict=True)]
    return soc_bands(np.concatenate(soc), np.concatenate(error_v))


def search_part(search: Search) -> SearchPart:
    """A search as it is stored."""
    problem: Problem = search.problem
    method, settings = describe(search.optimizer)
    return SearchPart(
        method=method,
        settings=settings,
        coordinates=problem.scale,
        objective=problem.kind,
        population=search.optimizer.population,
        iterations=search.optimizer.iterations,
        key=search.key,
        evaluations=search.evaluations,
        seeds=search.seeds,
    )


def _global_part(refinement: Refinement | None, optimum: GlobalOptimum) -> GlobalPart:
    """The global optimum as it is stored, with the optimality gap of every answer.

    Local optima are counted once, whoever found them: the seeds or the grid.
    """
    part = GlobalPart.model_validate(optimum, from_attributes=True)
    if refinement is None:
        return part
    gaps = [optimality_gap(seed.rmse_v, optimum.rmse_v) for seed in refinement.search.seeds]
    local = list(optimum.local_optima)
    for minimum in refinement.optima:
        known = [optimum.rmse_v, *(other.rmse_v for other in local)]
        if all(abs(minimum.rmse_v / other - 1) > SAME_RMSE for other in known if other):
            local.append(minimum)
    return part.model_copy(
        update={
            "local_optima": tuple(sorted(local, key=lambda minimum: minimum.rmse_v)),
            "median_gap": float(np.median(gaps)),
            "best_gap": min(gaps),
            "refined_gap": optimality_gap(refinement.rmse_v, optimum.rmse_v),
            "seeds_there": sum(
                seed.rmse_v <= optimum.rmse_v * (1 + SAME_RMSE) for seed in refinement.seeds
            ),
        }
    )


def joint_metrics(name: str, evaluations: Sequence[Evaluation]) -> MetricsPart:
    """The metrics of several records together, under one name."""
    return _metrics(name, pooled(evaluations), evaluations)


def metrics_part(evaluation: Evaluation) -> MetricsPart:
    """The metrics of one record under its name."""
    return _metrics(evaluation.prepared.record.name, evaluation.metrics, [evaluation])


def _metrics(name: str, metrics: Metrics, evaluations: Sequence[Evaluation]) -> MetricsPart:
    above = [
        evaluation.error_v[evaluation.prepared.scored & is_above(evaluation.prepared.soc)]
        for evaluation in evaluations
    ]
    errors_v = np.concatenate(above)
    above_v = float(np.sqrt(np.mean(errors_v**2))) if len(errors_v) else None
    moved = evaluations[0].registered if len(evaluations) == 1 else None
    moved_soc, least_v = moved or (None, None)
    return MetricsPart(
        record=name,
        **vars(metrics),
        rmse_above_10_soc_v=above_v,
        registered_v=least_v,
        start_moved_soc=moved_soc,
    )


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


@functools.cache
def all_versions() -> dict[str, str]:
    """The versions that can change a result's digits."""
    return {"python": sys.version.split()[0]} | {name: version(name) for name in VERSIONED}


def input_part(role: Any, record: Record | OcvTable) -> InputPart:
    """A file that was read, with what was decided about it."""
    if isinstance(record, OcvTable):
        return InputPart(role=role, name=record.name, sha256=record.sha256)
    how = {"sign": record.sign, "hold": record.hold, "voltage_lag_s": record.voltage_lag_s}
    return InputPart(role=role, name=record.name, sha256=record.sha256, **how)


def record_part(role: Any, evaluation: Evaluation) -> InputPart:
    """A record that was simulated."""
    prepared = evaluation.prepared
    soc = prepared.soc[prepared.scored]
    return input_part(role, prepared.record).model_copy(
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
        }
    )

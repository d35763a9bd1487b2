"""From what a run found to the result that is stored."""

import sys
from collections.abc import Sequence
from dataclasses import asdict, fields
from importlib.metadata import version
from typing import Any

import numpy as np

from .evaluate import Evaluation, pooled
from .metrics import Metrics
from .optimizers import OPTIMIZERS, AbstractPopulationMinimiser
from .optimum import GlobalOptimum, regret
from .records import Record
from .refinement import CrossCheck, Optimum
from .result import Result
from .result_parts import (
    DecisionPart,
    GlobalPart,
    InputPart,
    JointPart,
    MetricsBlock,
    MetricsPart,
    OptimumPart,
    RefinedPart,
    SearchPart,
    SeedPart,
)
from .trust import Assessment, Examination
from .trust_parts import trust_part

VERSIONED = ("barnax", "jax", "jaxlib", "numpy", "optimistix", "equinox", "scipy", "polars")
# An answer further above the global optimum than this is warned about.
REGRETTABLE = 1e-3


def make_result(
    checked: CrossCheck,
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
    found, problem = checked.found, checked.found.problem
    method, settings = describe(found.optimizer)
    records = [("identification", course.record) for course in problem.courses]
    records += [("validation", each.course.record) for each in validation]
    records += [("ocv", record) for record in ocv]
    return Result(
        model=problem.circuit,
        parameters=checked.parameters.to_dict(),
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
            rmse_v=checked.rmse_v,
            objective=checked.objective,
            evaluations=checked.evaluations,
            at_bound=checked.at_bound,
            optima=tuple(_optimum_part(each) for each in checked.optima),
            moved=tuple(seed.moved for seed in checked.refined),
            converged=tuple(seed.has_converged for seed in checked.refined),
            verdict=checked.verdict,
        ),
        global_optimum=None if optimum is None else global_part(checked, optimum),
        trust=None if assessment is None else trust_part(assessment, examination),
        metrics=MetricsBlock(
            identification=joint_metrics(problem.name, identification),
            validation=tuple(metrics_part(each) for each in validation),
        ),
        cell=problem.cell.to_dict(),
        bounds=dict(problem.bounds.ranges),
        fixed=dict(problem.bounds.fixed),
        window=problem.window,
        initial_soc=problem.course.initial_soc,
        initial_soc_reason=problem.course.initial_soc_reason,
        initial_direction=1 if problem.course.direction[0] > 0 else -1,
        rest_current_a=float(problem.course.rest_current_a),
        jointly=tuple(
            JointPart(
                initial_soc=each.course.initial_soc,
                initial_soc_reason=each.course.initial_soc_reason,
                metrics=metrics_part(each),
            )
            for each in identification
            if len(identification) > 1
        ),
        inputs=tuple(input_part(role, record) for role, record in records),
        warnings=all_warnings(checked, optimum, identification, validation, ocv),
        command=tuple(command),
        versions=all_versions(),
    )


def global_part(checked: CrossCheck, optimum: GlobalOptimum) -> GlobalPart:
    """The global optimum as it is stored, with the regret of every answer."""
    regrets = [regret(seed.rmse_v, optimum.rmse_v) for seed in checked.found.seeds]
    return GlobalPart(
        rmse_v=optimum.rmse_v,
        parameters=optimum.parameters.to_dict(),
        status=optimum.status,
        lower_bound_v=optimum.lower_bound_v,
        local_optima=tuple(_optimum_part(each) for each in optimum.local_optima),
        at_bound=optimum.at_bound,
        median_regret=float(np.median(regrets)),
        best_regret=min(regrets),
        refined_regret=regret(checked.rmse_v, optimum.rmse_v),
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
    return MetricsPart(record=evaluation.course.record.name, **asdict(metrics))


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
    checked: CrossCheck,
    optimum: GlobalOptimum | None,
    identification: Sequence[Evaluation],
    validation: Sequence[Evaluation],
    ocv: Sequence[Record],
) -> tuple[str, ...]:
    """Every warning of a run once, in the order of the flow."""
    problem = checked.found.problem
    texts = [*(text for record in ocv for text in record.warnings), *problem.warnings]
    texts += [
        f"{each.course.record.name}: the circuit does worse than a constant voltage would (R2 "
        f"{each.metrics.r2:.3g}); look for a wrong sign or unit with barnax check, and at what "
        "--fix and --bounds hold"
        for each in identification
        if each.metrics.r2 < 0
    ]
    for each in validation:
        texts += [*each.course.record.warnings, *each.course.warnings]
    excess = 0.0 if optimum is None else regret(checked.rmse_v, optimum.rmse_v)
    if excess > REGRETTABLE:
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

"""The figures of a comparison, with their captions."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from ..cell import CircuitParameters
from ..plots import (
    plot_compared_convergence,
    plot_compared_errors,
    plot_compared_parameters,
    plot_compared_voltages,
)
from ..plots.illustration import Illustration, record_roles
from .cell_illustrations import cell_illustrations, condition_illustrations
from .landscape_illustration import landscape_illustration

if TYPE_CHECKING:
    from ..comparison import Comparison, ComparisonResult
    from ..optimum import GlobalOptimum


def comparison_illustrations(
    result: "ComparisonResult",
    comparison: "Comparison | None" = None,
    optima: "Mapping[str, GlobalOptimum] | None" = None,
) -> list[Illustration]:
    """Every figure of a comparison; those over time only with the comparison itself.

    A stored comparison holds no records, so from `result` alone come the figures of the cell and
    of the seeds. `optima` are the global optima by model, for the landscapes.
    """
    figures = [*cell_illustrations(result.cell_model)]
    if comparison is not None and comparison.answered:
        evaluations = comparison.answered[0].evaluations
        roles = record_roles(1, len(evaluations) - 1)
        courses = [each.course for each in evaluations]
        figures += condition_illustrations(dict(zip(roles, courses, strict=True)))
        for record, role in enumerate(roles):
            figures += _rows_on(comparison, record, role)
    if any(row.seeds for row in result.rows):
        figures += _seeds_of(result)
    for model, found in (optima or {}).items():
        # The rows of other models are there without an answer, so that all keep their looks.
        answers = {
            row.name: [
                CircuitParameters.from_dict(seed.parameters)
                for seed in row.seeds
                if row.model == model
            ]
            for row in result.rows
            if row.seeds
        }
        refined = [
            CircuitParameters.from_dict(row.refined_parameters)
            for row in result.rows
            if row.model == model and row.refined_parameters is not None
        ]
        figures += landscape_illustration(model, found, answers, refined)
    return figures


def _rows_on(comparison: "Comparison", record: int, role: str) -> Iterator[Illustration]:
    evaluations = {row.name: row.evaluations[record] for row in comparison.answered}
    name = comparison.answered[0].evaluations[record].course.record.name
    yield Illustration(
        f"{role}-voltages",
        plot_compared_voltages(evaluations),
        f"Measured and simulated voltage on {name}. Below, the framed stretch, chosen by the "
        "current alone.",
        "Measured voltage and the simulations of the rows over time, with a magnified stretch",
    )
    yield Illustration(
        f"{role}-errors",
        plot_compared_errors(evaluations),
        f"Measured minus simulated voltage on {name}, over time and over the state of charge, on "
        "one scale. Dashed: plus and minus the RMSE; steps: the RMSE in each twentieth of the "
        "state of charge.",
        "Errors of the rows over time and over the state of charge",
    )


def _seeds_of(result: "ComparisonResult") -> Iterator[Illustration]:
    yield Illustration(
        "convergence",
        plot_compared_convergence(result),
        "How the best RMSE of each row fell: the median of its seeds, and a band from the tenth "
        "to the ninetieth percentile. Rows without a history are a mark.",
        "Best RMSE of the rows over evaluations, with the spread of the seeds",
    )
    yield Illustration(
        "parameters",
        plot_compared_parameters(result),
        "What every seed ended with, before refinement. Stroke: the median seed; diamond: the "
        "same, refined; dotted: a bound.",
        "Parameters of every seed of every row",
        is_dense=False,
    )

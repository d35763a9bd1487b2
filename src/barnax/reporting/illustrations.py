"""The figures of a report, with their captions."""

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

from ..cell import CircuitParameters
from ..plots import (
    plot_compared_convergence,
    plot_compared_errors,
    plot_compared_parameters,
    plot_compared_voltages,
    plot_condition,
    plot_convergence,
    plot_error,
    plot_hysteresis,
    plot_landscape,
    plot_ocv,
    plot_voltage,
)
from ..plots.landscape import has_landscape
from ..plots.sources import Illustration, record_roles
from ..results import describe

if TYPE_CHECKING:
    from ..cell import CellModel
    from ..comparison import Comparison, ComparisonResult
    from ..global_optimum import GlobalOptimum
    from ..model.inputs import PreparedRecord
    from ..search.evaluate import Evaluation
    from ..search.refine import Refinement


def cell_illustrations(cell: "CellModel") -> Iterator[Illustration]:
    """Open-circuit and hysteresis voltage."""
    yield Illustration(
        "ocv",
        plot_ocv(cell),
        "Open-circuit voltage: the measured points, the curve of each branch and their average. "
        "Below, what each curve leaves at its own points.",
        "Open-circuit voltage over the state of charge, with residuals of the fit",
        is_dense=False,
    )
    yield Illustration(
        "hysteresis",
        plot_hysteresis(cell),
        "Hysteresis voltage, the charge branch minus the discharge branch, and the segments that "
        "stand for it.",
        "Hysteresis voltage over the state of charge, with its five segments",
        is_dense=False,
    )


def condition_illustrations(
    prepared_records: "Mapping[str, PreparedRecord]",
) -> Iterator[Illustration]:
    """Current, voltage and state of charge of every record, by its role."""
    for role, prepared in prepared_records.items():
        yield Illustration(
            f"{role}-condition",
            plot_condition(prepared),
            f"The working condition of {prepared.record.name}: current, measured voltage and state "
            "of charge.",
            "Current, voltage and state of charge over time",
        )


def landscape_illustration(
    model: str,
    found: "GlobalOptimum",
    answers: "Mapping[str, Sequence[CircuitParameters]]",
    refined: "Sequence[CircuitParameters]",
) -> Iterator[Illustration]:
    """The landscape of one model, where it has two time constants to be drawn over."""
    if not has_landscape(found.landscape):
        return
    yield Illustration(
        f"landscape-{model}",
        plot_landscape(
            found.landscape,
            answers=answers,
            refined=refined,
            optimum=found.parameters,
            others=[each.parameters for each in found.local_optima],
        ),
        f"The lowest RMSE that {model} can reach at every pair of time constants, with what every "
        f"seed ended with. {found.verdict}",
        "The error over both time constants, with every seed's answer and the optimum",
        is_dense=False,
    )


def identification_illustrations(
    refinement: "Refinement",
    identified: "Sequence[Evaluation]",
    validated: "Sequence[Evaluation]",
    optimum: "GlobalOptimum | None" = None,
) -> list[Illustration]:
    """Every figure of an identification; evaluations are those of the refined parameters.

    With the global `optimum` comes the landscape.
    """
    roles = record_roles(len(identified), len(validated))
    evaluations = dict(zip(roles, [*identified, *validated], strict=True))
    figures = [*cell_illustrations(refinement.search.problem.cell)]
    figures += condition_illustrations({role: each.prepared for role, each in evaluations.items()})
    for role, each in evaluations.items():
        name = each.prepared.record.name
        figures += [
            Illustration(
                f"{role}-voltage",
                plot_voltage(each),
                f"Measured and simulated voltage on {name}, and the current. At the right the "
                "framed stretch, chosen by the current alone.",
                "Measured and simulated voltage over time, above the current",
            ),
            Illustration(
                f"{role}-error",
                plot_error(each),
                f"Measured minus simulated voltage on {name}, over time and over the state of "
                "charge. Dashed: plus and minus the RMSE.",
                "Error over time and over the state of charge",
            ),
        ]
    figures.append(
        Illustration(
            "convergence",
            plot_convergence(refinement.search, refinement),
            "How the best RMSE of every seed fell during the search, and how far each stayed "
            "above the refined answer.",
            "Best RMSE of every seed over evaluations",
        )
    )
    if optimum is not None:
        method, _ = describe(refinement.search.optimizer)
        answers = {method: [seed.parameters for seed in refinement.search.seeds]}
        circuit = refinement.search.problem.circuit
        figures += landscape_illustration(circuit, optimum, answers, [refinement.parameters])
    return figures


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
        prepared_records = [each.prepared for each in evaluations]
        figures += condition_illustrations(dict(zip(roles, prepared_records, strict=True)))
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
    name = comparison.answered[0].evaluations[record].prepared.record.name
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

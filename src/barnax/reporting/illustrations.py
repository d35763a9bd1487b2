"""The figures of a report, with their captions."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

from ..cell import CircuitParameters
from ..errors import InputError
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
    from matplotlib.figure import Figure

    from ..cell import CellModel
    from ..comparison import Comparison, ComparisonResult
    from ..global_optimum import GlobalOptimum
    from ..model.inputs import PreparedRecord
    from ..pipeline import Run
    from ..results import Result
    from ..search.evaluate import Evaluation


def cell_illustrations(cell: "CellModel") -> Iterator[Illustration]:
    """Open-circuit and hysteresis voltage."""
    yield _ocv(cell)
    yield _hysteresis(cell)


def _ocv(cell: "CellModel") -> Illustration:
    return Illustration(
        "ocv",
        plot_ocv(cell),
        "Open-circuit voltage: the measured points, the curve of each branch and their average. "
        "Below, what each curve leaves at its own points.",
        "Open-circuit voltage over the state of charge, with residuals of the fit",
        is_dense=False,
    )


def _hysteresis(cell: "CellModel") -> Illustration:
    return Illustration(
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
        yield _condition(role, prepared)


def _condition(role: str, prepared: "PreparedRecord") -> Illustration:
    return Illustration(
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
    if has_landscape(found.landscape):
        yield _landscape(model, found, answers, refined)


def _landscape(
    model: str,
    found: "GlobalOptimum",
    answers: "Mapping[str, Sequence[CircuitParameters]]",
    refined: "Sequence[CircuitParameters]",
) -> Illustration:
    return Illustration(
        f"landscape-{model}",
        plot_landscape(
            found.landscape,
            answers=answers,
            refined=refined,
            optimum=found.parameters,
            others=[each.parameters for each in found.local_optima],
        ),
        f"The lowest RMSE that {model} can reach at every pair of time constants, with what every "
        "seed ended with.",
        "The error over both time constants, with every seed's answer and the optimum",
        is_dense=False,
    )


# What is written beside a result even where no report is.
ALWAYS = ("ocv", "hysteresis", "convergence", "voltage", "error")


def identification_illustrations(
    run: "Run", wanted: Callable[[str], bool] = lambda name: True
) -> list[Illustration]:
    """The figures of an identification whose names are wanted; each is drawn only then."""
    return [draw() for name, draw in _identification_figures(run).items() if wanted(name)]


def is_always(name: str) -> bool:
    """Whether a figure is written beside every result."""
    return name.rpartition("-")[2] in ALWAYS


def figure_of(result: "Result", name: str) -> "Figure":
    """One figure of a result by its name, or the end of its name.

    Raises `InputError` where there is none of that name.
    """
    figures = _identification_figures(result.run)
    found = [each for each in figures if each == name or each.rpartition("-")[2] == name]
    found += [each for each in figures if each.startswith(name)]
    if not found:
        raise InputError(f"there is no figure {name!r}; there are {', '.join(figures)}")
    return figures[found[0]]().figure


def _identification_figures(run: "Run") -> dict[str, Callable[[], Illustration]]:
    """How to draw every figure of an identification, by its name."""
    cell = run.problem.cell
    figures: dict[str, Callable[[], Illustration]] = {
        "ocv": partial(_ocv, cell),
        "hysteresis": partial(_hysteresis, cell),
    }
    roles = record_roles(len(run.identification), len(run.validation))
    for role, each in zip(roles, [*run.identification, *run.validation], strict=True):
        figures[f"{role}-condition"] = partial(_condition, role, each.prepared)
        figures[f"{role}-voltage"] = partial(_voltage, role, each)
        figures[f"{role}-error"] = partial(_error, role, each)
    figures["convergence"] = partial(_convergence, run)
    if run.optimum is not None and has_landscape(run.optimum.landscape):
        method, _ = describe(run.search.optimizer)
        answers = {method: [seed.parameters for seed in run.search.seeds]}
        model = run.problem.circuit
        figures[f"landscape-{model}"] = partial(
            _landscape, model, run.optimum, answers, [run.answer.parameters]
        )
    return figures


def _voltage(role: str, evaluation: "Evaluation") -> Illustration:
    name = evaluation.prepared.record.name
    return Illustration(
        f"{role}-voltage",
        plot_voltage(evaluation),
        f"Measured and simulated voltage on {name}, and the current. At the right the framed "
        "stretch, chosen by the current alone.",
        "Measured and simulated voltage over time, above the current",
    )


def _error(role: str, evaluation: "Evaluation") -> Illustration:
    name = evaluation.prepared.record.name
    return Illustration(
        f"{role}-error",
        plot_error(evaluation),
        f"Measured minus simulated voltage on {name}, over time and over the state of charge. "
        "Dashed: plus and minus the RMSE.",
        "Error over time and over the state of charge",
    )


def _convergence(run: "Run") -> Illustration:
    return Illustration(
        "convergence",
        plot_convergence(run.search, run.refinement),
        "How the best RMSE of every seed fell during the search, and how far each stayed above "
        "the refined answer.",
        "Best RMSE of every seed over evaluations",
    )


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

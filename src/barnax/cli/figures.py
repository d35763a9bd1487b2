"""The figures of `barnax identify`, and its report: files by their path in the results folder."""

from typing import TYPE_CHECKING

from .output import report_files

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..cell import CellModel
    from ..global_optimum import GlobalOptimum
    from ..results import Result
    from ..search.evaluate import Evaluation
    from ..search.refine import Refinement


def cell_figures(cell: "CellModel") -> dict[str, bytes]:
    """PNG figures of the cell by their path below the results folder."""
    from ..plots import plot_hysteresis, plot_ocv

    return _pngs({"ocv": plot_ocv(cell), "hysteresis": plot_hysteresis(cell)})


def found_figures(
    refinement: "Refinement",
    identified: "list[Evaluation]",
    validated: "list[Evaluation]",
) -> dict[str, bytes]:
    """PNG figures of the search and the errors by their path below the results folder."""
    from ..plots import plot_convergence, plot_error, plot_voltage
    from ..plots.sources import record_roles

    figures = {"convergence": plot_convergence(refinement.search, refinement)}
    roles = record_roles(len(identified), len(validated))
    for role, evaluation in zip(roles, [*identified, *validated], strict=True):
        figures[f"{role}-voltage"] = plot_voltage(evaluation)
        figures[f"{role}-error"] = plot_error(evaluation)
    return _pngs(figures)


def report_with_figures(
    result: "Result",
    refinement: "Refinement",
    identified: "list[Evaluation]",
    validated: "list[Evaluation]",
    optimum: "GlobalOptimum | None",
) -> dict[str, bytes]:
    """The report in both forms and its figures, by their path below the results folder."""
    from ..reporting import identification_document, identification_illustrations

    drawn = identification_illustrations(refinement, identified, validated, optimum)
    return report_files(identification_document(result, drawn), drawn)


def _pngs(figures: "dict[str, Figure]") -> dict[str, bytes]:
    from ..plots.style import encode

    return {f"figures/{name}.png": encode(figure) for name, figure in figures.items()}

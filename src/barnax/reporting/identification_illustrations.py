"""The figures of one identification, with their captions."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..plots import plot_convergence, plot_error, plot_voltage
from ..plots.illustration import Illustration, record_roles
from ..result_making import describe
from .cell_illustrations import cell_illustrations, condition_illustrations
from .landscape_illustration import landscape_illustration

if TYPE_CHECKING:
    from ..evaluate import Evaluation
    from ..optimum import GlobalOptimum
    from ..refinement import CrossCheck


def identification_illustrations(
    checked: "CrossCheck",
    identified: "Sequence[Evaluation]",
    validated: "Sequence[Evaluation]",
    optimum: "GlobalOptimum | None" = None,
) -> list[Illustration]:
    """Every figure of an identification; evaluations are those of the refined parameters.

    With the global `optimum` comes the landscape.
    """
    roles = record_roles(len(identified), len(validated))
    evaluations = dict(zip(roles, [*identified, *validated], strict=True))
    figures = [*cell_illustrations(checked.found.problem.cell)]
    figures += condition_illustrations({role: each.course for role, each in evaluations.items()})
    for role, each in evaluations.items():
        name = each.course.record.name
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
            plot_convergence(checked.found, checked),
            "How the best RMSE of every seed fell during the search, and how far each stayed "
            "above the refined answer.",
            "Best RMSE of every seed over evaluations",
        )
    )
    if optimum is not None:
        method, _ = describe(checked.found.optimizer)
        answers = {method: [seed.parameters for seed in checked.found.seeds]}
        circuit = checked.found.problem.circuit
        figures += landscape_illustration(circuit, optimum, answers, [checked.parameters])
    return figures

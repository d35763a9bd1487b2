"""Tables and sentences about an identification, for a terminal."""

from collections.abc import Sequence

import numpy as np
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from .cell import CellModel, CircuitParameters
from .evaluate import Evaluation
from .optimum import GlobalOptimum
from .refinement import CrossCheck
from .result_making import describe, global_part
from .table_layout import LAYOUT

# Scored samples from which reducing a record costs less than simulating it for every candidate.
LONG = 2000
TOO_WIDE = "not known, the box is too wide for it."


def identification_report(
    checked: CrossCheck,
    evaluations: Sequence[Evaluation],
    optimum: GlobalOptimum | None = None,
    trust: Sequence[RenderableType] = (),
) -> list[RenderableType]:
    """What was decided, the parameters, the errors and the verdict. The evaluations of the
    identification records come first; `trust` stands after the parameters."""
    problem = checked.found.problem
    return [
        _decisions(checked),
        parameters_table(checked),
        *trust,
        metrics_table(evaluations),
        Text(f"Verdict: {checked.verdict}"),
        Text(f"Global optimum: {global_part(checked, optimum).words if optimum else TOO_WIDE}"),
        Text(ocv_sentence(problem.cell)),
    ]


def parameters_table(checked: CrossCheck) -> Table:
    """Refined values, and the spread of the seeds' own answers before refinement."""
    method, _ = describe(checked.found.optimizer)
    seeds = len(checked.found.seeds)
    table = Table(
        title=f"Parameters of {checked.found.problem.circuit}",
        caption=f"median, lowest, highest: {seeds} seeds of {method}, before refinement",
        **LAYOUT,
    )
    table.add_column("parameter")
    table.add_column("unit")
    table.add_column("refined", justify="right", style="bold")
    for head in ("median", "lowest", "highest"):
        table.add_column(head, justify="right")
    answers = [_values(seed.parameters) for seed in checked.found.seeds]
    for name, (unit, value) in _values(checked.parameters).items():
        spread = np.array([answer[name][1] for answer in answers])
        figures = (value, np.median(spread), spread.min(), spread.max())
        table.add_row(name, unit, *(f"{figure:.5g}" for figure in figures))
    before_mv = 1e3 * np.array([seed.rmse_v for seed in checked.found.seeds])
    figures = (1e3 * checked.rmse_v, np.median(before_mv), before_mv.min(), before_mv.max())
    table.add_section()
    table.add_row("RMSE", "mV", *(f"{figure:.4f}" for figure in figures))
    return table


def metrics_table(evaluations: Sequence[Evaluation]) -> Table:
    """Errors on every record (Li et al., 2023, Eq. 22 to 26)."""
    table = Table(title="Errors of the refined parameters", **LAYOUT)
    table.add_column("record", overflow="fold")
    for head in (
        "RMSE\n\\[mV]",
        "R2",
        "R2\n(paper)",
        "MAPE\n\\[%]",
        "CE\n\\[V]",
        "max\n\\[mV]",
        "samples",
    ):
        table.add_column(head, justify="right")
    for evaluation in evaluations:
        metrics = evaluation.metrics
        table.add_row(
            Text(evaluation.course.record.name),
            f"{1e3 * metrics.rmse_v:.3f}",
            f"{metrics.r2:.5f}",
            f"{metrics.r2_paper:.5f}",
            f"{metrics.mape_percent:.3f}",
            f"{metrics.ce_v:.2f}",
            f"{1e3 * metrics.max_v:.1f}",
            f"{metrics.samples}",
        )
    return table


def ocv_sentence(cell: CellModel) -> str:
    """How well the OCV curves pass through their points."""
    parts = [
        f"{name} {1e3 * error.rms_v:.2f} (max {1e3 * error.max_v:.2f})"
        for name, error in cell.errors.items()
    ]
    return (
        f"OCV from {len(cell.discharge_points)} discharge and {len(cell.charge_points)} charge "
        f"points; fit errors at the points in mV, rms: {', '.join(parts)}."
    )


def _decisions(checked: CrossCheck) -> RenderableType:
    problem = checked.found.problem
    lines = []
    for course in problem.courses:
        record = course.record
        lines += [
            f"Record {record.name}: {int(course.scored.sum())} scored of {len(course.soc)} "
            f"simulated samples, SOC {course.initial_soc:.3f} at the start "
            f"({course.initial_soc_reason}).",
            f"Current is {record.sign.value} in the file ({record.sign.strength}: "
            f"{record.sign.reason}); held {record.hold.value} ({record.hold.reason}).",
        ]
    lines += [
        f"Capacity {problem.cell.capacity_ah:.4f} Ah ({problem.cell.capacity_origin}); rest is "
        f"under {1e3 * problem.course.rest_current_a:.3g} mA.",
        f"{checked.found.evaluations} simulations in the search by the {problem.kind} objective, "
        f"{checked.evaluations} in the cross-check by the {checked.objective} one; key "
        f"{checked.found.key}. Errors are the scan's.",
    ]
    if problem.kind == "scan" and problem.scored >= LONG:
        lines.append(
            "--objective compressed searches the same objective in a fraction of the time."
        )
    if len(problem.courses) > 1:
        lines.append(f"The circuit is identified on {len(problem.courses)} records jointly.")
    return Text("\n".join(lines))


def _values(parameters: CircuitParameters) -> dict[str, tuple[str, float]]:
    """Unit and value of every parameter and time constant, in readable units."""
    values = {"R0": ("mOhm", 1e3 * parameters.r0)}
    pairs = zip(parameters.r, parameters.c, parameters.tau_s, strict=True)
    for pair, (r, c, tau_s) in enumerate(pairs, 1):
        values |= {f"R{pair}": ("mOhm", 1e3 * r), f"C{pair}": ("F", c), f"tau{pair}": ("s", tau_s)}
    if parameters.gamma is not None:
        values["gamma"] = ("1/SOC", parameters.gamma)
    return values

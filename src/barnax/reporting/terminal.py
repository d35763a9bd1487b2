"""Tables and sentences for a terminal."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from rich import box
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from ..cell import CellModel, CircuitParameters
from ..comparison import ComparisonResult
from ..global_optimum import GlobalOptimum
from ..results import describe, global_part
from ..search.evaluate import Evaluation
from ..search.refine import Refinement
from ..uncertainty import Assessment, Estimate, Examination
from . import document
from .comparison import comparison_document
from .comparison_sentences import answered, records
from .tables import bands_table, errors_table, failures_table, parameters_table, search_table

# Seven figures and a file's name in 80 columns.
LAYOUT: dict[str, Any] = {
    "box": box.SIMPLE_HEAD,
    "padding": (0, 1, 0, 0),
    "pad_edge": False,
    "title_style": "bold cyan",
    "header_style": "cyan",
}


# Scored samples from which reducing a record costs less than simulating it for every candidate.
LONG = 2000
TOO_WIDE = "not known, the box is too wide for it."


def identification_report(
    refinement: Refinement,
    evaluations: Sequence[Evaluation],
    optimum: GlobalOptimum | None = None,
    trust: Sequence[RenderableType] = (),
) -> list[RenderableType]:
    """What was decided, the parameters, the errors and the verdict. The evaluations of the
    identification records come first; `trust` stands after the parameters."""
    problem = refinement.search.problem
    return [
        _decisions(refinement),
        seeds_table(refinement),
        *trust,
        metrics_table(evaluations),
        Text(f"Verdict: {refinement.verdict}"),
        Text(f"Global optimum: {global_part(refinement, optimum).words if optimum else TOO_WIDE}"),
        Text(ocv_sentence(problem.cell)),
    ]


def seeds_table(refinement: Refinement) -> Table:
    """Refined values, and the spread of the seeds' own answers before refinement."""
    method, _ = describe(refinement.search.optimizer)
    seeds = len(refinement.search.seeds)
    table = Table(
        title=f"Parameters of {refinement.search.problem.circuit}",
        caption=f"median, lowest, highest: {seeds} seeds of {method}, before refinement",
        **LAYOUT,
    )
    table.add_column("parameter")
    table.add_column("unit")
    table.add_column("refined", justify="right", style="bold")
    for head in ("median", "lowest", "highest"):
        table.add_column(head, justify="right")
    answers = [_values(seed.parameters) for seed in refinement.search.seeds]
    for name, (unit, value) in _values(refinement.parameters).items():
        spread = np.array([answer[name][1] for answer in answers])
        figures = (value, np.median(spread), spread.min(), spread.max())
        table.add_row(name, unit, *(f"{figure:.5g}" for figure in figures))
    before_mv = 1e3 * np.array([seed.rmse_v for seed in refinement.search.seeds])
    figures = (1e3 * refinement.rmse_v, np.median(before_mv), before_mv.min(), before_mv.max())
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
            Text(evaluation.prepared.record.name),
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


def _decisions(refinement: Refinement) -> RenderableType:
    problem = refinement.search.problem
    lines = []
    for prepared in problem.prepared_records:
        record = prepared.record
        lines += [
            f"Record {record.name}: {int(prepared.scored.sum())} scored of {len(prepared.soc)} "
            f"simulated samples, SOC {prepared.initial_soc:.3f} at the start "
            f"({prepared.initial_soc_reason}).",
            f"Current is {record.sign.value} in the file ({record.sign.strength}: "
            f"{record.sign.reason}); held {record.hold.value} ({record.hold.reason}).",
        ]
    lines += [
        f"Capacity {problem.cell.capacity_ah:.4f} Ah ({problem.cell.capacity_origin}); rest is "
        f"under {1e3 * problem.prepared.rest_current_a:.3g} mA.",
        f"{refinement.search.evaluations} simulations in the search by the {problem.kind} objective, "
        f"{refinement.evaluations} in the cross-check by the {refinement.objective} one; key "
        f"{refinement.search.key}. Errors are the scan's.",
    ]
    if problem.kind == "scan" and problem.scored >= LONG:
        lines.append(
            "--objective compressed searches the same objective in a fraction of the time."
        )
    if len(problem.prepared_records) > 1:
        lines.append(
            f"The circuit is identified on {len(problem.prepared_records)} records jointly."
        )
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


def trust_report(
    assessment: Assessment, examination: Examination | None = None
) -> Iterator[RenderableType]:
    """Intervals beside the plain errors, and what the data leave open."""
    yield uncertainty_table(assessment)
    if examination is not None:
        yield examination_table(examination)
    yield Text(f"Trust: {assessment.words}")
    if examination is not None:
        yield Text(f"What would lower the error: {examination.words}")


def uncertainty_table(assessment: Assessment) -> Table:
    """Every parameter with its interval, its standard error and the plain one."""
    sure = assessment.uncertainty
    percent = f"{100 * sure.confidence:.0f} %"
    table = Table(
        title="How sure the parameters are",
        caption=f"from, to: {percent} interval; plain: as if all samples were independent",
        **LAYOUT,
    )
    table.add_column("parameter")
    table.add_column("unit")
    for head in ("refined", "from", "to", "error", "plain", "times"):
        table.add_column(head, justify="right", style="bold" if head == "refined" else "")
    for each in sure.estimates:
        symbol, unit, scale = _unit(each.name)
        table.add_row(symbol, unit, f"{scale * each.value:.5g}", *_errors(each, scale))
    return table


def examination_table(examination: Examination) -> Table:
    """The profile's and the bootstrap's intervals."""
    again = examination.bootstrap
    cut = ", cut short by the record" if again.is_cut else ""
    table = Table(
        title="The same by fitting again",
        caption=f"{again.replicates} replicates in blocks of {again.block_s:.0f} s{cut}; "
        f"{again.converged} refits converged",
        **LAYOUT,
    )
    table.add_column("parameter")
    table.add_column("unit")
    for head in ("profile\nfrom", "to", "bootstrap\nfrom", "to", "error"):
        table.add_column(head, justify="right")
    for each in examination.profiles:
        symbol, unit, scale = _unit(each.name)
        ends = ["open" if end is None else f"{scale * end:.4g}" for end in (each.low, each.high)]
        resampled = again.parameters.get(each.name)
        if resampled is not None:
            ends += [f"{scale * end:.4g}" for end in (resampled.low, resampled.high)]
            ends.append(_percent(resampled.relative_error))
        table.add_row(symbol, unit, *ends)
    return table


def _errors(estimate: Estimate, scale: float) -> list[str]:
    if estimate.relative_error is None or estimate.white_noise_relative_error is None:
        return [estimate.held or "", "", "", "", ""]
    ends = [
        "open" if end is None else f"{scale * end:.4g}" for end in (estimate.low, estimate.high)
    ]
    times = "" if estimate.inflation is None else f"{estimate.inflation:.1f}"
    shares = map(_percent, (estimate.relative_error, estimate.white_noise_relative_error))
    return [*ends, *shares, times]


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %" if share < 10 else "open"


def _unit(name: str) -> tuple[str, str, float]:
    """A parameter's symbol, the unit it is shown in, and the factor to that."""
    symbol, _, unit = name.partition(" [")
    unit = unit.rstrip("]")
    return (symbol, "mOhm", 1e3) if unit == "Ohm" else (symbol, unit, 1.0)


def comparison_report(
    result: ComparisonResult, seconds: Mapping[str, float] | None = None
) -> list[RenderableType]:
    """Parameters, searches, errors on every record and by SOC, failures, and the verdict.

    The tables are those of the report; differences between rows stand only there.
    """
    blocks: list[RenderableType] = []
    if answered(result):
        blocks += [
            _table("Parameters, unrefined", parameters_table(result)),
            _table("Searches", search_table(result, seconds)),
        ]
        for place, name in enumerate(records(result)):
            blocks += [
                _table(f"Errors on {name}", errors_table(result, place)),
                _table(f"Errors on {name} by state of charge", bands_table(result, place)),
            ]
    if any(row.failure for row in result.rows):
        blocks.append(_table("Without an answer", failures_table(result)))
    return [*blocks, *_verdict(result)]


def _table(title: str, table: document.Table) -> Table:
    """A report's table as rich prints it."""
    shown = Table(title=escape(title), **LAYOUT)
    for column in table.columns:
        head = f"{column.name}\n[{column.unit}]" if column.unit else column.name
        shown.add_column(
            escape(head),
            justify="right" if column.role == "number" else "left",
            overflow="fold",
        )
    for place, row in enumerate(table.rows):
        shown.add_row(
            *(
                Text(cell, style="bold" if (place, index) in table.best else "")
                for index, cell in enumerate(row)
            )
        )
    return shown


def _verdict(result: ComparisonResult) -> list[RenderableType]:
    sections = comparison_document(result).sections
    return [
        Text(f"- {sentence}")
        for section in sections
        if section.title == "Verdict"
        for block in section.blocks
        if isinstance(block, document.Bullets)
        for sentence in block.items
    ]

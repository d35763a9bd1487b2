"""What a design promised beside what an identification reached, and what made them differ."""

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from ..experiment.belief import followed
from ..experiment.stored import DRIVE
from ..experiment.widths import told_half
from .design import middle, together
from .document import Table, rows_table
from .terminal import headed_line, indented, terminal_table
from .words import counted, figures, joined, millivolt, symbol, with_unit

if TYPE_CHECKING:
    from ..experiment import Design
    from ..experiment.widths import Width
    from ..over_soc import TableFit
    from ..results import Result

# Promised and reached intervals within this share of each other agree.
AGREES = 0.25


def promised_lines(
    design: "Design", result: "Result", with_cli_options: Callable[[str], str] = str
) -> Iterator[RenderableType]:
    """The promises of a design beside what an identification reached."""
    if result.tables is None:
        told = (
            "intervals of tables over SOC, and the answer has one value at every SOC; with "
            "`over=soc` both are shown."
        )
        yield indented(headed_line("Promised", with_cli_options(told)))
        return
    is_alone = len(result.of_role("identification")) == 1
    yield Text()
    yield indented(terminal_table(promised_table(design, result.fit, is_alone)))
    if text := _differs(design, result):
        yield indented(headed_line("Differs", with_cli_options(text)))


def _differs(design: "Design", result: "Result") -> str:
    """What the fit found otherwise than the promise took it: time constants, resistances, what
    these follow, and the error."""
    fit, rmse_v, taken_v = result.fit, result.metrics.identification.rmse_v, design.error.rmse_v
    bounds = {bound.name: f", at the {bound.side} bound of its search" for bound in fit.at_bound}
    told = [
        f"{symbol(width.name)} {with_unit(width.name, found_s)}{bounds.get(width.name, '')} "
        f"(promise: {with_unit(width.name, width.value)})"
        for width in design.widths
        if width.soc is None and (found_s := fit.tables.constants.get(width.name)) is not None
        and _is_other(found_s, width.value)
    ]  # fmt: skip
    for name in [name for name in design.wanted if name.startswith("R")]:
        own = [(width.value, width.name, width.soc) for width in design.of_table(name)]
        ratios = [
            float(fit.tables.at(table, np.array([soc]))[0]) / value
            for value, table, soc in own
            if table in fit.tables.tables
        ]
        if ratios and _is_other(float(np.median(ratios)), 1.0):
            told.append(f"{name} {figures(float(np.median(ratios)), 2)} times the promise's")
    if words := followed(fit.tables.dependence):
        told.append(f"resistances that follow {joined(words)}, which the promise leaves out")
    if _is_other(rmse_v, taken_v):
        told.append(f"errors of {millivolt(rmse_v)} (promise: {millivolt(taken_v)})")
    return f"the fit has {joined(told)}." if told else ""


def _is_other(found: float, taken: float) -> bool:
    return abs(math.log(max(found, 1e-12) / max(taken, 1e-12))) > math.log1p(AGREES)


def promised_table(design: "Design", fit: "TableFit", is_alone: bool = True) -> Table:
    """The intervals that a design promised, beside those that the identification reached."""
    rows = []
    for name in [wanted for wanted in design.wanted if wanted != DRIVE]:
        pairs = [
            (promised, reached)
            for width in design.of_table(name)
            if (reached := reached_half(fit, width)) is not None
            for promised in [width.alone if is_alone else width.after]
        ]
        if not pairs:
            rows.append((name, "", "", "not determined", ""))
            continue
        promised, reached = np.transpose(pairs)
        near = int(np.sum(np.abs(np.log(reached / promised)) <= math.log1p(AGREES)))
        ratio = f"{np.median(reached) / np.median(promised):.2f}"
        nodes = f"{near} of {counted(len(design.of_table(name)), 'node')}"
        if better := int(np.sum(reached * (1 + AGREES) < promised)):
            nodes += f", {better} narrower"
        rows.append((name, middle(name, promised), middle(name, reached), ratio, nodes))
    earlier = () if is_alone else design.earlier
    caption = (
        "Half the 95 % interval that was promised of the test "
        f"{f'with {joined(earlier)}' if earlier else 'alone'} and reached by the standard errors, "
        "medians from 10 to 90 % SOC; a ratio under 1 is better than promised. An interval is "
        "wider yet where a short record tells its noise badly, and where nothing tells on which "
        "side of a sample its current flowed."
    )
    return rows_table(
        f"{caption} {together()}" if earlier else caption,
        ("", "promised", "reached", "ratio", "within 25 %"),
        rows,
        [""],
    )


def reached_half(fit: "TableFit", width: "Width") -> float | None:
    """Half the interval that a fit has where a width was promised, in its measure, were its noise
    known as well as the promise takes it; one value stands for every SOC."""
    nodes = () if fit.is_over_soc or not width.name.startswith("R") else fit.tables.nodes
    for node in fit.intervals:
        if node.name == width.name and node.soc in (width.soc, *nodes):
            half = told_half(node)
            if half is not None:
                return half
    return None

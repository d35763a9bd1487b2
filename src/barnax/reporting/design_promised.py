"""What a design promised beside what an identification reached, and what made them differ."""

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from ..experiment.stored import DRIVE
from ..experiment.widths import told_half
from .design import middle, together
from .document import Table, rows_table
from .terminal import headed_line, indented, terminal_table
from .words import counted, joined

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
        rows.append((name, middle(name, promised), middle(name, reached), ratio, nodes))
    earlier = () if is_alone else design.earlier
    caption = (
        "Half the 95 % interval that was promised of the test "
        f"{f'with {joined(earlier)}' if earlier else 'alone'} and reached by the standard errors, "
        "medians from 10 to 90 % SOC. An interval is wider yet where a short record tells its "
        "noise badly, and where nothing tells on which side of a sample its current flowed."
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

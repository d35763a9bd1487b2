"""How far the printed cells lie from ten groups of 30 runs of ours."""

from typing import Any

import numpy as np

from benchmarks.li2023.test_functions import FUNCTIONS
from benchmarks.pages import as_markdown

from .paper import PAPER
from .runs import OPTIMIZERS, RUNS
from .statistics import agrees, cell_of, scores
from .tournament import Tournament

GROUPS = 10


def z_score_rows(results: Tournament) -> list[dict[str, Any]]:
    """One row a function and optimizer, from runs that are `GROUPS` times `RUNS` long."""
    rows = []
    for function in FUNCTIONS:
        for optimizer in OPTIMIZERS:
            final = results[function, optimizer].final.reshape(GROUPS, RUNS)
            found = scores(
                function, PAPER[function, optimizer], [cell_of(group) for group in final]
            )
            rows.append(
                {"function": function, "optimizer": optimizer, **found, "reproduces": agrees(found)}
            )
    return rows


def z_score_page(rows: list[dict[str, Any]], seconds: float, facts: dict[str, str]) -> str:
    """The scores of best, mean and deviation, with those beyond three in bold."""
    cells = {(row["function"], row["optimizer"]): row for row in rows}
    lines = [
        "# Table 2: z-scores of the printed cells",
        "",
        "(printed - a) / b, with a and b the mean and standard deviation of a statistic over ten "
        "groups of 30 runs; in log10 for F2 and F4. In each cell: best, mean, standard deviation, "
        "and, where all are positive, the mean in log10. A cell reproduces when both scores of its "
        "mean are at most three. Where a group's losses scatter over decades the linear score is "
        "never large; there only the last one says something. A dash: over two groups of ten count "
        "as 0 and have no logarithm.",
        "",
        as_markdown(facts),
        f"- time: {seconds:.0f} s",
        "",
        "| | " + " | ".join(name.upper() for name in OPTIMIZERS) + " |",
        "|---" * (len(OPTIMIZERS) + 1) + "|",
    ]
    for function in FUNCTIONS:
        shown = [_show(cells[function, optimizer]) for optimizer in OPTIMIZERS]
        lines.append(f"| {function} | " + " | ".join(shown) + " |")
    counts = [sum(cells[f, name]["reproduces"] for f in FUNCTIONS) for name in OPTIMIZERS]
    lines += [
        "| reproduce | " + " | ".join(f"{count} of {len(FUNCTIONS)}" for count in counts) + " |",
        "",
        "Cells that do not reproduce: "
        + ", ".join(
            f"{optimizer.upper()} {function}"
            for (function, optimizer), row in cells.items()
            if not row["reproduces"]
        )
        + ".",
        "",
    ]
    return "\n".join(lines)


def _show(row: dict[str, Any]) -> str:
    numbers = " ".join(_number(row[name]) for name in ("best", "mean", "std", "mean_log10"))
    return numbers if row["reproduces"] else f"**{numbers}**"


def _number(score: float) -> str:
    if np.isnan(score):
        return "-"
    if not np.isfinite(score):
        return "inf" if score > 0 else "-inf"
    return f"{score:.1f}" if abs(score) < 100 else f"{score:.0e}".replace("e+0", "e")

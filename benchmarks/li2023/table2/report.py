"""The table as CSV rows and as a Markdown page."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.li2023.test_functions import FUNCTIONS
from benchmarks.pages import as_markdown

from .paper import PAPER
from .runs import OPTIMIZERS
from .statistics import agrees, cell_of, ranks, resampled_cells, scores, without_rounding
from .tournament import Tournament


def table_rows(results: Tournament) -> list[dict[str, Any]]:
    """One row a function and optimizer: ours, the printed cell, both ranks, and the verdict."""
    rows = []
    for function in FUNCTIONS:
        ours = {
            name: without_rounding(function, cell_of(results[function, name].final))
            for name in OPTIMIZERS
        }
        theirs = {name: without_rounding(function, PAPER[function, name]) for name in OPTIMIZERS}
        our_ranks = ranks(np.array([ours[name].mean for name in OPTIMIZERS]))
        their_ranks = ranks(np.array([theirs[name].mean for name in OPTIMIZERS]))
        for place, name in enumerate(OPTIMIZERS):
            runs = results[function, name]
            # The printed cell scatters as ours does, so their difference does by sqrt(2) as much.
            found = scores(
                function, PAPER[function, name], resampled_cells(runs.final), deviations=2**0.5
            )
            rows.append(
                {
                    "function": function,
                    "optimizer": name,
                    **ours[name]._asdict(),
                    "rank": int(our_ranks[place]),
                    **{f"paper_{key}": value for key, value in theirs[name]._asdict().items()},
                    "paper_rank": int(their_ranks[place]),
                    "z_mean_30_runs": found["mean"],
                    "reproduces": agrees(found),
                    "evaluations": runs.evaluations,
                }
            )
    return rows


def average_ranks(rows: list[dict[str, Any]], column: str) -> dict[str, float]:
    """The mean rank of every optimizer over the functions."""
    return {
        name: float(np.mean([row[column] for row in rows if row["optimizer"] == name]))
        for name in OPTIMIZERS
    }


def markdown_page(
    rows: list[dict[str, Any]], seconds: Mapping[str, float], facts: dict[str, str]
) -> str:
    """The whole page."""
    cells = {(row["function"], row["optimizer"]): row for row in rows}
    good = [name for name, row in cells.items() if row["reproduces"]]
    bad = [name for name, row in cells.items() if not row["reproduces"]]
    lines = [
        "# Table 2 of Li et al. (2023), run again",
        "",
        "30 candidates, 500 iterations, 30 runs, 30 dimensions, as in the paper. In each cell: "
        "best, mean, standard deviation, (rank); ours above, the printed ones below. BMO and IBMO "
        "evaluate their parents again in every generation, as the printed F5 cells imply; PSO "
        "neither clips positions nor scales its velocity limit of 6.",
        "",
        as_markdown(facts),
        f"- time: {seconds['all']:.0f} s in all, compilation included ("
        + ", ".join(f"{name} {seconds[name]:.0f}" for name in OPTIMIZERS)
        + "; two at a time)",
        "",
        "| | " + " | ".join(name.upper() for name in OPTIMIZERS) + " |",
        "|---" * (len(OPTIMIZERS) + 1) + "|",
    ]
    for function in FUNCTIONS:
        lines.append(
            f"| **{function}** | "
            + " | ".join(_show(cells[function, name], "") for name in OPTIMIZERS)
            + " |"
        )
        lines.append(
            "| paper | "
            + " | ".join(_show(cells[function, name], "paper_") for name in OPTIMIZERS)
            + " |"
        )
    for label, column in (("average rank", "rank"), ("paper's", "paper_rank")):
        averages = average_ranks(rows, column)
        lines.append(f"| {label} | " + " | ".join(f"{averages[n]:.2f}" for n in OPTIMIZERS) + " |")
    evaluations = {name: cells["F1", name]["evaluations"] for name in OPTIMIZERS}
    lines += [
        "| evaluations | " + " | ".join(f"{evaluations[n]:,}" for n in OPTIMIZERS) + " |",
        "",
        "The paper announces average ranks and does not print them; those above follow from its "
        "means.",
        "",
        "![Best loss against evaluations](table2.png)",
        "",
        "The figure shows the median over the runs of the best loss so far.",
        "",
        "## Which cells reproduce",
        "",
        "A cell reproduces when its printed mean lies within three standard deviations of ours, "
        "on the plain and, where both are positive, the logarithmic scale; the deviation "
        "is that of the difference of two means of 30 runs, by resampling ours. Ten groups of 30 "
        "runs are the sharper test: by them 53 do (table2_z_scores.md, printed by version 0.1.0).",
        "",
        f"{len(good)} of {len(cells)} do:",
        "",
        *_by_optimizer(good),
        "",
        f"{len(bad)} do not:",
        "",
        *_by_optimizer(bad),
        "",
        "The IGWO column is not the improved grey wolf optimizer the paper cites "
        "(Nadimi-Shahraki et al., 2021); some other algorithm made it. F5's cells measure how "
        "often a uniform noise was drawn rather than a search: compare evaluations first.",
        "",
    ]
    return "\n".join(lines)


def _show(row: dict[str, Any], prefix: str) -> str:
    best, mean, std = (_number(row[prefix + name]) for name in ("best", "mean", "std"))
    return f"{best} {mean} {std} ({row[prefix + 'rank']})"


def _number(value: float) -> str:
    return "0" if value == 0 else f"{value:.1e}".replace("e-0", "e-").replace("e+0", "e")


def _by_optimizer(names: list[tuple[str, str]]) -> list[str]:
    return [
        f"- {optimizer.upper()}: "
        + (", ".join(f for f, other in names if other == optimizer) or "none")
        for optimizer in OPTIMIZERS
    ]

"""The Markdown page."""

import numpy as np

from benchmarks.li2023.test_functions import FUNCTIONS
from benchmarks.pages import as_markdown

from .runs import EVALUATIONS, POPULATION, REPORTING_KEY, RUNS, Losses
from .statistics import (
    SUCCESS,
    average_run_ranks,
    critical_difference,
    duels,
    friedman,
    losses_of,
    methods_under,
    summary_rows,
)
from .verdict import verdict_on_the_aims, verdict_on_the_origin

TITLES = {
    "centered": "The optimum at the origin (F3: -0.5, F9: -1)",
    "shifted": "Shifted",
    "rotated": "Shifted and rotated",
}
# Errors below this count as zero in the CEC competitions.
CEC_ZERO = 1e-8


def markdown_page(results: Losses, seconds: float, facts: dict[str, str]) -> str:
    """The whole page; the verdict first."""
    lines = [
        "# What is left away from the origin",
        "",
        f"F1 to F9 in 30 dimensions, F5 without its noise, {RUNS} runs, {EVALUATIONS:,} "
        f"evaluations with the initial {POPULATION} counted. Shifted: f(x - o), o uniform within "
        "0.6 half-widths; rotated: f(Q (x - o)), Q a random orthogonal matrix. A run has the same "
        "o and Q for all methods. No variant was chosen by these offsets, rotations and keys "
        f"(key {REPORTING_KEY}). DE is SciPy's `differential_evolution` with its defaults and 30 "
        "candidates; CMA-ES is the `cmaes` package with its defaults, from a random point with "
        "sigma 0.3 of the width.",
        "",
        as_markdown(facts),
        f"- time: {seconds:.0f} s",
        "",
        "## Verdict",
        "",
        *(f"{sentence}\n" for sentence in verdict_on_the_origin(results)),
        "The aims for `ibmo-centered`, on the shifted and rotated functions:",
        "",
        *(f"- {sentence}" for sentence in verdict_on_the_aims(results)),
        "",
        "![Critical differences](centre_bias.png)",
        "",
    ]
    for condition in TITLES:
        lines += _section(results, condition)
    return "\n".join(lines)


def _section(results: Losses, condition: str) -> list[str]:
    methods = methods_under(results, condition)
    losses = losses_of(results, condition, methods)
    average, p = friedman(losses)
    by_run = average_run_ranks(losses)
    by_cec = average_run_ranks(np.where(losses < CEC_ZERO, 0, losses))
    rows = {(r["function"], r["method"]): r for r in summary_rows(results, (condition,))}
    order = np.argsort(by_run)
    lines = [
        f"## {TITLES[condition]}",
        "",
        "Average ranks: over all runs of all functions; the same with losses under 1e-8 counted "
        "as zero, as the CEC competitions do; and Friedman's, over the nine functions "
        f"(p that no method differs: {p:.1e}; critical difference "
        f"{critical_difference(len(methods), len(FUNCTIONS)):.2f}).",
        "",
        "| method | runs | CEC | Friedman | success rate |",
        "|---|---|---|---|---|",
    ]
    for m in order:
        success = np.mean([rows[f, methods[m]]["success_rate"] for f in FUNCTIONS])
        lines.append(
            f"| {methods[m]} | {by_run[m]:.2f} | {by_cec[m]:.2f} | {average[m]:.2f} "
            f"| {100 * success:.0f} % |"
        )
    lines += [
        "",
        f"Mean / median / standard deviation (share of runs below {SUCCESS:g}):",
        "",
        "| | " + " | ".join(FUNCTIONS) + " |",
        "|---" * (len(FUNCTIONS) + 1) + "|",
    ]
    for m in order:
        cells = [_show(rows[function, methods[m]]) for function in FUNCTIONS]
        lines.append(f"| {methods[m]} | " + " | ".join(cells) + " |")
    if condition != "centered":
        lines += _duel_table(results, condition, [methods[m] for m in order])
    return [*lines, ""]


def _duel_table(results: Losses, condition: str, methods: list[str]) -> list[str]:
    others = [method for method in methods if method != "ibmo-centered"]
    found = {
        (duel.other, duel.function): duel
        for duel in duels(results, condition, "ibmo-centered", others)
    }
    lines = [
        "",
        f"`ibmo-centered` against each (Wilcoxon signed-rank, Holm over all {len(found)} tests, "
        "5 %):",
        "",
        "| against | " + " | ".join(FUNCTIONS) + " |",
        "|---" * (len(FUNCTIONS) + 1) + "|",
    ]
    for other in others:
        verdicts = [found[other, function].verdict for function in FUNCTIONS]
        lines.append(f"| {other} | " + " | ".join(verdicts) + " |")
    return lines


def _show(row: dict) -> str:
    numbers = " / ".join(f"{row[name]:.1e}" for name in ("mean", "median", "std"))
    return f"{numbers} ({100 * row['success_rate']:.0f} %)"

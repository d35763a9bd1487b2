"""The page `optimizers.md`, from what its sections measured."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks.pages import as_markdown

from .runs import BASELINES, SOLVED
from .statistics import a12, holm, rank_methods, signed_rank_p

# Okabe and Ito's colors, which the color-blind can tell apart, each solid and dashed.
COLORS = ("#E69F00", "#56B4E9", "#009E73", "#0072B2", "#D55E00", "#CC79A7", "#000000")


INTRODUCTION = (
    "The functions of CEC are the C++ of `minionpy`, in [-100, 100], those of BBOB the C of COCO's "
    "`cocoex`, in [-5, 5], an instance (1 to 15) a run; errors of 1e-8 or less count as zero "
    "and end a run, as in the competitions. All evaluations are counted by one wrapper, which "
    "forgets what is evaluated beyond the budget. `de` (rand/1/bin, F 0.5, CR 0.9, 10 D "
    "candidates), `l-shade` (18 D), `jso` and `bipop-cma-es` are those of `minionpy`; ours have 30 "
    "candidates, `ibmo-adaptive` 18 D; it was developed on the odd functions of CEC 2017. "
    "The competitions' own budgets are 30 runs of 200,000 and 1,000,000 evaluations on CEC 2022 in "
    "10 and 20 dimensions, 51 of 10,000 a dimension on CEC 2017. "
    "Targets are COCO's 51, 100 to 1e-8. *Solved* and *targets* are the shares of runs, and of "
    "pairs of run and target, that were reached."
)

# Section, title and columns of the tables that need no more words.
TABLES = {
    "circuit": (
        "The circuit: 32 keyed seeds within 1e-6 of the lowest RMSE",
        "method | candidates | evaluations | seeds there | median to 1e-6 | most to 1e-6",
    ),
    "speed": ("A generation of 30 in 30 dimensions, compiled", "method | us a generation"),
    "seeds": ("Seeds in one call: 200 generations of `ibmo`", "seeds | s | MiB"),
}


def table(header: list[str], rows: list[list[Any]]) -> list[str]:
    """The lines of a table, and an empty one."""

    def shown(value: Any) -> str:
        return f"{value:.3g}" if isinstance(value, float) else str(value)

    lines = [header, ["---"] * len(header), *([*map(shown, row)] for row in rows)]
    return [f"| {' | '.join(line)} |" for line in lines] + [""]


class Results:
    """The rows of one suite as arrays `[functions, methods, ...]`."""

    def __init__(self, rows: list[dict[str, Any]]):
        self.methods = [*dict.fromkeys(row["method"] for row in rows)]
        self.functions = [*dict.fromkeys(row["function"] for row in rows)]
        self.rows = {(row["function"], row["method"]): row for row in rows}
        self.errors = self.array("errors")
        self.errors[self.errors <= SOLVED] = 0

    def array(self, column: str) -> NDArray:
        return np.array(
            [[self.rows[f, m][column] for m in self.methods] for f in self.functions], float
        )

    @property
    def means(self) -> NDArray:
        return self.errors.mean(axis=-1)


def results_of(section: dict[str, Any]) -> dict[str, Results]:
    """The results of every suite of a section."""
    return {
        name: Results([row for row in section["rows"] if row["suite"] == name])
        for name, *_ in section["suites"]
    }


def ranking(results: Results, against: str | None = None) -> list[str]:
    """Ranks, and every method against one, by default the best of ours."""
    ranks = rank_methods(results.means)
    ours = [index for index, name in enumerate(results.methods) if name not in BASELINES]
    best = min(ours, key=lambda index: ranks.mean_ranks[index])
    best = best if against is None else results.methods.index(against)
    others = [index for index in range(len(results.methods)) if index != best]
    logs = np.log10(np.maximum(results.means, SOLVED))
    p_values = holm([signed_rank_p(logs[:, best], logs[:, other]) for other in others])
    tested = dict(zip(others, p_values, strict=True)) | {best: np.nan}
    solved, reached = results.errors == 0, results.array("reached")[..., -1]
    rows = []
    for index in np.argsort(ranks.mean_ranks):
        pairs = zip(results.errors[:, best], results.errors[:, index], strict=True)
        effects = [a12(first, second) for first, second in pairs]
        lower = np.sum(results.means[:, best] < results.means[:, index])
        higher = np.sum(results.means[:, best] > results.means[:, index])
        compared = [float(tested[index]), float(np.mean(effects)), f"{lower} / {higher}"]
        share = [f"{100 * np.mean(part[:, index]):.0f} %" for part in (solved, reached)]
        shown = [""] * 3 if index == best else compared
        rows.append([results.methods[index], f"{ranks.mean_ranks[index]:.2f}", *share, *shown])
    return [
        f"Friedman's p that no method differs is {ranks.p_value:.1g}; mean ranks that differ by "
        f"less than {ranks.critical_difference:.2f} do not differ (Nemenyi, 5 %). Compared with "
        f"{against or results.methods[best] + ', the best of ours'}: p by Wilcoxon's signed ranks "
        "of the mean errors' logarithms, with Holm's correction; A12, the chance that a run of it "
        "ends lower; functions on which its mean is lower and higher.",
        "",
        *table(["method", "mean rank", "solved", "targets", "p", "A12", "lower / higher"], rows),
    ]


def errors_and_times(results: Results) -> list[str]:
    """Mean errors of every function, and the expected evaluations to the targets."""
    header, ert = ["", *results.methods], results.array("ert")
    means = [
        [f"F{f}", *map(float, row)] for f, row in zip(results.functions, results.means, strict=True)
    ]
    rows = [
        [f"F{number} to {target}", *(f"{t:,.0f}" if np.isfinite(t) else "" for t in times)]
        for number, of_function in zip(results.functions, ert, strict=True)
        for target, times in zip(("1", "0.0001", "1e-8"), of_function.T, strict=True)
        if np.isfinite(times).mean() >= 0.5
    ]
    return [
        "Mean errors:",
        "",
        *table(header, means),
        "Expected evaluations (ERT) to targets that half of the methods reach:",
        "",
        *table(header, rows),
    ]


@rc_context({"font.size": 14})
def ecdf_figure(sections: dict[str, dict[str, Any]], spent: NDArray) -> Figure:
    """Share of targets reached against evaluations a dimension, a panel a suite."""
    suites = {name: Results(section["rows"]) for name, section in sections.items()}
    rows = -(-len(suites) // 2)
    figure = Figure(figsize=(8, 1.5 + 2.8 * rows), layout="constrained")
    panels = figure.subplots(rows, 2, squeeze=False, sharey=True).ravel()
    for axes in panels[len(suites) :]:
        axes.remove()
    for axes, (title, results), section in zip(
        panels, suites.items(), sections.values(), strict=False
    ):
        # Runs end there.
        most = max(budget / dims for *_, dims, _, budget, _ in section["suites"])
        shares = results.array("reached").mean(axis=0)
        for number, (name, share) in enumerate(zip(results.methods, shares, strict=True)):
            style = "-" if number < len(COLORS) else "--"
            axes.plot(spent, share, style, color=COLORS[number % len(COLORS)], label=name)
        axes.set(xscale="log", title=title, xlabel="evaluations / dimension", xlim=(spent[0], most))
        axes.grid(alpha=0.3)
    figure.supylabel("share of targets reached")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def heading(title: str, section: dict[str, Any]) -> list[str]:
    facts, minutes = section["facts"], section["seconds"] / 60
    return [f"## {title}", "", f"{facts['command']}, {facts['date']}, {minutes:.0f} min.", ""]


def of_suites(section: dict[str, Any]) -> Iterator[tuple[str, Results]]:
    """What was run on every suite, and its results."""
    suites = section["suites"]
    for (name, results), (*_, budget, runs) in zip(
        results_of(section).items(), suites, strict=True
    ):
        count = len(results.functions)
        yield f"{name}: {count} functions, {runs} runs of {budget:,} evaluations", results


def page(sections: dict[str, Any], suites: list[str], missing: list[str]) -> str:
    """The page from everything that was measured."""
    lines = ["# Optimizers beside those that win the CEC competitions", "", INTRODUCTION, ""]
    lines += [as_markdown(sections[suites[0]]["facts"]), ""]
    if missing:
        lines += [f"Not measured yet: {'; '.join(missing)}.", ""]
    for name in suites:
        for title, results in of_suites(sections[name]):
            lines += heading(title, sections[name])
            lines += [*ranking(results), *errors_and_times(results)]
    lines += ["## Targets reached", "", "![Share of targets reached](optimizers.png)", ""]
    for name, title in (("ablation", "each part"), ("restarts", "a restart")):
        if name not in sections:
            continue
        lines += heading(f"What {title} of `ibmo-adaptive` is worth", sections[name])
        for title, results in of_suites(sections[name]):
            lines += [f"### {title}", "", *ranking(results, "ibmo-adaptive")]
    for name in [name for name in TABLES if name in sections]:
        title, columns = TABLES[name]
        lines += heading(title, sections[name])
        lines += table(columns.split(" | "), sections[name]["rows"])
    return "\n".join(lines)

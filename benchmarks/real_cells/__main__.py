"""Run with `python -m benchmarks.real_cells [FOLDER OF MEASURED CELLS]`.

Without the folder only the bundled cell runs. Writes benchmarks/results/real_cells.md.
"""

import sys
from datetime import date
from pathlib import Path

from barnax.reporting.wording import wording
from benchmarks.pages import save_page

from .cases import BUDGET, EXACT, Ran, cases, data_folder, run
from .tables import (
    conditions_table,
    count_sentences,
    differences_table,
    rows_table,
    summary_table,
    verdict_sentences,
)

RESULTS = Path(__file__).parents[1] / "results" / "real_cells.md"


def page(runs: list[Ran]) -> str:
    """The whole page."""
    lines = [
        "# Models and methods on measured cells",
        "",
        "Printed by `python -m benchmarks.real_cells FOLDER`, with the folder of measured cells, "
        f"{date.today()}. Interpolated OCV; population {BUDGET.population}, {BUDGET.iterations} "
        f"generations, {BUDGET.seeds} seeds, key {BUDGET.key}, raw R and C; bounds as `barnax "
        "compare` sets them. The OCV of the Samsung cell was measured at 25 degC, on another "
        "specimen.",
        "",
        "## Which model is best",
        "",
        f"The best circuit of each model in its box ({EXACT}, which draws nothing; its optimality "
        "gap below is measured against the global optimum), so that searches play no part. RMSE in "
        "mV.",
        "",
        *summary_table(runs),
        "",
        "Differences of RMSE with 95 % intervals of a moving-block bootstrap over time; n.s.: the "
        "interval holds zero.",
        "",
        *differences_table(runs),
        "",
        *count_sentences(runs),
        "",
        "## Why",
        "",
        *conditions_table(runs),
        "",
        "All three models share the OCV and differ in where between its branches they are: so-rc "
        "in the middle, iso-rc on the branch of the last current, esc on its way there. After a "
        "full charge esc starts on the charge branch, so it does not contain so-rc: where the "
        "middle is best throughout, it loses by its way down.",
        "",
    ]
    for ran in runs:
        lines += [f"## {ran.name}", "", *verdict_sentences(ran), "", *rows_table(ran), ""]
        lines += [
            f"- {name}: {wording('circuit.optimum', model.optimum)}."
            for name, model in ran.comparison.models.items()
            if model.optimum is not None
        ]
        lines.append("")
    return "\n".join(lines)


def main() -> None:
    """Measure, print the page and write it."""
    folder = data_folder(sys.argv[1] if len(sys.argv) > 1 else None)
    if folder is None:
        print(
            "the measured cells are not here (give their folder, or set BARNAX_SHARED_DATA); "
            "only the bundled cell runs, and nothing is written",
            file=sys.stderr,
        )
    runs: list[Ran] = []
    for case in cases(folder):
        runs += run(case)
        print(case.name, "done", file=sys.stderr)
    text = page(runs)
    if folder is not None:
        save_page(RESULTS, text)
    print(text)


if __name__ == "__main__":
    main()

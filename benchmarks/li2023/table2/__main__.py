"""Command: `python -m benchmarks.li2023.table2`, or with `--z-scores` the long one."""

import argparse
from pathlib import Path

from benchmarks.pages import provenance, save_figure, save_page, write_csv

from .figures import convergence_figure
from .report import markdown_page, table_rows
from .runs import RUNS
from .tournament import play
from .z_scores import GROUPS, z_score_page, z_score_rows

RESULTS = Path(__file__).parents[2] / "results"


def main() -> None:
    """Run the tournament and write its table, page and figure."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.li2023.table2", description=__doc__)
    parser.add_argument("--key", type=int, default=2023, help="seed of all runs")
    parser.add_argument("--z-scores", action="store_true", help="ten groups of 30 runs (long)")
    parser.add_argument("--workers", type=int, default=2, help="optimizers run at once")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder to write to")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)

    command = "python -m benchmarks.li2023.table2" + (" --z-scores" if options.z_scores else "")
    # Groups that are to judge the table are none of its own runs.
    key = options.key + options.z_scores
    facts = provenance(command, key)
    runs = GROUPS * RUNS if options.z_scores else RUNS
    results, seconds = play(key, runs, options.workers)
    if options.z_scores:
        rows = z_score_rows(results)
        page = z_score_page(rows, seconds["all"], facts)
        name = "table2_z_scores"
    else:
        rows = table_rows(results)
        page = markdown_page(rows, seconds, facts)
        name = "table2"
        save_figure(options.out / "table2.png", convergence_figure(results), dpi=110)
    write_csv(options.out / f"{name}.csv", rows)
    save_page(options.out / f"{name}.md", page)
    print(page)


if __name__ == "__main__":
    main()

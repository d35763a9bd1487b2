"""Command: `python -m benchmarks.li2023.table2`."""

import argparse
from pathlib import Path

from benchmarks.pages import provenance, publish, save_figure, write_csv

from .figures import convergence_figure
from .report import markdown_page, table_rows
from .runs import RUNS
from .tournament import play

RESULTS = Path(__file__).parents[2] / "results"


def main() -> None:
    """Run the tournament and write its table, page and figure."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.li2023.table2", description=__doc__)
    parser.add_argument("--key", type=int, default=2023, help="seed of all runs")
    parser.add_argument("--workers", type=int, default=2, help="optimizers run at once")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder to write to")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)

    facts = provenance("python -m benchmarks.li2023.table2", options.key)
    results, seconds = play(options.key, RUNS, options.workers)
    rows = table_rows(results)
    page = markdown_page(rows, seconds, facts)
    save_figure(options.out / "table2.png", convergence_figure(results), dpi=110)
    write_csv(options.out / "table2.csv", rows)
    publish(options.out / "table2.md", page)


if __name__ == "__main__":
    main()

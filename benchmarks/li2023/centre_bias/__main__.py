"""Command: `python -m benchmarks.li2023.centre_bias`."""

import argparse
import time
from pathlib import Path

from benchmarks.pages import provenance, publish, save_figure, write_csv

from .baselines import play_baselines
from .figures import critical_difference_figure
from .report import markdown_page
from .runs import CONDITIONS, REPORTING_KEY, optimizers_at_equal_evaluations, play
from .statistics import summary_rows

RESULTS = Path(__file__).parents[2] / "results"


def main() -> None:
    """Run the comparison, and write its table, page and figure."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.li2023.centre_bias", description=__doc__
    )
    parser.add_argument("--workers", type=int, default=2, help="methods run at once")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder to write to")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    begin = time.perf_counter()
    facts = provenance("python -m benchmarks.li2023.centre_bias", REPORTING_KEY, "cmaes")
    optimizers = optimizers_at_equal_evaluations()
    results = play(optimizers, CONDITIONS, REPORTING_KEY, workers=options.workers)
    results |= play_baselines(("shifted", "rotated"), REPORTING_KEY, options.workers)
    page = markdown_page(results, time.perf_counter() - begin, facts)
    save_figure(options.out / "centre_bias.png", critical_difference_figure(results), dpi=110)
    conditions = tuple(dict.fromkeys(condition for condition, _, _ in results))
    write_csv(options.out / "centre_bias.csv", summary_rows(results, conditions))
    publish(options.out / "centre_bias.md", page)


if __name__ == "__main__":
    main()

"""Command: `python -m benchmarks.li2023.centre_bias`; with `--ablation`, of the parts of ours."""

import argparse
import time
from pathlib import Path

from benchmarks.pages import provenance, save_figure, save_page, write_csv

from .ablation import ablation_page, variants
from .baselines import play_baselines
from .figures import critical_difference_figure
from .report import markdown_page
from .runs import (
    CONDITIONS,
    DEVELOPMENT_KEY,
    REPORTING_KEY,
    optimizers_at_equal_evaluations,
    play,
)
from .statistics import summary_rows

RESULTS = Path(__file__).parents[2] / "results"


def main() -> None:
    """Run the comparison, or the ablation, and write its table, page and figure."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.li2023.centre_bias", description=__doc__
    )
    parser.add_argument("--ablation", action="store_true", help="parts of ibmo-centered")
    parser.add_argument("--workers", type=int, default=2, help="methods run at once")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder to write to")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    begin = time.perf_counter()
    if options.ablation:
        facts = provenance("python -m benchmarks.li2023.centre_bias --ablation", DEVELOPMENT_KEY)
        results = play(variants(), ("rotated",), DEVELOPMENT_KEY, workers=options.workers)
        page = ablation_page(results, time.perf_counter() - begin, facts)
        name = "centre_bias_ablation"
    else:
        facts = provenance("python -m benchmarks.li2023.centre_bias", REPORTING_KEY, "cmaes")
        optimizers = optimizers_at_equal_evaluations()
        results = play(optimizers, CONDITIONS, REPORTING_KEY, workers=options.workers)
        results |= play_baselines(("shifted", "rotated"), REPORTING_KEY, options.workers)
        page = markdown_page(results, time.perf_counter() - begin, facts)
        name = "centre_bias"
        save_figure(options.out / f"{name}.png", critical_difference_figure(results), dpi=110)
    conditions = tuple(dict.fromkeys(condition for condition, _, _ in results))
    write_csv(options.out / f"{name}.csv", summary_rows(results, conditions))
    save_page(options.out / f"{name}.md", page)
    print(page)


if __name__ == "__main__":
    main()

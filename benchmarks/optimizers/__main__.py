"""`python -m benchmarks.optimizers` runs our optimizers and those that win the CEC competitions on
CEC 2017 and 2022 and on BBOB at equal evaluations; `--quick` takes a share of runs and evaluations.
`--only SECTION` measures a section again and leaves the others on the page as they are; `--runs`
takes fewer runs of as many evaluations."""

import argparse
import json
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.pages import provenance, publish, save_figure, save_page

from .page import ecdf_figure, page
from .runs import BASELINES, BBOB, OURS, RESTARTS, SPENT, VARIANTS, Suite, measure_suites
from .sections import circuit, many_seeds, speed

FOLDER = Path(__file__).parents[1] / "results"
ALL_2022 = tuple(range(1, 13))
ALL_BBOB = tuple(range(1, 25))
ODD, EVEN = tuple(range(1, 31, 2)), tuple(range(2, 31, 2))
# The competitions' evaluations and runs, and those of `--quick`.
SUITES = (
    (Suite(2022, 10, ALL_2022, 200_000, 30), (20_000, 5)),
    (Suite(2022, 20, ALL_2022, 1_000_000, 30), (20_000, 3)),
    (Suite(2017, 10, EVEN, 100_000, 51), (20_000, 3)),
    (Suite(2017, 30, EVEN, 300_000, 51), (30_000, 3)),
    (Suite(2017, 50, EVEN, 500_000, 51), (50_000, 3)),
    (Suite(BBOB, 10, ALL_BBOB, 100_000, 15), (20_000, 15)),
    (Suite(BBOB, 20, ALL_BBOB, 200_000, 15), (40_000, 15)),
)


def sections(
    is_quick: bool, workers: int, most_runs: int = 51
) -> dict[str, Callable[[], dict[str, Any]]]:
    """What measures each section, by its name: a suite's, and the others."""
    chosen = [
        suite._replace(budget=quick[0], runs=quick[1])
        if is_quick
        else suite._replace(runs=min(suite.runs, most_runs))
        for suite, quick in SUITES
    ]
    # On the functions that `ibmo-adaptive` was developed on, and on others.
    budget, runs = (10_000, 3) if is_quick else (100_000, 51)
    halves = [Suite(2017, 10, ODD, budget, runs), Suite(2022, 10, ALL_2022, budget, runs)]
    methods = (*OURS, *BASELINES)
    # Restarts come after 200 generations of stagnation, which smaller budgets do not have.
    restarted = [half._replace(budget=100_000, runs=5 if is_quick else 51) for half in halves]
    return {
        **{s.name: partial(measure_suites, [s], methods, workers) for s in chosen},
        "ablation": partial(measure_suites, halves, VARIANTS, workers),
        "restarts": partial(measure_suites, restarted, RESTARTS, workers),
        "circuit": circuit,
        "speed": speed,
        "seeds": many_seeds,
    }


def main() -> None:
    """Measure the sections asked for, keep their rows, and print the page of all of them."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.optimizers", description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--runs", type=int, default=51, help="at most so many runs of a suite")
    parser.add_argument("--only", nargs="*", metavar="SECTION")
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder to write to")
    options = parser.parse_args()
    raw = options.out / "optimizers.json"
    measured = json.loads(raw.read_text(encoding="utf-8")) if raw.exists() else {}
    measures = sections(options.quick, options.workers, options.runs)
    if unknown := {*(options.only or ())} - measures.keys():
        parser.error(f"no section is called {min(unknown)!r}; there are {', '.join(measures)}")
    command = "python -m benchmarks.optimizers" + " --quick" * options.quick
    command += f" --runs {options.runs}" * (options.runs != parser.get_default("runs"))
    for name in measures if options.only is None else options.only:
        start = time.perf_counter()
        rows = measures[name]()
        packages = ["minionpy", *["coco-experiment"] * name.startswith("BBOB")]
        facts = provenance(command, 0, *packages)
        measured[name] = rows | {"facts": facts, "seconds": time.perf_counter() - start}
        save_page(raw, json.dumps(measured, separators=(",", ":")) + "\n")
    missing = [name for name in sections(False, 1) if name not in measured]
    suites = [name for name in measured if name.startswith(("CEC", "BBOB"))]
    if not suites:
        parser.error("the page begins with a suite of functions; measure one of them too")
    publish(options.out / "optimizers.md", page(measured, suites, missing))
    figure = ecdf_figure({name: measured[name] for name in suites}, SPENT)
    save_figure(options.out / "optimizers.png", figure, dpi=80)


if __name__ == "__main__":
    main()

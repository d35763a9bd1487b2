"""`python -m benchmarks.optimizers` runs our optimizers and those that win the CEC competitions on
CEC 2017 and 2022 at equal evaluations; `--quick` takes fewer runs and a share of the evaluations.
`--only SECTION` measures a section again and leaves the others on the page as they are."""

import argparse
import itertools
import json
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.pages import provenance, publish, save_figure, save_page

from .page import ecdf_figure, page
from .runs import BASELINES, OURS, VARIANTS, Suite, run_method
from .sections import circuit, many_seeds, speed
from .statistics import expected_evaluations, reached

FOLDER = Path(__file__).parents[1] / "results"
ALL_2022 = tuple(range(1, 13))
ODD, EVEN = tuple(range(1, 31, 2)), tuple(range(2, 31, 2))
# Each whole, and quick: evaluations and runs. The competitions' are the whole ones.
SUITES = (
    (Suite(2022, 10, ALL_2022, 200_000, 30), (100_000, 5)),
    (Suite(2022, 20, ALL_2022, 1_000_000, 30), (100_000, 5)),
    (Suite(2017, 10, EVEN, 100_000, 51), (25_000, 5)),
    (Suite(2017, 30, EVEN, 300_000, 51), None),
    (Suite(2017, 50, EVEN, 500_000, 51), None),
)
# Evaluations a dimension at which the share of reached targets is taken; columns of the ERT.
SPENT, ERT = np.logspace(0.5, 5, 28), [10, 30, 50]


def measured(task: tuple[str, Suite]) -> list[dict[str, Any]]:
    """The runs of one method on the functions of a suite, a row a function."""
    name, suite = task
    return [
        {
            "suite": suite.name,
            "function": number,
            "method": name,
            "errors": [float(f"{error:.4g}") for error in record.best],
            "reached": [round(reached(record.hits, suite.dims * spent), 4) for spent in SPENT],
            "ert": [expected_evaluations(hits, suite.budget) for hits in record.hits.T[ERT]],
        }
        for number, record in zip(suite.functions, run_method(name, suite), strict=True)
    ]


def measure_suites(suites: Iterable[Suite], methods: Iterable[str], workers: int) -> dict[str, Any]:
    """Rows of every method on every function of every suite."""
    tasks = itertools.product(methods, suites)
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        rows = [*itertools.chain.from_iterable(pool.map(measured, tasks))]
    return {"rows": rows, "suites": [(suite.name, *suite) for suite in suites]}


def suites(options: argparse.Namespace) -> dict[str, Any]:
    """All methods on the judged functions."""
    chosen = [
        suite._replace(budget=quick[0], runs=quick[1]) if options.quick else suite
        for suite, quick in SUITES
        if quick or not options.quick
    ]
    return measure_suites(chosen, (*OURS, *BASELINES), options.workers)


def ablation(options: argparse.Namespace) -> dict[str, Any]:
    """The variants of `ibmo-adaptive`, on the functions it was developed on and on others."""
    budget, runs = (20_000, 5) if options.quick else (100_000, 51)
    chosen = [Suite(2017, 10, ODD, budget, runs), Suite(2022, 10, ALL_2022, budget, runs)]
    return measure_suites(chosen, VARIANTS, options.workers)


SECTIONS: dict[str, Callable[[argparse.Namespace], dict[str, Any]]] = {
    "suites": suites,
    "ablation": ablation,
    "circuit": lambda options: circuit(),
    "speed": lambda options: speed(),
    "seeds": lambda options: many_seeds(),
}


def main() -> None:
    """Measure the sections asked for, keep their rows, and print the page of all of them."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.optimizers", description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--only", nargs="*", choices=SECTIONS, default=[*SECTIONS])
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder to write to")
    options = parser.parse_args()
    raw = options.out / "optimizers.json"
    sections = json.loads(raw.read_text(encoding="utf-8")) if raw.exists() else {}
    command = "python -m benchmarks.optimizers" + " --quick" * options.quick
    for name in options.only:
        start = time.perf_counter()
        sections[name] = SECTIONS[name](options)
        facts = provenance(command, 0, "minionpy", "cmaes")
        sections[name] |= {"facts": facts, "seconds": time.perf_counter() - start}
        save_page(raw, json.dumps(sections, separators=(",", ":")) + "\n")
    if sections.keys() == SECTIONS.keys():
        publish(options.out / "optimizers.md", page(sections))
        save_figure(options.out / "optimizers.png", ecdf_figure(sections["suites"], SPENT), dpi=80)


if __name__ == "__main__":
    main()

"""Command: `python -m benchmarks.li2023.rule_check`."""

import argparse
import importlib.metadata
import json
import os
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.environments import WorkerError, make_environment, run_worker
from benchmarks.pages import provenance, save_page

from .coco_report import running_times
from .comparisons import COMPARISONS, REQUIREMENTS
from .ours import Sample, make_experiment, our_samples, our_values
from .report import markdown_page, outcomes
from .sizes import COCO_FUNCTIONS

HERE = Path(__file__).parent
RESULTS = HERE.parents[1] / "results"
KEY = 20_261_122
# The versions the baselines of centre_bias have here.
COCO_REQUIREMENTS = (
    "cma==4.5.0",
    *(f"{name}=={importlib.metadata.version(name)}" for name in ("cmaes", "numpy", "scipy")),
)
COCO_TASKS = [f"{method}-{function}" for method in ("de", "cma-es") for function in COCO_FUNCTIONS]
VALUED = ("evolopy", "niapy", "mealpy")


def make_environments() -> tuple[dict[str, Path], dict[str, str]]:
    """By library, the Python that has it, or why there is none."""
    wanted = {name: (requirement,) for name, requirement in REQUIREMENTS.items()}
    pythons, missing = {}, {}
    for name, requirements in (wanted | {"coco": COCO_REQUIREMENTS}).items():
        try:
            pythons[name] = make_environment(name, *requirements)
        except WorkerError as error:
            missing[name] = str(error)
    return pythons, missing


def play(
    pythons: dict[str, Path], experiment: dict, workers: int
) -> tuple[dict, dict[tuple[str, str], Any], dict[str, str]]:
    """What ours find, what every task of theirs printed, and why where it failed."""
    runs = {(other.library, other.task): other.runs for other in reversed(COMPARISONS)}
    tasks = [*runs, *(("coco", task) for task in COCO_TASKS)]
    tasks += [(library, "values") for library in VALUED]
    found, missing = {}, {}
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(workers) as pool:
        path = Path(folder) / "experiment.json"
        path.write_text(json.dumps(experiment))
        running = {
            (library, task): pool.submit(
                run_worker,
                pythons[library],
                HERE / f"{library}_worker.py",
                path,
                task,
                str(runs.get((library, task), "")),
            )
            for library, task in tasks
            if library in pythons
        }
        ours = pool.submit(our_samples, experiment)
        for name, future in running.items():
            try:
                found[name] = future.result()
            except WorkerError as error:
                missing[" ".join(name)] = str(error)
        return ours.result(), found, missing


def main() -> None:
    """Run all, print the page and write it."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.li2023.rule_check", description=__doc__
    )
    parser.add_argument("--workers", type=int, default=2, help="processes at once")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder to write to")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)

    pythons, missing = make_environments()
    begin = sum(os.times()[:4])
    experiment = make_experiment(KEY)
    ours, found, failed = play(pythons, experiment, options.workers)
    theirs = {
        comparison.name: Sample(
            {name: np.array(losses) for name, losses in answer["final"].items()},
            answer["evaluations"],
        )
        for comparison in COMPARISONS
        if (answer := found.get((comparison.library, comparison.task)))
    }
    their_values = {
        library: {name: np.array(value) for name, value in found[library, "values"].items()}
        for library in VALUED
        if (library, "values") in found
    }
    facts = provenance("python -m benchmarks.li2023.rule_check", KEY, "cmaes") | {
        "against": ", ".join([*REQUIREMENTS.values(), COCO_REQUIREMENTS[0]])
        + ", in environments that this command makes",
        "time": f"{sum(os.times()[:4]) - begin:.0f} s of CPU time in all, "
        f"processes at once: {options.workers}, beside making the environments",
    }
    page = markdown_page(
        outcomes(ours, theirs),
        our_values(experiment["points"]),
        their_values,
        [
            running_times(task, found["coco", task])
            for task in COCO_TASKS
            if ("coco", task) in found
        ],
        missing | failed,
        facts,
    )
    save_page(options.out / "rule_check.md", page)
    print(page)


if __name__ == "__main__":
    main()

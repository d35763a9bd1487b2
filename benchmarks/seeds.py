"""How many seeds of each optimizer find the optimum: `python -m benchmarks.seeds`.

On the bundled cell, iso-rc with interpolated OCV, in both coordinates, before refinement, against
the best refined answer of all. Writes benchmarks/results/seeds.md.
"""

from datetime import date
from pathlib import Path

import jax
import numpy as np

import barnax
from barnax.bundled import BUNDLED
from barnax.model.coordinates import SCALES
from benchmarks.pages import publish

RESULTS = Path(__file__).parent / "results" / "seeds.md"
KEY, SEEDS, POPULATION, EVALUATIONS = 1, 32, 30, 15_000
REACHED = 1e-3


def main() -> None:
    """Measure, print the page and write it."""
    tests = [barnax.read_record(path) for path in BUNDLED.ocv]
    cell = barnax.characterize(tests, ocv_fit="interpolated")
    record = barnax.read_record(barnax.bundled_file("identification"))
    searched, refined = {}, []
    for scale in SCALES:
        problem = barnax.make_problem(record, cell, "iso-rc", coordinates=scale)
        for name in barnax.OPTIMIZERS:
            cost = barnax.optimizers.evaluations_per_iteration(
                barnax.make_optimizer(name, POPULATION, 1)
            )
            iterations = (EVALUATIONS - POPULATION) // cost
            optimizer = barnax.make_optimizer(name, POPULATION, iterations)
            found = barnax.search_seeds(problem, optimizer, key=jax.random.key(KEY), seeds=SEEDS)
            searched[scale, name] = np.array([seed.rmse_v for seed in found.seeds])
            if name == "ibmo-centered":
                refined.append(barnax.refine(found).rmse_v)
    best_v = min(refined)
    lines = [
        "# How many seeds find the optimum",
        "",
        f"Printed by `python -m benchmarks.seeds`, {date.today()}. Bundled cell, iso-rc, "
        f"interpolated OCV, key {KEY}, {SEEDS} seeds of at most {EVALUATIONS} evaluations each, "
        f"before refinement. The best refined RMSE is {1e3 * best_v:.4f} mV; a seed counts as "
        f"there within {100 * REACHED:.1g} %.",
        "",
        "| coordinates | optimizer | seeds there | best excess [%] | median excess [%] "
        "| worst excess [%] |",
        "|---|---|---|---|---|---|",
    ]
    for (scale, name), errors_v in searched.items():
        excess = errors_v / best_v - 1
        figures = [
            f"{100 * value:.3g}" for value in (excess.min(), np.median(excess), excess.max())
        ]
        there = f"{np.count_nonzero(excess < REACHED)} of {SEEDS}"
        lines.append(f"| {' | '.join([scale, name, there, *figures])} |")
    publish(RESULTS, "\n".join([*lines, ""]))


if __name__ == "__main__":
    main()

"""Do 95 % intervals hold the truth 95 % of the time? `python -m benchmarks.coverage`.

Known circuits on the bundled cell's current, simulated with SciPy's lfilter, under noise of
several correlation times: 200 records each, identified again by Levenberg-Marquardt that starts at
the truth. Counts how often the trusted, the profile's and the plain interval of every parameter
hold it. Then the bundled cell itself, and measured cells where their folder is given:
`python -m benchmarks.coverage [FOLDER OF MEASURED CELLS]`.
Writes benchmarks/results/coverage.md.
"""

import sys
from collections.abc import Sequence
from datetime import date
from pathlib import Path

import jax

import barnax
from barnax.model.problem import Problem
from barnax.reporting.wording import sentences, wording
from barnax.uncertainty import assess
from benchmarks.pages import publish

from .cells import bundled, measured
from .simulated import CIRCUITS, NOISES, chance_band, coverage, values_of

RESULTS = Path(__file__).parents[1] / "results" / "coverage.md"
RECORDS, SEED, KEY = 200, 20, 0


def simulated_page() -> list[str]:
    """Coverage of every circuit under every noise."""
    problem = bundled("so-rc")
    low, high = chance_band(RECORDS)
    lines = [
        "## Known circuits, simulated",
        "",
        f"{RECORDS} records of {problem.scored} samples at 1 s each, seed {SEED}. Refits start at "
        "the truth: a search that ends in another optimum is not counted here. With "
        f"{RECORDS} records a share of 95 % has a standard error of 1.5 %, and lies in "
        f"{100 * low:.1f} to {100 * high:.1f} % but once in 1,000 times. Open intervals hold "
        "everything and count as none that hold the truth; the last column has their number over "
        "all parameters. The inflation is the trusted standard error over the plain one, its mean.",
        "",
    ]
    for truth in CIRCUITS:
        names = list(values_of(truth))
        values = ", ".join(f"{name} {value:.4g}" for name, value in values_of(truth).items())
        lines += [
            f"Truth: {values}.",
            "",
            f"| noise | interval | {' | '.join(names)} | at a bound | open |",
            f"|---|---|{'---|' * (len(names) + 2)}",
        ]
        for noise in NOISES:
            found = coverage(problem, truth, noise, RECORDS, SEED)
            kinds = {"trusted": found.trusted, "profile": found.profile, "plain": found.plain}
            opened = {"trusted": sum(found.open.values()), "profile": "", "plain": ""}
            for kind, shares in kinds.items():
                cells = " | ".join(
                    f"{100 * shares[name]:.1f} %" if name in shares else "-" for name in names
                )
                lines.append(f"| {noise.name} | {kind} | {cells} | {found.held} | {opened[kind]} |")
            cells = " | ".join(f"{found.inflation[name]:.1f}" for name in names)
            lines.append(f"| {noise.name} | inflation | {cells} | | |")
            print(truth, noise.name, found, file=sys.stderr)
        lines.append("")
    return lines


def cell_page(name: str, problem: Problem) -> list[str]:
    """Intervals of one cell, plain and trusted."""
    optimizer = barnax.make_optimizer("ibmo-centered", 30, 200)
    found = barnax.search_seeds(problem, optimizer, key=jax.random.key(KEY), seeds=8)
    refinement = barnax.refine(found)
    assessment = assess(problem, refinement.parameters)
    words = [
        wording("circuit.uncertainty", assessment.uncertainty),
        *sentences("circuit.identifiability", assessment.identifiability.findings),
        *sentences("circuit.diagnostics", assessment.diagnostics),
    ]
    lines = [
        f"## {name}",
        "",
        f"RMSE {1e3 * refinement.rmse_v:.3f} mV. {' '.join(words)}",
        "",
        "| parameter | value | plain | trusted | inflation | degrees of freedom | 95 % interval |",
        "|---|---|---|---|---|---|---|",
    ]
    for each in assessment.uncertainty.estimates:
        if each.relative_error is None or each.white_noise_relative_error is None:
            lines.append(f"| {each.name} | {each.value:.4g} | {each.held} | | | | |")
            continue
        ends = "open" if each.low is None else f"{each.low:.4g} to {each.high:.4g}"
        figures = (each.white_noise_relative_error, each.relative_error)
        plain, trusted = (f"{100 * error:.2f} %" for error in figures)
        lines.append(
            f"| {each.name} | {each.value:.4g} | {plain} | {trusted} | {each.inflation:.1f} "
            f"| {each.degrees_of_freedom:.1f} | {ends} |"
        )
    return [*lines, ""]


def main(arguments: Sequence[str]) -> None:
    """Measure, print the page and write it."""
    lines = [
        "# Do the intervals hold?",
        "",
        f"Printed by `python -m benchmarks.coverage [FOLDER OF MEASURED CELLS]`, {date.today()}.",
        "",
        *simulated_page(),
        *cell_page("Bundled virtual cell, iso-rc", bundled("iso-rc")),
    ]
    if arguments:
        problem = measured(Path(arguments[0]))
        lines += cell_page("CALCE INR18650-20R, DST at 25 degC, so-rc", problem)
    publish(RESULTS, "\n".join(lines))


if __name__ == "__main__":
    main(sys.argv[1:])

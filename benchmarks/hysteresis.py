"""Does the hysteresis voltage pay? `python -m benchmarks.hysteresis [FOLDER OF MEASURED CELLS]`.

Identifies so-rc and the circuits with hysteresis (iso-rc, esc, takacs) with both OCV fits on the
bundled cell and, where the folder is given, on measured cells that cannot be shipped. Writes
benchmarks/results/hysteresis.md.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import jax

import barnax
from barnax.reporting.comparison_verdict import conclusion
from benchmarks.pages import bounds_named, publish

RESULTS = Path(__file__).parent / "results" / "hysteresis.md"
KEY, SEEDS, ITERATIONS = 0, 8, 200
CIRCUITS = ("so-rc", "iso-rc", "esc", "takacs")


@dataclass(frozen=True)
class Cell:
    """One cell: its OCV tests, the record to identify on, the one to validate on."""

    name: str
    ocv: tuple[Path, ...]
    record: Path
    validation: Path | None
    window: barnax.Window
    capacity_ah: float | None = None


def bundled() -> Cell:
    return Cell(
        "bundled virtual cell (NMC/graphite-Si, simulated)",
        (barnax.bundled_file("ocv_discharge"), barnax.bundled_file("ocv_charge")),
        barnax.bundled_file("identification"),
        barnax.bundled_file("validation"),
        barnax.Window(),
    )


def measured(folder: Path) -> Iterator[Cell]:
    """CALCE INR18650-20R at three temperatures and Plett's A123 26650."""
    calce = folder / "calce-inr18650-20r"
    for temperature in (25, 0, 45):
        yield Cell(
            f"CALCE INR18650-20R (NMC), {temperature} degC, OCV at 25 degC",
            (calce / "ocv-incremental_25degC_SP20-3.parquet",),
            calce / f"dst_{temperature}degC_80soc_SP20-2.parquet",
            calce / f"us06_{temperature}degC_80soc_SP20-2.parquet",
            barnax.Window(start_after_step=3, initial_soc=1.0, score_steps=(7, 8)),
            2.0,
        )
    plett = folder / "plett-a123-26650"
    yield Cell(
        "A123 26650 (LFP), 25 degC, C/30 OCV",
        (plett / "ocv-s1_25degC.parquet", plett / "ocv-s3_25degC.parquet"),
        plett / "dyn-s1_25degC.parquet",
        None,
        barnax.Window(initial_soc=1.0),
    )


def errors_mv(case: Cell, ocv_fit: str, circuit: str) -> tuple[float, float | None, str]:
    """Refined RMSE on the identification and validation records, and what is at a bound."""
    cell = barnax.characterize(
        [barnax.read_record(path) for path in case.ocv],
        capacity_ah=case.capacity_ah,
        ocv_fit=ocv_fit,
    )
    record = barnax.read_record(case.record)
    problem = barnax.make_problem(
        record, cell, circuit, window=case.window, coordinates="log", objective="compressed"
    )
    optimizer = barnax.make_optimizer("ibmo-centered", 30, ITERATIONS)
    found = barnax.search_seeds(problem, optimizer, key=jax.random.key(KEY), seeds=SEEDS)
    refinement = barnax.refine(found)
    validated = None
    if case.validation is not None:
        other = barnax.read_record(case.validation)
        evaluation = barnax.validate(other, cell, circuit, refinement.parameters, case.window)
        validated = 1e3 * evaluation.metrics.rmse_v
    return 1e3 * refinement.rmse_v, validated, bounds_named(refinement.at_bound)


def report(case: Cell) -> list[str]:
    """Table and verdict of one cell."""
    lines = [
        f"## {case.name}",
        "",
        "| OCV fit | circuit | identification RMSE [mV] | validation RMSE [mV] | at a bound |",
        "|---|---|---|---|---|",
    ]
    sentences = []
    for ocv_fit in ("polynomial", "interpolated"):
        results = {circuit: errors_mv(case, ocv_fit, circuit) for circuit in CIRCUITS}
        for circuit, (identified, validated, at_bound) in results.items():
            shown = "-" if validated is None else f"{validated:.3f}"
            lines.append(f"| {ocv_fit} | {circuit} | {identified:.3f} | {shown} | {at_bound} |")
        sentences += [
            _sentence(f"{circuit} with the {ocv_fit} OCV", results["so-rc"], results[circuit])
            for circuit in CIRCUITS[1:]
        ]
    return [*lines, "", *sentences, ""]


def _sentence(subject: str, plain: tuple, corrected: tuple) -> str:
    changes = [
        (place, after - before)
        for place, before, after in zip(
            ("identification", "validation"), plain[:2], corrected[:2], strict=True
        )
        if before is not None
    ]
    words = " and ".join(
        f"{'raises' if change > 0 else 'lowers'} the {place} error by {abs(change):.2f} mV"
        for place, change in changes
    )
    kinds = ["better" if change < 0 else "worse" for _, change in changes]
    return f"- The hysteresis of {subject} {words}: {conclusion(kinds[0], kinds[1:])}."


def main() -> None:
    """Measure, print the page and write it."""
    cases = [bundled(), *(measured(Path(sys.argv[1])) if len(sys.argv) > 1 else ())]
    page = [
        "# Does the hysteresis voltage pay?",
        "",
        "Printed by `python -m benchmarks.hysteresis FOLDER`, with the folder of measured cells.",
        f"{date.today()}. Refined answers from ibmo-centered in log coordinates, key {KEY}, "
        f"{SEEDS} seeds, {ITERATIONS} generations.",
        "",
    ]
    for case in cases:
        page += report(case)
        print(case.name, "done", file=sys.stderr)
    publish(RESULTS, "\n".join(page))


if __name__ == "__main__":
    main()

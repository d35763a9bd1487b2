"""What the paper's section 5.5 sets beside its own result, by our own runs."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

import barnax
from barnax.comparison import Comparison, Row

HEADING = "## Section 5.5: other methods"
BUDGET = barnax.Budget(population=30, iterations=500, seeds=5, key=0)
# Circuit and method, what the paper says of it, and the figure it is.
CLAIMS = (
    ("so-rc", "apso", "He et al. (2021), PSO with an adaptive strategy: MAPE 1.5 %", "MAPE"),
    ("so-rc", "rls", "Yang et al. (2021), recursive least squares: RMSE 47.3 mV", "RMSE"),
    ("so-rc", "aga", "Ling and Wei (2021), adaptive genetic algorithm: RMSE 49.0 mV", "RMSE"),
    ("so-rc", "dual-ukf", "Peng et al. (2021), adaptive dual UKF: error band 2.8 %", "band"),
    ("iso-rc", "ibmo", "Li et al. (2023), IBMO: error band under 1 %", "band"),
    ("iso-rc", "ibmo", "Li et al. (2023), IBMO: RMSE 43.1 mV", "RMSE"),
    ("iso-rc", "ibmo", "Li et al. (2023), IBMO: MAPE 0.38 %", "MAPE"),
)


def cells(folder: Path | None) -> Iterator[tuple[str, Path, list[Path], barnax.Window, dict]]:
    """Name, record, OCV tests, window and settings of the cell, of each."""
    tests = [barnax.bundled_file(f"ocv_{way}") for way in ("charge", "discharge")]
    yield "bundled", barnax.bundled_file("identification"), tests, barnax.Window(), {}
    if folder is None:
        return
    calce, plett = folder / "calce-inr18650-20r", folder / "plett-a123-26650"
    yield (
        "Samsung INR18650-20R, DST",
        calce / "dst_25degC_80soc_SP20-2.parquet",
        [calce / "ocv-incremental_25degC_SP20-3.parquet"],
        barnax.Window(start_after_step=3, initial_soc=1.0, score_steps=(7, 8)),
        {"capacity_ah": 2.0},
    )
    yield (
        "A123 26650, drive",
        plett / "dyn-s1_25degC.parquet",
        [plett / "ocv-s1_25degC.parquet", plett / "ocv-s3_25degC.parquet"],
        barnax.Window(initial_soc=1.0),
        {},
    )


def compared(folder: Path | None) -> dict[str, Comparison]:
    """Every row on every cell, by the compressed objective."""
    rows = list(dict.fromkeys((model, method) for model, method, _, _ in CLAIMS))
    found = {}
    for name, record, tests, window, settings in cells(folder):
        given = {"ocv_fit": "polynomial", **settings}
        cell = barnax.characterize([barnax.read_record(each) for each in tests], **given)
        found[name] = barnax.compare(
            barnax.read_record(record), cell, rows, window=window, objective="compressed",
            budget=BUDGET,
        )  # fmt: skip
    return found


def section(folder: Path | None, facts: str) -> list[str]:
    """The heading, what is compared, and a row a claim."""
    comparisons = compared(folder)
    lines = [
        HEADING,
        "",
        f"Printed by `python -m benchmarks.li2023.paper --section-5-5 FOLDER`, {facts}. The "
        "paper takes He's and Peng's figures from their papers, of other cells and circuits, and "
        "runs Yang's and, as it reads, Ling's on its own data, all beside the 0.38 % and 43.1 mV "
        "of its own. "
        f"Here every figure is of a run on one record: so-rc, but iso-rc for IBMO; {BUDGET.seeds} "
        "seeds, the median's, unrefined. An error band is read as the largest error over the "
        "measured voltage. apso, aga and dual-ukf are in the manner of their papers, not their "
        "code ([methods](../../docs/methods.md)).",
        "",
        "| the paper says | " + " | ".join(comparisons) + " |",
        "|---" * (1 + len(comparisons)) + "|",
    ]
    for model, method, claim, figure in CLAIMS:
        shown = [
            next(
                _shown(row, figure)
                for row in comparison.rows
                if (row.model, row.method) == (model, method)
            )
            for comparison in comparisons.values()
        ]
        lines.append(f"| {claim} | " + " | ".join(shown) + " |")
    best = [
        f"{name}: {model} {1e3 * optimum.rmse_v:.1f} mV"
        for name, comparison in comparisons.items()
        for model, optimum in comparison.optima.items()
    ]
    return [*lines, "", f"The least RMSE that the circuits allow: {'; '.join(best)}.", ""]


def _shown(row: Row, figure: str) -> str:
    if row.failure is not None:
        return f"no answer: {row.failure}"
    evaluation = row.evaluations[0]
    if figure == "RMSE":
        return f"{1e3 * evaluation.metrics.rmse_v:.1f} mV"
    if figure == "MAPE":
        return f"{evaluation.metrics.mape_percent:.2f} %"
    scored = evaluation.prepared.scored
    relative = np.abs(evaluation.error_v / evaluation.prepared.voltage_v)[scored]
    return f"{100 * relative.max():.1f} %"

"""The measured cells, and what is run on each."""

import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import barnax
from barnax.comparison import PAPER_ROWS, ComparisonResult, Row
from barnax.model.prepared import prepare_record
from barnax.search.evaluate import Evaluation

from .conditions import Condition, condition_of

BUDGET = barnax.Budget(population=30, iterations=500, seeds=30, key=0)
MODELS = ("so-rc", "iso-rc", "esc")
# Variable projection draws nothing and ends at the best circuit of a model: it compares models.
EXACT = "varpro"
# Below this the A123's voltage falls off a cliff, and errors there would be all one sees.
LOWEST_SOC = 0.1
ROWS = (*((model, EXACT) for model in MODELS), *PAPER_ROWS, ("esc", "bmo"), ("esc", "ibmo"))


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


def data_folder(given: str | None) -> Path | None:
    """The folder of measured cells, or None where there is none."""
    folder = given or os.environ.get("BARNAX_SHARED_DATA")
    path = Path(folder) if folder else Path(__file__).parents[3] / "shared" / "data"
    return path if path.is_dir() else None


def given_folder(arguments: Sequence[str]) -> Path:
    """The folder of measured cells that a command was given, or where it is; ends without one."""
    folder = data_folder(arguments[0] if arguments else None)
    if folder is None:
        sys.exit("the measured cells are not here; give their folder")
    return folder


def cases(folder: Path | None) -> Iterator[Cell]:
    """The bundled cell, and every measured one that is here."""
    yield bundled()
    if folder is not None:
        yield from measured(folder)


@dataclass(frozen=True, eq=False)
class Ran:
    """One case: all rows, and their errors on the record that validates, if there is one."""

    name: str
    cell: barnax.CellModel
    comparison: ComparisonResult
    validation: dict[str, Evaluation]

    @property
    def identification(self) -> dict[str, Evaluation]:
        return {row.name: row.evaluations[0] for row in self.comparison.answered}

    @property
    def records(self) -> dict[str, dict[str, Evaluation]]:
        """Evaluations of the rows on every record there is, by its role."""
        found = {"identification": self.identification, "validation": self.validation}
        return {role: evaluations for role, evaluations in found.items() if evaluations}

    def condition(self, role: str) -> Condition:
        """What a record does to the hysteresis."""
        return condition_of(next(iter(self.records[role].values())).prepared, self.cell)

    def exact(self, model: str) -> Row:
        """The row of a model's best circuit."""
        return next(row for row in self.comparison.rows if row.name == f"{EXACT} {model}")


def run(case: Cell) -> list[Ran]:
    """Every row on one case; twice where there is one dynamic record only.

    That one is scored down to `LOWEST_SOC`, in whole, and its first half against its second.
    """
    tests = [barnax.read_record(path) for path in case.ocv]
    cell = barnax.characterize(tests, capacity_ah=case.capacity_ah, ocv_fit="interpolated")
    record = barnax.read_record(case.record)
    if case.validation is not None:
        other = barnax.read_record(case.validation)
        return [_compared(case.name, cell, record, case.window, (other, case.window))]
    prepared = prepare_record(record, cell, "so-rc", case.window)
    end_s = float(prepared.time_s[prepared.soc >= LOWEST_SOC][-1])
    middle_s = float((prepared.time_s[0] + end_s) / 2)
    whole, first, second = (
        replace(case.window, score_from_s=start_s, score_to_s=stop_s)
        for start_s, stop_s in ((None, end_s), (None, middle_s), (middle_s, end_s))
    )
    above = f"{case.name}, above {100 * LOWEST_SOC:.0f} % SOC"
    return [
        _compared(above, cell, record, whole, None),
        _compared(f"{above}, first half against second", cell, record, first, (record, second)),
    ]


def _compared(
    name: str,
    cell: barnax.CellModel,
    record: barnax.Record,
    window: barnax.Window,
    other: tuple[barnax.Record, barnax.Window] | None,
) -> Ran:
    comparison = barnax.compare(
        record, cell, ROWS, window=window, budget=BUDGET, objective="compressed"
    )
    validation = {}
    if other is not None:
        validation = {
            row.name: barnax.validate(other[0], cell, row.model, row.median.parameters, other[1])
            for row in comparison.answered
        }
    return Ran(name, cell, comparison, validation)

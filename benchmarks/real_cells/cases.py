"""The measured cells, and what is run on each."""

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from benchmarks.hysteresis import Case, bundled, measured

import barnax
from barnax.comparison import Comparison, Row
from barnax.comparison_run import PAPER_ROWS
from barnax.evaluate import Evaluation

from .conditions import Condition, condition_of

BUDGET = barnax.Budget(population=30, iterations=500, seeds=30, key=0)
MODELS = ("so-rc", "iso-rc", "esc")
# Variable projection draws nothing and ends at the best circuit of a model: it compares models.
EXACT = "varpro"
ROWS = (*((model, EXACT) for model in MODELS), *PAPER_ROWS, ("esc", "bmo"), ("esc", "ibmo"))


def data_folder(given: str | None) -> Path | None:
    """The folder of measured cells, or None where there is none."""
    folder = given or os.environ.get("BARNAX_SHARED_DATA")
    path = Path(folder) if folder else Path(__file__).parents[3] / "shared" / "data"
    return path if path.is_dir() else None


def cases(folder: Path | None) -> Iterator[Case]:
    """The bundled cell, and every measured one that is here."""
    yield bundled()
    if folder is not None:
        yield from measured(folder)


@dataclass(frozen=True, eq=False)
class Ran:
    """One case: all rows, and their errors on the record that validates.

    Where a cell has one dynamic record only, its first half identifies and its second validates.
    """

    case: Case
    cell: barnax.CellModel
    comparison: Comparison
    validation: dict[str, Evaluation]

    @property
    def identification(self) -> dict[str, Evaluation]:
        return {row.name: row.evaluations[0] for row in self.comparison.answered}

    @property
    def conditions(self) -> tuple[Condition, Condition]:
        """The condition of the record identified on and of the one validated on."""
        first, second = (
            next(iter(each.values())).course for each in (self.identification, self.validation)
        )
        return condition_of(first, self.cell), condition_of(second, self.cell)

    def exact(self, model: str) -> Row:
        """The row of a model's best circuit."""
        return next(row for row in self.comparison.rows if row.name == f"{EXACT} {model}")


def run(case: Case) -> Ran:
    """Every row on one case."""
    tests = [barnax.read_record(path) for path in case.ocv]
    cell = barnax.characterize(tests, capacity_ah=case.capacity_ah, ocv_fit="interpolated")
    record = barnax.read_record(case.record)
    window = later = case.window
    if case.validation is None:
        middle_s = float(record.time_s[[0, -1]].mean())
        window, later = replace(window, score_to_s=middle_s), replace(window, score_from_s=middle_s)
    comparison = barnax.compare(
        record, cell, ROWS, window=window, budget=BUDGET, objective="compressed"
    )
    other = record if case.validation is None else barnax.read_record(case.validation)
    validation = {
        row.name: barnax.validate(other, cell, row.model, row.median.parameters, later)
        for row in comparison.answered
    }
    return Ran(case, cell, comparison, validation)

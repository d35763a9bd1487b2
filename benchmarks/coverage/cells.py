"""The cells whose intervals are looked at."""

from pathlib import Path

import barnax
from barnax.bundled import BUNDLED
from barnax.model.problem import Problem


def bundled(circuit: str) -> Problem:
    """The bundled cell with interpolated OCV."""
    tests = [barnax.read_record(path) for path in BUNDLED.ocv]
    cell = barnax.characterize(tests, ocv_fit="interpolated")
    record = barnax.read_record(barnax.bundled_file("identification"))
    return barnax.make_problem(record, cell, circuit, coordinates="log", objective="compressed")


def measured(folder: Path) -> Problem:
    """CALCE INR18650-20R, DST at 25 degC."""
    calce = folder / "calce-inr18650-20r"
    test = barnax.read_record(calce / "ocv-incremental_25degC_SP20-3.parquet")
    return barnax.make_problem(
        barnax.read_record(calce / "dst_25degC_80soc_SP20-2.parquet"),
        barnax.characterize([test], capacity_ah=2.0, ocv_fit="interpolated"),
        "so-rc",
        window=barnax.Window(start_after_step=3, initial_soc=1.0, score_steps=(7, 8)),
        coordinates="log",
        objective="compressed",
    )

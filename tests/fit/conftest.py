"""Records of the bundled cell made ready for tables."""

from dataclasses import replace

import pytest

from barnax import TableSettings, characterize, read_record
from barnax.model.prepared import Window, prepare_record

# Few nodes and a narrow box, so that a factor is small.
NODES = (0.3, 0.5, 0.7, 0.85, 1.0)
BOX = {"tau1 [s]": (5.0, 20.0), "tau2 [s]": (40.0, 200.0)}
BEGIN = Window(score_from_s=200.0, score_to_s=4000.5)
SMALL = TableSettings(nodes=NODES, bounds=BOX, folds=0, max_boxes=0)


@pytest.fixture(scope="session")
def prepared(bundled_record, bundled_cell):
    """The first 4,000 s of the bundled record."""
    return prepare_record(bundled_record, bundled_cell, "so-rc", BEGIN)


@pytest.fixture(scope="session")
def with_hysteresis(bundled_record, bundled_cell):
    """The same with dynamic hysteresis."""
    return prepare_record(bundled_record, bundled_cell, "esc", BEGIN)


@pytest.fixture(scope="session")
def samsung(real_data):
    """Drive profiles of the measured INR18650-20R, made ready by their files' names."""
    folder = real_data / "calce-inr18650-20r"
    ocv = read_record(folder / "ocv-incremental_25degC_SP20-3.parquet")
    cell = characterize([ocv], capacity_ah=2.0, ocv_fit="interpolated")
    profile = Window(start_after_step=3, initial_soc=1.0, score_steps=(7, 8))

    def prepared(name, **changes):
        record = read_record(folder / f"{name}_SP20-2.parquet")
        return prepare_record(record, cell, "so-rc", replace(profile, **changes))

    return prepared

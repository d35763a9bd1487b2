"""What every test shares: the data it may use."""

import os
from pathlib import Path

import pytest

from barnax.bundled import BUNDLED
from barnax.cell import CellModel, characterize
from barnax.records import Record, read_record

REPOSITORY = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of measured cells, which cannot be shipped; tests that need it skip without."""
    folder = Path(os.environ.get("BARNAX_SHARED_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip("the measured cells are not here; set BARNAX_SHARED_DATA to their folder")
    return folder


@pytest.fixture(scope="session")
def bundled_record() -> Record:
    """The bundled cell's identification record."""
    return read_record(BUNDLED.record)


@pytest.fixture(scope="session")
def bundled_cell() -> CellModel:
    """The bundled cell, by polynomials through its OCV tests."""
    return characterize([read_record(path) for path in BUNDLED.ocv])

"""What every test shares: the data it may use."""

import os
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of measured cells, which cannot be shipped; tests that need it skip without."""
    folder = Path(os.environ.get("BARNAX_SHARED_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip("the measured cells are not here; set BARNAX_SHARED_DATA to their folder")
    return folder

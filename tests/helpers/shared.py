"""Measured cells and cases, which cannot be shipped; tests that need them skip without."""

import os
from pathlib import Path

import pytest

SHARED = Path(os.environ.get("BARNAX_SHARED_DATA", Path(__file__).parents[3] / "shared" / "data"))
CASES = SHARED.parent / "cases"
SET = "set BARNAX_SHARED_DATA to the folder of measured cells"
needs_data = pytest.mark.skipif(not SHARED.is_dir(), reason=SET)
needs_cases = pytest.mark.skipif(not CASES.is_dir(), reason=f"the cases are not here; {SET}")

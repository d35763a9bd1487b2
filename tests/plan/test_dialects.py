"""A folder of the bundled cell's files in any make's dialect gives the same circuit."""

import polars as pl
import pytest

import barnax
from barnax.bundled import BUNDLED
from helpers.dialects import WRITERS

FILES = {
    "drive": BUNDLED.record,
    "trip": BUNDLED.validation,
    "up": BUNDLED.ocv[0],
    "down": BUNDLED.ocv[1],
}
SMALL = {
    "model": "so-rc",
    "seeds": 2,
    "population": 8,
    "iterations": 5,
    "trust": "none",
}
# Its dates are of microseconds, and the bundled clock has both sides of a step closer together.
TOO_COARSE = ("NewareNDA CSV",)
CASES = {name: write for name, write in WRITERS.items() if name not in TOO_COARSE}


@pytest.fixture(scope="module")
def by_hand():
    return barnax.identify(
        [BUNDLED.record, BUNDLED.validation],
        ocv=BUNDLED.ocv,
        current_hold="forward",
        **SMALL,
    )


@pytest.mark.slow
@pytest.mark.parametrize("write", CASES.values(), ids=CASES)
def test_a_folder_in_a_dialect_gives_the_same_circuit(by_hand, tmp_path, write):
    for name, path in FILES.items():
        (tmp_path / name).write_bytes(write(pl.read_parquet(path)))
    found = barnax.identify(tmp_path, current_hold="forward", **SMALL)
    assert {each.name: each.role for each in found.inputs} == {
        "drive": "identification", "trip": "identification", "up": "ocv", "down": "ocv",
    }  # fmt: skip
    assert found.parameters == pytest.approx(by_hand.parameters, rel=1e-6)
    ours, theirs = (each.metrics.identification.rmse_v for each in (found, by_hand))
    assert ours == pytest.approx(theirs, rel=1e-6)

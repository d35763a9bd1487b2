"""What a fleet shows as a whole, on rows whose spread, outlier and failures are known."""

import numpy as np
import polars as pl
import pytest

from barnax.fleet.summary import summarize

CELLS = 40
FAILURES = [
    ("row 7 is empty", "cells.no-number"),
    ("row 12 is empty", "cells.no-number"),
    ("is not there", "input.refused"),
    ("there is no such file; check the name and the folder", "file.unreadable"),
    ("this is a folder; give the files in it", "file.unreadable"),
    ("there is no such file; check the name and the folder", "file.unreadable"),
]


@pytest.fixture(scope="module")
def rows():
    rng = np.random.default_rng(0)
    age = np.arange(CELLS) * 10.0
    made = [
        {
            "id": f"cell {number:02d}",
            "error": None,
            "age": age[number],
            "circuit": "so-rc",
            "R0 [Ohm]": 0.02 * np.exp(0.002 * age[number] + rng.normal(0, 0.02)),
            "R0 [Ohm] low": 0.01,
            "tau1 [s]": 5.0 * np.exp(rng.normal(0, 0.1)) * (100.0 if number == 17 else 1.0),
            "RMSE [V]": 0.01 + 1e-5 * number,
            "certified": number != 3,
            "at bound": "R1 [Ohm] lower" if number == 4 else "",
            "warnings": ["a.csv: look"] if number < 5 else [],
            "warning codes": ["sign.doubtful"] if number < 5 else [],
        }
        for number in range(CELLS)
    ]
    made += [
        {"id": f"bad {n}", "error": f"{n}.csv: {text}", "error code": code}
        for n, (text, code) in enumerate(FAILURES)
    ]
    return pl.DataFrame(made, infer_schema_length=None)


def test_the_summary_has_what_was_put_in(rows):
    actual = summarize(rows)
    assert (actual.cells, actual.identified, actual.certified) == (46, 40, 39)
    assert actual.at_bound == 1
    assert [(each.text, len(each.ids)) for each in actual.warnings] == [("look", 5)]
    r0 = next(each for each in actual.distributions if each.name == "R0 [Ohm]")
    assert r0.median == pytest.approx(0.02 * np.exp(0.002 * 195), rel=0.03)
    assert [each.name for each in actual.distributions] == ["R0 [Ohm]", "tau1 [s]", "RMSE [V]"]
    (outlier,) = actual.outliers
    assert (outlier.id, outlier.name) == ("cell 17", "tau1 [s]")
    assert outlier.deviations > 5
    # Causes of one code are as many as their words without numbers.
    causes = {each.ids for each in actual.failures}
    assert causes == {("bad 0", "bad 1"), ("bad 2",), ("bad 3", "bad 5"), ("bad 4",)}
    assert [name for name, _ in actual.worst] == [f"cell {n}" for n in range(39, 29, -1)]

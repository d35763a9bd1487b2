"""What a fleet shows as a whole, on rows whose spread, outlier and failures are known."""

import numpy as np
import polars as pl
import pytest

from barnax.fleet.summary import summarize

CELLS = 40


@pytest.fixture(scope="module")
def rows():
    rng = np.random.default_rng(0)
    age = np.arange(CELLS) * 10.0
    made = [
        {
            "id": f"cell {place:02d}",
            "error": None,
            "age": age[place],
            "maker": "north" if place % 2 else "south",
            "circuit": "so-rc",
            "R0 [Ohm]": 0.02 * np.exp(0.002 * age[place] + rng.normal(0, 0.02)),
            "R0 [Ohm] low": 0.01,
            "tau1 [s]": 5.0 * np.exp(rng.normal(0, 0.1)) * (100.0 if place == 17 else 1.0),
            "RMSE [V]": 0.01 + 1e-5 * place,
            "certified": place != 3,
            "at bound": "R1 [Ohm] lower" if place == 4 else "",
            "warnings": ["a.csv: look"] if place < 5 else [],
            "warning codes": ["sign.doubtful"] if place < 5 else [],
        }
        for place in range(CELLS)
    ]
    errors = ["a.csv: row 7 is empty", "b.csv: row 12 is empty", "c.csv: is not there"]
    codes = ["cells.no-number", "cells.no-number", "input.refused"]
    made += [
        {"id": f"bad {n}", "error": text, "error code": code}
        for n, (text, code) in enumerate(zip(errors, codes, strict=True))
    ]
    return pl.DataFrame(made, infer_schema_length=None)


def test_causes_of_one_code_are_told_apart_by_their_words():
    texts = [
        "a.csv: there is no such file; check the name and the folder",
        "b.csv: this is a folder; give the files in it",
        "c.csv: there is no such file; check the name and the folder",
    ]
    failed = [
        {"id": f"bad {n}", "error": text, "error code": "file.unreadable"}
        for n, text in enumerate(texts)
    ]
    found = summarize(pl.DataFrame(failed))
    assert [(each.text[:10], each.ids) for each in found.failures] == [
        ("there is n", ("bad 0", "bad 2")),
        ("this is a ", ("bad 1",)),
    ]


def test_the_summary_finds_what_was_put_in(rows):
    found = summarize(rows)
    assert (found.cells, found.identified, found.certified) == (43, 40, 39)
    assert found.at_bound == 1
    assert [(each.text, len(each.ids)) for each in found.warnings] == [("look", 5)]
    r0 = next(each for each in found.distributions if each.name == "R0 [Ohm]")
    assert r0.median == pytest.approx(0.02 * np.exp(0.002 * 195), rel=0.03)
    assert [each.name for each in found.distributions] == ["R0 [Ohm]", "tau1 [s]", "RMSE [V]"]
    (outlier,) = found.outliers
    assert (outlier.id, outlier.name) == ("cell 17", "tau1 [s]")
    assert outlier.deviations > 5
    assert [(len(each.ids), each.ids[0]) for each in found.failures] == [(2, "bad 0"), (1, "bad 2")]
    assert [name for name, _ in found.worst] == [f"cell {n}" for n in range(39, 29, -1)]

"""From a result to its next test, and from the test's record to what was promised."""

from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

import barnax
from barnax.cli.design import Cell, next_after
from barnax.experiment import Step
from barnax.reporting.design import promised_table
from barnax.reporting.verdict import next_step

BLOCKS = [
    barnax.Block("pulse", (10.0, 40.0), (1.0, 0.0)),
    barnax.Block("steps", (30.0, 30.0, 60.0, 60.0), (1.0, -1.0, 0.5, 0.0)),
]


@pytest.fixture(scope="module")
def result():
    options = {"max_boxes": 0, "folds": 0, "resistances_follow": "none"}
    return barnax.identify(
        over="soc", model="so-rc", seeds=0, trust="none", advise=False, **options
    )


@pytest.fixture(scope="module")
def design(result):
    return barnax.design(result, max_hours=1.5, blocks=BLOCKS)


def test_what_a_result_determines_counts(design):
    assert not design.finds_ocv
    assert design.earlier == ("identification.parquet",)
    assert design.steps[0] == Step("rest", 300.0, 0.0)
    for width in design.of_table("R1"):
        assert width.before is not None
        assert width.after < 1.1 * width.alone
    assert design.of_table("drive")[0].after < design.of_table("drive")[0].alone


def test_the_next_command_names_files_that_are_there(design, result, tmp_path):
    (tmp_path / "result.json").write_text(result.to_json())
    *_, command = next_after(design, result, Cell(result=tmp_path, capacity=2.1), tmp_path)
    words = str(command).split()
    files = [Path(word) for word in words if word.endswith(".parquet")]
    used = [part.name for part in result.inputs if part.role != "validation"]
    assert [path.name for path in files] == used
    assert all(path.is_file() for path in files)
    assert words[-4:] == ["--capacity", "2.1", "--design", str(tmp_path)]


def test_the_next_command_tells_of_a_file_that_is_elsewhere(design, result, tmp_path):
    moved = tuple(
        part.model_copy(update={"name": "away.csv"}) if part.role == "identification" else part
        for part in result.inputs
    )
    known = result.model_copy(update={"inputs": moved})
    advice, command = next_after(design, known, Cell(result=tmp_path), tmp_path)
    console = Console(width=200)
    with console.capture() as shown:
        console.print(advice)
    assert "write the path of away.csv: no file of that name" in shown.get()
    tests = [word for word in str(command).split() if Path(word).name.startswith("ocv_")]
    assert len(tests) == 2
    assert all(Path(word).is_file() for word in tests)


def test_a_table_left_open_is_answered_with_a_test(result):
    fit = result.tables.fit
    opened = tuple(
        replace(each, standard_error=each.value) if each.name == "R2 [Ohm]" else each
        for each in fit.intervals
    )
    part = result.tables.model_copy(update={"fits": (replace(fit, intervals=opened),)})
    assert not next_step(result).designs
    step = next_step(result.model_copy(update={"tables": part}))
    assert step.designs
    assert "R2" in step.advice


def test_promised_and_reached_stand_beside_each_other(design, result):
    table = promised_table(design, result.tables.fit)
    assert [row[0] for row in table.rows] == ["R0", "R1", "R2"]
    assert all(float(row[3]) > 0 for row in table.rows)

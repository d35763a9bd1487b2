"""`barnax compare` as a user runs it."""

import json
import re
import shutil

import pytest

from barnax import ComparisonResult, InputError, compare_files
from barnax.bundled import BUNDLED
from barnax.cli import compare as command
from barnax.fit.cross_validation import SocErrors
from barnax.reporting.view import View
from barnax.reporting.wording import wording
from barnax.result_parts import Candidate

from .conftest import BUDGET, contents, run_command

# Its rows are the paper's without a word.
COMMON = BUDGET[2:]

ROWS = ("--models", "1rc", "--methods", "ls,varpro")


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compared") / "out"
    return run_command("compare", *ROWS, *COMMON, "--out", folder), folder


def test_one_folder_comes_out_with_a_result_that_times_every_row_and_a_screen(compared):
    outcome, folder = compared
    assert outcome.status == 0
    files = {"comparison.json", "timings.json", "files.json", "report.html", "report.md"}
    assert {path.name for path in folder.iterdir()} == {*files, "figures"}
    assert {path.suffix for path in (folder / "figures").iterdir()} == {".png", ".svg"}
    result = ComparisonResult.from_json(folder / "comparison.json")
    timings = json.loads((folder / "timings.json").read_text())
    assert all(timings[f"{row.name} [s]"] >= 0 for row in result.rows)
    assert [row.name for row in result.rows] == ["ls 1rc", "varpro 1rc"]
    assert str(folder) not in result.to_json()
    *screen, written = outcome.out.splitlines()
    assert max(map(len, screen)) <= 80
    assert written.split()[:-2] == [f"{folder}/report.html", "comparison.json", "figures"]
    for part in ("Parameters", "Search", "lowest RMSE", "varpro 1rc"):
        assert part in " ".join(outcome.out.split())


def test_circuits_of_a_comparison_have_their_errors_on_each_record(compared):
    stored = ComparisonResult.from_json(compared[1] / "comparison.json")
    errors = SocErrors(0.0232, 0.0102), SocErrors(0.0245, 0.0102)
    circuits = (
        Candidate("so-rc", "soc", errors[0], (0.0123,), None, is_answer=True),
        Candidate("1rc", None, errors[1], (0.0345,), None),
    )
    result = stored.model_copy(update={"candidates": circuits})
    table = wording("result.candidates", View(result), ["v.csv"])
    assert re.findall(r"\d+\.\d (?:\(\d+\.\d\) )?(?=\|)", table) == [
        *("23.2 (10.2) ", "12.3 "),
        *("24.5 (10.2) ", "34.5 "),
    ]


def test_a_second_run_needs_force_and_gives_the_same_bytes(compared, tmp_path, monkeypatch):
    _, first = compared
    folder = tmp_path / "again"
    shutil.copytree(first, folder)
    monkeypatch.setattr(command, "drawn_files", lambda *_: {})
    before = contents(folder)
    assert run_command("compare", *ROWS, *COMMON, "--out", folder).status == 2
    assert contents(folder) == before
    assert run_command("compare", *ROWS, *COMMON, "--out", folder, "--force").status == 0
    assert contents(folder)["comparison.json"] == before["comparison.json"]


@pytest.mark.slow
def test_a_folder_is_planned_and_its_circuits_are_ranked_before_its_methods(run, tmp_path):
    for path in (BUNDLED.record, BUNDLED.validation, *BUNDLED.ocv):
        shutil.copy(path, tmp_path)
    words = ("--models", "so-rc", "--methods", "ls", "--seeds", "1", "--json")
    outcome = run("compare", tmp_path, *words)
    assert outcome.status == 0
    result = json.loads(outcome.out[outcome.out.index("{") :])
    best = [each for each in result["candidates"] if each["is_answer"]]
    assert [(each["model"], each["over"]) for each in best] == [("so-rc", "soc")]
    assert best[0]["proved_gap"] <= 0.01
    roles = {each["name"]: each["role"] for each in result["inputs"]}
    assert roles["identification.parquet"] == "identification"
    assert roles["validation.parquet"] == "validation"


def test_a_second_record_is_refused_rather_than_left_out():
    records = [BUNDLED.record, BUNDLED.validation]
    with pytest.raises(InputError, match="uses one record, but 2 were given"):
        compare_files(records, ocv=list(BUNDLED.ocv))

"""`barnax check`: exit statuses, tables, lines and JSON."""

import json

import numpy as np
import polars as pl
import pytest

from barnax.bundled import BUNDLED
from helpers.golden import GOLDEN, require_golden, without_blanks
from helpers.records import CURRENT, TIME, VOLTAGE, changed, frame

CLEAN = (BUNDLED.record, BUNDLED.validation, *BUNDLED.ocv)


@pytest.fixture
def faulty(tmp_path):
    """The bundled record in milliamperes, with one time that runs backwards."""
    table = changed(frame(), TIME, 12.5, [500]).with_columns(pl.col(CURRENT) * 1000)
    table.write_csv(tmp_path / "faulty.csv")
    return tmp_path / "faulty.csv"


@pytest.fixture
def unreadable(tmp_path):
    (tmp_path / "noise.csv").write_bytes(np.random.default_rng(0).bytes(4096))
    return tmp_path / "noise.csv"


def test_clean_files_give_status_0_and_say_what_they_can_serve_as(run):
    outcome = run("check", *CLEAN)
    assert (outcome.status, outcome.err) == (0, "")
    require_golden(GOLDEN / "check-clean.txt", without_blanks(outcome.out))


def test_findings_give_status_1_with_row_and_remedy(run, faulty):
    outcome = run("check", faulty)
    assert (outcome.status, outcome.err) == (1, "")
    require_golden(GOLDEN / "check-faulty.txt", without_blanks(outcome.out))


def test_a_file_that_is_no_table_gives_status_2_and_the_others_are_reported(
    run, faulty, unreadable
):
    outcome = run("check", unreadable, faulty, BUNDLED.record)
    assert outcome.status == 2
    assert "error: noise.csv: the content is binary" in outcome.err
    assert "faulty.csv" in outcome.out
    assert "2 files checked: 2 errors" in outcome.out
    assert "1 file could not be read" in outcome.out
    alone = run("check", unreadable)
    assert (alone.status, alone.out) == (2, "1 file could not be read, so nothing was checked.\n")


def test_quiet_gives_a_line_a_finding_and_nothing_else(run, faulty):
    outcome = run("check", faulty, BUNDLED.record, "--quiet")
    assert (outcome.status, outcome.out) == (1, "")
    lines = outcome.err.splitlines()
    assert len(lines) == 2
    assert all(line.startswith("warning: faulty.csv: row ") for line in lines)
    assert "[rename the column to 'Current / mA', or give" in lines[1]
    assert run("check", *CLEAN, "-q") == (0, "", "")


def test_json_holds_every_file_and_goes_to_stdout_alone(run, faulty, unreadable):
    outcome = run("check", faulty, BUNDLED.record, "--json")
    assert (outcome.status, outcome.err) == (1, "")
    document = json.loads(outcome.out)
    assert document["schema_version"] == 1
    assert [file["file"] for file in document["files"]] == ["faulty.csv", "identification.parquet"]
    assert [file["clean"] for file in document["files"]] == [False, True]
    findings = document["files"][0]["findings"]
    assert {finding["check"] for finding in findings} == {"clock", "unit"}
    assert [finding["row"] for finding in findings if finding["check"] == "clock"] == [502]
    outcome = run("check", unreadable, "--json")
    assert outcome.status == 2
    assert "binary" in json.loads(outcome.out)["files"][0]["unreadable"]
    gone = run("check", "gone.csv", "--json")
    assert [one["file"] for one in json.loads(gone.out)["files"]] == ["gone.csv"]


def test_words_of_the_file_are_shown_as_they_stand(run, tmp_path):
    frame().rename({VOLTAGE: "[bold]Voltage[/bold] x"}).write_csv(tmp_path / "[red]cell.csv")
    outcome = run("check", tmp_path / "[red]cell.csv")
    assert outcome.status == 1
    assert "[red]cell.csv" in outcome.out
    assert "[bold]Voltage[/bold] x" in " ".join(outcome.out.split())

"""`barnax report`: the page of what other commands stored."""

import json
import shutil

import pytest

from helpers.report_reader import ReportReader

from .conftest import contents


@pytest.mark.slow
def test_a_stored_result_s_page_has_the_figures_over_time_and_is_one_of_its_files(
    run, finished, tmp_path
):
    shutil.copytree(finished.folder, tmp_path / "done")
    outcome = run("report", "done", "--live")
    assert outcome.status == 0, outcome.err
    page = ReportReader((tmp_path / "done/report.html").read_text())
    assert "Measured and simulated voltage on" in page.text
    assert any("has-live" in (each.get("class") or "") for _, each in page.tags)
    assert "report.html" in json.loads((tmp_path / "done/files.json").read_text())
    refused = run("report", "done")
    assert refused.status == 2
    assert "exists already; replace it with --force" in refused.err


def test_without_the_measured_files_the_page_says_which_one_it_lacks(run, finished, tmp_path):
    stored = json.loads((finished.folder / "result.json").read_text())
    stored["inputs"][0]["name"] = "gone.csv"
    (tmp_path / "result.json").write_text(json.dumps(stored))
    outcome = run("report", "result.json", "--out", "page.html")
    assert outcome.status == 0, outcome.err
    assert "figures over time are left out: gone.csv: not found" in outcome.err
    page = ReportReader((tmp_path / "page.html").read_text())
    assert "Figures over time are left out: gone.csv: not found" in page.text
    assert page.count("img") > 0
    assert contents(tmp_path).keys() == {"result.json", "page.html"}

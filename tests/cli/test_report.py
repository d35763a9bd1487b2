"""`barnax report`: the page of what other commands stored."""

import json
import shutil

import pytest

from barnax.bundled import BUNDLED
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


@pytest.mark.slow
def test_a_replay_has_a_page_with_its_figure_and_a_stored_one_says_what_draws_it(
    run, finished, tmp_path
):
    replayed = run("soc", finished.folder, BUNDLED.validation, "--score-to", "1000", "--report")
    assert replayed.status == 0, replayed.err
    assert ReportReader((tmp_path / "barnax-soc/report.html").read_text()).count("img") == 1
    outcome = run("report", "barnax-soc/soc.json", "--out", "page.html")
    assert outcome.status == 0, outcome.err
    page = ReportReader((tmp_path / "page.html").read_text())
    assert page.count("img") == 0
    assert "barnax soc --report draws them" in page.text

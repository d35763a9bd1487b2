"""`barnax report`: the page of what other commands stored."""

import json

from helpers.report_reader import ReportReader

from .conftest import contents


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

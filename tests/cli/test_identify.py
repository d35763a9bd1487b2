"""`barnax identify` on the bundled cell: what it prints, what it writes, and that it repeats."""

import json
import os
import re
import time
from pathlib import Path

import pytest

from barnax.bundled import BUNDLED
from barnax.cli import identify as command
from barnax.cli.output import write_folder
from barnax.cli.session import Session
from barnax.model import problem
from barnax.results import Result

from .conftest import BUDGET, OCV, contents, run_command

SESSION = Session(is_quiet=True)
FIGURES = {
    "ocv",
    "hysteresis",
    "convergence",
    "identification-voltage",
    "identification-error",
    "validation-1-voltage",
    "validation-1-error",
}


@pytest.fixture
def without_figures(monkeypatch):
    """Drawing takes most of a small run's time."""
    monkeypatch.setattr(command, "found_figures", lambda *_: {})


def test_a_run_writes_the_result_its_timings_and_the_figures(finished):
    assert finished.outcome.status == 0
    assert set(contents(finished.folder)) == {
        "result.json",
        "timings.json",
        "figures",
        *(f"figures/{name}.png" for name in FIGURES),
    }


def test_the_figures_are_png_images(finished):
    for path in finished.folder.glob("figures/*"):
        content = path.read_bytes()
        assert content.startswith(b"\x89PNG\r\n\x1a\n")
        assert content.endswith(b"IEND\xaeB`\x82")
        assert len(content) > 10_000


def test_the_timings_are_seconds_by_stage(finished):
    timings = json.loads((finished.folder / "timings.json").read_text())
    assert {"Searching [s]", "Cross-checking [s]"} <= set(timings)
    assert all(seconds >= 0 for seconds in timings.values())


def test_nothing_is_left_beside_the_folder(finished):
    assert [path.name for path in finished.folder.parent.iterdir()] == ["out"]


def test_the_tables_give_every_parameter_its_unit(finished):
    words = [line.split()[:2] for line in finished.outcome.out.splitlines()]
    units = {"R0": "mOhm", "R1": "mOhm", "C1": "F", "R2": "mOhm", "C2": "F", "RMSE": "mV"}
    for name, unit in (units | {"tau1": "s", "tau2": "s"}).items():
        assert [name, unit] in words


def test_the_tables_print_what_the_result_stores(finished):
    result = Result.from_json(finished.folder / "result.json")
    lines = {
        line.split()[0]: line.split() for line in finished.outcome.out.splitlines() if line.split()
    }
    assert float(lines["R0"][2]) == pytest.approx(1e3 * result.parameters["R0 [Ohm]"], rel=1e-4)
    assert f"{1e3 * result.refined.rmse_v:.4f}" in finished.outcome.out
    validation = result.metrics.validation[0]
    assert float(lines["validation.parquet"][1]) == pytest.approx(1e3 * validation.rmse_v, abs=1e-3)
    assert f"Verdict: {result.refined.verdict}".split() == (
        finished.outcome.out[finished.outcome.out.index("Verdict") :]
        .split("Global optimum")[0]
        .split()
    )


def test_tables_fit_80_columns_and_keep_file_names_whole(finished):
    assert max(map(len, finished.outcome.out.splitlines())) <= 80
    assert "identification.parquet" in finished.outcome.out


def test_warnings_go_to_stderr_and_into_the_result(finished):
    warnings = Result.from_json(finished.folder / "result.json").warnings
    assert warnings
    assert finished.outcome.err.splitlines() == [f"warning: {text}" for text in warnings]
    assert "warning" not in finished.outcome.out


def test_json_prints_one_result_and_writes_nothing(run, finished, tmp_path):
    outcome = run("identify", *BUDGET, "--json")
    assert (outcome.status, outcome.err) == (0, finished.outcome.err)
    assert outcome.out == (finished.folder / "result.json").read_text()
    assert contents(tmp_path) == {}


@pytest.mark.usefixtures("without_figures")
def test_json_with_a_folder_prints_and_writes_the_same(run, finished, tmp_path):
    outcome = run("identify", *BUDGET, "--json", "--out", "kept")
    assert outcome.out == (tmp_path / "kept" / "result.json").read_text()
    assert outcome.out == (finished.folder / "result.json").read_text()


@pytest.mark.usefixtures("without_figures")
def test_quiet_prints_warnings_alone_and_writes_to_the_default_folder(run, finished, tmp_path):
    outcome = run("identify", *BUDGET, "--quiet")
    assert outcome == (0, "", finished.outcome.err)
    stored = tmp_path / "barnax-out" / "result.json"
    assert stored.read_bytes() == (finished.folder / "result.json").read_bytes()


@pytest.mark.usefixtures("without_figures")
def test_force_replaces_a_result(run, tmp_path):
    write_folder(
        tmp_path / "out", {"result.json": b"old", "figures/old.png": b"old"}, True, SESSION
    )
    assert run("identify", *BUDGET, "--out", "out", "--force", "-q").status == 0
    assert Result.from_json("out/result.json").model == "iso-rc"
    assert not Path("out/figures/old.png").exists()


@pytest.mark.usefixtures("without_figures")
def test_a_write_that_fails_leaves_the_old_result(run, tmp_path, monkeypatch):
    write_folder(tmp_path / "out", {"result.json": b"old"}, True, SESSION)
    before = contents(tmp_path)

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    outcome = run("identify", *BUDGET, "--out", "out", "--force")
    assert outcome.status == 2
    assert "No space left on device" in outcome.err
    assert contents(tmp_path) == before


def test_the_result_names_no_folder_and_no_moment(finished):
    text = (finished.folder / "result.json").read_text()
    assert str(finished.folder.parent) not in text
    assert str(BUNDLED.record.parent) not in text
    assert not re.search(r'"/|[A-Z]:\\\\|\d{4}-\d{2}-\d{2}|\d{2}:\d{2}:\d{2}', text)
    assert not re.search(r"seconds|elapsed|timing", text)


def test_the_stored_command_keeps_options_and_leaves_out_folders_and_output(finished):
    result = Result.from_json(finished.folder / "result.json")
    assert result.command == ("barnax", "identify", *BUDGET)


def test_the_bundled_files_may_be_given_by_their_paths(run, finished):
    words = (BUNDLED.record, *OCV, "--validate", BUNDLED.validation)
    outcome = run("identify", *words, *BUDGET, "--json")
    result, bundled = (
        json.loads(outcome.out),
        json.loads((finished.folder / "result.json").read_text()),
    )
    assert result["parameters"] == bundled["parameters"]
    assert result["metrics"] == bundled["metrics"]
    names = [path.name for path in (BUNDLED.record, *BUNDLED.ocv)]
    assert result["command"][2:7] == [names[0], "--ocv", names[1], "--ocv", names[2]]


def test_another_key_gives_another_search():
    first, second = (
        json.loads(run_command("identify", *BUDGET, "--json", "--key", key).out)["search"]
        for key in (0, 1)
    )
    assert (first["key"], second["key"]) == (0, 1)
    assert first["seeds"][0]["history"] != second["seeds"][0]["history"]


@pytest.mark.usefixtures("without_figures")
def test_records_are_compressed_once_though_two_threads_need_it(run, monkeypatch):
    compress, calls = problem.compress, []

    def slowly(*arguments):
        calls.append(arguments)
        # Long enough for the other thread to ask as well.
        time.sleep(0.5)
        return compress(*arguments)

    monkeypatch.setattr(problem, "compress", slowly)
    assert run("identify", *BUDGET, "--quiet").status == 0
    assert len(calls) == 1

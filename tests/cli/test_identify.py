"""`barnax identify` on the bundled cell: what it prints, what it writes, and that it repeats."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest

import barnax
from barnax.bundled import BUNDLED
from barnax.cli import identify as command
from barnax.cli.output import Output, write_folder
from barnax.cli.session import as_flags
from barnax.plan.document import FileRole, Plan
from barnax.reporting.first_screen import Next
from barnax.results import Result
from helpers import golden

from .conftest import BUDGET, OCV, contents


@pytest.fixture(scope="module")
def result(finished):
    return Result.from_json(finished.folder / "result.json")


def test_a_run_writes_the_result_its_timings_its_list_and_the_figures(finished):
    files = {"result.json", "plan.toml", "timings.json", "files.json", "figures/summary.png"}
    assert finished.outcome.status == 0
    assert set(contents(finished.folder)) == {*files, "figures"}
    listed = json.loads((finished.folder / "files.json").read_text())
    assert listed.keys() == files - {"files.json"}
    assert [path.name for path in finished.folder.parent.iterdir()] == ["out"]
    timings = json.loads((finished.folder / "timings.json").read_text())
    assert {"Searching [s]", "Refining [s]"} <= set(timings)
    assert all(seconds >= 0 for seconds in timings.values())


def test_a_name_may_be_that_of_a_file_in_the_folder(refuse, tmp_path):
    (tmp_path / "cell").mkdir()
    (tmp_path / "cell" / "ocv.csv").write_text("")
    assert "ocv.csv: the file is empty" in refuse("identify", "cell", "--ocv", "ocv.csv")
    assert "other.csv: there is no such file" in refuse("identify", "cell", "--ocv", "other.csv")


def test_the_golden_result_is_what_this_run_gives(finished, result):
    if golden.IS_WRITING:
        golden.RESULT.write_bytes((finished.folder / "result.json").read_bytes())
    assert result.parameters == pytest.approx(Result.from_json(golden.RESULT).parameters, rel=1e-6)
    # The last digits are the machine's.
    now, stored = (
        json.loads(path.read_text(), parse_float=lambda digits: float(f"{float(digits):.9g}"))
        for path in (finished.folder / "result.json", golden.RESULT)
    )
    assert now["inputs"] == stored["inputs"]


def test_the_first_screen_is_short_and_ends_with_what_shows_more(finished):
    """What it says is in golden/first_screen.txt, and `show` prints it again."""
    lines = finished.outcome.out.splitlines()
    # What is to be copied is in one line, however long.
    assert max(len(line) for line in lines if "  barnax " not in line) <= 80
    assert any(line.endswith(f" s  barnax show --all {finished.folder}") for line in lines)
    assert len([line for line in lines if line.strip()]) <= 20


def test_show_prints_the_first_screen_again_and_all_of_a_result_where_asked(run, finished):
    screen = finished.outcome.out
    shown = run("show", finished.folder)
    again = shown.out.rstrip()
    assert again
    assert screen.startswith(again)
    warnings = [line for line in finished.outcome.err.splitlines() if line.startswith("warning:")]
    assert warnings
    assert warnings == shown.err.splitlines()
    whole = run("show", "--all", finished.folder).out
    assert "What was decided" in whole
    assert whole.count("\n") > 3 * again.count("\n")


def test_warnings_go_to_stderr_and_into_the_result(finished, result):
    told = [f"warning: {as_flags(str(told))}" for told in result.warnings if told.counts]
    assert told
    assert finished.outcome.err.splitlines() == told
    assert "warning" not in finished.outcome.out


def test_json_prints_the_bytes_that_a_folder_holds_and_writes_nothing(run, finished, tmp_path):
    outcome = run("identify", *BUDGET, "--json")
    assert (outcome.status, outcome.err) == (0, finished.outcome.err)
    assert outcome.out == (finished.folder / "result.json").read_text()
    assert contents(tmp_path) == {}


@pytest.mark.usefixtures("without_figures")
def test_quiet_shows_warnings_alone_and_force_keeps_a_users_files(run, finished, tmp_path):
    old = {"result.json": b"old", "figures/old.png": b"old"}
    write_folder(tmp_path / "barnax-out", old, False)
    (tmp_path / "barnax-out/figures/mine.png").write_bytes(b"mine")
    outcome = run("identify", *BUDGET, "--quiet", "--force")
    assert outcome == (0, "", finished.outcome.err)
    folder = tmp_path / "barnax-out"
    assert set(contents(folder)) == {
        "result.json", "plan.toml", "timings.json", "files.json", "figures", "figures/mine.png"
    }  # fmt: skip
    stored = folder / "result.json"
    assert stored.read_bytes() == (finished.folder / "result.json").read_bytes()


def test_the_result_names_no_folder_and_no_moment(finished, result):
    text = (finished.folder / "result.json").read_text()
    assert str(finished.folder.parent) not in text
    assert str(BUNDLED.record.parent) not in text
    assert not re.search(r'"/|[A-Z]:\\\\|\d{4}-\d{2}-\d{2}|\d{2}:\d{2}:\d{2}', text)


def test_what_cannot_be_drawn_costs_only_itself(run, finished, tmp_path, monkeypatch):
    def broken(*_):
        raise RuntimeError("no fonts")

    # The search is done already.
    monkeypatch.setattr(
        "barnax.identification.pipeline.identify",
        lambda *_, **__: Result.from_json(finished[1] / "result.json"),
    )
    monkeypatch.setattr(command, "result_files", broken)
    outcome = run("identify", *BUDGET, "--quiet")
    assert outcome.status == 0
    assert "warning: the figures could not be drawn (no fonts); the result is written" in (
        outcome.err
    )
    assert (tmp_path / "barnax-out" / "result.json").is_file()


NOT_UTF8 = os.fsdecode(b"cell\xff\x1b[2J.csv")


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such names")
@pytest.mark.usefixtures("without_figures")
def test_a_name_that_no_terminal_should_see_is_stored_and_shown_harmlessly(run, tmp_path):
    table = pl.read_parquet(BUNDLED.record).head(1600).write_csv()
    (tmp_path / NOT_UTF8).write_text(table)
    outcome = run(
        "identify", NOT_UTF8, *OCV, *BUDGET, "--trust", "none", "--out", "o\x1b[2J", "--verbose"
    )
    assert outcome.status == 0
    assert "\x1b" not in outcome.out + outcome.err
    stored = Result.from_json("o\x1b[2J/result.json")
    assert stored.name == "cell\ufffd\ufffd[2J.csv"
    for words in (
        ("check", NOT_UTF8, "--json"),
        ("validate", "o\x1b[2J", NOT_UTF8),
        ("export", "o\x1b[2J", "--to", "csv", "--out", NOT_UTF8 + ".out"),
    ):
        outcome = run(*words)
        assert outcome.status in (0, 1)
        assert "\x1b" not in outcome.out + outcome.err
        (outcome.out + outcome.err).encode()


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_full_stdout_is_one_message_and_the_folder_is_written(tmp_path):
    words = [sys.executable, "-m", "barnax", "identify", *BUDGET, "--trust", "none"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(words, cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, text=True)
    assert done.returncode == 2
    assert done.stderr.count("error: ") == 1
    assert "error: output could not be written (No space left on device)" in done.stderr
    assert "Traceback" not in done.stderr
    assert Result.from_json(tmp_path / "barnax-out" / "result.json").model == "iso-rc"


@pytest.mark.parametrize(
    ("file", "expected"),
    [
        ("drive.csv", "barnax identify out/plan.toml --trust basic --design d --out barnax-out"),
        ("-", ""),
        ("/dev/fd/63", ""),
    ],
)
def test_the_next_step_is_an_option_beside_the_plan_of_the_run(
    tmp_path, monkeypatch, file, expected
):
    monkeypatch.chdir(tmp_path)
    step = Next("compute intervals of the parameters", {"trust": "basic"})
    monkeypatch.setattr("barnax.reporting.first_screen.next_step", lambda _: step)
    plan = Plan("identify", (FileRole(path=Path(file), name=file, role="identification"),))
    result, run = Result.from_json(golden.RESULT), Output().begun("out", with_jax=False)
    run.written = {"plan.toml"}
    advice, shown = command._next(result, run, plan, Path("d"))
    assert shown == expected
    assert advice.startswith(step.advice)
    assert ("saved as a file" in advice) == (not expected)


@pytest.mark.parametrize(
    ("reason", "given", "common", "shown"),
    [
        ("why", {}, {}, "barnax identify d/a.csv d/b.csv d/c.csv --ocv d/o.csv --out barnax-out"),
        ("why", {"over": "soc"}, {}, ""),
        ("why", {}, {"initial_soc": 0.0}, ""),
        ("", {}, {}, ""),
    ],
)
def test_a_record_is_identified_on_too_by_a_command_that_runs(
    tmp_path, monkeypatch, reason, given, common, shown
):
    """Of a folder whose roles were chosen; what its user gave stands in no words."""
    monkeypatch.chdir(tmp_path)
    step = Next("identify on c.csv too", also="c.csv")
    monkeypatch.setattr("barnax.reporting.first_screen.next_step", lambda _: step)
    roles = {"a.csv": "identification", "o.csv": "OCV test", "c.csv": "validation", "n": "not used"}
    parts = [
        FileRole(path=Path("d") / name, name=name, role=role, reason=reason)
        for name, role in roles.items()
    ]
    parts[0] = replace(parts[0], more=(Path("d/b.csv"),))
    chosen = Plan("identify", tuple(parts), {"capacity": 2.0}, {"capacity": "measured"})
    plan = chosen.changed(barnax.Window(**common), **given)
    result, run = Result.from_json(golden.RESULT), Output().begun("out", with_jax=False)
    assert command._next(result, run, plan, None) == (step.advice, shown)

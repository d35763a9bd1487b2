"""Real processes, killed at random moments: nothing is lost, nothing is half."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from barnax.cli.output import write_folder
from barnax.cli.session import Session

from .conftest import contents, run_command

WORDS = (
    *("identify", "--quiet", "--seeds", "24", "--population", "8", "--iterations", "30"),
    # What compiles fastest leaves the kills the most of the run.
    *("--score-to", "1500", "--method", "pso"),
)


OLD = {"result.json": b"old", "timings.json": b"old", "figures/ocv.png": b"old"}


def start(folder: Path, stderr: int = subprocess.DEVNULL) -> subprocess.Popen:
    command = [sys.executable, "-m", "barnax", *WORDS, "--out", str(folder), "--force"]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=stderr)


def journal_of(folder: Path) -> Path:
    return folder.parent / f".{folder.name}.journal"


def reproducible(folder: Path) -> dict[str, str]:
    return {name: each for name, each in contents(folder).items() if name != "timings.json"}


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    """A run that nothing disturbed."""
    folder = tmp_path_factory.mktemp("whole") / "out"
    assert run_command(*WORDS, "--out", folder).status == 0
    return folder


def kill_many_times(times: int, whole: Path, folder: Path) -> None:
    """Kill runs at random moments; what stood there stands, and the last run ends as `whole`."""
    write_folder(folder, OLD, False, Session(is_quiet=True))
    before, moments = contents(folder), random.Random(times)
    for _ in range(times):
        process = start(folder)
        time.sleep(moments.uniform(0.2, 4.0))
        process.send_signal(moments.choice([signal.SIGKILL, signal.SIGTERM, signal.SIGINT]))
        process.wait(60)
        # Either the old result or the new one, whole.
        if contents(folder) != before:
            assert reproducible(folder) == reproducible(whole)
            before = contents(folder)
    process = start(folder)
    assert process.wait(120) == 0
    assert reproducible(folder) == reproducible(whole)
    assert not journal_of(folder).exists()


def test_runs_killed_at_random_moments_lose_nothing_and_end_in_the_same_bits(whole, tmp_path):
    kill_many_times(5, whole, tmp_path / "out")


@pytest.mark.slow
def test_a_hundred_kills_lose_nothing(whole, tmp_path):
    kill_many_times(100, whole, tmp_path / "out")


def test_a_run_goes_on_from_its_journal(whole, tmp_path, monkeypatch):
    from barnax.cli import identify as command

    folder = tmp_path / "out"
    with monkeypatch.context() as patch:
        patch.setattr(command, "cell_figures", lambda _: {})
        patch.setattr(command, "found_figures", lambda *_: {})
        patch.setattr(command, "write_folder", lambda *_: os.kill(os.getpid(), signal.SIGINT))
        interrupted = run_command(*WORDS, "--out", folder)
    assert interrupted.status == 130
    assert "the same command goes on where this one stopped" in interrupted.err
    assert not folder.exists()
    assert journal_of(folder).stat().st_size > 10_000
    loud = [word for word in WORDS if word != "--quiet"]
    outcome = run_command(*loud, "--out", folder)
    assert "Going on where an interrupted run stopped" in outcome.err
    assert reproducible(folder) == reproducible(whole)
    timings = json.loads((folder / "timings.json").read_text())
    assert timings["Searching [s]"] is None
    assert timings["Cross-checking [s]"] > 0


def test_an_interrupted_process_says_whether_it_can_be_resumed(tmp_path):
    process = start(tmp_path / "out", subprocess.PIPE)
    time.sleep(3)
    process.send_signal(signal.SIGTERM)
    _, err = process.communicate(timeout=60)
    assert process.returncode in (0, 130)
    if process.returncode:
        assert b"earlier results are as they were" in err
        is_kept = journal_of(tmp_path / "out").exists()
        assert (b"the same command goes on" in err) == is_kept
        assert not (tmp_path / "out").exists()

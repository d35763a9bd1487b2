"""The command line run inside the tests' own process, on the bundled cell and a small budget."""

import contextlib
import hashlib
import io
import signal
import sys
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest
from matplotlib.layout_engine import ConstrainedLayoutEngine
from typer.main import get_command

from barnax.__main__ import SIGNALS, main
from barnax.bundled import BUNDLED

BUDGET = (
    *("--setup", "li2023", "--score-to", "1500"),
    *("--seeds", "3", "--population", "8", "--iterations", "5"),
)
OCV = tuple(word for path in BUNDLED.ocv for word in ("--ocv", path))


class Outcome(NamedTuple):
    """What a command left behind."""

    status: int
    out: str
    err: str


Run = Callable[..., Outcome]
# Typer makes the whole tree of commands anew for each run, which takes longer than many a run.
tree_of = cache(get_command)


def run_command(*words: object) -> Outcome:
    """`barnax` with these words, its streams caught. What is no exit is raised. Pictures are not
    laid out, which takes as long as drawing them; how they look is tested where they are made."""
    out, err = io.StringIO(), io.StringIO()
    argv, sys.argv = sys.argv, ["barnax", *map(str, words)]
    handlers = {number: signal.getsignal(number) for number in SIGNALS}
    try:
        with (
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
            pytest.MonkeyPatch.context() as patch,
        ):
            patch.setattr(ConstrainedLayoutEngine, "execute", lambda *_: None)
            patch.setattr("typer.main.get_command", tree_of)
            patch.setattr("barnax.cli.session.PATIENCE_S", 1e6)
            main()
        status = 0
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else int(end.code is not None)
    finally:
        sys.argv = argv
        for number, handler in handlers.items():
            signal.signal(number, handler)
    return Outcome(status, out.getvalue(), err.getvalue())


@pytest.fixture(scope="session", autouse=True)
def narrow_terminal() -> Iterator[None]:
    """Tables are as wide everywhere, and pictures have few pixels: most of a run's time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "80")
        patch.setattr("barnax.reporting.document.PICTURE_DPI", 40)
        yield


@pytest.fixture
def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawing takes most of a small run's time."""
    monkeypatch.setattr("barnax.cli.identify.result_files", lambda *_: {})


@pytest.fixture
def without_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """A command that reads anything fails: what is refused is refused before."""
    monkeypatch.setattr("barnax.identification.pipeline.read_inputs", None)


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Runs `barnax` in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return run_command


@pytest.fixture
def refuse(run: Run, tmp_path: Path) -> Callable[..., str]:
    """Runs `barnax`, expects it to refuse cleanly, and gives the message."""

    def refused(*words: object) -> str:
        before = contents(tmp_path)
        outcome = run(*words)
        assert outcome.status == 2
        assert outcome.out == ""
        assert "Traceback" not in outcome.err
        assert contents(tmp_path) == before
        return outcome.err

    return refused


class Finished(NamedTuple):
    """One whole run of `barnax identify` on the bundled cell."""

    outcome: Outcome
    folder: Path


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Finished:
    folder = tmp_path_factory.mktemp("finished") / "out"
    return Finished(run_command("identify", *BUDGET, "--out", folder), folder)


def contents(folder: Path) -> dict[str, str]:
    """Every entry below a folder, with the hash of its content."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        if path.is_file()
        else "folder"
        for path in folder.rglob("*")
    }

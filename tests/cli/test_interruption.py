"""Ctrl-C at any moment: one line, exit status 130, and files that are whole."""

import os
import subprocess
import sys
from pathlib import Path
from signal import SIGINT, default_int_handler, raise_signal, signal

import pytest

from barnax.bundled import BUNDLED
from barnax.cli.output import write_file, write_folder
from barnax.files import unfinished

from .conftest import BUDGET, contents

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals are sent otherwise there")
# What `stop` is called by.
MOMENTS = {
    "an extension of JAX is loaded": """
def hook(event, given):
    if event == "import" and given[0] == "jaxlib._jax": stop()
sys.addaudithook(hook)
""",
    "garbage is collected": """
gc.callbacks.append(lambda *_: "jax" in sys.modules and stop())
threading.Timer(1.0, gc.collect).start()
""",
    "records are read": """
import barnax.identification.pipeline
barnax.identification.pipeline.read_inputs = lambda *_, **__: stop()
""",
    "a file is opened": """
def hook(event, given):
    if event == "open" and str(given[0]).endswith(".parquet"): stop()
sys.addaudithook(hook)
""",
}
RUN = """
import gc, os, signal, sys, threading
def stop(): os.kill(os.getpid(), signal.{signal})
{moment}
sys.argv = {words!r}
from barnax.__main__ import main
main()
"""
IDENTIFY = ("identify", *BUDGET)
EARLIER, READING = "interrupted; earlier results are as they were\n", "interrupted\n"


def stopped(folder, moment, *words, number="SIGINT"):
    code = RUN.format(signal=number, moment=moment, words=["barnax", *map(str, words)])
    run = [sys.executable, "-c", code]
    return subprocess.run(run, cwd=folder, capture_output=True, text=True, start_new_session=True)


# A polite end from outside has the same handler as Ctrl-C.
@pytest.mark.parametrize(
    ("moment", "number", "words", "said"),
    [
        ("an extension of JAX is loaded", "SIGINT", IDENTIFY, EARLIER),
        pytest.param("garbage is collected", "SIGINT", IDENTIFY, EARLIER, marks=pytest.mark.slow),
        pytest.param("records are read", "SIGTERM", IDENTIFY, EARLIER, marks=pytest.mark.slow),
        # It loads no JAX, and has no result that it could leave as it was.
        ("a file is opened", "SIGTERM", ("check", BUNDLED.record), READING),
    ],
)
def test_an_interruption_is_one_line_and_writes_nothing(tmp_path, moment, number, words, said):
    done = stopped(tmp_path, MOMENTS[moment], *words, number=number)
    assert (done.returncode, done.stderr, contents(tmp_path)) == (130, said, {})


@pytest.fixture
def interruptible():
    """Ctrl-C raises, though a shell that begins tests in the background has them ignore it."""
    before = signal(SIGINT, default_int_handler)
    yield
    signal(SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_what_is_written_is_finished_first(tmp_path, monkeypatch):
    real = os.replace
    monkeypatch.setattr(os, "replace", lambda *each: (raise_signal(SIGINT), real(*each)))
    for content in (b"old", b"new"):
        with pytest.raises(KeyboardInterrupt):
            write_folder(tmp_path / "out", {"result.json": content, "figures/a.png": b""}, True)
        assert (tmp_path / "out" / "result.json").read_bytes() == content
    with pytest.raises(KeyboardInterrupt):
        write_file(tmp_path / "cell.h", b"whole")
    assert (tmp_path / "cell.h").read_bytes() == b"whole"
    assert not unfinished(tmp_path)


@pytest.mark.slow
def test_an_interrupted_fleet_ends_with_its_workers_and_says_how_to_continue(tmp_path):
    """The terminal sends Ctrl-C to the workers too, while they start."""
    Path(tmp_path, "m.csv").write_text(f"id,records\na,{BUNDLED.record}\nb,{BUNDLED.record}\n")
    moment = """
import barnax.fleet.engine as engine
real = engine.wait
engine.wait = lambda *given, **more: (os.killpg(0, signal.SIGINT), real(*given, **more))
"""
    done = stopped(tmp_path, moment, "fleet", "m.csv", "--quiet", "--workers", "2", "--out", "f")
    kept = "interrupted; the finished cells are kept, and the same command continues\n"
    assert (done.returncode, done.stderr) == (130, kept)

"""The tests of one module against a mutant of it, in a process that has its libraries already."""

import contextlib
import importlib
import importlib.abc
import importlib.util
import os
import resource
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import CodeType
from typing import Literal

import pytest

from .mutants import Mutant

Outcome = Literal["killed", "survived", "timed out"]

# Loaded once, before any process is made: most of a test run's time is their loading. None of them
# starts a thread or a device by that.
LIBRARIES = (
    "equinox", "fastexcel", "hypothesis.strategies", "jax.numpy", "jinja2", "jaxtyping", "lineax",
    "matplotlib.figure", "optimistix", "polars", "pydantic", "rich.console", "scipy.interpolate",
    "scipy.optimize", "scipy.signal", "scipy.stats", "typer",
)  # fmt: skip
MOST_MEMORY = 8_000_000_000
_LIMITED = (signal.SIGXCPU, signal.SIGKILL)


@dataclass(frozen=True)
class Trial:
    """A module and the test files that are to notice a change of it, quick ones first."""

    module: str
    tests: tuple[str, ...]

    @property
    def source(self) -> Path:
        spec = importlib.util.find_spec("barnax")
        assert spec is not None
        assert spec.origin is not None
        return Path(spec.origin).parent / f"{self.module.replace('.', '/')}.py"

    def run(self, mutant: Mutant | None, limit_s: int) -> tuple[Outcome, float]:
        """What the tests say of a mutant, or of the module as it is, and the seconds it computed.

        Computing for `limit_s` counts as never ending, and so does waiting for that long ten times
        over: how busy the machine is must not decide.
        """
        code = None if mutant is None else compile(mutant.tree, str(self.source), "exec")
        child = _in_child(lambda: self._test(code), limit_s)
        start = time.monotonic()
        while True:
            done, status, used = os.wait4(child, os.WNOHANG)
            if not done and time.monotonic() - start > 10 * limit_s:
                os.killpg(child, signal.SIGKILL)
                done, status, used = os.wait4(child, 0)
            if done:
                is_over = os.WIFSIGNALED(status) and os.WTERMSIG(status) in _LIMITED
                outcome = "timed out" if is_over else "killed"
                return "survived" if status == 0 else outcome, used.ru_utime + used.ru_stime
            time.sleep(0.01)

    def _test(self, code: CodeType | None) -> int:
        if code is not None:
            sys.meta_path.insert(0, _Finder(f"barnax.{self.module}", self.source, code))
        # The options of the suite are left out, for one of them imports the module in its own way.
        return pytest.main(
            [
                "-o", "addopts=", "-m", "not slow", "-x", "-q", "-n0", "-p", "no:cacheprovider",
                "--hypothesis-seed=0", "--no-header",
                "-W", "ignore::pytest.PytestAssertRewriteWarning", *self.tests,
            ]
        )  # fmt: skip


def load_libraries() -> None:
    for name in LIBRARIES:
        importlib.import_module(name)


def _in_child(work: Callable[[], int], limit_s: int) -> int:
    """The id of a process of its own group that ends with what `work` gives back; silent."""
    child = os.fork()
    if child:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.setpgid(child, child)
        return child
    status = 1
    try:
        os.setpgid(0, 0)
        silence = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(silence, stream)
        resource.setrlimit(resource.RLIMIT_DATA, (MOST_MEMORY, MOST_MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s))
        # What hypothesis remembers of one mutant must not help against the next.
        with tempfile.TemporaryDirectory() as folder:
            os.environ["HYPOTHESIS_STORAGE_DIRECTORY"] = folder
            # The tests on measured cells are not for everybody.
            os.environ["BARNAX_SHARED_DATA"] = folder + "/none"
            status = int(work())
    finally:
        os._exit(status)


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Gives other code for one module."""

    def __init__(self, name: str, path: Path, code: CodeType):
        self.name, self.path, self.code = name, path, code

    def find_spec(self, fullname, path=None, target=None):
        if fullname != self.name:
            return None
        return importlib.util.spec_from_file_location(fullname, self.path, loader=self)

    def create_module(self, spec):
        return None

    def exec_module(self, module):
        exec(self.code, module.__dict__)

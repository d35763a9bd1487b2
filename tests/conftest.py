"""How the suite runs: what is compiled and kept, and which process has which tests.

The process that hands out the tests runs none, and loads nothing of barnax: what tests share is in
`helpers.fixtures`.
"""

import gc
import os
import shutil
import tempfile
from collections.abc import Generator
from pathlib import Path

import pytest
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling

from helpers.compiling import QUICK_FLAGS

# Files that share what takes long run in one process: runs of the command and searches as small as
# theirs, a result, seeds, fits, fonts, the syntax trees of the source. These and the longest files
# go first, so that no process is left with one of them at the end.
TOGETHER = {
    "tests/cli": "commands",
    "tests/test_pipeline.py": "commands",
    "tests/test_reopening.py": "commands",
    "tests/reporting/test_identification.py": "commands",
    "tests/experiment": "designs",
    "tests/search": "seeds",
    "tests/global_optimum/test_optimum.py": "seeds",
    "tests/uncertainty": "fits",
    "tests/plots": "figures",
    "tests/test_house.py": "source",
    "tests/test_notices.py": "source",
    "tests/test_package.py": "source",
    "tests/reporting/test_templates.py": "source",
}
FIRST = (
    *TOGETHER,
    *("tests/fit/test_fitted_ocv.py", "tests/checks/test_findings.py", "tests/plan"),
    *("tests/filters/test_kalman.py", "tests/fit/test_registration.py", "tests/select"),
    *("tests/optimizers", "tests/life", "tests/test_answer.py"),
)


class Files(LoadScopeScheduling):
    """The tests of a file, or of several of `TOGETHER`, in one process."""

    def _split_scope(self, nodeid: str) -> str:
        file = nodeid.split("::")[0]
        return next((name for path, name in TOGETHER.items() if file.startswith(path)), file)


def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> Files:
    return Files(config, log)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Every second process begins with the last folder: what one has compiled when they meet, the
    other reads."""
    report = yield
    worker = os.environ.get("PYTEST_XDIST_WORKER", "gw0")
    if isinstance(collector, pytest.Directory) and int(worker.removeprefix("gw")) % 2:
        report.result.reverse()
    return report


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    def rank(item: pytest.Item) -> tuple[int, Path]:
        starts = [item.nodeid.startswith(path) for path in FIRST]
        return (starts.index(True) if any(starts) else len(FIRST)), item.path

    items.sort(key=rank)


def pytest_collection_finish() -> None:
    # Modules and tests stay until the end: nobody need look through them for garbage.
    gc.freeze()


def pytest_configure(config: pytest.Config) -> None:
    """What one process of the run has compiled serves all of them, and nobody else, unless a
    folder is given that keeps it for the next run."""
    is_worker = hasattr(config, "workerinput")
    if not is_worker:
        if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
            folder = tempfile.mkdtemp(prefix="barnax-tests-")
            config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))
            os.environ["JAX_COMPILATION_CACHE_DIR"] = folder
        os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
        os.environ["XLA_FLAGS"] = QUICK_FLAGS
        # Workers share the cores: threads of their own would only take turns.
        os.environ |= {"NPROC": "1", "OPENBLAS_NUM_THREADS": "1"}
    # As `pytest_collection_modifyitems` has them, not the files of most tests first.
    config.option.loadscopereorder = False
    # As `barnax` itself: traced programs are many objects and little garbage.
    gc.set_threshold(50_000, 20, 20)
    if is_worker or not config.getoption("numprocesses", None):
        config.pluginmanager.import_plugin("helpers.fixtures")

"""What every test shares: the data it may use."""

import gc
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

import hypothesis
import jax
import pytest
import threadpoolctl
from xdist.scheduler import LoadScopeScheduling

from barnax.bundled import BUNDLED
from barnax.cell import CIRCUITS, CellModel, characterize, elements
from barnax.model.problem import Problem, make_problem
from barnax.model.window import Window
from barnax.optimizers import make_optimizer
from barnax.records import Record, read_record
from barnax.search.refine import Refinement, refine
from barnax.search.seeds import Search, search_seeds
from helpers.compiling import QUICK_FLAGS
from helpers.shared import SET, SHARED

REPOSITORY = Path(__file__).parents[1]
# Files that share what takes long run in one process: runs of the command, a result, the syntax
# trees of the source. These and the longest files go first, so that no process is left with one of
# them at the end.
TOGETHER = {
    "tests/cli": "commands",
    "tests/experiment": "designs",
    "tests/test_house.py": "source",
    "tests/test_notices.py": "source",
    "tests/test_package.py": "source",
    "tests/reporting/test_templates.py": "source",
}
FIRST = (
    *TOGETHER,
    *("tests/over_soc/test_own_ocv.py", "tests/checks/test_findings.py", "tests/plan"),
    *("tests/filters/test_kalman.py", "tests/over_soc/test_registration.py", "tests/select"),
    *("tests/optimizers", "tests/test_pipeline.py", "tests/life", "tests/test_answer.py"),
)


class Files(LoadScopeScheduling):
    """The tests of a file, or of several of `TOGETHER`, in one process."""

    def _split_scope(self, nodeid: str) -> str:
        file = nodeid.split("::")[0]
        return next((name for path, name in TOGETHER.items() if file.startswith(path)), file)


def pytest_xdist_make_scheduler(config: pytest.Config) -> Files:
    return Files(config)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    def place(item: pytest.Item) -> int:
        starts = [item.nodeid.startswith(path) for path in FIRST]
        return starts.index(True) if any(starts) else len(FIRST)

    items.sort(key=place)


@pytest.fixture(autouse=True)
def known_circuits(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A circuit or an element that a test or a page makes is known there only."""
    monkeypatch.setattr(CIRCUITS, "_known", dict(CIRCUITS))
    known = vars(elements)["_ELEMENTS"]
    before = dict(known)
    yield
    known.clear()
    known.update(before)


def pytest_configure(config: pytest.Config) -> None:
    """What one process of the run has compiled serves all of them, and nobody else, unless a
    folder is given that keeps it for the next run."""
    if not hasattr(config, "workerinput"):
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
    threadpoolctl.threadpool_limits(1, "blas")
    # What takes long on a busy machine is no error.
    hypothesis.settings.register_profile("barnax", deadline=None)
    hypothesis.settings.load_profile("barnax")
    # As `barnax` itself: traced programs are many objects and little garbage.
    gc.set_threshold(50_000, 20, 20)
    # JAX has read its settings already where it was imported before.
    jax.config.update("jax_compilation_cache_dir", os.environ["JAX_COMPILATION_CACHE_DIR"])
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of measured cells, which cannot be shipped; tests that need it skip without."""
    if not SHARED.is_dir():
        pytest.skip(SET)
    return SHARED


@pytest.fixture(scope="session")
def bundled_record() -> Record:
    """The bundled cell's identification record."""
    return read_record(BUNDLED.record)


@pytest.fixture(scope="session")
def bundled_cell() -> CellModel:
    """The bundled cell, by polynomials through its OCV tests."""
    return characterize([read_record(path) for path in BUNDLED.ocv], ocv_fit="polynomial")


@pytest.fixture(scope="session")
def short_problem(bundled_record: Record, bundled_cell: CellModel) -> Problem:
    """The first 1,500 s of the bundled record; problems of this shape share compiled programs."""
    return make_problem(bundled_record, bundled_cell, window=Window(score_to_s=1500.5))


@pytest.fixture(scope="session")
def found(short_problem: Problem) -> Search:
    """Eight short searches on the short problem."""
    return search_seeds(
        short_problem, make_optimizer("ibmo", 12, 40), key=jax.random.key(0), seeds=8
    )


@pytest.fixture(scope="session")
def refinement(found: Search) -> Refinement:
    """The cross-check of `found`."""
    return refine(found)

"""What every test shares: the circuits that are known, and the data that it may use."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import hypothesis
import jax
import pytest
import threadpoolctl

from barnax import Record, Refinement, Search, Window, make_optimizer, read_record
from barnax.bundled import BUNDLED
from barnax.cell import CIRCUITS, ELEMENTS, CellModel, characterize
from barnax.model.problem import Problem, make_problem
from barnax.search.seeds import refine, search_seeds

from .shared import SET, SHARED


def pytest_configure() -> None:
    threadpoolctl.threadpool_limits(1, "blas")
    # What takes long on a busy machine is no error. Every run draws other examples.
    hypothesis.settings.register_profile(
        "barnax", deadline=None, max_examples=15, derandomize=False
    )
    hypothesis.settings.load_profile("barnax")
    # JAX has read its settings already where it was imported before.
    jax.config.update("jax_compilation_cache_dir", os.environ["JAX_COMPILATION_CACHE_DIR"])
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)


@pytest.fixture(autouse=True)
def registered_circuits() -> Iterator[None]:
    """A circuit or an element that a test or a page makes is known there only."""
    registries: tuple[dict[str, Any], ...] = CIRCUITS, ELEMENTS
    before = [dict(registry) for registry in registries]
    yield
    for registry, names in zip(registries, before, strict=True):
        registry.clear()
        registry.update(names)


@pytest.fixture
def double_precision() -> Iterator[None]:
    """Double precision for all of JAX, as wherever a simulation is compared with a reference."""
    with jax.enable_x64(True):
        yield


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
def bundled_validation() -> Record:
    """The bundled cell's validation record."""
    return read_record(BUNDLED.validation)


@pytest.fixture(scope="session")
def bundled_cell() -> CellModel:
    """The bundled cell, by polynomials through its OCV tests."""
    return characterize([read_record(path) for path in BUNDLED.ocv], ocv_fit="polynomial")


@pytest.fixture(scope="session")
def short_problem(bundled_record: Record, bundled_cell: CellModel) -> Problem:
    """The first 1,500 s of the bundled record; problems of this shape share compiled programs."""
    return make_problem(bundled_record, bundled_cell, window=Window(score_to_s=1500.5))


@pytest.fixture(scope="session")
def searched(short_problem: Problem) -> Search:
    """Eight short searches on the short problem."""
    return search_seeds(
        short_problem, make_optimizer("ibmo", 12, 40), key=jax.random.key(0), seeds=8
    )


@pytest.fixture(scope="session")
def refinement(searched: Search) -> Refinement:
    """The cross-check of `found`."""
    return refine(searched)

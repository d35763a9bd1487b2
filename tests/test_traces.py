"""Traces on disk: found again only by what is the same, and never believed when damaged."""

import enum
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barnax import traces
from barnax.optimizers import make_optimizer
from barnax.optimizers.test_functions import sphere
from barnax.traces import FOLDER, NotDescribedError, arrays_in, traced

VALUES = jnp.linspace(-1.0, 2.0, 7, dtype=jnp.float32)
KEY = jax.random.key(0)


@pytest.fixture
def folder(tmp_path: Path):
    """JAX's compilation cache, empty, for one test."""
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield tmp_path / FOLDER
    jax.config.update("jax_compilation_cache_dir", before)


@pytest.fixture
def exports(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Grows by one for every function that is traced to be kept."""
    counted, export = [], jax.export.export
    monkeypatch.setattr(
        jax.export, "export", lambda function: counted.append(function) or export(function)
    )
    return counted


def run(function, *arguments):
    return jax.jit(traced(function, arguments))(*arrays_in(arguments))


def described(*arguments) -> tuple[str, ...]:
    return tuple(traces._parts(arguments))


def test_a_second_run_reads_the_trace_of_the_first(folder: Path, exports: list[object]):
    first, second = run(sphere, VALUES, KEY), run(sphere, VALUES + 1, KEY)
    assert len(exports) == 1
    assert len(list(folder.iterdir())) == 1
    np.testing.assert_array_equal(first, sphere(VALUES, KEY))
    np.testing.assert_array_equal(second, sphere(VALUES + 1, KEY))


@pytest.mark.parametrize(
    "damage", [lambda kept: kept[:-9], lambda kept: b"", lambda kept: kept * 2]
)
def test_a_damaged_trace_is_made_anew(folder: Path, exports: list[object], damage):
    run(sphere, VALUES, KEY)
    (file,) = folder.iterdir()
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    np.testing.assert_array_equal(run(sphere, VALUES, KEY), sphere(VALUES, KEY))
    assert len(exports) == 2
    assert traces._read(file) is not None


def test_a_folder_that_cannot_be_written_costs_nothing_but_time(folder: Path):
    folder.write_text("a file where the folder should be")
    np.testing.assert_array_equal(run(sphere, VALUES, KEY), sphere(VALUES, KEY))


def test_without_the_cache_nothing_is_kept(tmp_path: Path, folder: Path):
    jax.config.update("jax_enable_compilation_cache", False)
    try:
        run(sphere, VALUES, KEY)
    finally:
        jax.config.update("jax_enable_compilation_cache", True)
    assert not folder.exists()


def test_code_of_the_user_is_traced_every_time(folder: Path):
    scale = 2.0

    def scaled(values):
        return scale * values

    np.testing.assert_array_equal(run(scaled, VALUES), scale * VALUES)
    scale = 3.0
    np.testing.assert_array_equal(run(scaled, VALUES), scale * VALUES)
    assert not folder.exists()


def test_a_search_and_its_settings_are_told_apart():
    default = make_optimizer("ibmo", 30, 500)
    assert described(default) == described(make_optimizer("ibmo", 30, 500))
    others = [make_optimizer("ibmo", 31, 500), make_optimizer("bmo", 30, 500)]
    assert len({described(each) for each in [default, *others]}) == 3


def test_code_and_settings_are_part_of_what_a_trace_is_found_by(monkeypatch: pytest.MonkeyPatch):
    def name():
        return traces._digest(traces._description(sphere, (VALUES, KEY)))

    before = name()
    assert name() == before
    with jax.enable_x64(not jax.config.jax_enable_x64):
        assert name() != before
    with jax.default_matmul_precision("highest"):
        assert name() != before
    monkeypatch.setattr(traces, "_code", lambda: b"other code")
    assert name() != before


plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary(),
    lambda inner: st.lists(inner) | st.tuples(inner, inner) | st.dictionaries(st.text(), inner),
    max_leaves=8,
)


@given(plain, plain)
def test_two_values_have_one_description_only_if_they_are_equal(first, second):
    # repr tells 1 from 1.0 and True, 0.0 from -0.0, and equals itself for NaN.
    assert (described(first) == described(second)) == (repr(first) == repr(second))


def test_of_arrays_all_but_the_numbers_counts():
    assert described(VALUES) == described(2 * VALUES)
    others = [
        VALUES[:3],
        VALUES[None],
        VALUES.astype(jnp.int32),
        jnp.asarray(2.0),
        jax.random.key(0),
    ]
    assert len({described(each) for each in [VALUES, *others]}) == 6
    # NumPy's are constants of the trace.
    assert described(np.arange(3)) != described(np.arange(3)[::-1])
    assert described(np.arange(3)) != described(np.arange(3.0))


class Mine(enum.Enum):
    ONE = 1


@pytest.mark.parametrize("value", [object(), Mine.ONE, lambda: 0, Path("x"), {1, 2}])
def test_what_is_not_known_is_not_described(value):
    with pytest.raises(NotDescribedError):
        described(value)

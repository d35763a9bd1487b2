"""Traces on disk: found again only by what is the same, and never believed when damaged."""

import enum
import functools
import os
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import barnax
from barnax import programs, traces
from barnax.optimizers import make_optimizer
from barnax.optimizers.test_functions import ackley, sphere
from barnax.traces import FOLDER, KEPT_S, NotDescribedError, arrays_in, traced
from barnax.trust import assess

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

    def counting(function, **how):
        counted.append(function)
        return export(function, **how)

    monkeypatch.setattr(jax.export, "export", counting)
    return counted


def run(function, *arguments):
    return jax.jit(traced(function, arguments))(*arrays_in(arguments))


def described(*arguments) -> tuple[str, ...]:
    return tuple(traces._parts(arguments))


def name() -> bytes:
    return traces._digest(traces._description(sphere, (VALUES, KEY)))


def test_a_second_run_reads_the_trace_of_the_first(folder: Path, exports: list[object]):
    first, second = run(sphere, VALUES, KEY), run(sphere, VALUES + 1, KEY)
    assert len(exports) == 1
    assert len(list(folder.iterdir())) == 1
    np.testing.assert_array_equal(first, sphere(VALUES, KEY))
    np.testing.assert_array_equal(second, sphere(VALUES + 1, KEY))


@pytest.mark.parametrize("kind", ["compressed", pytest.param("scan", marks=pytest.mark.slow)])
def test_an_identification_comes_from_traces_to_the_same_bits(
    kind, short_problem, folder: Path, exports: list[object], monkeypatch: pytest.MonkeyPatch
):
    def everything():
        monkeypatch.setattr(programs, "_programs", {})
        problem = barnax.make_problem(
            short_problem.course.record,
            short_problem.cell,
            window=short_problem.window,
            objective=kind,
        )
        found = barnax.identify(problem, make_optimizer("ibmo", 10, 12), key=KEY, seeds=2)
        checked = barnax.refine(found)
        estimates = assess(checked).uncertainty.estimates
        histories = [seed.history_v.tobytes() for seed in found.seeds]
        return histories, found.best.parameters, checked.parameters, repr(estimates)

    first = everything()
    made = len(exports)
    assert made >= 4
    assert everything() == first
    assert len(exports) == made
    jax.config.update("jax_enable_compilation_cache", False)
    try:
        assert everything() == first
    finally:
        jax.config.update("jax_enable_compilation_cache", True)


@pytest.mark.parametrize(
    "damage", [lambda kept: kept[:-9], lambda kept: b"", lambda kept: kept * 2]
)
def test_a_damaged_trace_is_made_anew(folder: Path, exports: list[object], damage):
    run(sphere, VALUES, KEY)
    (file,) = folder.iterdir()
    file.write_bytes(damage(file.read_bytes()))
    np.testing.assert_array_equal(run(sphere, VALUES, KEY), sphere(VALUES, KEY))
    assert len(exports) == 2
    assert traces._read(file) is not None


def test_a_trace_counts_under_its_own_name_only(folder: Path):
    run(sphere, VALUES, KEY)
    (first,) = folder.iterdir()
    run(ackley, VALUES, KEY)
    (second,) = set(folder.iterdir()) - {first}
    second.write_bytes(first.read_bytes())
    np.testing.assert_array_equal(run(ackley, VALUES, KEY), jax.jit(ackley)(VALUES, KEY))


def test_content_that_is_whole_but_no_trace_is_none(folder: Path, exports: list[object]):
    run(sphere, VALUES, KEY)
    (file,) = folder.iterdir()
    traces._write(file, b"no trace")
    np.testing.assert_array_equal(run(sphere, VALUES, KEY), sphere(VALUES, KEY))
    assert len(exports) == 2


def test_who_reads_while_others_write_reads_something_whole(folder: Path):
    run(sphere, VALUES, KEY)
    (file,) = folder.iterdir()
    trace = file.read_bytes()[traces.DIGEST_BYTES :]
    with ThreadPoolExecutor(4) as pool:
        writing = [pool.submit(traces._write, file, trace) for _ in range(100)]
        while not all(each.done() for each in writing):
            assert traces._read(file) is not None
        for each in writing:
            each.result()
    assert list(folder.iterdir()) == [file]


def test_traces_that_nobody_reads_go(folder: Path):
    run(sphere, VALUES, KEY)
    (file,) = folder.iterdir()
    long_ago = time.time() - KEPT_S - 60
    os.utime(file, (long_ago, long_ago))
    run(sphere, VALUES, KEY)
    run(ackley, VALUES, KEY)
    assert file in folder.iterdir()
    os.utime(file, (long_ago, long_ago))
    run(ackley, VALUES[:3], KEY)
    assert file not in folder.iterdir()


def test_a_folder_that_cannot_be_written_costs_nothing_but_time(folder: Path):
    folder.write_text("a file where the folder should be")
    np.testing.assert_array_equal(run(sphere, VALUES, KEY), sphere(VALUES, KEY))


@pytest.mark.parametrize("place", ["", "gs://bucket/cache"])
def test_only_in_folders_traces_are_kept(
    place: str, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    jax.config.update("jax_compilation_cache_dir", place)
    traced(sphere, (VALUES, KEY))
    assert not list(tmp_path.iterdir())


def test_code_of_the_user_is_traced_every_time(folder: Path):
    scale = 2.0

    def scaled(values):
        return scale * values

    np.testing.assert_array_equal(run(scaled, VALUES), scale * VALUES)
    scale = 3.0
    np.testing.assert_array_equal(run(scaled, VALUES), scale * VALUES)
    assert not folder.exists()


@functools.wraps(sphere)
def doubled(x, key):
    return 2 * sphere(x, key)


class Mine(enum.Enum):
    ONE = 1


class float(float):
    """Not what its name says."""


@pytest.mark.parametrize(
    "value",
    [
        doubled, jax.vmap(sphere), jax.grad(sphere), functools.partial(sphere), lambda: 0,
        object(), Mine.ONE, Path("x"), {1, 2}, float(2.0), np.array([{}]),
    ],
    # Addresses in names would differ from process to process.
    ids=[
        "wrapper", "vmap", "grad", "partial", "lambda", "object", "enum", "path", "set", "float",
        "objects",
    ],
)  # fmt: skip
def test_what_is_not_known_is_not_described(value):
    with pytest.raises(NotDescribedError):
        described(value)


def test_arrays_on_another_device_are_not_described(monkeypatch: pytest.MonkeyPatch):
    assert traces._platform([VALUES, KEY, np.zeros(3)]) == jax.default_backend()
    with jax.default_device(jax.devices()[0]), pytest.raises(NotDescribedError):
        traces._platform([VALUES])
    monkeypatch.setattr(jax, "devices", lambda: ["a better one"])
    with pytest.raises(NotDescribedError):
        traces._platform([VALUES])


def test_a_search_and_its_settings_are_told_apart():
    default = make_optimizer("ibmo", 30, 500)
    assert described(default) == described(make_optimizer("ibmo", 30, 500))
    others = [make_optimizer("ibmo", 31, 500), make_optimizer("bmo", 30, 500)]
    assert len({described(each) for each in [default, *others]}) == 3


@pytest.mark.parametrize("part", ["_sources", "_versions", "_settings"])
def test_code_and_settings_are_part_of_the_name(part: str, monkeypatch: pytest.MonkeyPatch):
    before = name()
    assert name() == before
    monkeypatch.setattr(traces, part, lambda *_: b"others")
    assert name() != before


def test_the_device_and_the_settings_of_a_thread_are_part_of_the_name(
    monkeypatch: pytest.MonkeyPatch,
):
    before = name()
    with jax.enable_x64(not jax.config.jax_enable_x64):
        assert name() != before
    with jax.default_matmul_precision("highest"):
        assert name() != before
    with jax.log_compiles():
        assert name() == before
    monkeypatch.setattr(jax, "default_backend", lambda: "another")
    assert name() != before


def test_sources_count_by_place_and_text_until_they_change(tmp_path: Path):
    now = time.time() + 60

    def digest(**files: str) -> bytes:
        package = tmp_path / str(len(list(tmp_path.iterdir())))
        package.mkdir()
        for stem, text in files.items():
            (package / f"{stem}.py").write_text(text)
        return traces._sources(package, now)

    digests = [digest(a="x = 1"), digest(a="x = 2"), digest(b="x = 1"), digest(a="x = 1", b="")]
    assert len(set(digests)) == 4
    package = tmp_path / "0"
    assert traces._sources(package, now) == digests[0]
    os.utime(package / "a.py", (now + 1, now + 1))
    for place in (package, tmp_path / "none"):
        with pytest.raises(NotDescribedError):
            traces._sources(place, now)


def test_versions_count_and_must_be_known():
    assert traces._versions(("jax",)) != traces._versions(("numpy",))
    with pytest.raises(NotDescribedError):
        traces._versions(("no-such-distribution",))


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
    weak = jax.jit(lambda: 2.0)()
    strong = jnp.asarray(weak, weak.dtype)
    others = [VALUES[:3], VALUES[None], VALUES.astype(jnp.int32), KEY, weak, strong]
    assert len({described(each) for each in [VALUES, *others]}) == 7
    # NumPy's may be constants of a trace.
    assert described(np.arange(3)) != described(np.arange(3)[::-1])
    assert described(np.arange(3)) != described(np.arange(3.0))

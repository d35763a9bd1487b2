"""Kept programs: loaded where all they were made from is the same, and from nobody else's file."""

import math
import os
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from barnax import execution, programs
from barnax.cell.elements import DIFFUSION, Element
from barnax.execution import compile_for
from barnax.files import remove_oldest
from barnax.model.coordinates import Coordinates
from barnax.model.search_space import Bounds

SOUND = np.array([[4.0, 2.0], [2.0, 5.0]])


def factor_of(matrix):
    return jnp.linalg.cholesky(matrix)


def total(values, axis=0, *, keepdims=False):
    return jnp.sum(values, axis=axis, keepdims=keepdims)


def other_total(values, axis=0):
    return jnp.sum(values, axis=axis)


def scaled(factors, values):
    return factors[:2] * values


def draw(key):
    return jax.random.normal(key)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder in which programs are kept, those of this file too, though the source may have been
    changed just now."""
    monkeypatch.setattr(programs, "NAMED", programs.NAMED | {__name__.partition(".")[0]})
    names = "jax_compilation_cache_dir", "jax_enable_compilation_cache"
    before = {name: getattr(jax.config, name) for name in names}
    monkeypatch.setattr(programs, "LOADED_S", time.time() + 2 * programs.SETTLED_S)
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield tmp_path / programs.FOLDER
    for name, value in before.items():
        jax.config.update(name, value)


@pytest.fixture
def compiled(monkeypatch):
    """A list that grows by the name of every program that is compiled."""
    names, compile_ = [], execution._compile

    def counted(of_arrays, arrays):
        names.append(of_arrays.__name__)
        return compile_(of_arrays, arrays)

    monkeypatch.setattr(execution, "_compile", counted)
    return names


def in_a_new_process(monkeypatch):
    """Forget the programs of this one."""
    monkeypatch.setattr(execution, "_programs", {})
    monkeypatch.setattr(execution, "_making", {})


def factor(monkeypatch, matrix=SOUND):
    """A Cholesky factor, by a program that is not in memory."""
    in_a_new_process(monkeypatch)
    return np.asarray(compile_for(factor_of, matrix)(matrix))


def test_a_kept_program_is_loaded_and_gives_the_same_bits(folder, compiled, monkeypatch):
    first, second = factor(monkeypatch), factor(monkeypatch)
    assert len(compiled) == len([*folder.iterdir()]) == 1
    assert first.tobytes() == second.tobytes()
    np.testing.assert_allclose(first, np.linalg.cholesky(SOUND), rtol=1e-6)


def test_a_key_of_random_numbers_is_taken(folder, compiled, monkeypatch):
    draws = []
    for key in jax.random.key(0), jax.random.key(0), jax.random.key(1):
        in_a_new_process(monkeypatch)
        draws.append(float(compile_for(draw, key)(key)))
    assert len(compiled) == 1
    assert draws[0] == draws[1] == float(jax.random.normal(jax.random.key(0))) != draws[2]


@pytest.mark.usefixtures("folder")
def test_without_a_folder_or_where_jaxs_cache_is_switched_off_nothing_is_kept():
    assert programs.path_of(total, [SOUND])
    jax.config.update("jax_enable_compilation_cache", False)
    assert programs.path_of(total, [SOUND]) is None
    jax.config.update("jax_enable_compilation_cache", True)
    jax.config.update("jax_compilation_cache_dir", None)
    assert programs.path_of(total, [SOUND]) is None


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    "other",
    {
        "function": (other_total, (SOUND, 0)),
        "shape": (total, (SOUND[:1], 0)),
        "type": (total, (SOUND.astype(np.float32), 0)),
        "value": (total, (SOUND, 1)),
        "type of a value": (total, (SOUND, False)),
        "structure": (total, ((SOUND,), 0)),
        "argument of a partial": (partial(total, keepdims=True), (SOUND, 0)),
    }.items(),
    ids=lambda item: item[0],
)
def test_another_program_has_another_file(other):
    assert programs.path_of(*other[1]) != programs.path_of(total, (SOUND, 0))


@pytest.mark.usefixtures("folder")
def test_values_count_in_full_though_their_text_hides_a_difference():
    values = np.arange(2000.0)
    others = values + 1e-9 * (values == 1000)
    assert repr(values) == repr(others)
    first, second = (programs.path_of(partial(scaled, own), [SOUND]) for own in (values, others))
    assert first != second


@pytest.mark.usefixtures("folder")
def test_an_element_counts_with_its_numbers():
    box = Coordinates.of(Bounds.default(1.0, 1.0, 1e3, elements=("rc", "diffusion")), "log")
    moved = Element("diffusion", "D", DIFFUSION.description, (0.5, 0.5), (1.0, 0.1))
    other = replace(box, elements=(box.elements[0], moved))
    assert box.elements[1] is DIFFUSION
    assert programs.path_of(Coordinates.decode, [other]) != programs.path_of(
        Coordinates.decode, [box]
    )


@pytest.mark.usefixtures("folder")
def test_equal_values_that_are_other_objects_have_one_file():
    named = ["".join(["to", "tal"]) for _ in range(2)]
    assert named[0] is not named[1]
    path = programs.path_of(partial(total, axis=0), [SOUND, (named[0], named[0])])
    assert path == programs.path_of(partial(total, axis=0), [SOUND, tuple(named)])


def test_what_is_not_of_the_package_has_no_file(folder, monkeypatch):
    assert programs.path_of(partial(total, axis=0), [SOUND])
    assert programs.path_of(lambda values: values, [SOUND]) is None
    monkeypatch.undo()
    monkeypatch.setattr(programs, "LOADED_S", math.inf)
    assert programs.path_of(Coordinates.decode, [SOUND]).parent == folder
    assert programs.path_of(partial(Coordinates.decode, total), [SOUND]) is None
    assert programs.path_of(total, [SOUND]) is None


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("changed", ["source", "versions", "processor"])
def test_another_source_version_or_processor_is_another_file(changed, monkeypatch):
    before = programs.path_of(total, [SOUND])
    if changed == "source":
        monkeypatch.setattr(programs, "_hash_of", lambda package: b"another")
    else:
        of = {"versions": ("importlib.metadata.version", lambda name: "0")}
        of["processor"] = ("barnax.programs.PROCESSOR", programs.PROCESSOR[1:])
        programs._surroundings.cache_clear()
        monkeypatch.setattr(*of[changed])
    after = programs.path_of(total, [SOUND])
    programs._surroundings.cache_clear()
    assert None not in (before, after)
    assert after != before


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("name", ["XLA_FLAGS", "NPROC"])
def test_other_settings_are_another_file(name, monkeypatch):
    before = programs.path_of(total, [SOUND])
    with jax.enable_x64(True):
        assert programs.path_of(total, [SOUND]) != before
    monkeypatch.setenv(name, "--xla_cpu_enable_fast_math=true")
    assert programs.path_of(total, [SOUND]) != before
    monkeypatch.setenv("XLA_FLAGS", "flags.txt")
    assert programs.path_of(total, [SOUND]) is None


def test_an_edit_is_another_source_and_none_is_known_of_what_was_edited_after_loading(tmp_path):
    path = tmp_path / "module.py"
    path.write_text("RATE = 1.0\n")
    now_s = time.time()
    before = programs._hash_of.__wrapped__(tmp_path)
    assert programs.is_unchanged(tmp_path, now_s + 2 * programs.SETTLED_S)
    # The time of an edit can be set back, but not that of the change.
    path.write_text("RATE = 2.0\n")
    os.utime(path, (0, 0))
    assert programs._hash_of.__wrapped__(tmp_path) != before
    assert not programs.is_unchanged(tmp_path, now_s)
    assert not programs.is_unchanged(tmp_path / "none", now_s)


def flipped(content):
    return content[:-9] + bytes([content[-9] ^ 1]) + content[-8:]


@pytest.mark.parametrize("damaged", [flipped, lambda content: content[:2000], lambda content: b""])
def test_a_damaged_file_is_compiled_anew_and_replaced(folder, compiled, damaged, monkeypatch):
    first = factor(monkeypatch)
    (path,) = folder.iterdir()
    path.write_bytes(damaged(path.read_bytes()))
    assert factor(monkeypatch).tobytes() == first.tobytes()
    assert len(compiled) == 2
    assert programs.load(path) is not None


@pytest.mark.parametrize("what", ["folder", "file"])
@pytest.mark.parametrize("mode", [0o720, 0o702])
def test_what_others_may_write_is_not_loaded(folder, compiled, what, mode, monkeypatch):
    factor(monkeypatch)
    (path,) = folder.iterdir()
    assert folder.stat().st_mode & 0o777 == 0o700
    assert path.stat().st_mode & 0o777 == 0o600
    (folder if what == "folder" else path).chmod(mode)
    assert programs.load(path) is None
    factor(monkeypatch)
    assert len(compiled) == 2


def test_what_is_another_users_is_neither_loaded_nor_written(folder, compiled, monkeypatch):
    factor(monkeypatch)
    (path,) = folder.iterdir()
    content, user = path.read_bytes(), os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: user + 1)
    assert programs.load(path) is None
    path.write_bytes(b"not touched")
    factor(monkeypatch)
    assert len(compiled) == 2
    assert path.read_bytes() == b"not touched" != content


def test_a_link_is_not_followed(folder, monkeypatch):
    factor(monkeypatch)
    (path,) = folder.iterdir()
    link = folder / "link"
    link.symlink_to(path)
    assert programs.load(path) is not None
    assert programs.load(link) is None
    other = folder.parent / "other"
    other.symlink_to(folder)
    assert programs.load(other / path.name) is None


def test_what_jax_cannot_write_is_not_kept(folder):
    def called(values):
        return jax.pure_callback(np.sin, jax.ShapeDtypeStruct(values.shape, values.dtype), values)

    path = folder / "program"
    folder.mkdir(mode=0o700)
    programs.keep(jax.jit(called).lower(jnp.ones(2)).compile(), path)
    assert not path.exists()
    programs.keep(jax.jit(jnp.sin).lower(jnp.ones(2)).compile(), path)
    assert programs.load(path) is not None


def test_a_full_disk_ends_nothing(folder, compiled, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    np.testing.assert_allclose(factor(monkeypatch), np.linalg.cholesky(SOUND), rtol=1e-6)
    assert len(compiled) == 1
    assert [*folder.iterdir()] == []


def test_those_unused_for_longest_go_first(tmp_path):
    for age, name in enumerate("abcd"):
        (tmp_path / name).write_bytes(bytes(100))
        os.utime(tmp_path / name, (1000 - age, 1000 - age))
    remove_oldest(tmp_path, 250)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]


SCRIPT = """
import sys
import barnax
barnax.LOADED_S += 10
import numpy as np
from jax.numpy.linalg import cholesky
from barnax import execution, programs

def factor_of(matrix):
    return cholesky(matrix)

programs.NAMED.add("__main__")
compile_ = execution._compile
execution._compile = lambda *given: print("compiled") or compile_(*given)
matrix = np.array([[4.0, 2.0], [2.0, 5.0]])
print(np.asarray(execution.compile_for(factor_of, matrix)(matrix)).tobytes().hex())
"""


def test_processes_share_programs_and_may_write_them_at_once(tmp_path):
    command = [sys.executable, "-W", "error", "-c", SCRIPT]
    environment = os.environ | {"JAX_COMPILATION_CACHE_DIR": str(tmp_path)}
    started = [
        subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    *_, first = (process.communicate()[0].split() for process in started)
    assert len([*Path(tmp_path, programs.FOLDER).iterdir()]) == 1
    ran = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    # Nothing else in that process has had JAX lower what calls LAPACK.
    assert ran.stdout.split() == first[-1:]

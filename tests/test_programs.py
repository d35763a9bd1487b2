"""Kept programs: loaded where all they were made from is the same, and from nobody else's file."""

import os
import subprocess
import sys
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jinja2 import DictLoader, Environment

from barnax import execution, programs
from barnax.execution import compile_for
from barnax.reporting.bytecode import KeptTemplates

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="kept on Linux alone")
SOUND = np.array([[4.0, 2.0], [2.0, 5.0]])


def factor_of(matrix):
    return jnp.linalg.cholesky(matrix)


def total(values, axis=0, *, keepdims=False):
    return jnp.sum(values, axis=axis, keepdims=keepdims)


def other_total(values, axis=0):
    return jnp.sum(values, axis=axis)


def scaled(factors, values):
    return factors[:2] * values


def called(values):
    return jax.pure_callback(np.sin, jax.ShapeDtypeStruct(values.shape, values.dtype), values)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The folder of a command's programs, in a cache of JAX that only the test has."""
    names = "jax_compilation_cache_dir", "jax_enable_compilation_cache"
    before = {name: getattr(jax.config, name) for name in names}
    monkeypatch.setattr(programs, "_source", "source")
    monkeypatch.setattr(programs, "_hash_source", lambda: "source")
    # The tests compile with flags.
    monkeypatch.setattr(programs, "FLAGS", ("TF_XLA_",))
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield tmp_path / programs.FOLDER
    for name, value in before.items():
        jax.config.update(name, value)


@pytest.fixture
def compiled(monkeypatch):
    """The names of all programs that are compiled, as they are."""
    names, compile_ = [], execution._compile

    def counted(of_arrays, arrays):
        names.append(of_arrays.__name__)
        return compile_(of_arrays, arrays)

    monkeypatch.setattr(execution, "_compile", counted)
    return names


def run(monkeypatch, function=factor_of, values=SOUND):
    """What a function gives in a process that has no program in memory."""
    monkeypatch.setattr(execution, "_programs", {})
    monkeypatch.setattr(execution, "_making", {})
    programs._is_ready.cache_clear()
    return np.asarray(compile_for(function, values)(values))


def test_a_kept_program_is_loaded_and_gives_the_same_bits(folder, compiled, monkeypatch):
    first, second = run(monkeypatch), run(monkeypatch)
    assert len(compiled) == len([*folder.iterdir()]) == 1
    assert first.tobytes() == second.tobytes()
    np.testing.assert_allclose(first, np.linalg.cholesky(SOUND), rtol=1e-6)
    assert folder.stat().st_mode & 0o777 == 0o700
    # JAX's own cache does not have it, or would be asked for it once the file is lost.
    assert not [*folder.parent.glob("*factor_of*")]


OTHERS = {
    "function": (other_total, (SOUND, 0)),
    "shape": (total, (SOUND[:1], 0)),
    "type": (total, (SOUND.astype(np.float32), 0)),
    "value": (total, (SOUND, 1)),
    "type of a value": (total, (SOUND, False)),
    "structure": (total, ((SOUND,), 0)),
    "argument of a partial": (partial(total, keepdims=True), (SOUND, 0)),
}


@pytest.mark.usefixtures("folder")
def test_each_other_program_has_another_file(monkeypatch):
    names = [programs._path_of(total, (SOUND, 0))]
    names += [programs._path_of(*other) for other in OTHERS.values()]
    with jax.enable_x64(not jax.config.jax_enable_x64):
        names.append(programs._path_of(total, (SOUND, 0)))
    for of, name, value in (
        (programs, "_source", "edited"),
        (programs, "_processor", lambda: ["another"]),
        (jax, "__version__", "0"),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(of, name, value)
            names.append(programs._path_of(total, (SOUND, 0)))
    monkeypatch.setenv("EQX_ON_ERROR", "nan")
    names.append(programs._path_of(total, (SOUND, 0)))
    assert None not in names
    assert len({*names}) == len(names) == 13


@pytest.mark.usefixtures("folder")
def test_values_count_in_full_and_not_as_objects():
    values = np.arange(2000.0)
    others = values + 1e-9 * (values == 1000)
    assert repr(values) == repr(others)
    own, other, again = (
        programs._path_of(partial(scaled, own), [SOUND]) for own in (values, others, values.copy())
    )
    assert own == again != other


def test_nothing_is_kept_of_what_is_not_known_whole(folder, monkeypatch):
    assert programs._path_of(total, [SOUND])
    assert programs._path_of(lambda values: values, [SOUND]) is None
    for name, value in (("_source", None), ("FLAGS", (*programs.FLAGS, "PATH"))):
        with monkeypatch.context() as patch:
            patch.setattr(programs, name, value)
            assert programs._path_of(total, [SOUND]) is None
    jax.config.update("jax_enable_compilation_cache", False)
    assert programs._path_of(total, [SOUND]) is None


def test_an_address_is_left_to_jax(folder, monkeypatch):
    monkeypatch.chdir(folder.parent)
    jax.config.update("jax_compilation_cache_dir", "gs://bucket/cache")
    assert programs._path_of(total, [SOUND]) is None
    assert [*folder.parent.iterdir()] == []


COMMAND = """
from barnax import programs
with programs.of_command():
    inside = programs._source
print(inside, programs._source, programs._hash_source())
"""


@pytest.mark.parametrize("before", ["", "numpy", "barnax.cell", "barnax.errors"])
def test_a_source_stands_only_in_a_command_where_nothing_ran_before(before):
    code = before and f"import {before}"
    ran = subprocess.run([sys.executable, "-c", code + COMMAND], capture_output=True, text=True)
    inside, after, source = ran.stdout.split()
    assert (inside, after) == ("None" if before else source, "None")


@pytest.mark.parametrize("edited", ["barnax", "jax"])
def test_an_edit_is_another_source_and_keeps_nothing(folder, tmp_path, edited, monkeypatch):
    content = programs._content_of(jax.jit(total).lower(SOUND).compile())
    path = programs._path_of(total, [SOUND])
    monkeypatch.undo()
    package = tmp_path / "jax"
    package.mkdir()
    file = (tmp_path if edited == "barnax" else package) / "edited.py"
    file.write_text("RATE = 1.0\n", encoding="utf-8")
    monkeypatch.setattr(programs, "__file__", str(tmp_path / "programs.py"))
    spec = SimpleNamespace(submodule_search_locations=[str(package)])
    monkeypatch.setattr(programs.util, "find_spec", lambda name: spec)
    before = programs._hash_source()
    assert programs._hash_source() == before
    monkeypatch.setattr(programs, "_source", before)
    file.write_text("RATE = 2.0\n", encoding="utf-8")
    assert programs._hash_source() != before
    programs.write(path, content)
    assert not [*folder.iterdir()]


def flipped(content):
    return content[:-9] + bytes([content[-9] ^ 1]) + content[-8:]


@pytest.mark.parametrize("damaged", [flipped, lambda content: content[:2000], lambda content: b""])
def test_a_damaged_file_is_compiled_anew_and_replaced(folder, compiled, damaged, monkeypatch):
    first = run(monkeypatch)
    (path,) = folder.iterdir()
    path.write_bytes(damaged(path.read_bytes()))
    assert programs.read(path) is None
    assert run(monkeypatch).tobytes() == first.tobytes() == run(monkeypatch).tobytes()
    assert len(compiled) == 2


def test_a_program_under_the_name_of_another_is_not_loaded(folder, monkeypatch):
    run(monkeypatch)
    (path,) = folder.iterdir()
    other = path.with_name(f"{'0' * 64}.program")
    other.write_bytes(path.read_bytes())
    other.chmod(0o600)
    assert programs.read(path)
    assert programs.read(other) is None


@pytest.mark.parametrize("kept", [True, False])
def test_templates_are_kept_beside_programs(folder, kept, monkeypatch):
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(folder.parent))
    monkeypatch.setenv("JAX_ENABLE_COMPILATION_CACHE", str(kept).lower())
    programs._is_ready.cache_clear()
    compiled, compile_ = [], Environment.compile

    def rendered(source):
        loader = DictLoader({"sum.txt": source})
        return Environment(loader=loader, bytecode_cache=KeptTemplates()).get_template("sum.txt")

    def counted(self, source, *given, **named):
        compiled.append(source)
        return compile_(self, source, *given, **named)

    monkeypatch.setattr(Environment, "compile", counted)
    first, second, edited = (
        rendered(text).render(x=2) for text in ["{{ x + 3 }}"] * 2 + ["{{ x }}"]
    )
    assert (first, second, edited) == ("5", "5", "2")
    assert len(compiled) == (2 if kept else 3)
    assert folder.exists() == kept


@pytest.mark.usefixtures("folder")
def test_nothing_is_kept_where_jax_has_several_devices(monkeypatch):
    monkeypatch.setattr(jax, "device_count", lambda: 2)
    assert programs._path_of(total, [SOUND]) is None


def test_what_jax_does_not_load_again_is_left_to_its_own_cache(folder, compiled, monkeypatch):
    first = run(monkeypatch)
    (path,) = folder.iterdir()
    programs.write(path, b"no program")
    assert programs.read(path) == b"no program"
    assert run(monkeypatch).tobytes() == first.tobytes() == run(monkeypatch).tobytes()
    assert programs.read(path) == b""
    assert compiled[1:] == ["factor_of", "factor_of"]


@pytest.mark.parametrize("mode", [0o720, 0o702])
def test_what_others_may_write_is_not_loaded(folder, compiled, mode, monkeypatch):
    run(monkeypatch)
    (path,) = folder.iterdir()
    assert path.stat().st_mode & 0o777 == 0o600
    path.chmod(mode)
    assert programs.read(path) is None
    path.chmod(0o600)
    folder.chmod(mode)
    run(monkeypatch)
    assert compiled[1] == "factor_of"


def test_what_is_another_users_is_neither_loaded_nor_written(folder, compiled, monkeypatch):
    run(monkeypatch)
    (path,) = folder.iterdir()
    content, user = path.read_bytes(), os.geteuid()
    with monkeypatch.context() as patch:
        patch.setattr(os, "geteuid", lambda: user + 1)
        assert programs.read(path) is None
        run(monkeypatch)
    assert len(compiled) == 2
    assert path.read_bytes() == content


def test_a_link_is_not_followed(folder, tmp_path, monkeypatch):
    run(monkeypatch)
    (path,) = folder.iterdir()
    link = folder / f"{'0' * 64}.program"
    link.symlink_to(path)
    assert programs.read(path)
    assert programs.read(link) is None
    folder.rename(tmp_path / "other")
    folder.symlink_to(tmp_path / "other")
    programs._is_ready.cache_clear()
    assert not programs._is_ready(folder)


def test_those_unused_for_longest_go_first(tmp_path, monkeypatch):
    monkeypatch.setattr(programs, "MOST_BYTES", 250)
    for age, name in enumerate("abcd"):
        (tmp_path / name).write_bytes(bytes(100))
        os.utime(tmp_path / name, (1000 - age, 1000 - age))
    programs._remove_oldest(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"a", "b"}


def test_what_jax_cannot_write_is_in_its_own_cache_from_then_on(folder, compiled, monkeypatch):
    sines = [run(monkeypatch, called, np.ones(2, np.float32)) for _ in range(2)]
    np.testing.assert_allclose(sines, np.sin(np.ones((2, 2))), rtol=1e-6)
    (path,) = folder.iterdir()
    assert programs.read(path) == b""
    assert [name == "called" for name in compiled] == [False, True]


def test_a_full_disk_ends_nothing(folder, monkeypatch):
    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    np.testing.assert_allclose(run(monkeypatch), np.linalg.cholesky(SOUND), rtol=1e-6)
    assert [*folder.iterdir()] == []


SCRIPT = """
import sys
from barnax import programs
with programs.of_command():
    import numpy as np
    from jax.numpy.linalg import cholesky
    from barnax import execution

    def factor_of(matrix):
        return cholesky(matrix)

    programs.FLAGS = ("TF_XLA_",)
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
    assert [process.returncode for process in started] == [0, 0]
    assert len([*Path(tmp_path, programs.FOLDER).iterdir()]) == 1
    ran = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    # Nothing else in that process has had JAX lower what calls LAPACK.
    assert ran.stdout.split() == first[-1:]

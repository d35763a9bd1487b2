"""What the package's code may not do, read from the code itself."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import barnax

SOURCE = Path(barnax.__file__).parent
# The generator of the bundled data travels with it in a wheel, and is never imported.
MODULES = sorted(set(SOURCE.rglob("*.py")) - set((SOURCE / "data").rglob("*.py")))
# Written files go through one module; a journal and a repeated run's folder are their own.
WRITERS = {"cli/output.py", "cli/journal.py", "cli/rerun.py", "traces.py"}
# `barnax export --verify` runs the module it has just written; a rerun and an old workbook have
# processes of their own.
RUNNERS = {"export/pybamm_module.py", "export/thevenin_module.py"}
STARTERS = {"cli/rerun.py", "records/readers/old_workbook.py"}

UNSAFE_MODULES = {"pickle", "cPickle", "dill", "joblib", "marshal", "shelve", "yaml", "cloudpickle"}
UNSAFE_CALLS = {"eval", "os.system", "os.popen", "np.load", "numpy.load", "pickle.loads"}
WRITING_CALLS = {
    "write_text", "write_bytes", "mkdir", "makedirs", "unlink", "rmdir", "rmtree", "replace_file",
    "rename", "symlink_to", "hardlink_to", "touch", "TemporaryDirectory", "NamedTemporaryFile",
    "mkstemp", "mkdtemp", "write_parquet", "write_csv", "savefig", "savez", "tofile", "copyfile",
}  # fmt: skip


def name_of(node: ast.expr) -> str:
    """A called name with its dots, as far as it is one."""
    if isinstance(node, ast.Attribute):
        return f"{name_of(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


def calls(path: Path) -> Iterator[tuple[str, ast.Call]]:
    """Every call in a module, by the name it calls; examples in docstrings are no code."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call):
            yield name_of(node.func), node


def opens_to_write(name: str, call: ast.Call) -> bool:
    """Whether a call opens a file in another mode than to read it."""
    if name.rpartition(".")[2] != "open":
        return False
    modes = [*call.args, *(each.value for each in call.keywords if each.arg == "mode")]
    texts = [each.value for each in modes if isinstance(each, ast.Constant)]
    return any(isinstance(text, str) and set(text) & set("wax+") for text in texts)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_a_module_unpickles_evaluates_starts_and_writes_nothing_it_may_not(path):
    place = path.relative_to(SOURCE).as_posix()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import | ast.ImportFrom):
            module = getattr(node, "module", None) or ""
            names = {module.split(".")[0], *(alias.name.split(".")[0] for alias in node.names)}
            assert not names & UNSAFE_MODULES
            assert "subprocess" not in names or place in STARTERS
    for name, call in calls(path):
        last = name.rpartition(".")[2]
        assert name not in UNSAFE_CALLS
        assert name != "exec" or place in RUNNERS
        assert not any(each.arg in ("shell", "allow_pickle") for each in call.keywords)
        is_writing = last in WRITING_CALLS or name == "os.replace" or opens_to_write(name, call)
        assert not is_writing or place in WRITERS


@pytest.mark.parametrize("place", sorted(STARTERS))
def test_a_process_of_python_takes_no_library_from_the_working_folder(place):
    started = [call for name, call in calls(SOURCE / place) if name == "subprocess.run"]
    assert started
    for call in started:
        assert isinstance(call.args[0], ast.List)
        words = [each.value for each in call.args[0].elts if isinstance(each, ast.Constant)]
        assert words[:2] == ["-P", "-m"]


@pytest.mark.parametrize("place", sorted(WRITERS | RUNNERS | STARTERS))
def test_what_is_excepted_is_there(place):
    assert (SOURCE / place).is_file()


def test_the_test_sees_what_it_looks_for(tmp_path):
    module = tmp_path / "module.py"
    module.write_text("path.open('ab')\nopen(path, mode='w')\nopen(path)\npath.open('rb')\n")
    assert [opens_to_write(*each) for each in calls(module)] == [True, True, False, False]

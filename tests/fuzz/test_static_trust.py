"""No module of the package unpickles, evaluates text or starts a shell, read from its code."""

import ast
from pathlib import Path

import pytest

import barnax

SOURCE = Path(barnax.__file__).parent
MODULES = sorted(SOURCE.rglob("*.py"))
UNSAFE_MODULES = {"pickle", "dill", "joblib", "marshal", "shelve", "yaml", "cloudpickle", "ctypes"}
UNSAFE_CALLS = {"eval", "system", "popen", "loads_pickle", "read_pickle", "mktemp"}
UNSAFE_OPTIONS = {"shell", "allow_pickle"}


def unsafe_in(code: str) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [getattr(node, "module", None) or "", *(alias.name for alias in node.names)]
            found |= {name.split(".")[0] for name in names} & UNSAFE_MODULES
        elif isinstance(node, ast.Call):
            called = ast.unparse(node.func).rpartition(".")[2]
            found |= {called} & UNSAFE_CALLS
            found |= {each.arg for each in node.keywords} & UNSAFE_OPTIONS
    return found


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_a_module_does_nothing_that_a_file_could_misuse(path):
    assert unsafe_in(path.read_text(encoding="utf-8")) == set()


def test_the_test_sees_what_it_looks_for():
    code = "import pickle\nx = eval('1')\nos.system('x')\nnp.load(f, allow_pickle=True)\n"
    assert unsafe_in(code) == {"pickle", "eval", "system", "allow_pickle"}

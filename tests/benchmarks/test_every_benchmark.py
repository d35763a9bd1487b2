"""Every benchmark can be imported, and finds what it reads by a name when it is run."""

import ast
import importlib
import importlib.util
import re
from importlib.util import resolve_name
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PATHS = sorted((ROOT / "benchmarks").rglob("*.py"))
# Tools that a benchmark compares with, which the tests do not need.
PEERS = {"cmaes", "cocoex", "minionpy", "pybamm", "pybop", "thevenin"}
PACKAGE = re.compile(r"(barnax|benchmarks)(\.\w+)+(:\w+)?")
COMMAND = re.compile(r"python -m (benchmarks[\w.]*)")


def module_of(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def names_read(path):
    """What a file imports of the project, wherever in it, and the names of it that are strings."""
    package = ".".join(path.relative_to(ROOT).parent.parts)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            source = resolve_name("." * node.level + (node.module or ""), package)
            if source.partition(".")[0] in ("barnax", "benchmarks"):
                yield from (f"{source}:{name.name}" for name in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            if PACKAGE.fullmatch(node.value):
                yield node.value
            yield from COMMAND.findall(node.value)


def is_there(name):
    """True where a module, or what "module:name" says is in it, can be read."""
    module, _, attribute = name.rstrip(".").partition(":")
    try:
        if attribute and hasattr(importlib.import_module(module), attribute):
            return True
        return importlib.util.find_spec(f"{module}.{attribute}".rstrip(".")) is not None
    except ModuleNotFoundError as missing:
        return missing.name in PEERS


@pytest.mark.parametrize("path", PATHS, ids=module_of)
def test_a_benchmark_is_imported_and_finds_every_name(path):
    assert is_there(f"{module_of(path)}:__doc__")
    assert not [name for name in names_read(path) if not is_there(name)]


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md", *sorted(
    str(path.relative_to(ROOT)) for path in (ROOT / "docs").glob("*.md")
)])  # fmt: skip
def test_a_page_names_benchmarks_that_are_there(page):
    text = (ROOT / page).read_text(encoding="utf-8")
    names = re.findall(r"`(benchmarks(?:\.\w+)+)`", text) + COMMAND.findall(text)
    # CONTRIBUTING and README say NAME where any may stand.
    assert not [name for name in names if "NAME" not in name and not is_there(name)]


@pytest.mark.parametrize(
    "gone", ["barnax.identification.pipeline:_problem", "benchmarks.gone", "barnax.gone:it"]
)
def test_a_name_that_is_gone_is_noticed(gone):
    assert not is_there(gone)


def test_names_of_imports_within_functions_and_in_strings_are_read():
    path = ROOT / "benchmarks" / "fleet.py"
    names = set(names_read(path))
    assert "barnax.fleet.rows:identify_rows" in names
    assert "barnax.model.problem:compress" in names

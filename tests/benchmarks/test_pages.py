"""Committed results are replaced whole: a benchmark that stops leaves the former page."""

import ast
import os
import re
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from barnax.errors import InputError
from benchmarks import pages

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
IN_PLACE = {"write_text", "write_bytes", "savefig", "copyfile"}


def test_a_stop_while_results_are_written_leaves_the_former_ones(tmp_path, monkeypatch):
    path = tmp_path / "results" / "page"
    pages.save_page(path, "former")

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(InputError, match="No space left"):
        pages.save_page(path, "new")
    with pytest.raises(InputError, match="No space left"):
        pages.save_figure(path, Figure(), dpi=50)
    assert path.read_text() == "former"
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize(
    "path", sorted([*BENCHMARKS.rglob("__main__.py"), *BENCHMARKS.glob("*.py")]), ids=str
)
def test_no_benchmark_writes_over_its_results(path):
    calls = [
        (node.func.attr, ast.unparse(node))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute)
    ]
    # What goes to a worker in a temporary folder is no result.
    assert not [
        text
        for name, text in calls
        if name in IN_PLACE and ("RESULTS" in text or "options.out" in text)
    ]


def test_the_index_has_every_page_once_with_the_command_that_is_on_it():
    results = BENCHMARKS / "results"
    rows = re.findall(
        r"^\| \[(.+?)\]\(\1\) \| `(.+?)` \|", (results / "README.md").read_text(), re.MULTILINE
    )
    pages = {path.name for path in results.glob("*.md")} - {"README.md"}
    assert sorted(name for name, _ in rows) == sorted(pages)
    for name, command in rows:
        assert f"`{command}`" in (results / name).read_text(encoding="utf-8")

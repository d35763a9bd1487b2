"""Whatever is in a result.json or a comparison.json: it is refused, or can be used and stored."""

import ast
import json
import math
from pathlib import Path

import numpy as np
import pytest

from barnax.comparison import ComparisonResult
from barnax.errors import InputError
from barnax.export import EXPORTERS
from barnax.results import Result

from .hostile import EXAMPLES, absurd_documents, damaged, repeated
from .stored import good_comparison, good_result

GOOD = {"result": good_result(), "comparison": good_comparison()}
KINDS = {"result": Result, "comparison": ComparisonResult}


def survive(folder: Path, kind: str, text: str | bytes) -> None:
    """Read a file; what is accepted must give itself back, and can be exported."""
    path = folder / f"{kind}.json"
    path.write_bytes(text if isinstance(text, bytes) else text.encode("utf-8", "surrogatepass"))
    try:
        stored = KINDS[kind].from_json(path)
    except InputError as problem:
        refusal = str(problem)
    else:
        refusal = f"{path}: "
        require_use(stored, folder)
    assert refusal.startswith(f"{path}: ")
    assert len(refusal) < 2000 + len(str(path))


def require_use(stored: Result | ComparisonResult, folder: Path) -> None:
    """What is accepted is stored again the same, and its cell has a finite OCV."""
    again = folder / "again.json"
    again.write_text(stored.to_json(), encoding="utf-8")
    assert type(stored).from_json(again).to_json() == stored.to_json()
    voltage_v = stored.cell_model.average_ocv_v(np.linspace(-0.5, 1.5, 41))
    assert np.isfinite(voltage_v).all()
    if isinstance(stored, Result):
        for exporter in EXPORTERS.values():
            content, _ = exporter.write(stored)
            if exporter.file_name.endswith(".py"):
                require_plain_module(content)


def require_plain_module(content: bytes) -> None:
    """An exported module has the statements of every other, and no text from the result in it."""
    for node in ast.walk(ast.parse(content)):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [getattr(node, "module", None), *(alias.name for alias in node.names)]
            assert {name.split(".")[0] for name in names if name} <= {"numpy", "pybamm", "interp"}
        if isinstance(node, ast.Name):
            assert node.id not in ("exec", "eval", "open", "__import__")
        if isinstance(node, ast.Constant) and isinstance(node.value, float):
            assert math.isfinite(node.value)


@pytest.mark.parametrize("kind", KINDS)
def test_the_good_files_are_good(tmp_path, kind):
    (tmp_path / "good.json").write_text(GOOD[kind].to_json())
    assert KINDS[kind].from_json(tmp_path / "good.json") == GOOD[kind]


@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize("kind", KINDS)
def test_absurd_values(tmp_path, kind, examples):
    good = json.loads(GOOD[kind].to_json())
    repeated(examples, lambda text: survive(tmp_path, kind, text), absurd_documents(good))


@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize("kind", KINDS)
def test_damaged_files(tmp_path, kind, examples):
    good = [GOOD[kind].to_json().encode()]
    repeated(examples, lambda content: survive(tmp_path, kind, content), damaged(good))

"""What `Result.from_json` refuses: parts that were changed, and files that never were a result."""

import copy
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from barnax.errors import InputError
from barnax.results import Result, make_result
from barnax.search.evaluate import evaluate
from barnax.search.refine import Refinement


@pytest.fixture(scope="module")
def result(refinement: Refinement) -> Result:
    prepared = refinement.search.problem.prepared
    return make_result(refinement, [evaluate(prepared, refinement.parameters)])


@pytest.fixture
def document(result: Result) -> dict[str, Any]:
    return json.loads(result.to_json())


@pytest.fixture
def read(tmp_path: Path) -> Callable[[Any], Result]:
    """Writes a document, or bytes as they are, and reads it back."""

    def from_disk(content: Any) -> Result:
        path = tmp_path / "result.json"
        path.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
        return Result.from_json(path)

    return from_disk


def put(place: str, value: Any) -> Callable[[dict[str, Any]], None]:
    """Sets the value at a place such as `search/key`; `...` deletes it."""

    def change(document: dict[str, Any]) -> None:
        *path, last = place.split("/")
        for step in path:
            document = document[int(step)] if isinstance(document, list) else document[step]
        if value is ...:
            del document[last]
        else:
            document[last] = value

    return change


TAMPERED = [
    ("surprise", 1),
    ("search/surprise", 1),
    ("parameters", ...),
    ("refined/verdict", ...),
    ("parameters/R0 [Ohm]", ...),
    ("parameters/R0 [Ohm]", -0.1),
    ("parameters/R0 [Ohm]", math.nan),
    ("parameters/R0 [Ohm]", "low"),
    ("refined/rmse [V]", math.inf),
    ("refined/rmse [V]", -1.0),
    ("metrics/validation", None),
    ("search/seeds", []),
    ("search/seeds/0/history", [math.nan]),
    ("search/coordinates", "polar"),
    ("schema_version", 99),
    ("model", "so-rc-2"),
    ("inputs/0/role", "spy"),
    ("inputs/0/sign/strength", "felt"),
    ("bounds", {"R0 [Ohm]": [1.0]}),
    ("window/initial_soc", 3.0),
    ("window/start_time_s", "noon"),
    ("window/surprise", 1),
    ("window/score_steps", [1.5]),
    ("cell", {}),
    ("cell/capacity [A.h]", 0),
    ("cell/capacity [A.h]", "two"),
    ("cell/charge", None),
    ("cell/charge points", [{}]),
    ("cell/hysteresis", {"kind": "circular"}),
]


@pytest.mark.parametrize(("place", "value"), TAMPERED, ids=lambda value: repr(value)[:40])
def test_a_tampered_part_is_refused_under_the_files_name(document, read, place, value):
    changed = copy.deepcopy(document)
    put(place, value)(changed)
    with pytest.raises(InputError, match="is not a barnax result") as caught:
        read(changed)
    assert "result.json: " in str(caught.value)
    assert "give the result.json that barnax identify wrote" in str(caught.value)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"not json",
        b"null",
        b"[]",
        b"{}",
        b'{"schema_version": 1',
        b"[" * 100_000,
        b'{"cell": ' * 100_000,
        b"\x89PNG\r\n\x1a\n\xff\xfe",
        b"\x00" * 64,
        "{}".encode("utf-16"),
    ],
    ids=lambda content: repr(content[:12]),
)
def test_content_that_is_no_result_is_refused_under_the_files_name(read, content):
    with pytest.raises(InputError, match=r"result.json: (is not a barnax|cannot be read)"):
        read(content)


@pytest.mark.parametrize("place", ["absent.json", "."])
def test_what_is_no_file_is_refused(tmp_path, place):
    with pytest.raises(InputError, match="cannot be read"):
        Result.from_json(tmp_path / place)


@pytest.mark.parametrize(
    ("model", "change"),
    [
        ("iso-rc", {"gamma": 50.0}),
        ("esc", {}),
        ("3rc", {}),
        ("1rc", {}),
    ],
)
def test_parameters_of_another_circuit_are_refused(result, tmp_path, model, change):
    stored = result.to_dict() | {"model": model}
    stored["parameters"] |= change
    path = tmp_path / "result.json"
    path.write_text(json.dumps(stored))
    with pytest.raises(InputError, match=f"the circuit {model} has the parameters"):
        Result.from_json(path)


@pytest.mark.parametrize(
    ("key", "value"),
    [("capacity [A.h]", 10**400), ("warnings", 5), ("warnings", [1]), ("warnings", "text")],
)
def test_a_cell_of_absurd_values_is_refused(result, tmp_path, key, value):
    stored = result.to_dict()
    stored["cell"][key] = value
    path = tmp_path / "result.json"
    path.write_text(json.dumps(stored))
    with pytest.raises(InputError, match="is not a barnax result"):
        Result.from_json(path)

"""The one schema of stored files: what is written is read, and nothing else is."""

import copy
import json
import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pydantic
import pytest
from benchmarks.schema import notices_page
from hypothesis import example, given
from hypothesis import strategies as st

from barnax import InputError, Notice, Result
from barnax.cli.session import as_flags
from barnax.reporting.first_screen import first_screen
from barnax.reporting.terminal import to_text
from helpers.golden import RESULT
from helpers.hostile import EXAMPLES, damaged, repeated

DOCUMENT = json.loads(RESULT.read_text(encoding="utf-8"))
DOCS = Path(__file__).parents[1] / "docs"
PUBLISHED = DOCS / "result.schema.json"


@pytest.fixture
def read(tmp_path: Path) -> Callable[[Any], Result]:
    """Writes a document, or bytes as they are, and reads it back."""

    def from_disk(content: Any) -> Result:
        path = tmp_path / "result.json"
        path.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
        return Result.from_json(path)

    return from_disk


def test_what_is_read_is_written_again_byte_for_byte():
    assert Result.from_json(RESULT).to_json() == RESULT.read_text(encoding="utf-8")


def test_what_is_not_finite_is_stored_as_null_and_read_again(read):
    changed = copy.deepcopy(DOCUMENT)
    changed["constant"]["search"]["seeds"][0]["rmse [V]"] = None
    result = read(changed)
    assert not math.isfinite(result.constant.search.seeds[0].rmse_v)
    assert result.to_dict()["constant"]["search"]["seeds"][0]["rmse [V]"] is None


@pytest.mark.skipif(
    [*map(int, pydantic.VERSION.split(".")[:2])] < [2, 14],
    reason="Pydantic wrote schemas in other words before 2.14",
)
def test_the_published_schema_is_that_of_the_code():
    """`python -m benchmarks.schema` writes it."""
    published = json.loads(PUBLISHED.read_text(encoding="utf-8"))
    assert published.pop("$schema") == "https://json-schema.org/draft/2020-12/schema"
    assert published == Result.json_schema()


def test_a_stored_result_has_the_keys_that_the_schema_names():
    schema = json.loads(PUBLISHED.read_text(encoding="utf-8"))
    assert require_keys(DOCUMENT, schema, schema["$defs"]) > 500


def require_keys(value: Any, schema: dict[str, Any], defs: dict[str, Any]) -> int:
    """The number of keys, of which each is a property that the schema has and none that it
    requires is missing; what may be of several types is looked at where it is of one or null."""
    schema = defs.get(schema.get("$ref", "").rpartition("/")[2], schema)
    types = [each for each in schema.get("anyOf", ()) if each.get("type") != "null"]
    if len(types) == 1 and value is not None:
        return require_keys(value, types[0], defs)
    if isinstance(value, list) and isinstance(schema.get("items"), dict):
        return sum(require_keys(each, schema["items"], defs) for each in value)
    if not isinstance(value, dict) or "properties" not in schema:
        return 0
    properties = schema["properties"]
    assert {*schema.get("required", ())} <= value.keys() <= properties.keys()
    return sum(1 + require_keys(value[key], properties[key], defs) for key in value)


def test_the_page_of_notices_is_that_of_the_code():
    assert (DOCS / "notices.md").read_text(encoding="utf-8") == notices_page()


def put(place: str, value: Any) -> dict[str, Any]:
    """The document with the value at a place such as `search/key`; `...` deletes it."""
    changed: Any = copy.deepcopy(DOCUMENT)
    part = changed
    *path, last = place.split("/")
    for step in path:
        part = part[int(step)] if isinstance(part, list) else part[step]
    at: Any = int(last) if isinstance(part, list) else last
    if value is ...:
        del part[at]
    else:
        part[at] = value
    return changed


TAMPERED = [
    ("surprise", 1),
    ("constant/parameters", ...),
    ("constant/parameters/R0 [Ohm]", -0.1),
    ("constant/refined/optima", []),
    ("constant/refined/rmse [V]", math.inf),
    ("schema_version", ...),
    ("metrics/identification/rmse [V]", -1.0),
    ("metrics/identification/samples", -3),
    ("metrics/identification/samples", 2**70),
    ("metrics/validation/0/registered [V]", -1e-3),
    ("model", "so-rc-2"),
    ("constant/model", "esc"),
    ("inputs/0/window/initial_soc", 3.0),
    ("inputs", []),
    ("constant/bounds", {"R0 [Ohm]": [1.0]}),
    ("cell/capacity [A.h]", 10**400),
    ("cell/hysteresis", {"kind": "circular"}),
]


@pytest.mark.parametrize(("place", "value"), TAMPERED, ids=lambda value: repr(value)[:40])
def test_a_tampered_part_is_refused_under_the_files_name(read, place, value):
    with pytest.raises(InputError) as caught:
        read(put(place, value))
    message = str(caught.value)
    assert "result.json: not a barnax result: " in message
    assert message.endswith("give the folder that barnax identify wrote, or its result.json")
    assert "\n" not in message


@pytest.mark.parametrize("examples", EXAMPLES)
def test_a_damaged_file_is_refused_or_gives_itself_back(read, examples):
    def survive(content: bytes) -> None:
        try:
            result = read(content)
        except InputError as problem:
            refusal = str(problem)
        else:
            refusal = "result.json: "
            assert read(result.to_json().encode()).to_json() == result.to_json()
        assert "result.json: " in refusal
        assert len(refusal) < 2000

    repeated(examples, survive, damaged([RESULT.read_bytes()]))


@pytest.mark.parametrize("version", [0, 8, 99])
def test_a_file_of_another_version_says_which_barnax_wrote_it(read, version):
    with pytest.raises(InputError, match=f"schema version {version}, written by ") as caught:
        read(DOCUMENT | {"schema_version": version, "versions": {"barnax": "0.1.2"}})
    assert caught.value.code == "file.schema-version"
    assert str(caught.value).endswith(
        "result.json: has schema version "
        f"{version}, written by barnax 0.1.2; this version of barnax reads schema version 10; "
        "make the file again with this version, or read it with the version that wrote it"
    )


GAPS = {"gaps": 1, "longest_s": 60.0, "longest_row": 12, "charge": "steady", "held_ah": 0.02}


def test_a_notice_is_stored_with_its_words_and_read_by_its_code(read):
    notice = Notice("gaps.missing", GAPS, "us06.csv", 12)
    result = Result.from_json(RESULT).model_copy(update={"warnings": (notice,)})
    document = json.loads(result.to_json())
    (stored,) = document["warnings"]
    assert stored["values"]["held [A.h]"] == 0.02
    assert f"us06.csv: row 12: {stored['what']}; {stored['remedy']}" == str(notice)
    assert read(document).warnings == (notice,)
    # One with a number too large to word is read as it was worded.
    stored["values"]["held [A.h]"] = 10**400
    (warning,) = read(document).warnings
    assert (warning.code, str(warning)) == ("stored.text", str(notice))


def leaves_of(part: Any, place: str = "") -> Iterator[str]:
    """The places of everything in a document that is no part of its own."""
    if isinstance(part, dict) and part:
        for key, value in part.items():
            yield from leaves_of(value, f"{place}/{key}" if "/" not in key else "")
    elif isinstance(part, list) and part:
        # Of many alike one is enough.
        yield from leaves_of(part[0], f"{place}/0")
    elif place:
        yield place.removeprefix("/")


@example("constant/search/seeds/0/rmse [V]", {})
@given(
    st.sampled_from(sorted(set(leaves_of(DOCUMENT)))),
    st.sampled_from(["x", -1, 1e300, None, [], {}, True]),
)
def test_any_leaf_of_any_kind_is_read_or_refused_and_then_shown(place, value):
    """Whatever is in a file of others, there is no traceback."""
    try:
        result = Result.model_validate(put(place, value))
    except (ValueError, InputError):
        return
    with suppress(InputError):
        assert to_text(first_screen(result).with_option_names(as_flags))

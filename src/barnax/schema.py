"""One schema: dataclasses to JSON and back, with units in the keys.

A stored document is a `Document` whose fields are the dataclasses that the numerics return, so that
nothing is defined twice: a field `rmse_v` is the key `rmse [V]`, an array a list, a circuit
PyBaMM's names and values. Anything that a dataclass needs in addition to plain values is an
annotation, such as `ARRAY` for an array of numbers.
"""

import json
import math
import os
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self, TypeVar, get_args

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetPydanticSchema,
    PlainSerializer,
    ValidationError,
)
from pydantic.json_schema import SkipJsonSchema
from pydantic_core import core_schema

from .display import brief
from .errors import InputError, cut, printable
from .notices import Notice, Severity

LARGEST_FILE = 200_000_000
LONGEST_REASON = 500
# By the last part of a field's name, the unit in its key.
UNITS = {"v": "V", "s": "s", "a": "A", "ah": "A.h", "ohm": "Ohm", "percent": "%", "degc": "degC"}
# Keys that differ from those derived from the name.
KEYS = {
    "boxes": "cells",
    "max_boxes": "most_cells",
    "difference_v2": "difference [V^2]",
    "interval_v2": "interval [V^2]",
    "beta_per_k": "beta [1/K]",
    "kappa_per_a2": "kappa [1/A2]",
    "reference_a2": "reference [A2]",
}
# JSON, where a file name was expected.
_TEXT = re.compile(r"\s*[{\[]\s*[\"{\[\]}]")
_LABEL = re.compile(rf" \[({'|'.join(map(re.escape, UNITS.values()))})\]$")
_UNIT = re.compile(rf"_({'|'.join(UNITS)})$")


def key_of(name: str) -> str:
    """A field's key.

    >>> key_of("rmse_v"), key_of("samples"), key_of("mape_percent")
    ('rmse [V]', 'samples', 'mape [%]')
    """
    return KEYS.get(name) or _UNIT.sub(lambda unit: f" [{UNITS[unit[1]]}]", name)


def _array(given: Any) -> np.ndarray:
    try:
        return np.array(given, dtype=float)  # None becomes NaN
    except TypeError as error:
        raise ValueError(f"no array of numbers: {error}") from error


def _listed(array: np.ndarray) -> list[Any]:
    values = array.astype(object)
    values[~np.isfinite(array)] = None
    return values.tolist()


# An array of numbers, stored as nested lists, null for values that are not finite.
ARRAY = GetPydanticSchema(
    lambda source, handler: core_schema.no_info_plain_validator_function(
        _array, serialization=core_schema.plain_serializer_function_ser_schema(_listed)
    ),
    lambda schema, handler: {"type": "array", "items": {"type": ["number", "null", "array"]}},
)
Kind = TypeVar("Kind")
_NONE = GetPydanticSchema(lambda source, handler: core_schema.none_schema())
# A field with a default that exists only in memory; documents leave it out.
Unstored = Annotated[Kind, _NONE, SkipJsonSchema(), Field(exclude=True)]

# A number that may be infinite, if nothing could be simulated; null in JSON.
MaybeInfinite = Annotated[
    float,
    Field(allow_inf_nan=True, json_schema_extra={"type": ["number", "null"]}),
    BeforeValidator(lambda value: math.inf if value is None else value),
    PlainSerializer(lambda value: None if math.isinf(value) else value, when_used="json"),
]
Loss = Annotated[MaybeInfinite, Field(ge=0)]
# Keys accepted by `jax.random.key`.
Key = Annotated[int, Field(ge=0, lt=2**64)]
Parameters = dict[str, float]
# Numbers, texts, lists and such mappings, by key.
Json = dict[str, Any]


def notice_to_dict(notice: Notice) -> Json:
    """A notice as plain values, units in the keys, with its words."""
    stored = {name: getattr(notice, name) for name in StoredNotice.model_fields}
    values = {key_of(name): value for name, value in notice.values.items()}
    return stored | {"values": values, "remedy": notice.remedy or None}


class Part(BaseModel):
    """A part of a document: immutable, without unknown keys or infinite numbers."""

    model_config = ConfigDict(
        frozen=True,
        extra="forbid",
        allow_inf_nan=False,
        alias_generator=key_of,
        populate_by_name=True,
        arbitrary_types_allowed=True,
    )

    def __repr_args__(self) -> Iterable[tuple[str | None, Any]]:
        """A few lines: the whole would be pages."""
        for name, value in super().__repr_args__():
            yield name, brief(value)


class Document(Part):
    """A whole file. Equal content gives equal bytes."""

    def to_dict(self) -> Json:
        """The file's content as plain Python values, units in the keys."""
        return self.model_dump(mode="json", by_alias=True)

    def to_json(self) -> str:
        return self.model_dump_json(by_alias=True, indent=1) + "\n"

    @classmethod
    def json_schema(cls) -> Json:
        """The JSON Schema of the document."""
        return cls.model_json_schema(by_alias=True)

    @classmethod
    def from_json(cls, path: str | Path) -> Self:
        """The document in a file. Raises `InputError` that describes the fault."""
        if not isinstance(path, str | os.PathLike) or _TEXT.match(str(path)):
            given = "its text" if isinstance(path, str) else f"a {type(path).__name__}"
            raise InputError(f"from_json takes the name of a file, not {given}; {cls.remedy}")
        path = Path(path)
        try:
            with path.open("rb") as file:
                content = file.read(LARGEST_FILE + 1)
            if len(content) > LARGEST_FILE:
                raise ValueError(f"over {LARGEST_FILE} bytes")
            document = json.loads(content.decode("utf-8"))
        except (OSError, ValueError, RecursionError) as problem:
            reason = getattr(problem, "strerror", None) or cut(str(problem), LONGEST_REASON)
            raise InputError(f"{path}: cannot be read ({reason}); {cls.remedy}") from problem
        if isinstance(document, dict):
            cls._require_version(document, str(path))
        try:
            return cls.model_validate(document)
        except (ValidationError, InputError) as problem:
            reason = cut(_reason(problem), LONGEST_REASON)
            raise InputError(f"{path}: not a {cls.what}: {reason}; {cls.remedy}") from problem

    @classmethod
    def _require_version(cls, document: Json, file: str) -> None:
        """Raise `InputError` for a file of another schema version, naming the version that wrote
        it."""
        versioned = cls.model_fields.get("schema_version")
        (current,) = get_args(versioned.annotation) if versioned else (None,)
        version, versions = document.get("schema_version"), document.get("versions")
        if current is None or type(version) is not int or version == current:
            return
        writer = versions.get("barnax") if isinstance(versions, dict) else None
        raise Notice(
            "file.schema-version",
            {
                "version": version,
                "current": current,
                "writer": printable(writer[:20]) if isinstance(writer, str) else None,
            },
            file,
        ).error()

    # The name of the document in messages, and the remedy for a file of another kind.
    what: ClassVar[str] = "barnax result"
    remedy: ClassVar[str] = "give the file that barnax wrote"


class StoredNotice(Part):
    """A stored notice, including its words for readers of the file without barnax."""

    code: str
    severity: Severity
    subject: str
    row: int | None = None
    sheet: str | None = None
    values: dict[str, float | int | str | None]
    what: str
    remedy: str | None = None


def _notice_of(stored: Any, read: Callable[[Any], StoredNotice]) -> Notice:
    if isinstance(stored, Notice):
        return stored
    part = read(stored)
    values = {_LABEL.sub(_named, key): value for key, value in part.values.items()}
    where = part.subject, part.row, part.severity, part.sheet
    try:
        return Notice(part.code, values, *where)
    except (KeyError, TypeError, ValueError, OverflowError):
        # From another version of barnax, or from elsewhere: its words are used unchanged.
        text = "; ".join(filter(None, (part.what, part.remedy)))
        return Notice("stored.text", {"text": text}, *where)


def _named(label: re.Match[str]) -> str:
    return next(f"_{name}" for name, unit in UNITS.items() if unit == label[1])


# A stored notice. One with an unknown code is read with its stored words.
_NOTICE = GetPydanticSchema(
    lambda source, handler: core_schema.no_info_wrap_validator_function(
        _notice_of,
        handler.generate_schema(StoredNotice),
        serialization=core_schema.plain_serializer_function_ser_schema(notice_to_dict),
    )
)
NoticeField = Annotated[Notice, _NOTICE]


def _reason(problem: ValidationError | InputError) -> str:
    if isinstance(problem, InputError):
        return str(problem)
    first = problem.errors(include_url=False, include_input=False)[0]
    field = ".".join(str(step) for step in first["loc"]) or "the file"
    return f"{cut(field, 200)}: {first['msg'].removeprefix('Value error, ')}"

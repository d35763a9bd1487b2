"""A good result and a good comparison, made up from what their types ask for."""

import types
from dataclasses import fields, is_dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel

from barnax.comparison import ComparisonResult
from barnax.results import Result
from helpers.results import make_cell
from sample_comparisons import BOX, PARAMETERS

# What a type alone does not tell.
KNOWN: dict[str, Any] = {
    "model": "iso-rc",
    "cell": make_cell().to_dict(),
    "bounds": BOX,
    "initial_soc": 0.9,
    "start_after_step": None,
    "sha256": "0123456789abcdef" * 4,
    "command": ("barnax", "identify", "drive.csv"),
    "score_from_s": None,
}


def example_of(kind: Any, name: str = "") -> Any:
    """A value of a type: one item in every list, a number where there may be none."""
    if name in KNOWN:
        return KNOWN[name]
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return example_of(arguments[0], name)
    if origin is Literal:
        return arguments[0]
    if origin in (Union, types.UnionType):
        return example_of(next(each for each in arguments if each is not type(None)), name)
    if origin is tuple:
        items = arguments[:1] if arguments[-1] is ... else arguments
        return tuple(example_of(each) for each in items)
    if origin is dict:
        return PARAMETERS if arguments[1] is float else {"name": example_of(arguments[1])}
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return kind(
            **{
                each: example_of(field.annotation, each)
                for each, field in kind.model_fields.items()
            }
        )
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        return kind(**{each.name: example_of(hints[each.name], each.name) for each in fields(kind)})
    return {float: 0.25, int: 1, bool: True, str: "words", Any: "anything"}[kind]


def good_result() -> Result:
    """A result with every part there can be."""
    return example_of(Result)


def good_comparison() -> ComparisonResult:
    """A comparison with every part there can be."""
    return example_of(ComparisonResult)

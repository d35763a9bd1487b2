"""Groups of options that several commands share: a dataclass each, spelled out field by field."""

import dataclasses
import functools
import inspect
from collections.abc import Callable, Iterator
from typing import Any, get_type_hints

import typer

WINDOW = "Records (FILE=VALUE for one of them)"
INPUT = "Files"
OUTPUT = "Output"
SEARCH = "Search"
TABLES = "Tables over SOC"
FILTER = "Filter"


def option(panel: str, metavar: str, text: str, **more: Any) -> Any:
    """An option with a value."""
    return typer.Option(metavar=metavar, help=text, rich_help_panel=panel, **more)


def flag(panel: str, names: str, text: str) -> Any:
    """An option without a value, under all its names."""
    return typer.Option(*names.split(), help=text, rich_help_panel=panel)


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """The command, with each parameter that is a group of options spelled out field by field.

    A group may hold other groups.
    """
    signature = inspect.signature(command, eval_str=True)
    spelled: list[inspect.Parameter] = []
    for each in signature.parameters.values():
        is_group = dataclasses.is_dataclass(each.annotation)
        own = each.replace(kind=inspect.Parameter.KEYWORD_ONLY)
        spelled += _spelled(each.annotation) if is_group else [own]

    @functools.wraps(command)
    def spread(**given: Any) -> None:
        for name, each in signature.parameters.items():
            if dataclasses.is_dataclass(each.annotation):
                given[name] = _made(each.annotation, given)
        command(**given)

    spread.__signature__ = signature.replace(parameters=spelled)  # pyright: ignore
    spread.__annotations__ = {each.name: each.annotation for each in spelled}
    return spread


def _spelled(group: Any) -> Iterator[inspect.Parameter]:
    """The options of a group as parameters."""
    hints = get_type_hints(group, include_extras=True)
    for each in dataclasses.fields(group):
        hint, is_required = hints[each.name], each.default is dataclasses.MISSING
        if dataclasses.is_dataclass(hint):
            yield from _spelled(hint)
        else:
            default = inspect.Parameter.empty if is_required else each.default
            kind = inspect.Parameter.KEYWORD_ONLY
            yield inspect.Parameter(each.name, kind, default=default, annotation=hint)


def _made(group: Any, given: dict[str, Any]) -> Any:
    """The group with its options, which are taken out of those given."""
    hints = get_type_hints(group)
    return group(
        **{
            name: _made(hint, given) if dataclasses.is_dataclass(hint) else given.pop(name)
            for name, hint in hints.items()
        }
    )

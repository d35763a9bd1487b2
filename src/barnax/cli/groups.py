"""Groups of options that several commands share: a dataclass each, spelled out field by field."""

import dataclasses
import functools
import inspect
from collections.abc import Callable
from typing import Any, get_type_hints

import typer

WINDOW = "Records (FILE=VALUE for one of them)"
INPUT = "Files"
OUTPUT = "Output"
SEARCH = "Search"
TABLES = "Tables over SOC"


def option(panel: str, metavar: str, text: str, **more: Any) -> Any:
    return typer.Option(metavar=metavar, help=text, rich_help_panel=panel, **more)


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """The command, with each parameter that is a group of options spelled out field by field."""
    signature = inspect.signature(command, eval_str=True)
    groups: dict[str, Any] = {}
    spelled: list[inspect.Parameter] = []
    for parameter in signature.parameters.values():
        group = parameter.annotation
        if not dataclasses.is_dataclass(group):
            spelled.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
            continue
        groups[parameter.name] = group
        hints = get_type_hints(group, include_extras=True)
        spelled += [
            inspect.Parameter(
                each.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=(
                    inspect.Parameter.empty if each.default is dataclasses.MISSING else each.default
                ),
                annotation=hints[each.name],
            )
            for each in dataclasses.fields(group)
        ]

    @functools.wraps(command)
    def spread(**given: Any) -> None:
        for name, group in groups.items():
            own = {each.name: given.pop(each.name) for each in dataclasses.fields(group)}
            given[name] = group(**own)
        command(**given)

    spread.__signature__ = signature.replace(parameters=spelled)  # pyright: ignore
    spread.__annotations__ = {each.name: each.annotation for each in spelled}
    return spread

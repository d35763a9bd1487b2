"""Options of the commands: how a group is declared, and those that several commands share."""

import functools
import inspect
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields
from importlib import import_module
from pathlib import Path
from typing import Any, dataclass_transform, get_args, get_type_hints

import typer
from typer.models import ParameterInfo

from ..errors import InputError
from ..files import restore
from ..settings import (
    LIMITS,
    WINDOW_OPTIONS,
    CellSettings,
    Reading,
    Settings,
    TableOptions,
    Window,
    choices_in,
    explained,
)
from .session import as_flags

# What was given of some options, by name.
Given = Mapping[str, Any]

# The panels of the help.
WINDOW = "Records (FILE=VALUE for one of them)"
INPUT = "Files"
OUTPUT = "Output"
SEARCH = "Search"
TABLES = "Tables over SOC"
FILTER = "Filter"
# Where a group keeps what Typer is told of a field.
DECLARED = "declared"


def argument(metavar: str, text: str, default: Any = ...) -> Any:
    """A word of the command without a name; required unless it has a default."""
    return typer.Argument(
        default, metavar=metavar, help=text, show_default=False, callback=_restored
    )


def _restored(given: Any) -> Any:
    """What was given, after `restore` of what it names."""
    for path in given if isinstance(given, list) else [given]:
        if isinstance(path, Path):
            restore(path)
    return given


def option(panel: str, metavar: str, text: str, default: Any = None, **more: Any) -> Any:
    """An option with a value; `...` as its default makes it required."""
    return typer.Option(default, metavar=metavar, help=text, rich_help_panel=panel, **more)


def flag(panel: str, names: str, text: str, default: bool | None = False) -> Any:
    """An option without a value, under all its names."""
    return typer.Option(default, *names.split(), help=text, rich_help_panel=panel)


def known_names(module: str, registry: str) -> Callable[[str], list[str]]:
    """Completes the names of a registry, which is imported only then."""

    def complete(incomplete: str) -> list[str]:
        names = getattr(import_module(f"barnax.{module}"), registry)
        return [name for name in names if name.startswith(incomplete)]

    return complete


# What the help writes for a value, where its type does not say it.
METAVARS: dict[Any, str] = {
    int: "N",
    **{"model": "iso-rc|so-rc|esc|...", "method": "NAME", "columns": "NAMES", "block_s": "S"},
    **dict.fromkeys(("current_sign", "ocv_current_sign", "validate_current_sign"), "SIGN"),
    **{
        "current_hold": "HOLD",
        "voltage_lag": "[FILE=]S",
        "ocv_fit": "FIT",
        "hysteresis_fit": "FIT",
        "nodes": "SOC,SOC,...",
    },
    **dict.fromkeys(("roughness", "resistance_ridge", "voltage_ridge"), "WEIGHT"),
    **{"capacity": "AH", "ocv_capacity": "AH", "temperature": "DEGC", "rest_current": "A"},
    **{"start_time": "S", "score_from": "S", "score_to": "S", "start_after_step": "N"},
    **{"initial_soc": "0..1", "initial_direction": "+1|-1", "score_steps": "N,N"},
    "score_soc": "LOW,HIGH",
}
FLAGS = {
    "rising_ocv": "--rising-ocv/--free-ocv",
    "half_hysteresis": "--half-hysteresis",
    "resistances_follow": "--resistances-follow",
    "keep_starts": "--keep-starts",
}
COMPLETED = {
    "model": known_names("cell", "CIRCUITS"),
    "method": known_names("optimizers", "OPTIMIZERS"),
}


def options_of(kind: Any, panel: str, *names: str) -> Any:
    """A part of a group: options of a dataclass, with its types, defaults and help; all, or some.

    A command gets those that were given, by name. `kind` is an instance, whose values are defaults.
    """
    told, hints = explained(type(kind)), get_type_hints(type(kind))
    made = {}
    for name in names or hints:
        hint, default, choices = hints[name], getattr(kind, name), choices_in(hints[name])
        if hint not in (int, float, float | None, str, str | None, bool) and not choices:
            # Written in one word, or a word for each of several, and read where it is used.
            hint = list[str] if Sequence[str] in get_args(hint) else str
            hint, default = hint | None, None
        metavar = METAVARS.get(name) or METAVARS.get(hint) or "|".join(choices) or None
        flags = (FLAGS[name],) if name in FLAGS else ()
        more = {"autocompletion": COMPLETED.get(name), "rich_help_panel": panel}
        more["min"] = LIMITS.get(name, (None,))[0]
        declared = typer.Option(
            default, *flags, metavar=metavar, help=_help(told.get(name, "")), **more
        )
        made[name] = _parameter(name, hint, declared)
    return field(metadata={DECLARED: made})


def windows_of_records() -> Any:
    """The fields of a `Window` as options: each for all records, or for one by its name."""
    told, made = explained(Window), {}
    for asked, (name, *_) in WINDOW_OPTIONS.items():
        declared = option(WINDOW, f"[FILE=]{METAVARS[asked]}", _help(told.get(name, "")))
        made[asked] = _parameter(asked, list[str] | None, declared)
    return field(metadata={DECLARED: made})


def _help(text: str) -> str:
    return as_flags(text).replace("[", r"\[")


def _parameter(name: str, hint: Any, default: Any) -> inspect.Parameter:
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hint)


@dataclass_transform(frozen_default=True, kw_only_default=True)
def group(cls: Any) -> Any:
    """A dataclass of arguments, options, flags and other groups."""
    for name, declared in list(vars(cls).items()):
        if isinstance(declared, ParameterInfo):
            default = MISSING if declared.default is ... else declared.default
            setattr(cls, name, field(default=default, metadata={DECLARED: declared}))
    return dataclass(frozen=True, kw_only=True)(cls)


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """The command, whose parameters are groups, as Typer wants it: spelled out field by field."""
    groups = get_type_hints(command)
    groups.pop("return")

    @functools.wraps(command)
    def spread(context: typer.Context, **given: Any) -> None:
        sources = {name: context.get_parameter_source(name) for name in given}
        typed = {
            name for name, source in sources.items() if source and source.name == "COMMANDLINE"
        }
        command(**{name: _made(kind, given, typed) for name, kind in groups.items()})

    spelled = [_parameter("context", typer.Context, inspect.Parameter.empty)]
    spelled += [parameter for of in groups.values() for parameter in _spelled(of)]
    spread.__signature__ = inspect.Signature(spelled)  # pyright: ignore
    spread.__annotations__ = {parameter.name: parameter.annotation for parameter in spelled}
    return spread


def _spelled(group: Any) -> Iterator[inspect.Parameter]:
    hints = get_type_hints(group)
    for member in fields(group):
        hint, declared = hints[member.name], member.metadata.get(DECLARED)
        if declared is None:
            yield from _spelled(hint)
        elif isinstance(declared, dict):
            yield from declared.values()
        else:
            yield _parameter(member.name, hint, declared)


def _made(group: Any, given: Mapping[str, Any], typed: Collection[str]) -> Any:
    hints, values = get_type_hints(group), {}
    for member in fields(group):
        declared = member.metadata.get(DECLARED)
        if declared is None:
            values[member.name] = _made(hints[member.name], given, typed)
        elif isinstance(declared, dict):
            values[member.name] = {name: given[name] for name in declared if name in typed}
        else:
            values[member.name] = given[member.name]
    return group(**values)


FORCE = flag(OUTPUT, "--force", "Replace the file if it exists.")
QUIET = flag(OUTPUT, "--quiet -q", "Print no tables and no progress; warnings still go to stderr.")
REPORT = flag(OUTPUT, "--report", "Also write report.html and report.md, with every figure.")
LIVE = flag(OUTPUT, "--live", "Let records be zoomed in report.html, which is then written too.")
PAPER = flag(
    OUTPUT,
    "--paper",
    "Also write figures/paper: every figure as PDF and SVG, one journal column wide (89 mm, 7 pt).",
)
STORED = argument("RESULT", "The folder that identify wrote, or its result.json.")
DATA = option(
    INPUT,
    "FOLDER",
    "Folder of the measured files (default: here and beside the result); repeatable.",
)
# How a record is read.
HOW_READ = ("current_sign", "current_hold", "voltage_lag", "columns", "series")


@group
class Files:
    """The files of a run, and how they are read."""

    ocv: list[Path] | None = option(
        INPUT,
        "FILE",
        "OCV test of the same cell: pulses and rests, a slow sweep, or a table; repeatable.",
    )
    validate: list[Path] | None = option(INPUT, "FILE", "Record to validate on; repeatable.")
    cell: Given = options_of(CellSettings(), INPUT)
    read: Given = options_of(Reading(), INPUT)


@group
class RecordOptions:
    """Starts, capacities and scored parts of the records: for all, or for one by its name."""

    given: Given = windows_of_records()

    def chosen(self) -> dict[str, dict[str, Any]]:
        """Fields of a `Window` by the name of the record they are for, "" for all."""
        found: dict[str, dict[str, Any]] = {}
        for asked, (name, parse, example) in WINDOW_OPTIONS.items():
            for text in self.given.get(asked, ()):
                record, _, value = text.rpartition("=")
                try:
                    found.setdefault(record, {})[name] = parse(value)
                except ValueError as problem:
                    raise InputError(
                        f"`{asked}` {text!r}: write it like {example}, or FILE={example} for one "
                        "of the records"
                    ) from problem
        return found

    def windows(self) -> Window | dict[str, Window] | None:
        """One window for all records, or one for each that has its own; None where none is given.

        A record's own start replaces the common one. Raises `InputError` where options of one
        record contradict each other.
        """
        chosen = self.chosen()
        if not chosen:
            return None
        common = chosen.get("", {})
        windows = {}
        for name, own in chosen.items():
            kept = common
            if own.keys() & {"start_time_s", "start_after_step"}:
                kept = {key: common[key] for key in common if not key.startswith("start")}
            try:
                windows[name] = Window(**(kept | own))
            except InputError as problem:
                raise InputError(f"{name}: {problem}" if name else str(problem)) from problem
        return windows


FIX = option(SEARCH, "NAME=VALUE", 'Hold a parameter, such as "C1 \\[F]=500"; repeatable.')


@group
class SearchOptions:
    """The box, and the search in it."""

    settings: Given = options_of(
        Settings(),
        SEARCH,
        *("objective", "coordinates", "seeds", "population", "iterations", "key"),
    )
    bounds: Path | None = option(
        SEARCH,
        "FILE.toml",
        'Bounds: a file with a table \\[bounds], such as "R0 \\[Ohm]" = \\[0.001, 0.1].',
    )
    fix: list[str] | None = FIX


@group
class Tables:
    """Tables over SOC, and temperature: whether, and how."""

    over: Given = options_of(Settings(), TABLES, "over")
    how: Given = options_of(
        TableOptions(), TABLES,
        *("ocv_correction", "rising_ocv", "half_hysteresis", "resistances_follow", "keep_starts"),
        *("nodes", "roughness", "resistance_ridge", "voltage_ridge", "folds", "block_s"),
    )  # fmt: skip

    def chosen(self) -> dict[str, Any]:
        """The chosen options, by the names of `barnax.identify`."""
        chosen = {**self.over, **self.how}
        if "nodes" in chosen:
            try:
                chosen["nodes"] = tuple(float(node) for node in chosen["nodes"].split(","))
            except ValueError as problem:
                raise InputError(
                    f"`nodes` {chosen['nodes']!r}: write states of charge like 0,0.1,0.5,1"
                ) from problem
        return chosen


def run_options(
    files: Files, of_records: RecordOptions, search: SearchOptions, records: list[Path]
) -> dict[str, Any]:
    """The chosen options that commands share, by the names of `barnax.identify`."""
    from ..model.search_space import parse_fixed

    paths = {"records": records, "ocv": files.ocv or [], "validate": files.validate or []}
    more = {
        **paths,
        "window": of_records.windows(),
        "bounds": search.bounds,
        "fix": parse_fixed(search.fix or []),
    }
    return {
        **{name: value for name, value in more.items() if value},
        **files.cell,
        **files.read,
        **search.settings,
    }


def require_choice(option: str, value: str, choices: Iterable[str]) -> None:
    """Raise `InputError` where an option's value is none of its choices."""
    if value not in choices:
        raise InputError(f"`{option}` {value!r} is not known; there are {', '.join(choices)}")

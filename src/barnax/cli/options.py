"""Options of the commands, made of dataclasses: types and defaults, and help from docstrings.

A group is a dataclass whose docstring has a section for each panel of the help, with a line `NAME
(SPELLING): help` for each field: flags begin with a dash, and the rest is how a value is called.
Fields of the panel "Arguments" are words without a name. What several groups have is explained in
`Shared`; options of a job are those of `barnax.identify`, from `settings.py`.
"""

import functools
import inspect
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, dataclass_transform, get_args, get_type_hints

import typer

from ..errors import InputError
from ..files import restore
from ..settings import (
    LIMITS,
    WINDOW_OPTIONS,
    CellSettings,
    Reading,
    Scope,
    Settings,
    TableOptions,
    Window,
    choices_in,
)
from .session import as_flags

# What was given of some options, by name.
Given = Mapping[str, Any]

# Panels of the help.
WINDOW = "Records (FILE=VALUE for one of them)"
INPUT = "Files"
SEARCH = "Search"
TABLES = "Tables over SOC"
# Where a field keeps the options that it stands for.
DECLARED = "declared"
SECTION = re.compile(r"^(\S.*):\n((?:    .*\n?)+)", re.M)
ENTRY = re.compile(r"    (\w+)(?: \(([^()]*)\))?: (.*(?:\n {8}.*)*)")

# How the value of an option of a job is called, where its type does not say it.
SPELLED: dict[Any, str] = {
    int: "N",
    **{"model": "iso-rc|so-rc|esc|...", "method": "NAME", "columns": "NAMES", "block_s": "S"},
    **dict.fromkeys(("current_sign", "ocv_current_sign", "validate_current_sign"), "SIGN"),
    **{"current_hold": "HOLD", "voltage_lag": "[FILE=]S", "nodes": "SOC,SOC,..."},
    **{"ocv_fit": "FIT", "hysteresis_fit": "FIT", "rising_ocv": "--rising-ocv/--free-ocv"},
    **dict.fromkeys(("roughness", "resistance_ridge", "voltage_ridge"), "WEIGHT"),
    **{"capacity": "AH", "ocv_capacity": "AH", "temperature": "DEGC", "rest_current": "A"},
    **{"start_time": "S", "score_from": "S", "score_to": "S", "start_after_step": "N"},
    **{"initial_soc": "0..1", "initial_direction": "+1|-1", "score_steps": "N,N"},
    "score_soc": "LOW,HIGH",
}


class Entry(NamedTuple):
    """A field as a docstring explains it."""

    panel: str
    spelling: str
    help: str


def documented(kind: type) -> dict[str, Entry]:
    """The fields that a class's docstring explains, by name."""
    return {
        name: Entry(panel, spelling, " ".join(text.split()))
        for panel, section in SECTION.findall(inspect.cleandoc(kind.__doc__ or ""))
        for name, spelling, text in ENTRY.findall(section)
    }


def known_names(module: str, registry: str) -> Callable[[str], list[str]]:
    """Completes the names of a registry, which is imported only then."""

    def complete(incomplete: str) -> list[str]:
        names = getattr(import_module(f"barnax.{module}"), registry)
        return [name for name in names if name.startswith(incomplete)]

    return complete


COMPLETED = {
    "model": known_names("cell", "CIRCUITS"),
    "method": known_names("optimizers", "OPTIMIZERS"),
}


def _parameter(name: str, hint: Any, default: Any, entry: Entry, **more: Any) -> inspect.Parameter:
    """An option as Typer wants it, or a word of the command."""
    # Square brackets are markup, of which only bold type is meant.
    text = re.sub(r"\[(?!/?bold\])", r"\\[", as_flags(entry.help))
    flags = [word for word in entry.spelling.split() if word.startswith("-")]
    metavar = " ".join(word for word in entry.spelling.split() if word not in flags) or None
    if entry.panel == "Arguments":
        more = {"show_default": False, "callback": _restored}
        declared = typer.Argument(default, metavar=metavar, help=text, **more)
    else:
        # A flag that is off has no other to switch it off.
        flags = flags or [f"--{name.replace('_', '-')}"] * (default is False)
        more |= {"metavar": metavar, "rich_help_panel": entry.panel}
        declared = typer.Option(default, *flags, help=text, **more)
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=declared, annotation=hint
    )


def _restored(given: Any) -> Any:
    """What was given, after `restore` of what it names."""
    for path in given if isinstance(given, list) else [given]:
        if isinstance(path, Path):
            restore(path)
    return given


@dataclass_transform(frozen_default=True, kw_only_default=True, field_specifiers=(field,))
def group(cls: Any) -> Any:
    """A dataclass of arguments, options, flags and other groups."""
    return dataclass(frozen=True, kw_only=True)(cls)


@group
class Shared:
    """Options that several commands have.

    Arguments:
        result (RESULT): The folder that identify wrote, or its result.json.

    Files:
        data (FOLDER): Folder of the measured files (default: here and beside the result);
            repeatable.

    Output:
        report: Also write report.html and report.md, with every figure.
        live: Let records be zoomed in report.html, which is then written too.
        paper: Also write figures/paper: every figure as PDF and SVG, one journal column wide (89
            mm, 7 pt).
        force: Replace the file if it exists.
        quiet (--quiet -q): Print no tables and no progress; warnings still go to stderr.
    """


@group
class Paths:
    """Files of a job, and parameters that it holds.

    Files:
        ocv (FILE): OCV test of the same cell: pulses and rests, a slow sweep, or a table;
            repeatable.
        validate (FILE): Record to validate on; repeatable.

    Search:
        bounds (FILE.toml): Bounds: a file with a table [bounds], such as "R0 [Ohm]" = [0.001, 0.1].
        fix (NAME=VALUE): Hold a parameter, such as "C1 [F]=500"; repeatable.
    """

    ocv: list[Path] | None = None
    validate: list[Path] | None = None
    bounds: Path | None = None
    fix: list[str] | None = None


def _parameters(kind: type) -> Iterator[inspect.Parameter]:
    """The options of a group, those of its groups in their place."""
    hints, entries = get_type_hints(kind), documented(Shared) | documented(kind)
    for member in fields(kind):
        more = dict(member.metadata)
        default = ... if member.default is MISSING else member.default
        if DECLARED in more:
            yield from more[DECLARED].values()
        elif is_dataclass(hints[member.name]):
            yield from _parameters(hints[member.name])
        else:
            name = member.name
            yield _parameter(name, hints[name], default, entries[name], **more)


def options_of_settings(settings: Any, panel: str, *names: str) -> dict[str, inspect.Parameter]:
    """Options of a dataclass of `settings.py`, whose values are defaults; all, or some."""
    hints, entries, options = get_type_hints(type(settings)), documented(type(settings)), {}
    for name in names or entries:
        hint, default, choices = hints[name], getattr(settings, name), choices_in(hints[name])
        if hint not in (int, float, float | None, str, str | None, bool) and not choices:
            # Written in one word, or a word for each of several, and read where it is used.
            hint = list[str] if Sequence[str] in get_args(hint) else str
            hint, default = hint | None, None
        spelling = SPELLED.get(name) or SPELLED.get(hint) or "|".join(choices)
        entry = Entry(panel, spelling, entries[name].help)
        more = {"min": LIMITS.get(name, (None,))[0], "autocompletion": COMPLETED.get(name)}
        options[name] = _parameter(name, hint, default, entry, **more)
    return options


def _of_windows() -> Iterator[inspect.Parameter]:
    """The fields of a `Window`, each for all records, or for one by its name."""
    entries = documented(Window)
    for option, (name, *_) in WINDOW_OPTIONS.items():
        entry = Entry(WINDOW, f"[FILE=]{SPELLED[option]}", entries[name].help)
        yield _parameter(option, list[str] | None, None, entry)


# Options of `barnax.identify`, by name.
OF_JOB = {
    **{parameter.name: parameter for parameter in (*_parameters(Paths), *_of_windows())},
    **options_of_settings(Settings(), SEARCH),
    **options_of_settings(Scope(), SEARCH),
    **options_of_settings(Settings(), TABLES, "over"),
    **options_of_settings(TableOptions(), TABLES),
    **options_of_settings(CellSettings(), INPUT),
    **options_of_settings(Reading(), INPUT),
}
# Those of files, of their records, of the search and of tables.
HOW_READ = ("current_sign", "current_hold", "voltage_lag", "columns", "series")
OF_FILES = ("ocv", "validate", *documented(CellSettings), *documented(Reading))
OF_RECORDS = (*WINDOW_OPTIONS,)
OF_SEARCH = (
    *("objective", "coordinates", "seeds", "population", "iterations", "key"),
    *("bounds", "fix"),
)
OF_TABLES = (
    *("over", "ocv_correction", "rising_ocv", "half_hysteresis", "resistances_follow"),
    *("keep_starts", "nodes", "roughness", "resistance_ridge", "voltage_ridge"),
    *("folds", "block_s"),
)


def options_of(
    *names: str, among: Mapping[str, inspect.Parameter] = OF_JOB, are_texts: bool = False
) -> Any:
    """Options of a job in a group, which gets those that were given, by name and with the values of
    `barnax.identify`, or as texts."""
    declared = {name: among[name] for name in names}
    return field(metadata={DECLARED: declared, "are_texts": are_texts})


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """The command, whose parameters are groups, as Typer wants it: spelled out field by field."""
    groups = get_type_hints(command)
    groups.pop("return")

    @functools.wraps(command)
    def spread(context: typer.Context, **given: Any) -> None:
        sources = {name: context.get_parameter_source(name) for name in given}
        typed = {name for name, of in sources.items() if of and of.name == "COMMANDLINE"}
        command(**{name: _made(kind, given, typed) for name, kind in groups.items()})

    empty, kind = inspect.Parameter.empty, inspect.Parameter.KEYWORD_ONLY
    spelled = [inspect.Parameter("context", kind, default=empty, annotation=typer.Context)]
    spelled += [parameter for of in groups.values() for parameter in _parameters(of)]
    spread.__signature__ = inspect.Signature(spelled)  # pyrefly: ignore
    spread.__annotations__ = {parameter.name: parameter.annotation for parameter in spelled}
    return spread


def _made(kind: Any, given: Given, typed: Collection[str]) -> Any:
    hints, values = get_type_hints(kind), {}
    for member in fields(kind):
        name, declared = member.name, member.metadata.get(DECLARED)
        if declared is not None:
            texts = {option: given[option] for option in declared if option in typed}
            values[name] = texts if member.metadata["are_texts"] else options_of_job(texts)
        elif is_dataclass(hints[name]):
            values[name] = _made(hints[name], given, typed)
        else:
            values[name] = given[name]
    return kind(**values)


def windows_by_record(given: Given) -> dict[str, dict[str, Any]]:
    """Fields of a `Window` by the name of the record they are for, "" for all."""
    windows: dict[str, dict[str, Any]] = {}
    for option, (name, parse, example) in WINDOW_OPTIONS.items():
        for text in given.get(option, ()):
            record, _, value = text.rpartition("=")
            try:
                windows.setdefault(record, {})[name] = parse(value)
            except ValueError as problem:
                raise InputError(
                    f"`{option}` {text!r}: write it like {example}, or FILE={example} for one of "
                    "the records"
                ) from problem
    return windows


def windows_of(given: Given) -> dict[str, Window]:
    """A window for all records by the name "", and one for each record that has its own.

    A record's own start replaces the common one. Raises `InputError` where options of one record
    contradict each other.
    """
    chosen, windows = windows_by_record(given), {}
    common = chosen.get("", {})
    for name, own in chosen.items():
        kept = common
        if own.keys() & {"start_time_s", "start_after_step"}:
            kept = {key: common[key] for key in common if not key.startswith("start")}
        try:
            windows[name] = Window(**(kept | own))
        except InputError as problem:
            raise InputError(f"{name}: {problem}" if name else str(problem)) from problem
    return windows


def options_of_job(given: Given) -> dict[str, Any]:
    """What was given, by the names and with the values of `barnax.identify`."""
    options = {name: value for name, value in given.items() if name not in WINDOW_OPTIONS}
    if windows := windows_of(given):
        options["window"] = windows
    if "fix" in options:
        from ..model.search_space import parse_fixed

        options["fix"] = parse_fixed(options["fix"])
    if "nodes" in options:
        try:
            options["nodes"] = tuple(float(node) for node in options["nodes"].split(","))
        except ValueError as problem:
            raise InputError(
                f"`nodes` {options['nodes']!r}: write states of charge like 0,0.1,0.5,1"
            ) from problem
    return options

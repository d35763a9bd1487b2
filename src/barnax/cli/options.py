"""Options of the commands, derived from their signatures (types and defaults) and docstrings
(help).

The parameters of a command are its options, and those that several commands share are a dataclass.
The docstring of either has a section for each panel of the help, with a line `NAME (SPELLING):
help` for each: flags begin with a dash, and the rest names the value. Parameters of the panel
"Arguments" are positional. Common options are explained in `Shared`; options of a job are those of
`barnax.identify`, from `settings.py`.

Help is one screen. If all options take more, it has the usual ones with their first words, and
`--help-all` has every one by its panel. Options for research only are keys of a plan, or arguments
in Python.
"""

import inspect
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, is_dataclass
from pathlib import Path
from typing import Any, NamedTuple, dataclass_transform, get_args, get_type_hints

import typer
from typer.core import TyperCommand

from ..errors import InputError, choices_in, naming
from ..files import restore
from ..settings import (
    WINDOW_OPTIONS,
    CellSettings,
    Reading,
    Scope,
    Settings,
    TableOptions,
    Window,
)
from .session import RESEARCH, as_flags

# The given values of some options, by name.
Given = Mapping[str, Any]

# Panels of the help.
ARGUMENTS = "Arguments"
WINDOW = "Records (FILE=VALUE for one of them)"
PANELS = {
    **{Settings: "Search", Scope: "Search", TableOptions: "Tables over SOC"},
    **{CellSettings: "Files", Reading: "Files"},
}
# Types that are converted directly.
PLAIN = {int, float, str, bool, type(None)}
SECTION = re.compile(r"^(\S.*):\n((?:    .*\n?)+)", re.M)
ENTRY = re.compile(r"    (\w+)(?: \(([^()]*)\))?: (.*(?:\n {8}.*)*)")
# Lines of a screen, and the column where the first words on an option end.
LINES = 40
FIRST_WORDS = re.compile(r"[.;:] | \(|[.;:]$")

# Names of values of a job's options that their types do not give.
SPELLED: dict[Any, str] = {
    **{"model": "iso-rc|so-rc|esc|...", "method": "NAME", "columns": "NAMES"},
    **dict.fromkeys(("current_sign", "ocv_current_sign", "validate_current_sign"), "SIGN"),
    **{"current_hold": "HOLD", "voltage_lag": "[FILE=]S", "ocv_fit": "FIT", "ocv_capacity": "AH"},
    **{"capacity": "AH", "temperature": "DEGC", "rest_current": "A", "resistances_follow": "LAW"},
    **{"start_time": "S", "score_from": "S", "score_to": "S", "start_after_step": "N"},
    **{"initial_soc": "0..1", "initial_direction": "+1|-1", "score_steps": "N,N"},
    "score_soc": "LOW,HIGH",
}


class Entry(NamedTuple):
    """A parameter as a docstring explains it."""

    panel: str
    spelling: str
    help: str


def documented(kind: Any) -> dict[str, Entry]:
    """The parameters that a docstring explains, by name."""
    return {
        name: Entry(panel, spelling, " ".join(text.split()))
        for panel, section in SECTION.findall(inspect.cleandoc(kind.__doc__ or ""))
        for name, spelling, text in ENTRY.findall(section)
    }


def _parameter(name: str, hint: Any, default: Any, entry: Entry, **more: Any) -> inspect.Parameter:
    """An option as Typer wants it, or a word of the command."""
    flags = [word for word in entry.spelling.split() if word.startswith("-")]
    more |= {"metavar": " ".join(word for word in entry.spelling.split() if word not in flags)}
    more |= {"help": as_flags(entry.help), "rich_help_panel": entry.panel, "show_default": False}
    if entry.panel == ARGUMENTS:
        declared = typer.Argument(default, callback=_restored, **more)
    else:
        # A flag that is off by default has no opposite.
        is_flag = hint in (bool, bool | None)
        flags = flags or [f"--{name.replace('_', '-')}"] * is_flag
        declared = typer.Option(default, *flags, **more)
    return inspect.Parameter(
        name, inspect.Parameter.KEYWORD_ONLY, default=declared, annotation=hint
    )


def _restored(given: Any) -> Any:
    """What was given, after `restore` of the files it names."""
    for path in given if isinstance(given, list) else [given]:
        if isinstance(path, Path):
            restore(path)
    return given


@dataclass_transform(frozen_default=True, kw_only_default=True)
def group(cls: Any) -> Any:
    """A dataclass of parameters that commands share."""
    return dataclass(frozen=True, kw_only=True)(cls)


@group
class Shared:
    """Options that several commands have.

    Arguments:
        result (RESULT): The folder that identify wrote, or its result.json.

    Files:
        data (FOLDER): Folder of the measured files (default: here and next to the result);
            repeatable.

    Output:
        report: Also write report.html and report.md (with every figure).
        live: Also write report.html, with records that can be zoomed.
        paper: Also write figures/paper: every figure as PDF and SVG, one journal column wide (89
            mm, 7 pt).
        force: Replace the file if it exists.
        quiet (--quiet -q): Print no tables and no progress; warnings still go to stderr.
        help_all (--help-all): Show every option, by group.
    """


@group
class Paths:
    """Files of a job, and parameters that it holds.

    Files:
        ocv (FILE): OCV test of the same cell: pulses and rests, a slow sweep, or a table;
            repeatable.
        validate (FILE): Record to validate on; repeatable.

    Search:
        bounds (FILE.toml): Bounds of parameters: a table [bounds] with lines such as "R0 [Ohm]" =
            [0.001, 0.1].
        fix (NAME=VALUE): Hold a parameter at a value, such as "C1 [F]=500"; repeatable.
    """

    ocv: list[Path] | None = None
    validate: list[Path] | None = None
    bounds: Path | None = None
    fix: list[str] | None = None


def _members(kind: Any) -> Iterator[tuple[str, Any, Any, Any]]:
    """Name, type and default of every parameter of a command or a group, and what `Annotated` adds,
    such as the options of `Given`."""
    hints, annotated = get_type_hints(kind), get_type_hints(kind, include_extras=True)
    for name, member in inspect.signature(kind).parameters.items():
        (more,) = getattr(annotated[name], "__metadata__", [{}])
        yield name, hints[name], member.default, more


def _parameters(kind: Any) -> Iterator[inspect.Parameter]:
    """The options of a command or a group, including those of nested groups, in order."""
    entries = documented(Shared) | documented(kind)
    for name, hint, default, more in _members(kind):
        if hint == Given:
            yield from more.values()
        elif is_dataclass(hint):
            yield from _parameters(hint)
        else:
            default = ... if default is inspect.Parameter.empty else default
            yield _parameter(name, hint, default, entries[name], **more)


def _of_job() -> Iterator[inspect.Parameter]:
    """The options of `barnax.identify`; None if not given."""
    yield from _parameters(Paths)
    for name, (of_window, *_) in WINDOW_OPTIONS.items():
        entry = Entry(WINDOW, f"[FILE=]{SPELLED[name]}", documented(Window)[of_window].help)
        yield _parameter(name, list[str] | None, None, entry)
    for kind, panel in PANELS.items():
        hints = get_type_hints(kind)
        for name, entry in documented(kind).items():
            hint, choices = hints[name], choices_in(hints[name])
            if not (choices or {*(get_args(hint) or [hint])} <= PLAIN):
                # Written as one word, or one per value, and parsed where it is used.
                hint = list[str] if Sequence[str] in get_args(hint) else str
            spelling = SPELLED.get(name) or "|".join(choices) or "N" * (hint is int)
            yield _parameter(name, hint | None, None, Entry(panel, spelling, entry.help))


OF_JOB = {option.name: option for option in _of_job() if option.name not in RESEARCH}
# Options of a job that commands share.
GROUPS = {
    "reading": ("current_sign", "current_hold", "voltage_lag", "columns", "series"),
    "files": ("ocv", "validate", "ocv_capacity", "ocv_fit", *documented(Reading)),
    "records": (*WINDOW_OPTIONS,),
    "search": (
        *("objective", "coordinates", "seeds", "population", "iterations", "key"),
        *("bounds", "fix"),
    ),
    "tables": ("over", "resistances_follow", "keep_starts"),
}
# What a help longer than a screen keeps, and what it leaves out of the rest.
USUAL = {"ocv", "validate", "capacity", "temperature", "initial_soc", "current_sign", "columns"}
USUAL |= {"series", "model", "over", "trust", "bounds"}
RARE = {"design", "live", "paper", "as_json", "addresses", "group", "scheduler", "shard"}
RARE |= {*OF_JOB} - USUAL


def options_of(*names: str) -> dict[str, inspect.Parameter]:
    """Options of a job, or its `GROUPS`, for a parameter `Given`: by name, if they were given."""
    return {name: OF_JOB[name] for group in names for name in GROUPS.get(group, (group,))}


class Command(TyperCommand):
    """A command whose help is one screen."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments; a flag that is a key of a plan is refused with the way to set it
        there."""
        for flag in (word.split("=")[0] for word in args):
            if flag.removeprefix("--no-").lstrip("-").replace("-", "_") in RESEARCH:
                key = flag.removeprefix("--").replace("-", "_")
                raise typer.BadParameter(
                    f"{flag} is no option: write the plan with `barnax identify ... --plan`, set "
                    f"{key} in it, and identify the plan; in Python it is an argument"
                )
        return super().parse_args(ctx, args)

    def get_help(self, ctx: Any) -> str:
        """All options if they fit on a screen or are requested, else the usual ones."""
        whole = super().get_help(ctx)
        if ctx.meta.get("help_all") or whole.count("\n") < LINES:
            return whole
        ctx.meta["is short"] = True
        return super().get_help(ctx)

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """The options by panel; in the short help one panel with the first words on each."""
        is_short, panels = "is short" in ctx.meta, {ARGUMENTS: list[tuple[str, str]]()}
        for shown in self.get_params(ctx):
            flags = "/".join([", ".join(sorted(shown.opts)), *shown.secondary_opts])
            is_argument = shown.param_type_name == "argument"
            text, metavar = getattr(shown, "help", None) or "", shown.metavar or ""
            words = metavar if is_argument else f"{flags} {metavar}".strip()
            panel = getattr(shown, "rich_help_panel", None) or "Output"
            if is_short:
                panel = panel if is_argument else "Options"
                text = FIRST_WORDS.split(text)[0]
            if not (is_short and shown.name in RARE):
                panels.setdefault(panel, []).append((words, text))
        for panel in filter(panels.get, panels):
            with formatter.section(panel):
                formatter.write_dl(panels[panel])


def _print_all(context: typer.Context, is_asked: bool) -> None:
    if is_asked:
        context.meta["help_all"] = True
        typer.echo(context.get_help())
        raise typer.Exit


def grouped(command: Callable[..., None]) -> Callable[..., None]:
    """The command for Typer, with its groups expanded into parameters."""

    def spread(**given: Any) -> None:
        _called(command, given)

    of_help = documented(Shared)["help_all"]
    spelled = [*_parameters(command)]
    spelled += [_parameter("help_all", bool, False, of_help, callback=_print_all, is_eager=True)]
    spread.__name__ = command.__name__
    spread.__doc__, *_ = SECTION.split(inspect.getdoc(command) or "")
    spread.__signature__ = inspect.Signature(spelled)  # pyrefly: ignore
    spread.__annotations__ = {parameter.name: parameter.annotation for parameter in spelled}
    return spread


def _called(kind: Any, given: Given) -> Any:
    """A command or a group, called with its part of what was given."""
    values = {}
    for name, hint, _, more in _members(kind):
        if hint == Given:
            values[name] = {each: given[each] for each in more if given[each] not in (None, [])}
        else:
            values[name] = _called(hint, given) if is_dataclass(hint) else given[name]
    return kind(**values)


def windows_of(given: Given) -> dict[str, Window]:
    """The common window under the name "", and one for each record that has its own.

    A record's own start replaces the common one. Raises `InputError` for a value that cannot be
    read, and for contradictory options of one record.
    """
    chosen: dict[str, dict[str, Any]] = {}
    for option, (name, parse, example) in WINDOW_OPTIONS.items():
        for text in given.get(option, ()):
            record, _, value = text.rpartition("=")
            try:
                chosen.setdefault(record, {})[name] = parse(value)
            except ValueError as problem:
                raise InputError(
                    f"`{option}` {text!r}: write it like {example}, or FILE={example} for one of "
                    "the records"
                ) from problem
    windows, common = dict[str, Window](), chosen.get("", {})
    for name, of_record in chosen.items():
        kept = common
        if of_record.keys() & {"start_time_s", "start_after_step"}:
            kept = {key: common[key] for key in common if not key.startswith("start")}
        with naming(name):
            windows[name] = Window(**(kept | of_record))
    return windows


def options_of_job(given: Given) -> dict[str, Any]:
    """What was given, by the names and with the values of `barnax.identify`."""
    options = {name: value for name, value in given.items() if name not in WINDOW_OPTIONS}
    if windows := windows_of(given):
        options["window"] = windows
    if "fix" in options:
        from ..bounds_file import parse_fixed

        options["fix"] = parse_fixed(options["fix"])
    return options

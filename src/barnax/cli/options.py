"""Options of the commands: how a group is declared, and those that several commands share."""

import functools
import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, dataclass_transform, get_type_hints

import typer
from typer.models import ParameterInfo

from ..errors import InputError
from .session import command_line

if TYPE_CHECKING:
    from ..model.window import Window

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
    return typer.Argument(default, metavar=metavar, help=text, show_default=False)


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
    def spread(**given: Any) -> None:
        command(**{name: _made(each, given) for name, each in groups.items()})

    spelled = [each for of in groups.values() for each in _spelled(of)]
    spread.__signature__ = inspect.Signature(spelled)  # pyright: ignore
    spread.__annotations__ = {each.name: each.annotation for each in spelled}
    return spread


def _spelled(group: Any) -> Iterator[inspect.Parameter]:
    hints, kind = get_type_hints(group), inspect.Parameter.KEYWORD_ONLY
    for each in fields(group):
        hint = hints[each.name]
        if is_dataclass(hint):
            yield from _spelled(hint)
        else:
            declared = each.metadata[DECLARED]
            yield inspect.Parameter(each.name, kind, default=declared, annotation=hint)


def _made(group: Any, given: Mapping[str, Any]) -> Any:
    hints = get_type_hints(group)
    values = {
        name: _made(hint, given) if is_dataclass(hint) else given[name]
        for name, hint in hints.items()
    }
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
SETUP = option(
    SEARCH,
    "li2023",
    "The set-up of a paper: li2023 is iso-rc alone on an OCV polynomial, as in Li et al. (2023).",
)
COLUMNS = option(
    INPUT,
    "NAMES",
    "Columns that are not recognized: time=NAME:UNIT,current=NAME:UNIT,voltage=NAME, with a unit "
    "if the name has none.",
    "",
)
SERIES = option(
    INPUT, "N", "Cells in series, for packs and modules: the voltage is divided by it.", 1, min=1
)
Sign = Literal["auto", "charge-positive", "discharge-positive"]


@group
class HowRead:
    """How the records are read."""

    current_sign: Sign = option(
        INPUT,
        "SIGN",
        "Sign of current in the records: charge-positive, discharge-positive, or auto (decided "
        "from the data).",
        "auto",
    )
    current_hold: Literal["auto", "forward", "backward"] = option(
        INPUT,
        "HOLD",
        "When a sample's current flows: until the next sample (forward), since the previous one "
        "(backward), or auto (decided from the data).",
        "auto",
    )
    columns: str = COLUMNS
    series: int = SERIES


@group
class Files:
    """The files of a run, and how they are read."""

    ocv: list[Path] | None = option(
        INPUT,
        "FILE",
        "OCV test of the same cell: pulses and rests, a slow sweep, or a table; repeatable.",
    )
    validate: list[Path] | None = option(INPUT, "FILE", "Record to validate on; repeatable.")
    ocv_capacity: float | None = option(
        INPUT, "AH", "Capacity in the OCV test, if it does not span full to empty."
    )
    ocv_fit: Literal["polynomial", "interpolated"] | None = option(
        INPUT,
        "FIT",
        "OCV curves: interpolated (PCHIP) or a polynomial of degree 7 (default: interpolated).",
    )
    hysteresis_fit: Literal["continuous", "independent"] = option(
        INPUT,
        "FIT",
        "Hysteresis segments: continuous (they meet at the knots) or independent.",
        "continuous",
    )
    ocv_current_sign: Sign = option(INPUT, "SIGN", "Sign of current in the OCV tests.", "auto")
    validate_current_sign: Sign = option(
        INPUT, "SIGN", "Sign of current in the validation records.", "auto"
    )
    read: HowRead


def _of_a_record(metavar: str, text: str) -> Any:
    return option(WINDOW, f"[FILE=]{metavar}", text)


PerRecord = list[str] | None


@group
class RecordOptions:
    """What is known of the records, and what of them counts; for all, or for one by its name."""

    capacity: PerRecord = _of_a_record(
        "AH", "Capacity of the cell when the record was measured (default: that of the OCV test)."
    )
    temperature: PerRecord = _of_a_record(
        "DEGC", "Temperature in degC (default: the median of the record's column)."
    )
    start_time: PerRecord = _of_a_record(
        "S", "Time at which the simulation starts, on the file's clock."
    )
    start_after_step: PerRecord = _of_a_record(
        "N", "Start at the last sample of the last block of this step."
    )
    initial_soc: PerRecord = _of_a_record(
        "0..1", "State of charge at the start (default: from the rested voltage)."
    )
    initial_direction: PerRecord = _of_a_record(
        "+1|-1",
        "Last direction before the start, if the record does not show it: +1 charge, -1 discharge "
        "(default: both are tried).",
    )
    score_steps: PerRecord = _of_a_record("N,N", "Score only these steps, such as 7,8.")
    score_from: PerRecord = _of_a_record("S", "Score from this time on.")
    score_to: PerRecord = _of_a_record("S", "Score up to this time.")
    score_soc: PerRecord = _of_a_record(
        "LOW,HIGH", "Score only between these states of charge, such as 0.1,1."
    )
    rest_current: PerRecord = _of_a_record(
        "A", "Current below which the cell is at rest (default: C/100)."
    )

    def chosen(self) -> dict[str, dict[str, Any]]:
        """Fields of a `Window` by the name of the record they are for, "" for all."""
        from ..model.window import OPTIONS

        found: dict[str, dict[str, Any]] = {}
        for asked, (name, parse, example) in OPTIONS.items():
            for text in getattr(self, asked) or []:
                record, _, value = text.rpartition("=")
                try:
                    found.setdefault(record, {})[name] = parse(value)
                except ValueError as problem:
                    raise InputError(
                        f"`{asked}` {text!r}: write it like {example}, or FILE={example} for one "
                        "of the records"
                    ) from problem
        return found

    def windows(self) -> "Window | dict[str, Window] | None":
        """One window for all records, or one for each that has its own; None where none is given.

        A record's own start replaces the common one. Raises `InputError` where options of one
        record contradict each other.
        """
        from ..model.window import Window

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

    objective: Literal["auto", "scan", "compressed"] = option(
        SEARCH,
        "auto|scan|compressed",
        "How the search computes errors: scan simulates every sample, compressed reduces the "
        "record once. auto: compressed if the bounds allow it; in compare, scan. Reported errors "
        "are always computed by scan.",
        "auto",
    )
    coordinates: Literal["rc", "log"] = option(
        SEARCH,
        "rc|log",
        "Search R and C themselves, as in the paper (rc), or logarithms of R and tau (log).",
        "rc",
    )
    seeds: int = option(
        SEARCH, "N", "Independent runs of the optimizer; 0: only the global optimum.", 30, min=0
    )
    population: int = option(SEARCH, "N", "Candidates per generation.", 30, min=4)
    iterations: int = option(SEARCH, "N", "Generations.", 500, min=1)
    key: int = option(
        SEARCH, "N", "Random key; the same key gives the same result.", 0, min=0, max=2**32 - 1
    )
    bounds: Path | None = option(
        SEARCH,
        "FILE.toml",
        'Bounds: a file with a table \\[bounds], such as "R0 \\[Ohm]" = \\[0.001, 0.1].',
    )
    fix: list[str] | None = FIX


@group
class TableOptions:
    """Tables over SOC, and temperature: whether, and how."""

    over: str | None = option(
        TABLES,
        "soc|soc,temperature",
        "Tables over SOC of the resistances and an OCV correction, whatever they gain; with "
        "temperature, one set of tables per temperature, with shared time constants.",
    )
    ocv_correction: bool | None = flag(
        TABLES,
        "--ocv-correction/--no-ocv-correction",
        "Fit a table that corrects the OCV, or not (default: yes).",
        None,
    )
    rising_ocv: bool | None = flag(
        TABLES,
        "--rising-ocv/--free-ocv",
        "Let the corrected OCV only rise with SOC, or leave the correction free (default: rising).",
        None,
    )
    half_hysteresis: bool | None = flag(
        TABLES,
        "--half-hysteresis",
        "Fit the amplitude of a dynamic hysteresis as a table, instead of using half the "
        "hysteresis voltage; needs records in both directions.",
        None,
    )
    nodes: str | None = option(
        TABLES, "SOC,SOC,...", "Nodes of the tables (default: 17, from -0.05 to 1)."
    )
    roughness: float | None = option(
        TABLES, "WEIGHT", "Weight of the tables' second differences (default: 1e-4)."
    )
    resistance_ridge: float | None = option(
        TABLES, "WEIGHT", "Weight of squared resistances (default: 1e-9)."
    )
    voltage_ridge: float | None = option(
        TABLES, "WEIGHT", "Weight of squared voltages (default: 1e-7)."
    )
    folds: int | None = option(
        TABLES, "N", "Folds of the cross-validation, 0 for none (default: 5)."
    )
    block_s: float | None = option(TABLES, "S", "Longest held-out block in s (default: 400).")

    def chosen(self) -> dict[str, Any]:
        """What was chosen, by the names of `Settings` and `TableSettings`."""
        chosen = {name: value for name, value in vars(self).items() if value is not None}
        if self.nodes is not None:
            try:
                chosen["nodes"] = tuple(float(node) for node in self.nodes.split(","))
            except ValueError as problem:
                raise InputError(
                    f"`nodes` {self.nodes!r}: write states of charge like 0,0.1,0.5,1"
                ) from problem
        return chosen


def run_options(
    files: Files, of_records: RecordOptions, search: SearchOptions, records: list[Path]
) -> dict[str, Any]:
    """What a run takes of the shared options, by the names of the library's arguments."""
    from ..inputs import file_names
    from ..model.search_space import parse_fixed
    from ..settings import Reading, Settings

    given = [records, files.ocv or [], files.validate or []]
    settings = dict(vars(search))
    bounds, fix = settings.pop("bounds"), settings.pop("fix")
    return {
        "records": given[0],
        "ocv": given[1],
        "validate": given[2],
        "window": of_records.windows(),
        "ocv_capacity": files.ocv_capacity,
        "bounds": bounds,
        "fix": parse_fixed(fix or []),
        **({"ocv_fit": files.ocv_fit} if files.ocv_fit else {}),
        "hysteresis_fit": files.hysteresis_fit,
        "reading": Reading(
            ocv_current_sign=files.ocv_current_sign,
            validate_current_sign=files.validate_current_sign,
            **vars(files.read),
        ),
        "settings": Settings(**settings),
        "command": command_line(file_names([path for paths in given for path in paths])),
    }


def require_choice(option: str, value: str, choices: Iterable[str]) -> None:
    """Raise `InputError` where an option's value is none of its choices."""
    if value not in choices:
        raise InputError(f"`{option}` {value!r} is not known; there are {', '.join(choices)}")

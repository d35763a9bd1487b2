"""Options that several commands share: declared once, in groups, with their help."""

import dataclasses
import functools
import inspect
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

import typer

from ..errors import InputError
from .session import command_line

if TYPE_CHECKING:
    from ..model.inputs import Window

WINDOW = "Records (FILE=VALUE for one of them)"
INPUT = "Files"
OUTPUT = "Output"
SEARCH = "Search"

PerRecord = list[str] | None


def _option(panel: str, metavar: str, text: str, **more: Any) -> Any:
    return typer.Option(metavar=metavar, help=text, rich_help_panel=panel, **more)


def _of_a_record(metavar: str, text: str) -> Any:
    return _option(WINDOW, f"[FILE=]{metavar}", text)


SignOf = Literal["auto", "charge-positive", "discharge-positive"]
Sign = Annotated[
    SignOf,
    _option(
        INPUT,
        "SIGN",
        "Sign of current in the records: charge-positive, discharge-positive, or auto (decided "
        "from the data).",
    ),
]
Hold = Annotated[
    Literal["auto", "forward", "backward"],
    _option(
        INPUT,
        "HOLD",
        "Whether a sample's current flows until the next sample (forward), since the one "
        "before (backward), or auto (decided from the data).",
    ),
]


def complete_methods(incomplete: str) -> list[str]:
    """Registered optimizers for shell completion."""
    from ..optimizers import OPTIMIZERS

    return [name for name in OPTIMIZERS if name.startswith(incomplete)]


def complete_circuits(incomplete: str) -> list[str]:
    """Registered circuits for shell completion."""
    from ..cell import CIRCUITS

    return [name for name in CIRCUITS if name.startswith(incomplete)]


def complete_exporters(incomplete: str) -> list[str]:
    """Registered export targets for shell completion."""
    from ..export import EXPORTERS

    return [name for name in EXPORTERS if name.startswith(incomplete)]


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


@dataclass(frozen=True)
class Files:
    """The files of a run, and how they are read."""

    ocv: Annotated[
        list[Path] | None,
        _option(
            INPUT,
            "FILE",
            "OCV test of the same cell: pulses and rests, a slow sweep, or a table; repeatable.",
        ),
    ] = None
    validate: Annotated[
        list[Path] | None, _option(INPUT, "FILE", "Record to validate on; repeatable.")
    ] = None
    ocv_capacity: Annotated[
        float | None,
        _option(INPUT, "AH", "Capacity in the OCV test, where it does not span full to empty."),
    ] = None
    ocv_fit: Annotated[
        Literal["polynomial", "interpolated"],
        _option(INPUT, "FIT", "OCV curves: polynomial of degree 7, or interpolated (PCHIP)."),
    ] = "polynomial"
    hysteresis_fit: Annotated[
        Literal["continuous", "independent"],
        _option(
            INPUT, "FIT", "Hysteresis segments: continuous (they meet at the knots) or independent."
        ),
    ] = "continuous"
    current_sign: Sign = "auto"
    ocv_current_sign: Annotated[
        SignOf, _option(INPUT, "SIGN", "Sign of current in the OCV tests.")
    ] = "auto"
    validate_current_sign: Annotated[
        SignOf, _option(INPUT, "SIGN", "Sign of current in the validation records.")
    ] = "auto"
    current_hold: Hold = "auto"


@dataclass(frozen=True)
class RecordOptions:
    """What is known of the records, and what of them counts; for all, or for one by its name."""

    capacity: Annotated[
        PerRecord,
        _of_a_record(
            "AH", "Capacity of the cell when the record was measured (default: the OCV test's)."
        ),
    ] = None
    start_time: Annotated[
        PerRecord, _of_a_record("S", "Time at which the simulation starts, on the file's clock.")
    ] = None
    start_after_step: Annotated[
        PerRecord, _of_a_record("N", "Start at the last sample of the last block of this step.")
    ] = None
    initial_soc: Annotated[
        PerRecord,
        _of_a_record("0..1", "State of charge at the start (default: from the rested voltage)."),
    ] = None
    initial_direction: Annotated[
        PerRecord,
        _of_a_record(
            "+1|-1",
            "What the cell did before the start, where the record does not show it: +1 charge, "
            "-1 discharge (default: both are tried).",
        ),
    ] = None
    score_steps: Annotated[
        PerRecord, _of_a_record("N,N", "Count errors only in these steps, such as 7,8.")
    ] = None
    score_from: Annotated[PerRecord, _of_a_record("S", "Count errors from this time on.")] = None
    score_to: Annotated[PerRecord, _of_a_record("S", "Count errors up to this time.")] = None
    score_soc: Annotated[
        PerRecord,
        _of_a_record(
            "LOW,HIGH", "Count errors only between these states of charge, such as 0.1,1."
        ),
    ] = None
    rest_current: Annotated[
        PerRecord, _of_a_record("A", "Current below which the cell is at rest (default: C/100).")
    ] = None

    def chosen(self) -> dict[str, dict[str, Any]]:
        """Fields of a `Window` by the name of the record they are for, "" for all."""
        found: dict[str, dict[str, Any]] = {}
        for option, (name, parse) in _WINDOW_FIELDS.items():
            for text in getattr(self, option) or []:
                record, _, value = text.rpartition("=")
                try:
                    found.setdefault(record, {})[name] = parse(value)
                except ValueError as problem:
                    raise InputError(
                        f"`{option}` {text!r}: write it like {_EXAMPLES.get(option, '5')}, or "
                        f"FILE={_EXAMPLES.get(option, '5')} for one of the records"
                    ) from problem
        return found

    def windows(self) -> "Window | dict[str, Window] | None":
        """One window for all records, or one for each that has its own; None where none is given.

        Raises `InputError` where they contradict each other.
        """
        from ..model.inputs import Window

        chosen = self.chosen()
        if not chosen:
            return None
        common = chosen.get("", {})
        return {name: Window(**(common | own)) for name, own in chosen.items()}


def _numbers(text: str, kind: Callable[[str], Any], count: int | None = None) -> tuple[Any, ...]:
    values = tuple(kind(part) for part in text.split(","))
    if count is not None and len(values) != count:
        raise ValueError(text)
    return values


_EXAMPLES = {
    "initial_soc": "0.9",
    "initial_direction": "-1",
    "score_steps": "7,8",
    "score_soc": "0.1,1",
}
_WINDOW_FIELDS: dict[str, tuple[str, Callable[[str], Any]]] = {
    "capacity": ("capacity_ah", float),
    "start_time": ("start_time_s", float),
    "start_after_step": ("start_after_step", int),
    "initial_soc": ("initial_soc", float),
    "initial_direction": ("initial_direction", int),
    "score_steps": ("score_steps", lambda text: _numbers(text, int)),
    "score_from": ("score_from_s", float),
    "score_to": ("score_to_s", float),
    "score_soc": ("score_soc", lambda text: _numbers(text, float, 2)),
    "rest_current": ("rest_current_a", float),
}


@dataclass(frozen=True)
class SearchOptions:
    """The box, and the search in it."""

    objective: Annotated[
        Literal["auto", "scan", "compressed"],
        _option(
            SEARCH,
            "auto|scan|compressed",
            "How the search computes errors: scan simulates every sample, compressed reduces the "
            "record once. auto: compressed where the bounds allow it, in compare scan. Reported "
            "errors are always the scan's.",
        ),
    ] = "auto"
    coordinates: Annotated[
        Literal["rc", "log"],
        _option(
            SEARCH,
            "rc|log",
            "Search raw R and C, as the paper does (rc), or logarithms of R and tau (log).",
        ),
    ] = "rc"
    seeds: Annotated[int, _option(SEARCH, "N", "Independent runs of the optimizer.", min=1)] = 30
    population: Annotated[int, _option(SEARCH, "N", "Candidates in a generation.", min=4)] = 30
    iterations: Annotated[int, _option(SEARCH, "N", "Generations.", min=1)] = 500
    key: Annotated[
        int,
        _option(
            SEARCH, "N", "Random key; the same key gives the same result.", min=0, max=2**32 - 1
        ),
    ] = 0
    bounds: Annotated[
        Path | None,
        _option(
            SEARCH,
            "FILE.toml",
            'Bounds: a table \\[bounds] with lines such as "R0 \\[Ohm]" = \\[0.001, 0.1].',
        ),
    ] = None
    fix: Annotated[
        list[str] | None,
        _option(SEARCH, "NAME=VALUE", 'Hold a parameter, such as "C1 \\[F]=500"; repeatable.'),
    ] = None

    @property
    def fixed(self) -> dict[str, float]:
        from ..model.search_space import parse_fixed

        return parse_fixed(self.fix or [])


@dataclass(frozen=True)
class Choices:
    """Which circuit, which method, and how far the answer is looked into."""

    model: Annotated[
        str,
        _option(
            SEARCH,
            "iso-rc|so-rc|esc|...",
            "Circuit: two RC pairs with switched (iso-rc), no (so-rc) or dynamic (esc) "
            "hysteresis; 1rc, 3rc and 4rc have that many pairs and no hysteresis.",
            autocompletion=complete_circuits,
        ),
    ] = "iso-rc"
    method: Annotated[
        str,
        _option(
            SEARCH,
            "NAME",
            "Optimizer: ibmo, ibmo-centered, pso or any other that "
            "[bold]barnax optimizers[/bold] lists.",
            autocompletion=complete_methods,
        ),
    ] = "ibmo"
    trust: Annotated[
        Literal["none", "basic", "full"],
        _option(
            SEARCH,
            "none|basic|full",
            "How closely the answer is examined: basic gives intervals, identifiability and "
            "residuals; full also profile likelihoods, a block bootstrap, and what would lower "
            "the error.",
        ),
    ] = "basic"
    report: Annotated[
        bool,
        typer.Option(
            "--report",
            help="Also write report.html and report.md, with every figure.",
            rich_help_panel=OUTPUT,
        ),
    ] = False


@dataclass(frozen=True)
class Rows:
    """Which rows are compared."""

    models: Annotated[
        str | None,
        _option(
            SEARCH,
            "NAME,NAME",
            "Circuits, each with every method (default: the paper's five rows).",
        ),
    ] = None
    methods: Annotated[
        str | None,
        _option(
            SEARCH,
            "NAME,NAME",
            "Methods, each with every circuit: ls, rls, varpro, lm, pso-lm, de, or any that "
            "[bold]barnax optimizers[/bold] lists.",
        ),
    ] = None


@dataclass(frozen=True)
class ExportChoices:
    """Where an export goes, and whether it is simulated there."""

    to: Annotated[
        str,
        _option(
            OUTPUT,
            "pybamm|thevenin|simscape|c-header|csv",
            "The tool or format to write for.",
            autocompletion=complete_exporters,
        ),
    ]
    out: Annotated[
        Path | None,
        _option(
            OUTPUT,
            "FILE",
            "File to write (default: barnax_pybamm.py, barnax_thevenin.py, barnax_simscape.mat, "
            "barnax_cell.h or barnax_parameters.csv).",
        ),
    ] = None
    force: Annotated[
        bool,
        typer.Option("--force", help="Replace the file if it exists.", rich_help_panel=OUTPUT),
    ] = False
    verify: Annotated[
        bool,
        typer.Option(
            "--verify",
            help="Simulate the exported circuit in PyBaMM or thevenin, and print the largest "
            "difference from barnax.",
            rich_help_panel=OUTPUT,
        ),
    ] = False


@dataclass(frozen=True)
class Output:
    """Where results go, and what is printed."""

    out: Annotated[
        Path | None, _option(OUTPUT, "FOLDER", "Folder for the results (default: barnax-out).")
    ] = None
    force: Annotated[
        bool,
        typer.Option("--force", help="Replace the result in the folder.", rich_help_panel=OUTPUT),
    ] = False
    as_json: Annotated[
        bool,
        typer.Option(
            "--json",
            help="Print the result as JSON; write files only with --out.",
            rich_help_panel=OUTPUT,
        ),
    ] = False
    verbose: Annotated[
        bool,
        typer.Option(
            "--verbose", help="Print every decision, table and warning.", rich_help_panel=OUTPUT
        ),
    ] = False
    quiet: Annotated[
        bool,
        typer.Option(
            "--quiet",
            "-q",
            help="Print no tables and no progress; warnings still go to stderr.",
            rich_help_panel=OUTPUT,
        ),
    ] = False


Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet",
        "-q",
        help="Print no tables and no progress; warnings still go to stderr.",
        rich_help_panel=OUTPUT,
    ),
]
StoredResult = Annotated[
    Path,
    typer.Argument(metavar="RESULT", help="The folder that identify wrote, or its result.json."),
]


def run_options(
    files: Files, of_records: RecordOptions, search: SearchOptions, records: list[Path]
) -> dict[str, Any]:
    """What a run takes of the shared options, by the names of the library's arguments."""
    from ..gather import Reading, Settings, file_names

    given = [records, files.ocv or [], files.validate or []]
    return {
        "records": given[0],
        "ocv": given[1],
        "validate": given[2],
        "window": of_records.windows(),
        "ocv_capacity": files.ocv_capacity,
        "bounds": search.bounds,
        "fix": search.fixed,
        "ocv_fit": files.ocv_fit,
        "hysteresis_fit": files.hysteresis_fit,
        "reading": Reading(
            files.current_sign,
            files.ocv_current_sign,
            files.validate_current_sign,
            files.current_hold,
        ),
        "settings": Settings(
            objective=search.objective,
            coordinates=search.coordinates,
            seeds=search.seeds,
            population=search.population,
            iterations=search.iterations,
            key=search.key,
        ),
        "command": command_line(file_names([path for paths in given for path in paths])),
    }


def require_choice(option: str, value: str, choices: Iterable[str]) -> None:
    """Raise `InputError` where an option's value is none of its choices."""
    if value not in choices:
        raise InputError(f"`{option}` {value!r} is not known; there are {', '.join(choices)}")

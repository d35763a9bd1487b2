"""Options that several commands share: declared once, in groups, with their help."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from ..errors import InputError
from .groups import OUTPUT, SEARCH, TABLES, flag, option
from .output import require_free, require_there
from .record_options import Files, RecordOptions
from .session import Session, command_line


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


Quiet = Annotated[
    bool,
    flag(OUTPUT, "--quiet -q", "Print no tables and no progress; warnings still go to stderr."),
]
Force = Annotated[bool, flag(OUTPUT, "--force", "Replace the file if it exists.")]
StoredResult = Annotated[
    Path,
    typer.Argument(metavar="RESULT", help="The folder that identify wrote, or its result.json."),
]


Paper = Annotated[
    bool,
    flag(
        OUTPUT,
        "--paper",
        "Also write figures/paper: every figure as PDF and SVG, one journal column wide "
        "(89 mm, 7 pt).",
    ),
]


@dataclass(frozen=True)
class SearchOptions:
    """The box, and the search in it."""

    objective: Annotated[
        Literal["auto", "scan", "compressed"],
        option(
            SEARCH,
            "auto|scan|compressed",
            "How the search computes errors: scan simulates every sample, compressed reduces the "
            "record once. auto: compressed if the bounds allow it; in compare, scan. Reported "
            "errors are always computed by scan.",
        ),
    ] = "auto"
    coordinates: Annotated[
        Literal["rc", "log"],
        option(
            SEARCH,
            "rc|log",
            "Search R and C themselves, as in the paper (rc), or logarithms of R and tau (log).",
        ),
    ] = "rc"
    seeds: Annotated[
        int,
        option(
            SEARCH, "N", "Independent runs of the optimizer; 0: only the global optimum.", min=0
        ),
    ] = 30
    population: Annotated[int, option(SEARCH, "N", "Candidates per generation.", min=4)] = 30
    iterations: Annotated[int, option(SEARCH, "N", "Generations.", min=1)] = 500
    key: Annotated[
        int,
        option(
            SEARCH, "N", "Random key; the same key gives the same result.", min=0, max=2**32 - 1
        ),
    ] = 0
    bounds: Annotated[
        Path | None,
        option(
            SEARCH,
            "FILE.toml",
            'Bounds: a file with a table \\[bounds], such as "R0 \\[Ohm]" = \\[0.001, 0.1].',
        ),
    ] = None
    fix: Annotated[
        list[str] | None,
        option(SEARCH, "NAME=VALUE", 'Hold a parameter, such as "C1 \\[F]=500"; repeatable.'),
    ] = None

    @property
    def fixed(self) -> dict[str, float]:
        from ..model.search_space import parse_fixed

        return parse_fixed(self.fix or [])


@dataclass(frozen=True)
class Choices:
    """Which circuit, which method, and how far the answer is looked into."""

    model: Annotated[
        str | None,
        option(
            SEARCH,
            "iso-rc|so-rc|esc|...",
            "Circuit: two RC pairs with switched (iso-rc), no (so-rc) or dynamic (esc) "
            "hysteresis; 1rc, 3rc and 4rc have one, three and four pairs and no hysteresis "
            "(default: iso-rc; with tables so-rc, or esc if half the hysteresis voltage is worth "
            "8 % SOC or more).",
            autocompletion=complete_circuits,
        ),
    ] = None
    method: Annotated[
        str,
        option(
            SEARCH,
            "NAME",
            "Optimizer: ibmo, ibmo-centered, pso or any other that "
            "[bold]barnax optimizers[/bold] lists.",
            autocompletion=complete_methods,
        ),
    ] = "ibmo"
    trust: Annotated[
        Literal["none", "basic", "full"],
        option(
            SEARCH,
            "none|basic|full",
            "How closely to examine the answer: basic gives intervals, identifiability and "
            "residuals; full also gives profile likelihoods, a block bootstrap, and what would "
            "lower the error.",
        ),
    ] = "basic"
    report: Annotated[
        bool, flag(OUTPUT, "--report", "Also write report.html and report.md, with every figure.")
    ] = False
    paper: Paper = False


@dataclass(frozen=True)
class TableOptions:
    """Tables over SOC, and temperature: whether, and how."""

    over: Annotated[
        str | None,
        option(
            TABLES,
            "soc|soc,temperature",
            "Also fit the resistances and an OCV correction as tables over SOC; with temperature, "
            "one set of tables per temperature, with shared time constants.",
        ),
    ] = None
    ocv_correction: Annotated[
        bool | None,
        flag(
            TABLES,
            "--ocv-correction/--no-ocv-correction",
            "Fit a table that corrects the OCV, or not (default: yes).",
        ),
    ] = None
    half_hysteresis: Annotated[
        bool | None,
        flag(
            TABLES,
            "--half-hysteresis",
            "Fit the amplitude of a dynamic hysteresis as a table, instead of using half "
            "the hysteresis voltage; needs records in both directions.",
        ),
    ] = None
    nodes: Annotated[
        str | None,
        option(TABLES, "SOC,SOC,...", "Nodes of the tables (default: 17, from -0.05 to 1)."),
    ] = None
    roughness: Annotated[
        float | None,
        option(TABLES, "WEIGHT", "Weight of the tables' second differences (default: 1e-4)."),
    ] = None
    resistance_ridge: Annotated[
        float | None, option(TABLES, "WEIGHT", "Weight of squared resistances (default: 1e-9).")
    ] = None
    voltage_ridge: Annotated[
        float | None, option(TABLES, "WEIGHT", "Weight of squared voltages (default: 1e-7).")
    ] = None
    folds: Annotated[
        int | None, option(TABLES, "N", "Folds of the cross-validation, 0 for none (default: 5).")
    ] = None
    block_s: Annotated[
        float | None, option(TABLES, "S", "Length of the held-out blocks in s (default: 400).")
    ] = None

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


@dataclass(frozen=True)
class Rows:
    """Which rows are compared."""

    models: Annotated[
        str | None,
        option(
            SEARCH,
            "NAME,NAME",
            "Circuits, each with every method (default: the five rows of the paper); so-rc:soc "
            "adds so-rc with tables over SOC.",
        ),
    ] = None
    methods: Annotated[
        str | None,
        option(
            SEARCH,
            "NAME,NAME",
            "Methods, each with every circuit: ls, rls, wrls, rls-ekf, dual-ukf, n4sid, "
            "varpro, lm, pso-lm, de, or any that [bold]barnax optimizers[/bold] lists.",
        ),
    ] = None


@dataclass(frozen=True)
class ExportChoices:
    """Where an export goes, and whether it is simulated there."""

    to: Annotated[
        str,
        option(
            OUTPUT,
            "pybamm|thevenin|simscape|c-header|csv|json|c-filter",
            "The tool or format to export to.",
            autocompletion=complete_exporters,
        ),
    ]
    out: Annotated[
        Path | None,
        option(
            OUTPUT,
            "FILE",
            "File to write (default: barnax_pybamm.py, barnax_thevenin.py, barnax_simscape.mat, "
            "barnax_cell.h, barnax_parameters.csv, barnax_cell.json or "
            "barnax_filter.h).",
        ),
    ] = None
    force: Force = False
    verify: Annotated[
        bool,
        flag(
            OUTPUT,
            "--verify",
            "Simulate the exported circuit in PyBaMM or thevenin, and print the largest "
            "difference from barnax.",
        ),
    ] = False


@dataclass(frozen=True)
class Output:
    """Where results go, and what is printed."""

    out: Annotated[
        Path | None,
        option(
            OUTPUT, "FOLDER", "Folder for the results (default: barnax-out; barnax-soc for soc)."
        ),
    ] = None
    force: Annotated[bool, flag(OUTPUT, "--force", "Replace the result in the folder.")] = False
    as_json: Annotated[
        bool, flag(OUTPUT, "--json", "Print the result as JSON; write files only with --out.")
    ] = False
    verbose: Annotated[
        bool, flag(OUTPUT, "--verbose", "Print every decision, table and warning.")
    ] = False
    quiet: Quiet = False

    def begun(self, default: Path, inputs: Iterable[Path] = ()) -> tuple[Session, Path | None]:
        """The session of a run, and the folder of its results, None where they are only printed.

        Raises `InputError` where an input is missing, or results cannot go there.
        """
        for path in inputs:
            require_there(path)
        folder = self.out or (None if self.as_json else default)
        if folder is not None:
            require_free(folder, self.force)
        return Session(is_quiet=self.quiet or self.as_json), folder


@dataclass(frozen=True)
class Identification:
    """All that identifying a circuit can be told."""

    files: Files
    of_records: RecordOptions
    search: SearchOptions
    chosen: Choices
    tables: TableOptions
    output: Output


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
        **({"ocv_fit": files.ocv_fit} if files.ocv_fit else {}),
        "hysteresis_fit": files.hysteresis_fit,
        "reading": Reading(
            files.current_sign,
            files.ocv_current_sign,
            files.validate_current_sign,
            files.current_hold,
            files.columns,
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

"""Options that several commands share, with their help."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Literal

import typer

from ..errors import InputError

WINDOW = "Window"
INPUT = "Reading the files"
OUTPUT = "Output"
SEARCH = "Search"

Sign = Literal["auto", "charge-positive", "discharge-positive"]
Hold = Literal["auto", "forward", "backward"]
Scale = Literal["rc", "log"]
OcvFit = Literal["polynomial", "interpolated"]
HysteresisFit = Literal["continuous", "independent"]

CurrentSign = Annotated[
    Sign,
    typer.Option(
        metavar="SIGN",
        help="Sign of current in the record: charge-positive, discharge-positive, or auto, "
        "decided from the data.",
        rich_help_panel=INPUT,
    ),
]
CurrentHold = Annotated[
    Hold,
    typer.Option(
        metavar="HOLD",
        help="Whether a sample's current flowed in the interval after it (forward) or before it "
        "(backward), or auto.",
        rich_help_panel=INPUT,
    ),
]
RestCurrent = Annotated[
    float | None,
    typer.Option(
        metavar="A",
        help="Current below which the cell rests (default C/100).",
        rich_help_panel=INPUT,
    ),
]
InitialDirection = Annotated[
    int | None,
    typer.Option(
        metavar="+1|-1",
        help="Last current before the record: +1 charge (assumed), -1 discharge.",
        rich_help_panel=WINDOW,
    ),
]
StartTime = Annotated[
    float | None,
    typer.Option(
        metavar="S", help="Start the simulation here, on the file's clock.", rich_help_panel=WINDOW
    ),
]
StartAfterStep = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        help="Start at the last sample of this step's last block.",
        rich_help_panel=WINDOW,
    ),
]
InitialSoc = Annotated[
    float | None,
    typer.Option(
        metavar="0..1",
        help="State of charge at the start (default from the rested voltage).",
        rich_help_panel=WINDOW,
    ),
]
ScoreSteps = Annotated[
    str | None,
    typer.Option(
        metavar="N,N", help="Count errors only in these steps, such as 7,8.", rich_help_panel=WINDOW
    ),
]
ScoreFrom = Annotated[
    float | None,
    typer.Option(metavar="S", help="Count errors from this time on.", rich_help_panel=WINDOW),
]
ScoreTo = Annotated[
    float | None,
    typer.Option(metavar="S", help="Count errors up to this time.", rich_help_panel=WINDOW),
]
Record = Annotated[
    Path | None,
    typer.Argument(
        metavar="RECORD",
        help="Dynamic record to identify on; without it, the bundled cell runs.",
        show_default=False,
    ),
]
Ocv = Annotated[
    list[Path] | None,
    typer.Option(
        metavar="FILE",
        help="OCV test, pulse-rest or slow sweep; repeatable.",
        rich_help_panel=INPUT,
    ),
]
Validate = Annotated[
    list[Path] | None,
    typer.Option(metavar="FILE", help="Record to validate on; repeatable.", rich_help_panel=INPUT),
]
Capacity = Annotated[
    float | None,
    typer.Option(metavar="AH", help="Capacity (default from the OCV test).", rich_help_panel=INPUT),
]
Coordinates = Annotated[
    Scale,
    typer.Option(
        metavar="rc|log",
        help="Search raw R and C, as the paper does, or logarithms of R and tau.",
        rich_help_panel=SEARCH,
    ),
]
Objective = Annotated[
    Literal["scan", "compressed"],
    typer.Option(
        metavar="scan|compressed",
        help="Simulate every sample for every candidate, or reduce the record once; both agree "
        "to 1e-9, and every error that is reported comes from the scan.",
        rich_help_panel=SEARCH,
    ),
]
Seeds = Annotated[
    int, typer.Option(min=1, metavar="N", help="Independent runs.", rich_help_panel=SEARCH)
]
Population = Annotated[
    int, typer.Option(min=4, metavar="N", help="Candidates a generation.", rich_help_panel=SEARCH)
]
Iterations = Annotated[
    int, typer.Option(min=1, metavar="N", help="Generations.", rich_help_panel=SEARCH)
]
RandomKey = Annotated[
    int,
    typer.Option(
        min=0,
        max=2**32 - 1,
        metavar="N",
        help="The number all randomness comes from.",
        rich_help_panel=SEARCH,
    ),
]
BoundsFile = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE.toml",
        help='Bounds, in a table \\[bounds], such as "R0 \\[Ohm]" = \\[0.001, 0.1].',
        rich_help_panel=SEARCH,
    ),
]
Fix = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=VALUE",
        help='Hold a parameter, such as "C1 \\[F]=500"; repeatable.',
        rich_help_panel=SEARCH,
    ),
]
OcvCurves = Annotated[
    OcvFit,
    typer.Option(
        metavar="FIT",
        help="OCV curves: polynomial (degree 7) or interpolated (PCHIP through the points).",
        rich_help_panel=INPUT,
    ),
]
HysteresisSegments = Annotated[
    HysteresisFit,
    typer.Option(
        metavar="FIT",
        help="Hysteresis segments: continuous (they meet at the knots) or independent (nine "
        "free parameters).",
        rich_help_panel=INPUT,
    ),
]
OcvCurrentSign = Annotated[
    Sign,
    typer.Option(metavar="SIGN", help="Sign of current in the OCV tests.", rich_help_panel=INPUT),
]
ValidateCurrentSign = Annotated[
    Sign,
    typer.Option(
        metavar="SIGN", help="Sign of current in the validation records.", rich_help_panel=INPUT
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help="Where results go (default barnax-out).",
        rich_help_panel=OUTPUT,
    ),
]
Trust = Annotated[
    Literal["basic", "full"],
    typer.Option(
        metavar="basic|full",
        help="How far the answer is looked into: intervals, identifiability and residuals, or also "
        "profiles, a block bootstrap and what would lower the error, by fitting again.",
        rich_help_panel=SEARCH,
    ),
]
Report = Annotated[
    bool,
    typer.Option(
        "--report",
        help="Write report.html and report.md as well, with every figure as PNG and SVG.",
        rich_help_panel=OUTPUT,
    ),
]
Force = Annotated[
    bool,
    typer.Option(
        "--force", help="Replace the result that the folder holds.", rich_help_panel=OUTPUT
    ),
]
Json = Annotated[
    bool,
    typer.Option(
        "--json", help="Print the result as JSON; files only with --out.", rich_help_panel=OUTPUT
    ),
]
Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet",
        "-q",
        help="No tables and no progress; warnings still go to stderr.",
        rich_help_panel=OUTPUT,
    ),
]


def require_choice(option: str, value: str, choices: Iterable[str]) -> None:
    """Raise `InputError` where an option's value is none of its choices."""
    if value not in choices:
        raise InputError(f"{option} {value!r} is not known; there are {', '.join(choices)}")


def parse_steps(text: str | None) -> tuple[int, ...] | None:
    """Step numbers from `7,8`. Raises `InputError` where they are not numbers."""
    if text is None:
        return None
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError as problem:
        raise InputError(f"--score-steps {text!r}: write step numbers, such as 7,8") from problem

"""`barnax check`, what is wrong with files, and `barnax convert`, a file as a clean table."""

import json
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from ..errors import InputError, printable
from .groups import INPUT, OUTPUT, flag, option
from .options import Force, Quiet
from .output import require_free_file, write_file
from .record_options import Columns, Hold, Sign
from .session import Session, as_flags, shown

FINDINGS = 1
SCHEMA_VERSION = 1


def check(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE", help="Files from a cycler; - is standard input."),
    ],
    capacity: Annotated[
        float | None,
        option(INPUT, "AH", "Capacity of the cell, to check the ampere-hours against."),
    ] = None,
    columns: Columns = "",
    as_json: Annotated[bool, flag(OUTPUT, "--json", "Print the findings as JSON.")] = False,
    quiet: Annotated[
        bool,
        flag(
            OUTPUT,
            "--quiet -q",
            "Print no tables and no notes; findings go to stderr, one per line.",
        ),
    ] = False,
) -> None:
    """List every problem in measured files, and how to fix it.

    Exit status: 0 for notes only, 1 for errors or warnings, 2 for a file that is not a table.
    """
    session = Session(is_quiet=quiet or as_json)
    with session.watch("Loading"):
        from ..checks import check_file
        from ..reporting.checks import check_document, count_sentence, finding_line
        from ..reporting.terminal import to_terminal

    if capacity is not None and not capacity > 0:
        raise InputError(f"`capacity` {capacity} Ah must be positive")
    found, unreadable = [], []
    listed: list[dict[str, Any]] = []
    for file in files:
        try:
            with session.watch(f"Looking at {file.name}"):
                each = check_file(file, capacity_ah=capacity, columns=columns)
        except InputError as problem:
            unreadable.append(str(problem))
            listed.append({"file": printable(file.name), "unreadable": printable(str(problem))})
            continue
        found.append(each)
        listed.append(each.to_dict())
        session.show(to_terminal(check_document(each).spelled(as_flags)))
        if quiet:
            session.warn(finding_line(each.file, one) for one in each.findings if one.counts)
    if as_json:
        document = {"schema_version": SCHEMA_VERSION, "files": listed}
        typer.echo(json.dumps(document, indent=1, ensure_ascii=False))
    session.show([count_sentence(found, len(unreadable))])
    if unreadable:
        raise InputError("\n".join(unreadable))
    if not all(each.is_clean for each in found):
        raise typer.Exit(FINDINGS)


def convert(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="File from a cycler; - is standard input.")
    ],
    to: Annotated[
        Literal["bdf"],
        typer.Option(help="Format: the Battery Data Format.", rich_help_panel=OUTPUT),
    ] = "bdf",
    out: Annotated[
        Path | None,
        option(
            OUTPUT,
            "FILE",
            "File to write, .parquet or .csv (default: the name of FILE with .bdf.parquet).",
        ),
    ] = None,
    current_sign: Sign = "auto",
    current_hold: Hold = "auto",
    columns: Columns = "",
    force: Force = False,
    quiet: Quiet = False,
) -> None:
    """Convert a cycler file to SI units, on one clock, with charge positive.

    Its origin, and what was decided and changed, is in the metadata of the
    Parquet file, or in a JSON file beside the CSV.
    """
    session = Session(is_quiet=quiet)
    with session.watch("Loading"):
        from ..records import read_record
        from ..records.bdf import bdf_files

    stem = file.name.split(".")[0] if file.name != "-" else "record"
    path = out or Path(f"{stem}.{to}.parquet")
    require_free_file(path, force)
    with session.watch(f"Reading {file.name}"):
        record = read_record(
            file, current_sign=current_sign, current_hold=current_hold, columns=columns
        )
    for name, content in bdf_files(record, path.name).items():
        write_file(path.with_name(name), content)
    session.warn(record.warnings)
    session.show([f"Battery Data Format, {record.samples:,} samples: [bold]{shown(path)}[/bold]"])

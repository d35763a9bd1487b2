"""`barnax check`: what is wrong with files, what mends it, and what they can serve as."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from ..errors import InputError, printable
from .groups import INPUT, OUTPUT
from .record_options import Columns
from .session import Session, as_flags

FINDINGS = 1
SCHEMA_VERSION = 1


def check(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE", help="Files from a cycler; - is standard input."),
    ],
    capacity: Annotated[
        float | None,
        typer.Option(
            metavar="AH",
            help="Capacity of the cell, to check the ampere-hours against.",
            rich_help_panel=INPUT,
        ),
    ] = None,
    columns: Columns = "",
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Print the findings as JSON.", rich_help_panel=OUTPUT),
    ] = False,
    quiet: Annotated[
        bool,
        typer.Option(
            "--quiet",
            "-q",
            help="Print no tables and no notes; findings go to stderr, one per line.",
            rich_help_panel=OUTPUT,
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

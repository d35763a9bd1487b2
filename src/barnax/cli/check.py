"""`barnax check`: what is wrong with files, what mends it, and what they can serve as."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from ..errors import InputError
from . import options
from .session import Session

FINDINGS = 1
SCHEMA_VERSION = 1


def check(
    files: Annotated[list[Path], typer.Argument(metavar="FILE", help="Cyclers' files to look at.")],
    capacity: Annotated[
        float | None,
        typer.Option(
            metavar="AH",
            help="Capacity of the cell, to judge the charge by.",
            rich_help_panel=options.INPUT,
        ),
    ] = None,
    as_json: Annotated[
        bool,
        typer.Option("--json", help="Print the diagnoses as JSON.", rich_help_panel=options.OUTPUT),
    ] = False,
    quiet: Annotated[
        bool,
        typer.Option(
            "--quiet",
            "-q",
            help="No tables and no notes; findings go to stderr, a line each.",
            rich_help_panel=options.OUTPUT,
        ),
    ] = False,
) -> None:
    """Look for everything that is wrong with measured files, and say what mends it.

    Exit status 0: nothing but notes. 1: findings. 2: a file that cannot be read as a table.
    """
    session = Session(is_quiet=quiet or as_json)
    with session.stage("Loading"):
        from ..checks import check_file
        from .check_report import diagnosis_report, finding_line, verdict_sentence

    if capacity is not None and not capacity > 0:
        raise InputError(f"--capacity {capacity} Ah must be positive")
    diagnoses, unreadable = [], []
    listed: list[dict[str, Any]] = []
    for file in files:
        try:
            with session.stage(f"Looking at {file.name}"):
                diagnosis = check_file(file, capacity_ah=capacity)
        except InputError as problem:
            unreadable.append(str(problem))
            listed.append({"file": file.name, "unreadable": str(problem)})
            continue
        diagnoses.append(diagnosis)
        listed.append(diagnosis.to_dict())
        session.show(diagnosis_report(diagnosis))
        if quiet:
            counting = [finding for finding in diagnosis.findings if finding.counts]
            session.warn(finding_line(diagnosis.file, finding) for finding in counting)
    if as_json:
        document = {"schema_version": SCHEMA_VERSION, "files": listed}
        typer.echo(json.dumps(document, indent=1, ensure_ascii=False))
    session.show([verdict_sentence(diagnoses)])
    if unreadable:
        raise InputError("\n".join(unreadable))
    if not all(diagnosis.is_clean for diagnosis in diagnoses):
        raise typer.Exit(FINDINGS)

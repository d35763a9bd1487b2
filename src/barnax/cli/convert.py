"""`barnax convert`: a cycler's file as a clean table that other programs read."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from .groups import OUTPUT
from .options import Quiet
from .output import require_free_file, write_file
from .record_options import Columns, Hold, Sign
from .session import Session, shown


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
        typer.Option(
            metavar="FILE",
            help="File to write, .parquet or .csv (default: the name of FILE with .bdf.parquet).",
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    current_sign: Sign = "auto",
    current_hold: Hold = "auto",
    columns: Columns = "",
    force: Annotated[
        bool,
        typer.Option("--force", help="Replace the file if it exists.", rich_help_panel=OUTPUT),
    ] = False,
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

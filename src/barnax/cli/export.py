"""`barnax export`: a result in the format of another tool."""

import os
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from ..errors import InputError
from . import options
from .output import require_free_file, write_file
from .session import Session, complete_exporters, use_compilation_cache

if TYPE_CHECKING:
    from ..export import Verification


def export(
    result: Annotated[Path, typer.Argument(metavar="RESULT.json", help="What identify wrote.")],
    to: Annotated[
        str,
        typer.Option(
            "--to",
            metavar="pybamm|thevenin|simscape|c-header|csv",
            help="The tool or format to write for.",
            autocompletion=complete_exporters,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Where it goes (default barnax_pybamm.py, barnax_thevenin.py, "
            "barnax_simscape.mat, barnax_cell.h or barnax_parameters.csv).",
            rich_help_panel=options.OUTPUT,
        ),
    ] = None,
    force: Annotated[
        bool,
        typer.Option(
            "--force", help="Replace the file if it exists.", rich_help_panel=options.OUTPUT
        ),
    ] = False,
    verify: Annotated[
        bool,
        typer.Option(
            "--verify",
            help="Simulate the exported circuit in pybamm or thevenin, and print the largest "
            "difference from barnax in volts.",
        ),
    ] = False,
    quiet: options.Quiet = False,
) -> None:
    """Write an identified circuit for another tool.

    What the tool cannot hold is named on stderr, and in the file where its format has comments.
    """
    session = Session(is_quiet=quiet)
    # PyBaMM would ask, and then report, what it is used for.
    os.environ.setdefault("PYBAMM_DISABLE_TELEMETRY", "true")
    with session.stage("Loading JAX"):
        use_compilation_cache()
        from ..export import get_exporter, require_package
        from ..export import verify as simulate_both
        from ..results import Result

    exporter = get_exporter(to)
    if verify:
        require_package(exporter)
    path = out or Path(exporter.file_name)
    _require_other(path, result)
    require_free_file(path, force)
    stored = Result.from_json(result)
    content, caveats = exporter.write(stored)
    found = None
    if verify:
        with session.stage(f"Simulating in {exporter.package}"):
            found = simulate_both(stored, exporter, content)
    write_file(path, content, force)
    session.warn(caveats)
    session.show([f"{exporter.description}: [bold]{escape(str(path))}[/bold]"])
    if found is not None:
        session.show([_sentence(found)])


def _require_other(path: Path, result: Path) -> None:
    """Raise `InputError` where the export would take the place of the result it is made from."""
    # Names that are no files are refused elsewhere, with the reason.
    with suppress(OSError):
        if path.samefile(result):
            raise InputError(f"{path}: is the result itself; give --out another file")


def _sentence(found: "Verification") -> str:
    text = (
        f"Largest difference from barnax in {found.package} {found.version}, over {found.samples} "
        f"samples of a pulse test: {found.largest_v:.3g} V (rms {found.rms_v:.3g} V)"
    )
    remainders = {
        "without the hysteresis voltage": found.without_hysteresis_v,
        "apart from the samples at which the current turns": found.without_turns_v,
    }
    reason, remainder_v = min(remainders.items(), key=lambda item: item[1])
    if remainder_v < found.largest_v / 2:
        text += f"; {reason} {remainder_v:.3g} V"
    return text + "."

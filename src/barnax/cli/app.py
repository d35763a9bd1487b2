"""The command `barnax`: its subcommands and their common options."""

from typing import Annotated

import typer

from .. import __version__, devices
from .compare import compare, optimizers
from .design import design
from .files import check, convert, export
from .fleet import fleet, life
from .identify import hppc, identify, pack
from .options import Command, grouped
from .results import report, show, soc, validate

app = typer.Typer(
    name="barnax",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
COMMANDS = (
    *(identify, hppc, pack, fleet, life, show, report, validate, soc, design, compare),
    *(export, check, convert, optimizers),
)
for command in COMMANDS:
    app.command(cls=Command)(grouped(command))


def _print_version(is_asked: bool) -> None:
    if is_asked:
        print(f"barnax {__version__}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version."),
    ] = False,
) -> None:
    """Identify lithium-ion equivalent-circuit parameters from measured current and voltage.

    Run barnax identify without arguments to see it work on the bundled cell.
    """
    devices.keep_compiled()

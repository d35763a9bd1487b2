"""The command `barnax` and its exit statuses."""

import atexit
import gc
import os
import signal
import sys
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape

from .. import __version__
from ..errors import InputError
from .check import check
from .compare import compare
from .export import export
from .identify import identify
from .optimizers import optimizers
from .rerun import rerun
from .validate import validate

BAD_INPUT = 2
INTERRUPTED = 130

app = typer.Typer(
    name="barnax",
    help="Identify lithium-ion equivalent-circuit parameters from measured current and voltage.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command()(identify)
app.command()(validate)
app.command()(compare)
app.command()(rerun)
app.command()(export)
app.command()(check)
app.command()(optimizers)


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

    Run [bold]barnax identify[/bold] without arguments to see it work on the bundled cell.
    """


def _stop(*_: object) -> None:
    """Say at once that the signal was heard: a compiled search ends only by itself."""
    # Not by sys.stderr: the signal may have come in the middle of a write to it.
    os.write(2, b"\nstopping as soon as what is being computed is done\n")
    raise KeyboardInterrupt


def main() -> None:
    """Run the command line; bad input is one message and exit status 2, never a traceback."""
    # Modules and traces are many objects and no garbage: looking through them for some, at Python's
    # usual intervals and once more at the end, took a tenth of `barnax identify` on short records.
    gc.set_threshold(50_000, 20, 20)
    atexit.register(gc.freeze)
    # A polite end from outside is the same as Ctrl-C: what is being written is finished or undone.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _stop)
    try:
        app()
    except InputError as problem:
        Console(stderr=True, highlight=False, soft_wrap=True).print(
            "[bold red]error:[/bold red]", escape(str(problem))
        )
        sys.exit(BAD_INPUT)
    except SystemExit as end:
        # Typer turns Ctrl-C into this status, and says nothing.
        if end.code == INTERRUPTED:
            Console(stderr=True).print("interrupted; earlier results are as they were")
        raise

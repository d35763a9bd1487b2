"""Run the command line; bad input is one message and exit status 2, never a traceback."""

import atexit
import gc
import os
import signal
import sys

from rich.console import Console
from rich.markup import escape

from .cli.app import app
from .cli.session import as_flags
from .errors import InputError, printable

BAD_INPUT = 2
INTERRUPTED = 130


def _stop(*_: object) -> None:
    """Say at once that the signal was heard: a compiled search ends only by itself."""
    # Not by sys.stderr: the signal may have come in the middle of a write to it.
    os.write(2, b"\nstopping as soon as what is being computed is done\n")
    raise KeyboardInterrupt


def main() -> None:
    """The command `barnax`."""
    # Modules are many objects and no garbage: looking through them for some, at Python's usual
    # intervals and once more at the end, took a tenth of `barnax identify` on short records.
    gc.set_threshold(50_000, 20, 20)
    atexit.register(gc.freeze)
    # A polite end from outside is the same as Ctrl-C: what is being written is finished or undone.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _stop)
    try:
        app()
    except InputError as problem:
        _complain(as_flags(str(problem)))
        sys.exit(BAD_INPUT)
    except OSError as problem:
        # A full disk behind stdout, or a reader that has gone: what was written is written.
        _complain(f"output could not be written ({problem.strerror or problem})")
        os._exit(BAD_INPUT)
    except SystemExit as end:
        # Typer turns Ctrl-C into this status, and says nothing.
        if end.code == INTERRUPTED:
            kept = "earlier results are as they were"
            if sys.argv[1:2] == ["fleet"]:
                kept = "the finished cells are kept, and the same command continues"
            Console(stderr=True).print(f"interrupted; {kept}")
        raise


def _complain(text: str) -> None:
    console = Console(stderr=True, highlight=False, soft_wrap=True)
    lines = [escape(printable(line)) for line in text.split("\n")]
    console.print("[bold red]error:[/bold red]", "\n".join(lines))


if __name__ == "__main__":
    main()

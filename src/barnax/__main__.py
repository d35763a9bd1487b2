"""Run the command line; bad input is one message and exit status 2, never a traceback."""

import atexit
import gc
import os
import signal
import sys
from contextlib import suppress

BAD_INPUT = 2
INTERRUPTED = 130
SIGNALS = (signal.SIGINT, signal.SIGTERM)
# The commands that write no result.
READING = {"check", "optimizers", "show", "validate"}


def _stop(*_: object) -> None:
    """End the process immediately: code that loads or calls back may fail on an exception, or drop
    it.

    Unfinished files hold the signal back (`undisturbed`).
    """
    # Once is enough: another signal, or a pending one, is ignored.
    for number in SIGNALS:
        signal.signal(number, lambda *_: None)
    kept = "; earlier results are as they were"
    if sys.argv[1:2] == ["fleet"]:
        kept = "; the finished cells are kept, and the same command continues"
    elif {*sys.argv[1:2]} <= READING:
        kept = ""
    # A progress bar occupies the line, and hides the cursor.
    cleared = "\r\x1b[2K\x1b[?25h" if os.isatty(2) else ""
    with suppress(OSError):
        # Not via sys.stderr: the signal may have come in the middle of a write to it.
        os.write(2, f"{cleared}interrupted{kept}\n".encode())
    os._exit(INTERRUPTED)


def main() -> None:
    """The command `barnax`."""
    # SIGTERM is the same as Ctrl-C. Set before anything that takes time to load.
    for number in SIGNALS:
        signal.signal(number, _stop)
    # Modules are many objects and no garbage: scanning them at Python's usual intervals and once
    # more at the end took a tenth of `barnax identify` on short records.
    gc.set_threshold(500_000, 20, 20)
    atexit.register(gc.freeze)
    from .devices import ONE_POOL, prefer_cpu, set_malloc
    from .programs import of_command

    set_malloc(ONE_POOL)
    prefer_cpu()
    with of_command():
        _run()


def _run() -> None:
    from .cli.app import app
    from .cli.session import as_flags
    from .errors import InputError

    try:
        app()
    except InputError as problem:
        _complain(as_flags(str(problem)))
        sys.exit(BAD_INPUT)
    except OSError as problem:
        # A full disk behind stdout, or a reader that has gone: files already written are kept.
        _complain(f"output could not be written ({problem.strerror or problem})")
        os._exit(BAD_INPUT)
    finally:
        # All work is done.
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)


def _complain(text: str) -> None:
    from rich.console import Console
    from rich.markup import escape

    from .errors import printable

    console = Console(stderr=True, highlight=False, soft_wrap=True, emoji=False)
    lines = [escape(printable(line)) for line in text.split("\n")]
    console.print("[bold red]error:[/bold red]", "\n".join(lines))


if __name__ == "__main__":
    main()

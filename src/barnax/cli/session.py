"""One run of a command: its console, progress, timings and compiled code."""

import json
import re
import shlex
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from datetime import timedelta
from importlib import import_module
from typing import Any

from rich.console import Console, RenderableType
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from .. import devices, reporting
from ..errors import OPTION, InputError, as_keys, printable, reason_of
from ..notices import Notice, sentences_of
from ..settings import TableOptions

# Options of `barnax.identify` that are keys of a plan rather than options of a command.
RESEARCH = {*vars(TableOptions()), "hysteresis_fit"} - {"resistances_follow", "keep_starts"}

# Without a terminal, a stage is first reported after this time.
PATIENCE_S = 10.0


def flag_of(name: str) -> str:
    """An option as the command line spells it."""
    return f"--{name.replace('_', '-')}"


def as_flags(text: str) -> str:
    """A message, with the options that it names in backticks spelled as on the command line.

    >>> as_flags("give `initial_soc=0.9` or `current_sign='charge-positive'`")
    'give --initial-soc 0.9 or --current-sign charge-positive'
    >>> as_flags("more `nodes`, or `folds=0`")
    'more nodes (in plan.toml), or folds = 0 (in plan.toml)'
    """

    def flag(match: re.Match[str]) -> str:
        if match[1] in RESEARCH:
            return f"{as_keys(match[0])} (in plan.toml)"
        name = flag_of(match[1])
        return name if match[2] is None else f"{name} {shlex.quote(match[2].strip(chr(39)))}"

    return OPTION.sub(flag, text)


def shown(text: object) -> str:
    """A name for a console: no markup, and no control characters."""
    return escape(printable(str(text)))


class Session:
    """The console of one command. Tables go to stdout, everything else to stderr.

    A quiet command shows warnings only.
    """

    def __init__(self, is_quiet: bool):
        self._is_quiet = is_quiet
        self._console = Console(highlight=False, emoji=False)
        self._notes = Console(stderr=True, highlight=False, emoji=False)
        # Of all stages so far.
        self.seconds: dict[str, float] = {}
        self._started = time.perf_counter()

    @contextmanager
    def watch(self, title: str, total: int = 0) -> Iterator[Callable[..., None]]:
        """Time a stage, under a bar of `total` steps if there are any. The function it yields takes
        the steps gained, or the arguments of `Progress.update` and a `remark`.

        Without a terminal, a stage of more than `PATIENCE_S` is reported in a line.
        """
        counts = (MofNCompleteColumn(), TimeRemainingColumn()) if total else ()
        remark = TextColumn("{task.fields[remark]}")
        columns = (BarColumn(pulse_style="cyan"), remark, *counts, TimeElapsedColumn())
        is_shown = self._notes.is_terminal and not self._is_quiet
        progress = Progress(
            TextColumn("{task.description}"), *columns,
            console=self._notes, transient=True, disable=not is_shown,
        )  # fmt: skip
        task = progress.add_task(shown(title), total=total or None, remark="")
        is_over = threading.Event()
        if not (is_shown or self._is_quiet):
            lines = (title, progress.tasks[0], is_over)
            threading.Thread(target=self._report, args=lines, daemon=True).start()
        with self.timed(title), progress:
            try:
                yield lambda gained=0, **state: progress.update(task, advance=gained, **state)
            finally:
                is_over.set()

    def _report(self, title: str, task: Task, is_over: threading.Event) -> None:
        """Print the progress of a stage, at intervals that double, until it is over.

        It imports nothing: a thread that waits for a module can break its import in another one.
        """
        wait_s = PATIENCE_S
        while not is_over.wait(wait_s):
            wait_s, elapsed_s, steps = 2 * wait_s, task.elapsed or 0.0, ""
            if task.total and task.completed:
                left_s = round(elapsed_s * (task.total / task.completed - 1))
                left = f"about {timedelta(seconds=left_s)} left"
                steps = f", {task.completed:g} of {task.total:g}, {left}"
            self.note(f"{title}: {timedelta(seconds=round(elapsed_s))}{steps}")

    def load_jax(self) -> None:
        """A stage that loads JAX and the identification."""
        with self.watch("Loading JAX"):
            require_platform()
            import_module("barnax.identification.pipeline")

    @contextmanager
    def timed(self, title: str, advance: Any = None) -> Iterator[Any]:
        """Time a stage that shows its progress itself; `advance` is what it calls."""
        start = time.perf_counter()
        try:
            yield advance
        finally:
            self.seconds[title] = time.perf_counter() - start

    def show(self, blocks: Iterable[RenderableType]) -> None:
        """Print tables and sentences, unless the command is quiet."""
        if not self._is_quiet:
            for block in blocks:
                # Text to be copied stays on one line, however narrow the terminal.
                self._console.print(block, soft_wrap=isinstance(block, Text), crop=False)

    def show_document(self, document: "reporting.document.Page") -> None:
        """Print a document, with options as on the command line."""
        self.show([reporting.terminal.to_terminal(document.with_option_names(as_flags))])

    def note(self, text: str) -> None:
        """Print a sentence to stderr, unless the command is quiet."""
        if not self._is_quiet:
            self._notes.print(shown(as_flags(text)), soft_wrap=True)

    def warn(self, warnings: Iterable[object], notes: Iterable[object] = ()) -> None:
        """Print notes and warnings to stderr; if the command is quiet, only warnings and
        assumptions about a file."""
        every = [*warnings]
        minor = [one for one in every if isinstance(one, Notice) and not one.counts]
        self._list("[dim]note:[/dim]", () if self._is_quiet else notes)
        self._list("[yellow]warning:[/yellow]", (one for one in every if one not in minor))
        self._list("[dim]note:[/dim]", (note for note in minor if note.is_kept))

    def _list(self, kind: str, notices: Iterable[object]) -> None:
        for sentence in sentences_of(notices):
            self._notes.print(kind, shown(as_flags(sentence)), soft_wrap=True)

    @property
    def elapsed_s(self) -> float:
        return time.perf_counter() - self._started

    def timings_json(self) -> bytes:
        """Seconds of every stage so far, as `timings.json`."""
        seconds = {f"{stage} [s]": round(spent, 3) for stage, spent in self.seconds.items()}
        return (json.dumps(seconds, indent=1) + "\n").encode()


def require_platform() -> None:
    """Raise `InputError` if JAX is set to compute on a device that is missing."""
    platforms = devices.given_platforms()
    if set(platforms.values()) <= {"cpu", ""}:
        return
    import jax

    try:
        jax.devices()
    # Without the plugin of a platform, JAX fails an assertion.
    except (RuntimeError, AssertionError) as problem:
        named = ", ".join(f"{name}={printable(value)}" for name, value in platforms.items())
        reason = f" ({reason_of(problem)})" if str(problem) else ""
        raise InputError(
            f"{named}: JAX cannot compute there{reason}; unset {' and '.join(platforms)} to "
            "compute on the CPU, or install JAX for it, such as jax[cuda13]"
        ) from problem

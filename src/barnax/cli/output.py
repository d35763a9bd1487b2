"""A folder of results, or a single file, written completely or not at all."""

import filecmp
import hashlib
import itertools
import json
import os
import shlex
import shutil
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import Any

import typer

import barnax

from .. import reporting
from ..errors import InputError
from ..files import aside, locked, restore, undisturbed, unfinished, write_whole
from .options import group
from .session import Session, as_flags

DEFAULT_FOLDER = "barnax-out"
# Every folder of results has one of these, except those of factors, which have tables only.
RESULTS = ("result.json", "comparison.json", "soc.json", "design.json", "life.json")
TABLES = "tables.csv"
# The file next to a result that repeats the run.
PLAN = "plan.toml"
# What barnax wrote into a folder, each file with its SHA-256: all else is the user's, whatever its
# name, as is anything changed since.
LIST = "files.json"
# Bytes of a result with its report and figures.
ROOM = 4_000_000


@group
class Output:
    """The folder of the results, and what is printed.

    Output:
        out (FOLDER): Folder for the results (default: barnax-out; barnax-soc for soc, barnax-design
            for design, barnax-life for life).
        force: Replace the result in the folder.
        as_json (--json): Print the result as JSON; write files only with --out.
        verbose: Print every decision, table and warning.
    """

    out: Path | None = None
    force: bool = False
    as_json: bool = False
    verbose: bool = False
    quiet: bool = False

    def begun(self, default: str | None, *inputs: Path, with_jax: bool = True) -> "Delivery":
        """The run of a command, which loads JAX if it computes `with_jax`. Raises `InputError` if
        an input is missing, or results cannot go to their folder; without a default there is a
        folder only if one is given."""
        for path in inputs:
            require_there(path)
        folder = self.out or (None if self.as_json or default is None else Path(default))
        run = Delivery(self, folder)
        if folder is not None:
            require_free(folder, self.force)
            report_unfinished(run, folder.resolve().parent)
        if with_jax:
            run.load_jax()
        return run


class Delivery(Session):
    """A session whose results go to a folder; None if they are only printed."""

    def __init__(self, output: Output, folder: Path | None):
        super().__init__(output.quiet or output.as_json)
        self.output, self.folder = output, folder
        self.written: set[str] = set()

    def deliver(self, texts: Mapping[str, str], draw: Callable[[], Mapping[str, bytes]]) -> None:
        """Write texts, the first of which is the result, with the figures, and print the result if
        requested. A figure that fails to be drawn is the only loss."""
        files = {name: text.encode() for name, text in texts.items()}
        if self.folder is not None:
            with self.watch("Drawing figures"):
                try:
                    files |= draw()
                except Exception as problem:
                    words = f"the figures could not be drawn ({problem}); the result is written"
                    self.warn([words])
            self.write(files | {"timings.json": self.timings_json()})
        if self.output.as_json:
            typer.echo(next(iter(texts.values())), nl=False)

    def write(self, files: Mapping[str, bytes]) -> None:
        """Put files into the folder, or into the next free one with a message."""
        assert self.folder is not None
        folder, self.written = self.folder, {*files}
        self.folder = write_folder(folder, files, self.output.force)
        if self.folder != folder:
            where = f"the results are in {self.folder}"
            self.warn([f"{folder}: something else has appeared there; {where}"])

    def show_written(self, names: Sequence[str], remark: str = "", following: str = "") -> None:
        """Print which of these files and folders were written, a remark, and the time taken."""
        if self.folder is not None:
            heads = self.written | _folders(self.written)
            first, *others = (name for name in names if name in heads)
            words = (*others, remark, f"{self.elapsed_s:.1f} s", following)
            line = "  ".join(filter(None, (f"  {self.folder}/{first}", *words)))
            self.show(["", reporting.terminal.whole_line(line)])


def page_of(document: "reporting.document.Page") -> bytes:
    """A document as an HTML page, with options as on the command line."""
    return reporting.render.to_html(document.with_option_names(as_flags)).encode()


def drawn_files(
    draw: Callable[[], Any],
    document_of: Callable[[Any], "reporting.document.Page"],
    report: bool,
    paper: bool,
) -> dict[str, bytes]:
    """The report with the figures that `draw` makes, or only the main ones, and all of them for
    paper, by their paths in the results folder."""
    files: dict[str, bytes] = {}
    if paper:
        with barnax.plots.column_width():
            files = reporting.render.paper_files(draw())
    drawn = draw()
    if report:
        document = document_of(drawn)
        markdown = reporting.render.to_markdown(document.with_option_names(as_flags))
        files |= {
            "report.html": page_of(document),
            "report.md": markdown.encode(),
            **{f"figures/{picture.name}.svg": picture.svg for picture in drawn},
        }
    shown = (picture for picture in drawn if report or picture.is_main)
    return files | {f"figures/{picture.name}.png": picture.png for picture in shown}


def require_there(path: Path) -> None:
    """Raise `InputError` if there is no such file; "-" is the standard input."""
    if path == Path("-"):
        return
    try:
        os.lstat(path)
    except FileNotFoundError:
        words = "there is no such file; check the name and the folder."
        raise InputError(f"{path}: {words}") from None
    except (OSError, ValueError):
        # The reader of the file explains why it cannot be read.
        return


def require_free(folder: Path, is_forced: bool) -> None:
    """Raise `InputError` if results cannot go to `folder`. Called before any work is done."""
    another = "give `out` another folder"
    with _described(folder, another):
        target = folder.resolve()
        if target == Path.cwd() or os.path.ismount(target):
            raise InputError(
                f"{folder}: results replace their folder as a whole; give `out` one in it"
            )
        existing = _writable(folder, target, another)
        restore(target)
        for name in target.relative_to(existing).parts:
            # A name that no folder can have is refused now, not when the search is done.
            with suppress(FileNotFoundError):
                os.lstat(existing / name)
        with suppress(FileNotFoundError):
            names, results = sorted(os.listdir(target)), sorted(_results_in(target))
            if names and _ours_and_theirs(target)[0].isdisjoint(results):
                words = f"holds {names[0]!r}, which barnax did not write"
                if results:
                    words = f"{results[0]!r} was changed since barnax wrote it"
                raise InputError(f"{folder}: {words}; {another}")
            if names and not is_forced:
                raise InputError(f"{folder}: holds a result; replace it with `force` or {another}")


def write_folder(folder: Path, files: Mapping[str, bytes], is_forced: bool) -> Path:
    """Put all files into `folder`, or leave it as it was. Keys are paths in the folder.

    An existing result is replaced if forced and unchanged; the user's own files stay. Files that
    appeared after `require_free` stay too, and the results go to a new folder next to it,
    `folder-2` or the next free one, so that a long search is not lost. Returns the folder that was
    used.

    A folder appears with all its files at once, the user's included. If the process is killed
    between the two steps of a replacement, `restore` does the second one.
    """
    target = folder.resolve()
    files = {**files, LIST: _listed({name: _hash(content) for name, content in files.items()})}
    described = _described(folder, "nothing was changed; give `out` another folder")
    with described, undisturbed(), ExitStack() as stack:
        target.parent.mkdir(parents=True, exist_ok=True)
        restore(target)
        # Two commands that end at the same time write one after the other.
        stack.enter_context(locked(target.parent))
        workshop = aside(target.parent)
        workshop.mkdir()
        stack.callback(shutil.rmtree, workshop, ignore_errors=True)
        fresh, old = workshop / "new", workshop / "old" / target.name
        for name, content in files.items():
            write_whole(fresh / name, content)
        ours, theirs = _ours_and_theirs(target)
        is_replaced = is_forced and not ours.isdisjoint(_results_in(target))
        # What would replace a file of the user's.
        clashes = [name for name in files if (target / name).is_dir()]
        clashes += theirs & (files.keys() | _folders(files))
        if clashes or not is_replaced:
            moved = _moved(fresh, target)
            return folder if moved == target else moved
        _share(target, fresh, ours | (_folders(ours) - _folders(theirs)))
        old.parent.mkdir()
        os.replace(target, old)
        try:
            os.replace(fresh, target)
        except BaseException:
            # Not before it is back: undoing may be stopped too.
            kept = stack.pop_all()
            os.replace(old, target)
            kept.close()
            raise
        # What somebody saved there meanwhile.
        late = [name for name in _ours_and_theirs(old)[1] if not (old / name).is_symlink()]
        if len(filecmp.cmpfiles(old, target, late)[0]) < len(late):
            _moved(old, target)
    return folder


def _share(target: Path, fresh: Path, but: set[str]) -> None:
    """Put all of a folder into another one, `but` these paths: as hard links, or as copies if the
    file system has none."""

    def left_out(folder: str, names: Sequence[str]) -> list[str]:
        inside = Path(folder).relative_to(target)
        return [name for name in names if (inside / name).as_posix() in but]

    def share(file: str, other: str) -> None:
        try:
            os.link(file, other)
        except OSError:
            shutil.copy2(file, other)

    shutil.copytree(
        target, fresh, symlinks=True, ignore=left_out, copy_function=share, dirs_exist_ok=True
    )


def _folders(names: Iterable[str]) -> set[str]:
    """The folders of the files with these paths."""
    return {str(folder) for name in names for folder in PurePosixPath(name).parents[:-1]}


def _listed(hashes: Mapping[str, str]) -> bytes:
    return (json.dumps(hashes, indent=1, sort_keys=True) + "\n").encode()


def _listing(folder: Path) -> dict[str, str]:
    """The files that barnax wrote according to a folder's list, with the hash of each."""
    path = folder / LIST
    with suppress(OSError, ValueError):
        # A pipe would wait for its other end.
        listed = json.loads(path.read_text()) if path.is_file() else None
        if isinstance(listed, dict):
            return listed
    return {}


def _results_in(folder: Path) -> set[str]:
    """The results that barnax wrote according to a folder's list."""
    listed = _listing(folder).keys()
    return (listed & {*RESULTS}) or (listed & {TABLES})


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def free_names(path: Path) -> Iterator[Path]:
    """The path itself if nothing or an empty folder is there, and the free names after it."""
    for number in itertools.count(1):
        free = path if number == 1 else path.with_name(f"{path.name}-{number}")
        if not os.path.lexists(free) or (free.is_dir() and not any(free.iterdir())):
            yield free


def new_run(*words: str) -> str:
    """The command that identifies into a free folder."""
    out = next(free_names(Path(DEFAULT_FOLDER)))
    return shlex.join(["barnax", "identify", *words, "--out", str(out)])


def _moved(fresh: Path, target: Path) -> Path:
    """The first free name, to which the folder has been moved."""
    for free in free_names(target):
        with suppress(OSError):
            # Not every system moves a folder over an empty one.
            free.rmdir()
        try:
            os.replace(fresh, free)
            return free
        except OSError:
            # Another process may have taken it since, or it can be neither removed nor replaced.
            if not os.path.lexists(free):
                raise
    raise AssertionError("there is always another number")


def _ours_and_theirs(folder: Path) -> tuple[set[str], set[str]]:
    """Files in a folder that barnax wrote and nobody changed since, and all others."""
    listed = _listing(folder)
    paths = (path for path in folder.rglob("*") if path.is_symlink() or not path.is_dir())
    there = {path.relative_to(folder).as_posix(): path for path in paths}
    ours = {
        name
        for name, path in there.items()
        if name in listed and not path.is_symlink() and path.is_file()
        if _hash(path.read_bytes()) == listed[name]
    }
    ours |= {LIST} & there.keys() if ours else set()
    return ours, there.keys() - ours


def require_free_file(path: Path, is_forced: bool, read: Iterable[Path] = ()) -> None:
    """Raise `InputError` if a file cannot go to `path`, or it is an input. Called before any work
    is done."""
    for other in read:
        # Names that are not files are refused elsewhere, with the reason.
        with suppress(OSError):
            if path.samefile(other):
                raise InputError(f"{path}: this is the file to read; choose another with `out`")
    another = "give `out` another file"
    with _described(path, another):
        target = path.resolve()
        if target.is_symlink():
            # A link to itself, which `resolve` does not report from Python 3.13 on.
            target.stat()
        if target.is_dir():
            raise InputError(f"{path}: is a folder; give `out` a file in it")
        if target.exists() and not stat.S_ISREG(target.stat().st_mode):
            raise InputError(f"{path}: is a device or a pipe, and no file; {another}")
        if target.exists() and not is_forced:
            raise InputError(f"{path}: exists already; replace it with `force` or {another}")
        _writable(path, target, another)


def _writable(path: Path, target: Path, another: str) -> Path:
    """The nearest existing folder above a path. Raises `InputError` if nothing can be written."""
    existing = next(parent for parent in target.parents if parent.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK):
        raise InputError(f"{path}: {existing} cannot be written to; {another}")
    usage = shutil.disk_usage(existing)
    # Some file systems of a network do not say.
    if usage.total and usage.free < ROOM:
        room = f"{usage.free / 1e6:.1f} MB left, and results take about {ROOM / 1e6:.0f} MB"
        raise InputError(f"{path}: the disk of {existing} has {room}; make room, or {another}")
    return existing


def write_file(path: Path, content: bytes) -> None:
    """Put `content` into the file `path`, or leave it as it was."""
    target = path.resolve()
    with _described(path, "nothing was changed; give `out` another file"):
        write_whole(target, content)


def add_file(path: Path, content: bytes) -> None:
    """`write_file`; in a folder of results the file is added to its list."""
    with locked(path.resolve().parent.parent):
        write_file(path, content)
        if listed := _listing(path.parent):
            with suppress(OSError):
                write_whole(path.parent / LIST, _listed({**listed, path.name: _hash(content)}))


def report_unfinished(session: Session, folder: Path) -> None:
    """Report what killed commands left in a folder, if it exists."""
    session.warn(
        f"{path}: left by a command that was stopped while it wrote"
        + (", with the result that it was to replace" if any(path.glob("old/*")) else "")
        + "; delete it when no command runs there"
        for path in unfinished(folder.resolve())
    )


@contextmanager
def _described(path: Path, remedy: str) -> Iterator[None]:
    """Turn an error of the system into an `InputError` that names the path."""
    try:
        yield
    # Before Python 3.13 a link to itself is a RuntimeError.
    except (OSError, RuntimeError) as problem:
        reason = getattr(problem, "strerror", None) or problem
        raise InputError(f"{path}: cannot be used ({reason}); {remedy}") from problem

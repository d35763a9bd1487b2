"""A folder of results, or a single file, written whole or not at all."""

import hashlib
import itertools
import json
import os
import shutil
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import typer

from ..errors import InputError
from ..files import aside, undisturbed, unfinished, write_whole
from .options import OUTPUT, QUIET, flag, group, option
from .session import Session, as_flags

if TYPE_CHECKING:
    from ..reporting.document import Document

try:
    import fcntl
except ImportError:  # Not on Windows.
    fcntl = None

DEFAULT_FOLDER = Path("barnax-out")
# One of these is in every folder of results.
RESULTS = ("result.json", "comparison.json", "soc.json", "design.json", "life.json")
# What barnax wrote into a folder, each file with its SHA-256: all else is the user's, whatever its
# name, and so is what was changed since.
LIST = "files.json"


@group
class Output:
    """The folder of the results, and what is printed."""

    out: Path | None = option(
        OUTPUT,
        "FOLDER",
        "Folder for the results (default: barnax-out; barnax-soc for "
        "soc, barnax-design for design, barnax-life for life).",
    )
    force: bool = flag(OUTPUT, "--force", "Replace the result in the folder.")
    as_json: bool = flag(OUTPUT, "--json", "Print the result as JSON; write files only with --out.")
    verbose: bool = flag(OUTPUT, "--verbose", "Print every decision, table and warning.")
    quiet: bool = QUIET

    def begun(self, default: Path, inputs: Iterable[Path] = ()) -> tuple[Session, Path | None]:
        """The session of a run, and the folder of its results, None where they are only printed.

        Raises `InputError` where an input is missing, or results cannot go there.
        """
        for path in inputs:
            require_there(path)
        folder = self.out or (None if self.as_json else default)
        if folder is not None:
            require_free(folder, self.force)
        session = Session(is_quiet=self.quiet or self.as_json)
        if folder is not None:
            tell_unfinished(session, folder.resolve().parent)
        return session, folder

    def deliver(
        self,
        session: Session,
        folder: Path | None,
        name: str,
        document: str,
        draw: Callable[[], Mapping[str, bytes]],
        beside: Mapping[str, str] | None = None,
    ) -> tuple[Path | None, set[str]]:
        """Write a result under its name with its figures and what stands `beside` it, and print it,
        as far as is wanted.

        What fails to be drawn costs only itself. Gives the folder that it went to, and the files
        in it.
        """
        texts = {name: document, **(beside or {})}
        written = {name: text.encode() for name, text in texts.items()}
        if folder is not None:
            with session.watch("Drawing figures"):
                try:
                    written |= draw()
                except Exception as problem:
                    session.warn(
                        [f"the figures could not be drawn ({problem}); the result is written"]
                    )
            written["timings.json"] = session.timings_json()
            place = write_folder(folder, written, self.force)
            if place != folder:
                session.warn(
                    [f"{folder}: something else has appeared there; the results are in {place}"]
                )
            folder = place
        if self.as_json:
            typer.echo(document, nl=False)
        return folder, set(written)


def drawn_files(
    draw: Callable[[], Any], document_of: Callable[[Any], "Document"], report: bool, paper: bool
) -> dict[str, bytes]:
    """The report with the figures that `draw` makes, or only the main ones, and all of them for
    paper, by their path below the results folder."""
    from ..plots import column_width
    from ..reporting.render import paper_files, report_files

    files: dict[str, bytes] = {}
    if paper:
        with column_width():
            files = paper_files(draw())
    drawn = draw()
    if not report:
        return files | {
            f"figures/{figure.name}.png": figure.png for figure in drawn if figure.is_main
        }
    return files | report_files(document_of(drawn).with_option_names(as_flags), drawn)


def require_there(path: Path) -> None:
    """Raise `InputError` where there is no such file; "-" is the standard input."""
    if path == Path("-"):
        return
    try:
        os.lstat(path)
    except FileNotFoundError:
        words = "there is no such file; check the name and the folder."
        raise InputError(f"{path}: {words}") from None
    except (OSError, ValueError):
        # Whoever reads it says why it cannot be.
        return


def require_free(folder: Path, is_forced: bool) -> None:
    """Raise `InputError` where results cannot go to `folder`. Called before any work is done."""
    another = "give `out` another folder"
    with _described(folder, another):
        place = folder.resolve()
        if place == Path.cwd() or os.path.ismount(place):
            raise InputError(
                f"{folder}: results replace their folder as a whole; give `out` one in it"
            )
        existing = _writable(folder, place, another)
        for name in place.relative_to(existing).parts:
            # A name that no folder can have is refused now, not when the search is done.
            with suppress(FileNotFoundError):
                os.lstat(existing / name)
        with suppress(FileNotFoundError):
            names = sorted(os.listdir(place))
            own, _ = _own_and_others(place)
            if names and own.isdisjoint(RESULTS):
                known = sorted({*names, *RESULTS} & _listing(place).keys() & {*RESULTS})
                what = f"{known[0]!r} was changed since" if known else f"holds {names[0]!r}, which"
                words = "barnax wrote it" if known else "barnax did not write"
                raise InputError(f"{folder}: {what} {words}; {another}")
            if names and not is_forced:
                raise InputError(f"{folder}: holds a result; replace it with `force` or {another}")


def write_folder(folder: Path, files: Mapping[str, bytes], is_forced: bool) -> Path:
    """Put all files into `folder`, or leave what was there. Keys are paths below the folder.

    A result that is there is replaced where that is forced, file by file of its own list, if these
    are as they were written; a user's own files stay. What has appeared there since `require_free`
    was asked stays too, and the files go to a new folder beside it, `folder-2` or the next that is
    free: a long search is not lost.
    Gives the folder that they went to.

    A new folder is there at once with all its files. An old result is copied aside before the first
    of its files is replaced: where the process is killed before the last, old and new are whole in
    what it left `unfinished`.
    """
    place = folder.resolve()
    hashes = {name: [_hash(content)] for name, content in files.items()}
    files = {**files, LIST: _listed(hashes)}
    described = _described(folder, "nothing was changed; give `out` another folder")
    with described, undisturbed(), ExitStack() as stack:
        place.parent.mkdir(parents=True, exist_ok=True)
        # Two commands that end at once write one after the other.
        stack.enter_context(_locked(place.parent))
        own, theirs = _own_and_others(place)
        is_replaced = is_forced and not own.isdisjoint(RESULTS)
        is_replaced &= not any(_is_in_the_way(place, name, theirs) for name in files)
        workshop = aside(place.parent)
        workshop.mkdir()
        stack.callback(shutil.rmtree, workshop, ignore_errors=True)
        fresh, old = workshop / "new", workshop / "old"
        for name, content in files.items():
            _write(fresh / name, content)
        if not is_replaced:
            found = _moved(fresh, place)
            return folder if found == place else found
        for name in own:
            (old / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(place / name, old / name, follow_symlinks=False)
        # After a kill, what is of either result is still known to be ours.
        both = _listing(place)
        both |= {name: both.get(name, []) + own_hash for name, own_hash in hashes.items()}
        _write(workshop / LIST, _listed(both))
        try:
            os.replace(workshop / LIST, place / LIST)
            for name in sorted(files.keys() - {LIST}, key=lambda name: name in RESULTS):
                (place / name).parent.mkdir(parents=True, exist_ok=True)
                os.replace(fresh / name, place / name)
            _take_away(place, own.difference(files))
            os.replace(fresh / LIST, place / LIST)
        except BaseException:
            # Not to go before all is as it was: undoing may be stopped too.
            kept = stack.pop_all()
            _take_away(place, files.keys() - own)
            for name in own:
                os.replace(old / name, place / name)
            kept.close()
            raise
    return folder


def _listed(hashes: Mapping[str, Sequence[str]]) -> bytes:
    return (json.dumps({name: hashes[name] for name in sorted(hashes)}, indent=1) + "\n").encode()


def _listing(place: Path) -> dict[str, list[str]]:
    """What a folder's list says that barnax wrote, with the hashes of each file."""
    path = place / LIST
    with suppress(OSError, ValueError):
        # A pipe would wait for its other end.
        listed = json.loads(path.read_text()) if path.is_file() else None
        if isinstance(listed, dict) and all(isinstance(own, list) for own in listed.values()):
            return listed
    return {}


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """A block that one process at a time is in, where the system locks folders."""
    if fcntl is None:
        yield
        return
    lock = os.open(folder, os.O_RDONLY)
    try:
        # Some file systems lock nothing.
        with suppress(OSError):
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield
    finally:
        os.close(lock)


def free_name(place: Path) -> Path:
    """The place itself where nothing or an empty folder is, else the first free name after it."""
    return next(_free_names(place))


def _free_names(place: Path) -> Iterator[Path]:
    for number in itertools.count(1):
        free = place if number == 1 else place.with_name(f"{place.name}-{number}")
        if not os.path.lexists(free) or (free.is_dir() and not any(free.iterdir())):
            yield free


def _moved(fresh: Path, place: Path) -> Path:
    """The first free name, where the folder now is."""
    for free in _free_names(place):
        with suppress(OSError):
            # Not every system moves a folder over an empty one.
            free.rmdir()
        try:
            os.replace(fresh, free)
        except OSError:
            # Another process may have taken it since.
            if not os.path.lexists(free):
                raise
        else:
            return free
    raise AssertionError("there is always another number")


def _own_and_others(place: Path) -> tuple[set[str], set[str]]:
    """Files in a folder that barnax wrote and nobody changed since, and all others."""
    listed = _listing(place)
    paths = (path for path in place.rglob("*") if path.is_symlink() or not path.is_dir())
    there = {path.relative_to(place).as_posix(): path for path in paths}
    own = {
        name
        for name, path in there.items()
        if name in listed and not path.is_symlink() and path.is_file()
        if _hash(path.read_bytes()) in listed[name]
    }
    own |= {LIST} & there.keys() if own else set()
    return own, there.keys() - own


def _take_away(place: Path, names: Iterable[str]) -> None:
    """Delete these files, and the folders that held nothing else."""
    for name in names:
        (place / name).unlink(missing_ok=True)
        with suppress(OSError):
            for parent in PurePosixPath(name).parents[:-1]:
                (place / parent).rmdir()


def _is_in_the_way(place: Path, name: str, theirs: set[str]) -> bool:
    """True if a file there would take the place of something of the user's."""
    path = PurePosixPath(name)
    return (place / name).is_dir() or any(str(part) in theirs for part in (path, *path.parents))


def require_free_file(path: Path, is_forced: bool) -> None:
    """Raise `InputError` where a file cannot go to `path`. Called before any work is done."""
    another = "give `out` another file"
    with _described(path, another):
        place = path.resolve()
        if place.is_symlink():
            # It leads to itself, which `resolve` does not tell from Python 3.13 on.
            place.stat()
        if place.is_dir():
            raise InputError(f"{path}: is a folder; give `out` a file in it")
        if place.exists() and not stat.S_ISREG(place.stat().st_mode):
            raise InputError(f"{path}: is a device or a pipe, and no file; {another}")
        if place.exists() and not is_forced:
            raise InputError(f"{path}: exists already; replace it with `force` or {another}")
        _writable(path, place, another)


def _writable(path: Path, place: Path, another: str) -> Path:
    """The nearest folder above a place that is there. Raises `InputError` unless one can write
    to it."""
    existing = next(parent for parent in place.parents if parent.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK):
        raise InputError(f"{path}: {existing} cannot be written to; {another}")
    return existing


def write_file(path: Path, content: bytes) -> None:
    """Put `content` into the file `path`, or leave what was there."""
    place = path.resolve()
    with _described(path, "nothing was changed; give `out` another file"):
        write_whole(place, content)


def add_file(path: Path, content: bytes) -> None:
    """`write_file`; in a folder of results the file is listed as one of theirs."""
    write_file(path, content)
    if listed := _listing(path.parent):
        with suppress(InputError):
            write_file(path.parent / LIST, _listed({**listed, path.name: [_hash(content)]}))


def tell_unfinished(session: Session, folder: Path) -> None:
    """Say what killed commands left in a folder, as far as it is there."""
    session.warn(
        f"{path}: left by a command that was stopped while it wrote"
        + (", with the result that it was to replace" if (path / "old").is_dir() else "")
        + "; delete it when no command runs there"
        for path in unfinished(folder.resolve())
    )


@contextmanager
def _described(path: Path, remedy: str) -> Iterator[None]:
    """Turn what the system says into an `InputError` that names the place."""
    try:
        yield
    # Before Python 3.13 a link that leads to itself is a RuntimeError.
    except (OSError, RuntimeError) as problem:
        reason = getattr(problem, "strerror", None) or problem
        raise InputError(f"{path}: cannot be used ({reason}); {remedy}") from problem


def _write(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())

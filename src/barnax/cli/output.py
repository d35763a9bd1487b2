"""A folder of results, or a single file, written whole or not at all."""

import itertools
import os
import tempfile
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from .session import Session

if TYPE_CHECKING:
    from ..plots.sources import Illustration
    from ..reporting import Document

DEFAULT_FOLDER = Path("barnax-out")
# A folder that holds one of these was written by us.
RESULTS = ("result.json", "comparison.json")
OURS = (*RESULTS, "timings.json", "report.html", "report.md", "figures")


def require_free(folder: Path, is_forced: bool) -> None:
    """Raise `InputError` where results cannot go to `folder`. Called before any work is done."""
    another = "give --out another folder"
    try:
        place = folder.resolve()
        if place == Path.cwd() or os.path.ismount(place):
            raise InputError(
                f"{folder}: results replace their folder as a whole; give --out one in it"
            )
        existing = next(parent for parent in place.parents if parent.exists())
        if not existing.is_dir() or not os.access(existing, os.W_OK):
            raise InputError(f"{folder}: {existing} cannot be written to; {another}")
        for name in place.relative_to(existing).parts:
            # A name that no folder can have is refused now, not when the search is done.
            with suppress(FileNotFoundError):
                os.lstat(existing / name)
        names = _entries(place)
    except NotADirectoryError as problem:
        raise InputError(f"{folder}: is a file; {another}") from problem
    # Before Python 3.13 a link that leads to itself is a RuntimeError.
    except (OSError, RuntimeError) as problem:
        reason = getattr(problem, "strerror", None) or problem
        raise InputError(f"{folder}: cannot be used ({reason}); {another}") from problem
    foreign = _foreign(names)
    if foreign:
        raise InputError(f"{folder}: holds {foreign[0]!r}, which barnax did not write; {another}")
    if names and not is_forced:
        raise InputError(f"{folder}: holds a result; replace it with --force or {another}")


def _entries(folder: Path) -> list[str]:
    """The sorted names in a folder, none where it does not exist yet."""
    try:
        return sorted(os.listdir(folder))
    except FileNotFoundError:
        return []


def _foreign(names: list[str]) -> list[str]:
    """Which of a folder's names are not ours."""
    # Without a result beside it, a folder of figures is somebody else's.
    has_result = any(name in names for name in RESULTS)
    return [name for name in names if name not in OURS or not has_result]


def write_folder(
    folder: Path, files: Mapping[str, bytes], is_forced: bool, session: Session
) -> Path:
    """Put all files into `folder`, or leave what was there. Keys are paths below the folder.

    What `require_free` would refuse may have appeared there since it was asked. That stays too, and
    the files go to a new folder beside it, `folder-2` or the next one that is free: a long search
    is not lost. Gives the folder they went to; `session` warns where that is another one.
    """
    wanted = folder
    try:
        folder = folder.resolve()
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(
            prefix=".barnax-", dir=folder.parent, ignore_cleanup_errors=True
        ) as workshop:
            fresh, old = Path(workshop, "new"), Path(workshop, "old")
            for name, content in files.items():
                _write(fresh / name, content)
            if is_forced and not _is_foreign(folder):
                _put_in_place(fresh, folder, old)
                return wanted
            place = _put_beside(fresh, folder)
    except OSError as problem:
        raise InputError(
            f"{folder}: results could not be written ({problem.strerror or problem}); "
            "nothing was changed; free the place or give --out another folder"
        ) from problem
    if place == folder:
        return wanted
    session.warn(
        [f"{wanted}: something else has appeared there and stays; the results are in {place}"]
    )
    return place


def _is_foreign(place: Path) -> bool:
    """Whether something is there that not even --force replaces."""
    try:
        return bool(_foreign(_entries(place)))
    except NotADirectoryError:
        return True


def _put_beside(fresh: Path, folder: Path) -> Path:
    """Move `fresh` to `folder` or the first free name after it, over nothing but empty folders."""
    for number in itertools.count(1):
        place = folder if number == 1 else folder.with_name(f"{folder.name}-{number}")
        with suppress(OSError):
            # Not every system moves a folder over an empty one; none removes one that is not.
            place.rmdir()
        try:
            os.rename(fresh, place)
        except OSError:
            if not os.path.lexists(place):
                raise
        else:
            return place
    raise AssertionError("there is always another number")


def require_free_file(path: Path, is_forced: bool) -> None:
    """Raise `InputError` where a file cannot go to `path`. Called before any work is done."""
    another = "give --out another file"
    try:
        place = path.resolve()
        if place.is_dir():
            raise InputError(f"{path}: is a folder; give --out a file in it")
        if place.exists() and not is_forced:
            raise InputError(f"{path}: exists already; replace it with --force or {another}")
        existing = next(parent for parent in place.parents if parent.exists())
        if not existing.is_dir() or not os.access(existing, os.W_OK):
            raise InputError(f"{path}: {existing} cannot be written to; {another}")
    # Before Python 3.13 a link that leads to itself is a RuntimeError.
    except (OSError, RuntimeError) as problem:
        reason = getattr(problem, "strerror", None) or problem
        raise InputError(f"{path}: cannot be used ({reason}); {another}") from problem


def write_file(path: Path, content: bytes, is_forced: bool = True) -> None:
    """Put `content` into the file `path`, or leave what was there.

    Raises `InputError` where that fails, or where it would replace something and is not forced to.
    """
    try:
        place = path.resolve()
        place.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(
            prefix=".barnax-", dir=place.parent, ignore_cleanup_errors=True
        ) as workshop:
            fresh = Path(workshop, "new")
            _write(fresh, content)
            if is_forced:
                os.replace(fresh, place)
            else:
                _put_where_nothing_is(fresh, place)
    except FileExistsError as problem:
        raise InputError(
            f"{path}: has appeared in the meantime and is left as it is; replace it with --force "
            "or give --out another file"
        ) from problem
    except OSError as problem:
        raise InputError(
            f"{path}: could not be written ({problem.strerror or problem}); nothing was changed; "
            "free the place or give --out another file"
        ) from problem


def _put_where_nothing_is(fresh: Path, place: Path) -> None:
    """Move a file. Raises `FileExistsError` where `place` exists."""
    try:
        os.link(fresh, place)
    except FileExistsError:
        raise
    except OSError:
        # No hard links here; then another file can still appear between these two lines.
        if os.path.lexists(place):
            raise FileExistsError(place) from None
        os.replace(fresh, place)


def _write(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def _put_in_place(fresh: Path, folder: Path, old: Path) -> None:
    """Move `fresh` to `folder`; what was there goes to `old`, and back if anything stops this."""
    try:
        if folder.exists():
            os.replace(folder, old)
        os.replace(fresh, folder)
    except BaseException:
        if old.exists() and not folder.exists():
            os.replace(old, folder)
        raise


def report_files(document: "Document", drawn: "Iterable[Illustration]") -> dict[str, bytes]:
    """A report in both forms and its figures, by their path below the results folder."""
    from ..reporting import to_html, to_markdown

    files = {
        "report.html": to_html(document).encode(),
        "report.md": to_markdown(document).encode(),
    }
    for each in drawn:
        files |= {f"figures/{each.name}.png": each.png, f"figures/{each.name}.svg": each.svg}
    return files

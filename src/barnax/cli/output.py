"""A folder of results, or a single file, written whole or not at all."""

import ctypes
import os
import sys
import tempfile
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError

if TYPE_CHECKING:
    from ..plots.illustration import Illustration
    from ..reporting import Document

# Of Linux's renameat2.
AT_FDCWD, RENAME_EXCHANGE = -100, 2
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
    # Without a result beside it, a folder of figures is somebody else's.
    has_result = any(name in names for name in RESULTS)
    foreign = [name for name in names if name not in OURS or not has_result]
    if foreign:
        raise InputError(f"{folder}: holds {foreign[0]!r}, which barnax did not write; {another}")
    if names and not is_forced:
        raise InputError(f"{folder}: holds another result; replace it with --force or {another}")


def _entries(folder: Path) -> list[str]:
    """The sorted names in a folder, none where it does not exist yet."""
    try:
        return sorted(os.listdir(folder))
    except FileNotFoundError:
        return []


def write_folder(folder: Path, files: Mapping[str, bytes]) -> None:
    """Put all files into `folder`, or leave what was there. Keys are paths below the folder."""
    try:
        folder = folder.resolve()
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(
            prefix=".barnax-", dir=folder.parent, ignore_cleanup_errors=True
        ) as workshop:
            fresh, old = Path(workshop, "new"), Path(workshop, "old")
            for name, content in files.items():
                _write(fresh / name, content)
            _put_in_place(fresh, folder, old)
    except OSError as problem:
        raise InputError(
            f"{folder}: results could not be written ({problem.strerror or problem}); "
            "nothing was changed; free the place or give --out another folder"
        ) from problem


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


def write_file(path: Path, content: bytes) -> None:
    """Put `content` into the file `path`, or leave what was there."""
    try:
        place = path.resolve()
        place.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(
            prefix=".barnax-", dir=place.parent, ignore_cleanup_errors=True
        ) as workshop:
            fresh = Path(workshop, "new")
            _write(fresh, content)
            os.replace(fresh, place)
    except OSError as problem:
        raise InputError(
            f"{path}: could not be written ({problem.strerror or problem}); nothing was changed; "
            "free the place or give --out another file"
        ) from problem


def _write(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def _put_in_place(fresh: Path, folder: Path, old: Path) -> None:
    """Move `fresh` to `folder`; what was there goes to `old`, and back if anything stops this."""
    try:
        if folder.exists() and _exchange(fresh, folder):
            return
        if folder.exists():
            os.replace(folder, old)
        os.replace(fresh, folder)
    except BaseException:
        if old.exists() and not folder.exists():
            os.replace(old, folder)
        raise


def _exchange(first: Path, second: Path) -> bool:
    """Swap two folders in one step, where the system can: then no moment has neither."""
    rename = getattr(ctypes.CDLL(None), "renameat2", None) if sys.platform == "linux" else None
    if rename is None:
        return False
    places = os.fsencode(first), os.fsencode(second)
    return rename(AT_FDCWD, places[0], AT_FDCWD, places[1], RENAME_EXCHANGE) == 0


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

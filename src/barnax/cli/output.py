"""A folder of results, written whole or not at all."""

import io
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DEFAULT_FOLDER = Path("barnax-out")
OURS = ("result.json", "timings.json", "figures")


def require_free(folder: Path, is_forced: bool) -> None:
    """Raise `InputError` where results cannot go to `folder`. Called before any work is done."""
    given, folder = folder, folder.resolve()
    another = "give --out another folder"
    if folder == Path.cwd() or os.path.ismount(folder):
        raise InputError(f"{given}: results replace their folder as a whole; give --out one in it")
    existing = next(place for place in folder.parents if place.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK):
        raise InputError(f"{given}: {existing} cannot be written to; {another}")
    if not folder.exists():
        return
    if not folder.is_dir():
        raise InputError(f"{given}: is a file; {another}")
    try:
        names = sorted(entry.name for entry in folder.iterdir())
    except OSError as problem:
        raise InputError(f"{given}: cannot be listed ({problem.strerror}); {another}") from problem
    # Without a result beside it, a folder of figures is somebody else's.
    foreign = [name for name in names if name not in OURS or "result.json" not in names]
    if foreign:
        raise InputError(f"{given}: holds {foreign[0]!r}, which barnax did not write; {another}")
    if names and not is_forced:
        raise InputError(f"{given}: holds another result; replace it with --force or {another}")


def write_folder(folder: Path, files: Mapping[str, bytes]) -> None:
    """Put all files into `folder`, or leave what was there. Keys are paths below the folder."""
    folder = folder.resolve()
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(
            prefix=f".{folder.name}-", dir=folder.parent, ignore_cleanup_errors=True
        ) as workshop:
            fresh, old = Path(workshop, "new"), Path(workshop, "old")
            for name, content in files.items():
                path = fresh / name
                path.parent.mkdir(parents=True, exist_ok=True)
                with path.open("wb") as file:
                    file.write(content)
                    file.flush()
                    os.fsync(file.fileno())
            _put_in_place(fresh, folder, old)
    except OSError as problem:
        raise InputError(
            f"{folder}: results could not be written ({problem.strerror or problem}); "
            "nothing was changed; free the place or give --out another folder"
        ) from problem


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


def png_bytes(figure: "Figure") -> bytes:
    """A figure as the content of a PNG file; equal figures give equal bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=150, metadata={"Software": None})
    return buffer.getvalue()

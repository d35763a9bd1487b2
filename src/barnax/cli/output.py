"""A folder of results, written whole or not at all."""

import io
import os
import shutil
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
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; give --out another folder")
    if not folder.exists():
        parent = folder.absolute().parent
        existing = next(place for place in (parent, *parent.parents) if place.exists())
        if not existing.is_dir() or not os.access(existing, os.W_OK):
            raise InputError(
                f"{folder}: {existing} cannot be written to; give --out another folder"
            )
        return
    foreign = sorted(entry.name for entry in folder.iterdir() if entry.name not in OURS)
    if foreign:
        raise InputError(
            f"{folder}: holds {foreign[0]!r}, which barnax did not write; give --out another folder"
        )
    if any(folder.iterdir()) and not is_forced:
        raise InputError(
            f"{folder}: holds another result; replace it with --force or give --out another folder"
        )


def write_folder(folder: Path, files: Mapping[str, bytes]) -> None:
    """Put all files into `folder`, or leave what was there. Keys are paths below the folder."""
    folder = folder.absolute()
    folder.parent.mkdir(parents=True, exist_ok=True)
    fresh = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    try:
        fresh.chmod(0o755)
        for name, content in files.items():
            path = fresh / name
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
        old = None
        if folder.exists():
            old = Path(tempfile.mkdtemp(prefix=f".{folder.name}-old-", dir=folder.parent))
            os.replace(folder, old / folder.name)
        try:
            os.replace(fresh, folder)
        except OSError:
            if old is not None:
                os.replace(old / folder.name, folder)
            raise
        if old is not None:
            shutil.rmtree(old)
    except OSError as problem:
        raise InputError(
            f"{folder}: results could not be written ({problem.strerror or problem}); "
            "nothing was changed"
        ) from problem
    finally:
        shutil.rmtree(fresh, ignore_errors=True)


def png_bytes(figure: "Figure") -> bytes:
    """A figure as the content of a PNG file; equal figures give equal bytes."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=150, metadata={"Software": None})
    return buffer.getvalue()

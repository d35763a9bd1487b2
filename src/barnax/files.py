"""Files that are there whole or not at all, whoever is killed when.

A file is written beside its place under a name of its own, and put there in one step. What is left
of a killed process is `unfinished`: it is told and stays, for nobody else knows whether its process
still runs, perhaps on another machine.
"""

import os
import re
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO


def aside(folder: Path) -> Path:
    """A name in a folder that nothing else has."""
    return folder / f".barnax-{uuid.uuid4().hex}"


def unfinished(folder: Path) -> list[Path]:
    """What processes that were killed, or still write, have aside in a folder."""
    return sorted(
        path
        for path in folder.glob(".barnax-*")
        if re.fullmatch(r".barnax-[0-9a-f]{32}", path.name)
    )


@contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """A file to write that takes its place when all is written; else what was there stays."""
    written = aside(path.parent)
    try:
        with written.open("xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(written, path)
    finally:
        written.unlink(missing_ok=True)

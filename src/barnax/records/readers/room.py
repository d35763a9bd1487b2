"""Room for what a file holds, asked for before it is taken: one limit, by counting or by a trial.

A packed file of some kilobytes may hold more than any memory. What is packed is counted as it is
unpacked; what only a library can tell, it tells in a process of its own, which may die.
"""

import gzip
import io
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from copy import copy
from shutil import copyfileobj
from typing import IO
from zipfile import ZipFile, ZipInfo

from ...errors import InputError
from ..table import LARGEST_FILE

# A number as it is read and as it is kept.
NUMBER_BYTES = 16
_PIECE = 1 << 20
_LIMITED = """
import sys
content = sys.stdin.buffer.read()
try:
    import resource
    most = resource.getrlimit(resource.RLIMIT_DATA)[1]
    resource.setrlimit(resource.RLIMIT_DATA, (int(sys.argv[1]) + 2 * len(content), most))
except (ImportError, OSError, ValueError):
    pass
"""
# A library holds part of what it reads twice for a while.
_FOR_A_WHILE = 1.5
# Threads take room too, and there may be one for each of many cores.
_ALONE = {"POLARS_MAX_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def require_room(size: float, content: bytes, file: str, doubt: str = "") -> None:
    """Raise InputError where a file's content takes so many bytes, and they are too many."""
    if size > LARGEST_FILE:
        raise InputError(
            f"{file}: its {len(content):,} bytes need more than the limit of "
            f"{LARGEST_FILE / 1e9:g} GB of memory{doubt}; give a part of the record, or fewer "
            "columns, as CSV."
        )


def require_room_to_unpack(
    parts: Iterable[IO[bytes] | gzip.GzipFile], content: bytes, file: str
) -> None:
    """Raise InputError where packed files are together too large; nothing of them is kept."""
    size = 0
    for part in parts:
        while piece := part.read(_PIECE):
            size += len(piece)
            require_room(size, content, file)


def unpack(part: IO[bytes] | gzip.GzipFile, content: bytes, file: str) -> bytes:
    """A packed file that can be read twice, without a second copy while it is put together."""
    require_room_to_unpack([part], content, file)
    part.seek(0)
    whole = io.BytesIO()
    copyfileobj(part, whole, _PIECE)
    return whole.getvalue()


def require_trial(code: str, content: bytes, file: str) -> None:
    """Raise InputError where code that reads `content` takes more memory than the limit.

    What it raises, as for a damaged file, is left to be raised where the file is read in earnest.
    """
    if dies(code, content, LARGEST_FILE):
        require_room(float("inf"), content, file, ", or are damaged")


def dies(code: str, content: bytes, most_bytes: float) -> bool:
    """True if code that may read `content` dies, or takes more memory, in a process of its own."""
    room = str(int(_FOR_A_WHILE * most_bytes))
    command = [sys.executable, "-P", "-c", _LIMITED + code, room]
    done = subprocess.run(command, input=content, capture_output=True, env=os.environ | _ALONE)
    return done.returncode not in (0, 1) or b"MemoryError" in done.stderr


@contextmanager
def refusing(damaged: str, missing: str = "") -> Iterator[None]:
    """Raise `InputError` in our words where a library fails: it is missing, or the file is damaged,
    for which libraries raise errors of many kinds."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:
        words = missing if missing and isinstance(error, ImportError) else damaged
        raise InputError(words) from error


def unpacked(archive: ZipFile, files: Iterable[ZipInfo]) -> Iterator[IO[bytes]]:
    """Files of a zip archive, to be read to their ends, whatever their size is said to be."""
    for found in files:
        whole = copy(found)
        whole.file_size = 2 * LARGEST_FILE
        with archive.open(whole) as part:
            yield part

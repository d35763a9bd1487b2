"""Files that exist whole or not at all, even if a process is killed.

A file is written beside its destination under a unique name, and moved there in one step; a folder
that replaces another takes two steps, between which `restore` recovers. Leftovers of a killed
process are `unfinished`: they are reported and kept, because it is unknown whether the process
still runs, perhaps on another machine.
"""

import csv
import io
import os
import re
import signal
import threading
import uuid
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO
from urllib.parse import urlsplit
from urllib.request import url2pathname

from .errors import InputError, installing, reason_of

try:
    import fcntl
except ImportError:  # Not on Windows.
    fcntl = None

# Suffix of a factor file.
SUFFIX = ".factors.npz"


def csv_text(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Rows under their heads, separated by commas.

    >>> csv_text(("cell", "R0"), [("A1", 0.02), ("B 2, spare", None)])
    'cell,R0\\nA1,0.02\\n"B 2, spare",\\n'
    """
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([heads, *rows])
    return text.getvalue()


def is_factor_file(path: str | Path) -> bool:
    """True if a path has the suffix of factor files.

    >>> is_factor_file("fleet/factors/A1.factors.npz"), is_factor_file("A1.csv")
    (True, False)
    """
    return str(path).endswith(SUFFIX)


def is_address(path: str | Path) -> bool:
    """True if a path is in an object store, or at another address.

    >>> is_address("s3://bucket/cell.parquet"), is_address("cell.parquet")
    (True, False)
    """
    return "://" in str(path)


def located(where: str | Path) -> Any:
    """A path, or its equivalent for an address such as `s3://bucket/folder`.

    Credentials and servers are those of fsspec's own configuration. Nothing is cached about its
    content, because other machines write there too. Raises `InputError` if no package for such
    addresses is installed.
    """
    if not is_address(where):
        return Path(where)
    parts = urlsplit(str(where))
    if parts.scheme == "file":
        return Path(url2pathname(parts.path))
    try:
        from upath import UPath

        address = UPath(where, use_listings_cache=False)
        _ = address.fs
        return address
    except ImportError as problem:
        raise InputError(
            f"{where}: addresses need packages that are not installed ({reason_of(problem)}); "
            f"install them with {installing('cloud')}, or give a folder"
        ) from problem
    except ValueError as problem:
        raise InputError(f"{where}: is no address of a kind that fsspec opens") from problem


def fetched(address: str | Path, most_bytes: int, remedy: str = "") -> bytes:
    """The content of a file, or at an address. Raises `InputError`, with a remedy if there is one,
    if it cannot be read, or is longer."""
    try:
        path = located(address)
        with path.open("rb") as file:
            # A device has no size, and no end.
            is_long = isinstance(path, Path) and os.fstat(file.fileno()).st_size > most_bytes
            content = b"" if is_long else file.read(most_bytes + 1)
    except InputError:
        raise
    except Exception as problem:
        # Each store has its own kinds of errors.
        reason = None if is_address(address) else getattr(problem, "strerror", None)
        failed = f"{address}: cannot be read ({reason or reason_of(problem)})"
        raise InputError(failed + remedy) from problem
    if is_long or len(content) > most_bytes:
        raise InputError(f"{address}: is longer than {most_bytes:,} bytes, and not read{remedy}")
    return content


def changed_ns(path: Path) -> int:
    """The time at which a file was written, in ns; 0 if its store does not know."""
    if isinstance(path, Path):
        return path.stat().st_mtime_ns
    try:
        return int(path.fs.modified(path.path).timestamp() * 1e9)
    except NotImplementedError:
        return 0


def aside(folder: Path) -> Path:
    """A unique name in a folder."""
    return folder / f".barnax-{uuid.uuid4().hex}"


def unfinished(folder: Path) -> list[Path]:
    """Temporary files in a folder, from processes that were killed or are still writing."""
    paths = sorted(folder.glob(".barnax-*"))
    return [path for path in paths if re.fullmatch(r".barnax-[0-9a-f]{32}", path.name)]


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """A block for one process at a time, if the system can lock folders."""
    with ExitStack() as stack:
        # Some file systems have no locks, and not every folder can be read.
        with suppress(OSError):
            if fcntl is not None:
                lock = os.open(folder, os.O_RDONLY)
                stack.callback(os.close, lock)
                fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def restore(path: Path) -> None:
    """Move a new result to `path` if a process was killed while replacing it.

    A result that cannot be restored is missing when it is read.
    """
    with suppress(OSError, RuntimeError):
        path = path.resolve()
        while not path.parent.exists():
            path = path.parent
        for left in unfinished(path.parent):
            if (left / "old" / path.name).exists():
                # A process that is still writing finishes first.
                with locked(path.parent):
                    if not os.path.lexists(path):
                        os.replace(left / "new", path)


@contextmanager
def replacing(path: Path) -> Iterator[BinaryIO]:
    """A file to write that replaces its target when it is complete; otherwise the old content
    stays.

    A store guarantees that an object appears only once all of it has arrived.
    """
    if not isinstance(path, Path):
        content = io.BytesIO()
        yield content
        with undisturbed():
            path.fs.pipe_file(path.path, content.getvalue())
        return
    written = aside(path.parent)
    with undisturbed():
        try:
            with written.open("xb") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())
            os.replace(written, path)
        finally:
            written.unlink(missing_ok=True)


def write_whole(path: Path, content: bytes) -> None:
    """Put `content` into the file `path`, or keep its old content."""
    # A store has no folders.
    if isinstance(path, Path):
        path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as file:
        file.write(content)


@contextmanager
def undisturbed() -> Iterator[None]:
    """A block that delays Ctrl-C and SIGTERM; a process started in it never receives Ctrl-C."""
    held: list[int] = []
    before = {}
    masks = hasattr(signal, "pthread_sigmask")  # Not on Windows.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT]) if masks else None
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            # A handler that Python did not set cannot be restored.
            if signal.getsignal(number) is not None:
                # Another thread may receive a signal that this one blocks.
                before[number] = signal.signal(number, lambda number, _: held.append(number))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if mask is not None:
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for number in held:
            signal.raise_signal(number)

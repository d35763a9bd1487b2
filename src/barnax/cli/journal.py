"""What a long command has finished, kept beside its output until that is written.

A run that was interrupted, by whatever means, goes on from here to the same bits. The file is
lines of JSON, each with a check sum that its run is part of; a line that was cut off, or is another
run's, ends what is read.
"""

import base64
import errno
import hashlib
import json
import os
import platform
import zlib
from collections.abc import Callable, Iterator, MutableMapping
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import typer

from ..errors import InputError
from .session import Session

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

Arrays = tuple[np.ndarray, ...]
VERSION = 2
DTYPES = ("<f8", "<i8", "<i4", "|b1")


class Journal(MutableMapping[str, Arrays]):
    """Finished pieces by name, on the disk as they finish.

    `folder` is where the command writes its results, `run` the fingerprint of the run. What another
    run has left in the same place is never taken, and dropped when the first piece is finished.
    Until `close` no other process can open the same journal, where the system has such locks.

    Where the disk fails later on, `warn` is told once and the run goes on without a journal. Raises
    `InputError` where the place cannot be written to or another run has it.
    """

    def __init__(self, folder: Path, run: str, warn: Callable[[str], None] = print):
        self.path = journal_path(folder)
        self._run = run
        self._warn = warn
        self._done: dict[str, Arrays] = {}
        self._is_full = False
        try:
            self._file: BinaryIO | None = _open_locked(self.path)
        except BlockingIOError as problem:
            raise InputError(
                f"{folder}: another run is about to write its results there; wait until it is done "
                "or give --out another folder"
            ) from problem
        except OSError as problem:
            raise InputError(
                f"{self.path}: cannot be written to ({problem.strerror or problem}); give --out a "
                "folder elsewhere"
            ) from problem
        # As much of the file as is ours; the rest is cut off when there is something to add.
        self._length = self._recover(self._file)

    def __getitem__(self, name: str) -> Arrays:
        return self._done[name]

    def __setitem__(self, name: str, arrays: Arrays) -> None:
        try:
            self._append({"piece": name, "arrays": [_encode(array) for array in arrays]})
        except OSError as problem:
            self._warn(
                f"{self.path}: cannot be written to any more ({problem.strerror or problem}); the "
                "run goes on, but what it finishes from now on is lost if it is interrupted"
            )
            self._is_full = True
        self._done[name] = arrays

    def __delitem__(self, name: str) -> None:
        del self._done[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._done)

    def __len__(self) -> int:
        return len(self._done)

    @property
    def is_kept(self) -> bool:
        """Whether pieces of this run are on the disk."""
        return self._length > 0

    def remove(self) -> None:
        """Forget everything: the command's output is written."""
        if self._file is None:
            return
        # Open, and so locked, until it is gone, except on Windows, which cannot have that.
        if os.name == "nt":
            self._close_file()
        with suppress(FileNotFoundError):
            self.path.unlink()
        self._length = 0
        self._close_file()

    def close(self) -> None:
        """Leave what is finished to a later run, and nothing where nothing was ever finished."""
        if self._file is None:
            return
        with suppress(OSError):
            if not os.fstat(self._file.fileno()).st_size:
                self.remove()
        self._close_file()

    def _close_file(self) -> None:
        if self._file is not None:
            self._file.close()
        self._file = None

    def _append(self, entry: dict[str, Any]) -> None:
        if self._file is None or self._is_full:
            return
        lines = [] if self._length else [{"barnax journal": VERSION, "run": self._run}]
        content = b"".join(_line(each, self._run) for each in (*lines, entry))
        try:
            self._file.truncate(self._length)
            # In one piece: between two writes another process could put its own.
            if self._file.write(content) != len(content):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(self._file.fileno())
        except OSError:
            with suppress(OSError):
                self._file.truncate(self._length)
            raise
        self._length += len(content)

    def _recover(self, file: BinaryIO) -> int:
        """Read what is whole and ours; the length in bytes of that."""
        file.seek(0)
        entries = list(_whole(file.read().splitlines(keepends=True), self._run))
        if not entries or entries[0][0] != {"barnax journal": VERSION, "run": self._run}:
            return 0
        length = entries[0][1]
        for entry, size in entries[1:]:
            try:
                self._done[entry["piece"]] = tuple(_decode(each) for each in entry["arrays"])
            except (KeyError, TypeError, ValueError):
                break
            length += size
        return length if self._done else 0


def _open_locked(path: Path) -> BinaryIO:
    """The file, for this process alone. Raises `BlockingIOError` where another one has it."""
    while True:
        file = path.open("a+b", buffering=0)
        try:
            _lock(file)
            # The process that had it may have removed it in the meantime.
            with suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(file.fileno()), path.stat()):
                    return file
        except BaseException:
            file.close()
            raise
        file.close()


def _lock(file: BinaryIO) -> None:
    if fcntl is None:
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise
    except OSError:
        # Some network file systems have no locks; then check sums alone tell runs apart.
        return


def fingerprint(*facts: Any) -> str:
    """One name for everything that a run's results depend on."""
    return hashlib.sha256(json.dumps(facts, sort_keys=True, default=str).encode()).hexdigest()


def journal_path(folder: Path) -> Path:
    """Where the journal of a command that writes to `folder` lies: hidden, beside it."""
    place = folder.resolve()
    return place.parent / f".{place.name}.journal"


def _line(entry: dict[str, Any], run: str) -> bytes:
    content = json.dumps(entry).encode()
    return b"%08x %s\n" % (_check_sum(content, run), content)


def _check_sum(content: bytes, run: str) -> int:
    """Of a line and of the run that wrote it: the line of another run is none."""
    return zlib.crc32(content, zlib.crc32(run.encode()))


def _whole(lines: list[bytes], run: str) -> Iterator[tuple[dict[str, Any], int]]:
    for line in lines:
        content = line[9:-1]
        if not line.endswith(b"\n") or line[:9] != b"%08x " % _check_sum(content, run):
            return
        yield json.loads(content), len(line)


def _encode(array: np.ndarray) -> dict[str, Any]:
    array = np.ascontiguousarray(array)
    return {
        "dtype": array.dtype.str,
        "shape": list(array.shape),
        "data": base64.b64encode(array.tobytes()).decode(),
    }


def _decode(stored: dict[str, Any]) -> np.ndarray:
    if stored["dtype"] not in DTYPES:
        raise ValueError(f"an array of {stored['dtype']!r} is no part of a journal")
    content = base64.b64decode(stored["data"], validate=True)
    return np.frombuffer(content, stored["dtype"]).reshape(stored["shape"]).copy()


@contextmanager
def open_journal(session: Session, folder: Path | None, *facts: Any) -> Iterator[Journal | None]:
    """The journal of a command that writes to `folder`; none where it writes nothing.

    `facts` are what the results depend on beside barnax, the libraries it computes with and the
    kind of machine. An interruption says that the command can be resumed, where it can.
    """
    if folder is None:
        yield None
        return
    from ..result_making import all_versions

    run = fingerprint(all_versions(), platform.machine(), platform.processor(), *facts)
    folder.resolve().parent.mkdir(parents=True, exist_ok=True)
    with closing(Journal(folder, run, lambda text: session.warn([text]))) as journal:
        if journal:
            session.note(f"Going on where an interrupted run stopped ({journal.path}).")
        try:
            yield journal
        except KeyboardInterrupt:
            if journal.is_kept:
                typer.echo("the same command goes on where this one stopped", err=True)
            raise

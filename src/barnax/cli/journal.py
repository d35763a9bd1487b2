"""What a long command has finished, kept beside its output until that is written.

A run that was interrupted, by whatever means, goes on from here to the same bits. The file is
lines of JSON, each with a check sum; a line that was cut off ends what is read.
"""

import base64
import hashlib
import json
import os
import platform
import zlib
from collections.abc import Iterator, MutableMapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError

Arrays = tuple[np.ndarray, ...]
VERSION = 1
DTYPES = ("<f8", "<i8", "<i4", "|b1")


class Journal(MutableMapping[str, Arrays]):
    """Finished pieces by name; every one is on the disk before it counts as finished.

    `run` is the fingerprint of the run. What another run has left in the same place is dropped.
    Raises `InputError` where the place cannot be written to.
    """

    def __init__(self, path: Path, run: str):
        self.path = path
        self._done: dict[str, Arrays] = {}
        try:
            kept = self._recover(run)
            with path.open("ab") as file:
                file.truncate(kept)
            if not kept:
                self._append({"barnax journal": VERSION, "run": run})
        except OSError as problem:
            if not self._done:
                with suppress(OSError):
                    self.path.unlink(missing_ok=True)
            raise InputError(
                f"{path}: cannot be written to ({problem.strerror or problem}); give --out a "
                "folder elsewhere"
            ) from problem

    def __getitem__(self, name: str) -> Arrays:
        return self._done[name]

    def __setitem__(self, name: str, arrays: Arrays) -> None:
        self._append({"piece": name, "arrays": [_encode(array) for array in arrays]})
        self._done[name] = arrays

    def __delitem__(self, name: str) -> None:
        del self._done[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._done)

    def __len__(self) -> int:
        return len(self._done)

    def remove(self) -> None:
        """Forget everything: the command's output is written."""
        with suppress(FileNotFoundError):
            self.path.unlink()

    def _append(self, entry: dict[str, Any]) -> None:
        content = json.dumps(entry).encode()
        with self.path.open("ab") as file:
            file.write(b"%08x %s\n" % (zlib.crc32(content), content))
            file.flush()
            os.fsync(file.fileno())

    def _recover(self, run: str) -> int:
        """Read what is whole; the length in bytes of that."""
        try:
            lines = self.path.read_bytes().splitlines(keepends=True)
        except FileNotFoundError:
            return 0
        entries = list(_whole(lines))
        if not entries or entries[0][0] != {"barnax journal": VERSION, "run": run}:
            return 0
        length = entries[0][1]
        for entry, size in entries[1:]:
            try:
                self._done[entry["piece"]] = tuple(_decode(each) for each in entry["arrays"])
            except (KeyError, TypeError, ValueError):
                break
            length += size
        return length


def fingerprint(*facts: Any) -> str:
    """One name for everything that a run's results depend on."""
    return hashlib.sha256(json.dumps(facts, sort_keys=True, default=str).encode()).hexdigest()


def journal_path(folder: Path) -> Path:
    """Where the journal of a command that writes to `folder` lies: hidden, beside it."""
    place = folder.resolve()
    return place.parent / f".{place.name}.journal"


def _whole(lines: list[bytes]) -> Iterator[tuple[dict[str, Any], int]]:
    for line in lines:
        content = line[9:-1]
        if not line.endswith(b"\n") or line[:9] != b"%08x " % zlib.crc32(content):
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


def open_journal(folder: Path | None, *facts: Any) -> Journal | None:
    """The journal of a command that writes to `folder`; none where it writes nothing.

    `facts` are what the results depend on beside barnax, the libraries it computes with and the
    kind of machine.
    """
    if folder is None:
        return None
    from ..result import all_versions

    run = fingerprint(all_versions(), platform.machine(), platform.processor(), *facts)
    folder.resolve().parent.mkdir(parents=True, exist_ok=True)
    return Journal(journal_path(folder), run)

"""One cell of a fleet as it travels to a worker: paths and options, no data."""

import hashlib
import json
import os
import pickle
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .. import __version__

# What a row of a manifest may say of how its files are read and what is identified.
OPTIONS = (
    *("ocv_capacity", "ocv_fit", "hysteresis_fit", "model"),
    *("current_sign", "ocv_current_sign", "validate_current_sign", "current_hold", "columns"),
)


@dataclass(frozen=True, eq=False)
class FleetCell:
    """A cell, or one test of it: its files, options, and the columns copied to its row.

    `window` has fields of a `Window`, `validate_window` those that differ for validation records;
    `options` are arguments of `barnax.identify`. `cell` is the result.json whose cell model is used
    instead of OCV tests. `missing` are the files and patterns that were not found. `problem`
    replaces all files.
    """

    id: str
    records: tuple[str, ...] = ()
    ocv: tuple[str, ...] = ()
    validate: tuple[str, ...] = ()
    cell: str | None = None
    bounds: str | None = None
    window: Mapping[str, Any] = field(default_factory=dict)
    validate_window: Mapping[str, Any] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    carried: Mapping[str, Any] = field(default_factory=dict)
    missing: tuple[str, ...] = ()
    problem: Any = None

    @property
    def files(self) -> tuple[str, ...]:
        """Every file that its row depends on."""
        more = [each for each in (self.cell, self.bounds) if each]
        return (*self.records, *self.ocv, *self.validate, *more)

    def fingerprint(self, settings: Mapping[str, Any]) -> str:
        """What changes where an input or a setting does: files by path, size and time of change."""
        known = [
            *(__version__, self.id, _plain(settings), self.records, self.ocv, self.validate),
            *(self.cell, self.bounds, self.missing, [stamp(path) for path in self.files]),
            *map(_plain, (self.window, self.validate_window, self.options, self.carried)),
        ]
        content = json.dumps(known, default=str).encode()
        if self.problem is not None:
            content += pickle.dumps(self.problem)
        return hashlib.sha256(content).hexdigest()


def _plain(values: Mapping[str, Any]) -> list[tuple[str, str]]:
    return sorted((name, repr(value)) for name, value in values.items())


def stamp(path: str) -> tuple[int, int] | None:
    """Size and time of change; None for what is not here, or not in a file system."""
    if is_address(path):
        return None
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_size, found.st_mtime_ns


def is_address(path: str) -> bool:
    """Whether Polars has to fetch it from an object store.

    >>> is_address("s3://bucket/cell.parquet"), is_address("cell.parquet")
    (True, False)
    """
    return "://" in path


def short_name(path: str) -> str:
    """A file's name without folders."""
    return path.rpartition("/")[2] if is_address(path) else Path(path).name

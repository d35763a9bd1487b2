"""One file, or one data frame, as it was read: the source of records, checks and OCV tables."""

import hashlib
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self
from warnings import catch_warnings

import numpy as np
import polars as pl

from ..errors import LONGEST_NAME, InputError, cut, printable, reason_of
from ..notices import Notice
from .cell_values import settled
from .columns import NOTHING, Header, read_columns
from .logger import Logger
from .readers import read_table
from .samples import Samples
from .table import LARGEST_FILE, Table, table_sha256

# A file or its content, a `Record`, or a data frame.
Given = Any
STDIN, STDIN_NAME = Path("-"), "standard input"
# The names under which a shell passes another command's output.
_PIPES, _PIPE_NAME = (Path("/dev/fd"), Path("/proc/self/fd")), "piped file"
_LONGEST_WARNING = 200
_MAX_IN_SERIES = 1000
# Files that are common in folders of measurements, and are no candidates.
_BESIDE = (".toml", ".json")
_TEMPORARY = (".", "~$")


@dataclass(frozen=True, eq=False)
class Source:
    """One file, or one data frame, as it was read: the source of records, checks and OCV tables.

    `name` is used in messages and results; `sha256` is that of the file's bytes, or of the frame's
    names and values. A source with `span_s` is the part of a file between two times of its own
    clock. Its voltage is that of `series` cells in series. `logger` has the evidence of other
    records of its logger.
    """

    name: str
    table: Table
    sha256: str
    span_s: tuple[float, float] | None = None
    series: int = 1
    logger: Logger | None = None

    def __post_init__(self):
        if not 1 <= self.series <= _MAX_IN_SERIES:
            given = f"`series` {self.series} must be between 1 and {_MAX_IN_SERIES}"
            raise InputError(f"{given}, the number of cells in series")

    def logged_by(self, loggers: Mapping[tuple[str, ...], Logger]) -> Self:
        """The source with its logger, by the names of its columns."""
        return replace(self, logger=loggers.get(self.table.header.names))

    def cut(self, samples: Samples) -> Samples:
        """The samples of the part in `span_s`."""
        if self.span_s is None:
            return samples
        return samples.keep((samples.time_s >= self.span_s[0]) & (samples.time_s <= self.span_s[1]))


def name_of(path: Path) -> str:
    """The name of the record in a file."""
    if path == STDIN or path.parent in _PIPES:
        return STDIN_NAME if path == STDIN else _PIPE_NAME
    return printable(path.name)


def read_source(
    path: str | Path,
    *,
    columns: Mapping[str, str] | str = NOTHING,
    series: int = 1,
    content: bytes | None = None,
) -> Source:
    """The table in a file, whose format is detected from its content; "-" is the standard input.

    `columns` are names of columns that barnax does not know, and `series` the number of cells in
    series, as for `read_record`. `content` is the file's, if it has already been read. Raises
    InputError if the file cannot be read.
    """
    given = read_columns(columns)
    if not isinstance(path, str | os.PathLike):
        raise InputError(
            f"a {type(path).__name__} is no file; barnax.record_from_frame reads data frames"
        )
    path = Path(path)
    name = name_of(path)
    content = _read_content(path) if content is None else content
    # The hash of a large file takes a tenth of the time, and lets another thread work.
    with ThreadPoolExecutor(1) as beside:
        hashing = beside.submit(lambda: hashlib.sha256(content).hexdigest())
        with catch_warnings(record=True, action="always", category=UserWarning) as caught:
            table = read_table(content, name, given)
        sha256 = hashing.result()
    texts = dict.fromkeys(cut(printable(str(one.message)), _LONGEST_WARNING) for one in caught)
    notes = (*table.notes, *(Notice("format.library", {"text": text}) for text in texts))
    table = replace(table, notes=notes)
    return Source(name, _clean(table, given), sha256, series=series)


def folders_around(folder: Path) -> tuple[Path, ...]:
    """The folders in which a file of a plan or result in `folder` is looked for: its data may have
    moved with it."""
    has_name = folder.name not in ("", "..")
    return tuple(dict.fromkeys((folder, (folder if has_name else folder.resolve()).parent, Path())))


def find_file(name: str, sha256: str, folders: Sequence[Path]) -> Path | Notice:
    """The file of this name in one of the folders, with the given digest if there is one, and the
    reason if there is none."""
    paths = [folder / name for folder in folders if (folder / name).is_file()]
    if not paths:
        return Notice("file.not-found", {"folders": ", ".join(map(str, folders))}, name)
    for path in paths:
        if not sha256 or sha256 == _sha256_of(path):
            return path
    return Notice("file.not-found", subject=str(paths[0]))


def find_planned(
    file: Path, name: str, sha256: str = "", *, beside: Path
) -> tuple[Path, tuple[Notice, ...]]:
    """The path of a file that a plan in `beside` names, with a warning if its digest differs, or if
    it is elsewhere and only its name agrees because the digest is unknown."""
    named = [path for path in dict.fromkeys((beside / file, file)) if os.path.isfile(path)]
    around = [path for folder in folders_around(beside) if os.path.isfile(path := folder / name)]
    digests = {path: _sha256_of(path) for path in named or around} if sha256 else {}
    for path, digest in digests.items():
        if digest == sha256:
            return path, ()
    if named:
        changed = Notice("plan.other-file", subject=str(file))
        return named[0], (changed,) if any(digests.values()) else ()
    if around and not sha256:
        taken = printable(str(around[0].absolute()))
        return around[0], (Notice("plan.other-file", {"path": taken}, str(file)),)
    return file, ()


def _sha256_of(path: Path) -> str:
    """The digest of a file; empty if it cannot be read, which is refused when it is needed."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""


def source_from_frame(
    frame: Any, name: str, *, columns: Mapping[str, str] | str = NOTHING, series: int = 1
) -> Source:
    """The table in a data frame of pandas, Polars or another library that narwhals supports.

    A mapping of names to columns is accepted too. Rows are numbered as in a file whose first row
    has the names.
    """
    # Only data frames need it, and it takes longer to load than a file takes to read.
    import narwhals as nw

    try:
        # Integers mixed with floats are floats.
        is_mapping = isinstance(frame, Mapping)
        whole = nw.from_native(pl.DataFrame(frame, strict=False) if is_mapping else frame)
    except pl.exceptions.PolarsError as error:
        raise InputError(f"{name}: its columns make no table ({reason_of(error)})") from error
    except TypeError as error:
        kind = type(frame).__name__
        raise InputError(
            f"{name}: not a data frame, but of type {kind}; give a pandas, Polars or PyArrow frame."
        ) from error
    whole = whole.collect() if isinstance(whole, nw.LazyFrame) else whole
    cells = tuple(_series(column) for column in whole.iter_columns())
    header = Header(tuple(str(column) for column in whole.columns))
    made = Table(header, cells, np.arange(2, len(whole) + 2))
    table = _clean(made, read_columns(columns))
    return Source(printable(name), table, table_sha256(made), series=series)


def _series(column: Any) -> pl.Series:
    """A narwhals column as a Polars series."""
    if isinstance(native := column.to_native(), pl.Series):
        return native
    kind = pl.Float64 if column.dtype.is_numeric() else None
    return pl.Series(str(column.name), column.to_list(), dtype=kind, strict=False)


def _clean(table: Table, given: Mapping[str, str]) -> Table:
    """The table with names that a message can quote, and with numeric columns as numbers."""
    # A byte order mark remains if a script split the file.
    unmarked = (name.replace("\ufeff", "") for name in table.header.names)
    names = (" ".join(name.split()) if not name.isprintable() else name for name in unmarked)
    return replace(
        table,
        columns=settled(table.columns),
        header=Header(tuple(printable(cut(name, LONGEST_NAME)) for name in names), given),
        sheets=tuple((printable(cut(name, LONGEST_NAME)), rows) for name, rows in table.sheets),
    )


def _read_content(path: Path) -> bytes:
    """A file's bytes. Raises InputError if it does not exist, is too large, or cannot be read."""
    try:
        with sys.stdin.buffer if path == STDIN else path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            # A pipe or a device has no size, and a device no end.
            content = b"" if size > LARGEST_FILE else file.read(size or LARGEST_FILE + 1)
        if max(size, len(content)) <= LARGEST_FILE:
            return content
        reason = "large"
    except IsADirectoryError:
        reason = "folder"
    except FileNotFoundError:
        reason = "missing"
    except (OSError, ValueError) as error:
        reason = str(getattr(error, "strerror", None) or error)
    values = {"reason": reason, "limit_gb": LARGEST_FILE / 1e9}
    raise Notice("file.unreadable", values, str(path)).error(".")


def files_of(sources: Sequence[Any], folders: Sequence[Path] = ()) -> list[Any]:
    """The given files, with folders replaced by the files in them and their subfolders, and names
    that do not exist here by those in one of `folders`.

    Raises `InputError` for a folder without files.
    """
    files: list[Any] = []
    for source in sources:
        if isinstance(source, str | Path) and not os.path.exists(source):
            there = (folder / source for folder in folders if folder.is_dir())
            source = next((path for path in there if path.exists()), source)
        is_folder = isinstance(source, str | Path) and os.path.isdir(source)
        inside = list(_inside(Path(source))) if is_folder else [source]
        if not inside:
            name = printable(str(source))
            raise InputError(f"{name}: has no files; give the folder with the records of a cell")
        files += inside
    return files


def _inside(folder: Path) -> Iterator[Path]:
    """The files in a folder and its subfolders, except results."""
    for path in sorted(folder.iterdir()):
        if path.name.startswith(_TEMPORARY):
            continue
        if not path.is_dir():
            yield from [path] if path.suffix.lower() not in _BESIDE else []
        elif os.access(path, os.R_OK) and not (path / "result.json").exists():
            # A link may lead back.
            yield from [] if folder.resolve().is_relative_to(path.resolve()) else _inside(path)

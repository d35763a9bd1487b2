"""The dataset of a fleet: parts while it runs, one Parquet file when it ends.

A part is written under a temporary name and renamed in one step, so that it exists whole or not at
all. The final file absorbs the parts in the same way; rows in both count once. If factors were
kept, its rows can be regrouped into cells: no raw data are read again.
"""

import hashlib
import io
import os
import re
import uuid
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from numbers import Number
from pathlib import Path
from typing import Any

import polars as pl

from ..errors import InputError, listed, reason_of
from ..files import SUFFIX, changed_ns, located, replacing, write_whole
from ..records.readers.content import dies
from ..records.table import LARGEST_FILE
from .manifest import FleetCell

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

RESULTS, FACTORS = "results", "factors"
Shard = tuple[int, int]
# Rows of fleets unpack to a few times their size.
MOST_UNPACKED = 30
# Columns whose type cannot be derived from a part without any value.
TYPES = {
    "id": pl.String,
    "error": pl.String,
    "error code": pl.String,
    "warnings": pl.List(pl.String),
    "warning codes": pl.List(pl.String),
    "at bound": pl.String,
    "pack": pl.String,
    "sampling": pl.String,
    "sampling evidence": pl.String,
    "fingerprint": pl.String,
}


def _named(name: str, shard: Shard | None) -> str:
    return name if shard is None else f"{name}-{shard[0]:05d}-of-{shard[1]:05d}"


def dataset_path(out: Path, shard: Shard | None = None) -> Path:
    """The file of the whole fleet, or of one shard of it."""
    return out / f"{_named('cells', shard)}.parquet"


def parts_folder(out: Path, shard: Shard | None = None) -> Path:
    """The folder for parts until the end."""
    return out / _named("parts", shard)


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]] | pl.DataFrame) -> None:
    """The rows as a Parquet file, whole or not at all."""
    with replacing(path) as file:
        (rows if isinstance(rows, pl.DataFrame) else _framed(rows)).write_parquet(file)


def write_part(folder: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """The rows, if there are any, as a part under a unique name."""
    if rows:
        write_rows(folder / f"{uuid.uuid4().hex}.parquet", rows)


def rows_bytes(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """The rows as the content of a Parquet file."""
    file = io.BytesIO()
    _framed(rows).write_parquet(file)
    return file.getvalue()


def _framed(rows: Sequence[Mapping[str, Any]]) -> pl.DataFrame:
    names = dict.fromkeys(name for row in rows for name in row)
    return pl.DataFrame([_column(name, [row.get(name) for row in rows]) for name in names])


def _column(name: str, values: Sequence[Any]) -> pl.Series:
    """The values in one type; as text if they mix numbers, dates or other such kinds."""
    if name in TYPES:
        return pl.Series(name, values, TYPES[name])
    kinds = {
        Number if isinstance(value, Number) and not isinstance(value, bool) else type(value)
        for value in values
        if value is not None
    }
    if len(kinds) < 2:
        with suppress(pl.exceptions.PolarsError, TypeError, ValueError, OverflowError):
            types = pl.Series(name, values, strict=False)
            if types.dtype != pl.Object:
                return types
    return _text(name, values)


def _text(name: str, values: Iterable[Any]) -> pl.Series:
    return pl.Series(name, [None if value is None else str(value) for value in values], pl.String)


def _joined(frames: Sequence[pl.DataFrame]) -> pl.DataFrame:
    """All rows, one frame below the other; columns whose types differ by more than the kind of
    number become text."""
    types: dict[str, set[Any]] = {}
    for frame in frames:
        for name, dtype in frame.schema.items():
            types.setdefault(name, set()).update([dtype] if dtype != pl.Null else [])
    mixed = {
        name
        for name, dtypes in types.items()
        if len(dtypes) > 1 and not all(dtype.is_numeric() for dtype in dtypes)
    }
    alike = [
        frame.with_columns(_text(name, frame[name].to_list()) for name in mixed & {*frame.columns})
        for frame in frames
    ]
    return pl.concat(alike, how="diagonal_relaxed")


def result_path(out: Path, name: str) -> Path:
    """The file of a cell's result."""
    return out / RESULTS / name / "result.json"


def factors_path(out: Path, name: str) -> Path:
    """The file of the factors of a cell's records."""
    return out / FACTORS / f"{name}{SUFFIX}"


def keep_file(out: Path, path: Path, content: bytes) -> int:
    """Write a file beside the dataset; its length in bytes. Raises `InputError` if it would be
    outside the folder."""
    # A store has neither folders nor links.
    if isinstance(out, Path):
        for folder in reversed(path.parents[: len(path.relative_to(out).parts) - 1]):
            _require_no_link(folder)
    write_whole(path, content)
    return len(content)


def _require_no_link(folder: Path) -> None:
    if folder.is_symlink():
        raise InputError(
            f"{folder}: is a link, and a dataset is written nowhere else; delete the link, or "
            "write the dataset to another folder"
        )


def opened(path: Path) -> Path | io.BytesIO:
    """A file as Polars reads it: from a store it is fetched by fsspec, like everything else
    there."""
    return path if isinstance(path, Path) else io.BytesIO(path.read_bytes())


def read_rows(
    out: Path, columns: Iterable[str] | None = None, shard: Shard | None = None
) -> pl.DataFrame:
    """Every cell's newest row, in the order of their ids; for a shard, the rows that it wrote
    itself.

    Raises `InputError` for a broken file.
    """
    chosen = None if columns is None else [*columns]
    dated_parts = []
    for path in _files(out, shard):
        try:
            time_ns = changed_ns(path)
            dated_parts.append((time_ns, pl.read_parquet(opened(path), columns=chosen, glob=False)))
        except FileNotFoundError:
            continue
        except (OSError, pl.exceptions.PolarsError) as problem:
            raise InputError(
                f"{path}: not part of a fleet's dataset ({reason_of(problem)}); if barnax wrote "
                "it, delete it, and its cells are identified again; else give `out` another folder"
            ) from problem
    if not dated_parts:
        names = ("id", "fingerprint", "error", "error code")
        return pl.DataFrame(schema=dict.fromkeys(names, pl.String))
    # At the same time, a part is newer than a file that absorbs parts.
    dated_parts.reverse()
    dated_parts.sort(key=lambda dated: dated[0])
    rows = _joined([frame for _, frame in dated_parts])
    return rows.unique("id", keep="last", maintain_order=True).sort("id")


def rows_of_others(out: Path) -> pl.DataFrame:
    """Every cell's newest row in a folder that may come from somebody else.

    Raises `InputError` if its files unpack to far more than a fleet's do.
    """
    paths = list(_files(out, None))
    sizes = [path.stat().st_size for path in paths if path.exists()]
    code = (
        "from barnax.files import located\nfrom barnax.fleet.dataset import read_rows\n"
        f"read_rows(located({str(out)!r}))"
    )
    if dies(code, b"", max(LARGEST_FILE, MOST_UNPACKED * sum(sizes))):
        raise InputError(
            f"{out}: its {sum(sizes):,} bytes unpack to more than a fleet's dataset does; write it "
            "again with `barnax fleet`, or ask who made it"
        )
    return read_rows(out)


def _files(out: Path, shard: Shard | None) -> Iterator[Path]:
    """The files of rows in the order in which rows move between them, listed as late as possible:
    rows that another shard absorbs meanwhile are in a later file."""
    for pattern in ("parts*/*.parquet", "cells-*.parquet"):
        for path in list(out.glob(pattern)):
            is_wanted = shard is None or path.parent == parts_folder(out, shard)
            if is_wanted and _OURS.fullmatch(path.relative_to(out).as_posix()):
                yield path
    yield dataset_path(out, shard)


# Other files that a user puts beside the files of rows are neither read nor deleted.
_OURS = re.compile(r"(?:parts(?:-\d{5}-of-\d{5})?/[0-9a-f]{32}|cells-\d{5}-of-\d{5})\.parquet")


def finished(out: Path) -> dict[str, tuple[str, bool]]:
    """The fingerprint of every cell that has a row, and whether that is an error."""
    rows = read_rows(out, ("id", "fingerprint", "error"))
    prints = rows.select("id", "fingerprint", pl.col("error").is_not_null())
    return {name: (print_, has_failed) for name, print_, has_failed in prints.iter_rows()}


@contextmanager
def writing(out: Path, shard: Shard | None = None) -> Iterator[Path]:
    """The folder for parts, for this process alone.

    Raises `InputError` if it cannot be written to, or another command is writing there, which
    cannot be checked in a store without locks.
    """
    folder = parts_folder(out, shard)
    if not isinstance(folder, Path):
        try:
            folder.joinpath(".begun").write_text("")
        except Exception as problem:
            raise InputError(
                f"{out}: cannot be written to ({reason_of(problem)}); give `out` another folder, "
                "or fsspec the right server and credentials"
            ) from problem
        yield folder
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _require_no_link(folder)
        # Does not wait for the other end of a pipe.
        with open(os.open(folder / ".lock", os.O_RDWR | os.O_CREAT, 0o666), "r+") as lock:
            if fcntl is not None:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield folder
    except BlockingIOError as problem:
        raise InputError(
            f"{out}: another command is writing there; wait for it, or give `out` another folder"
        ) from problem
    except (FileExistsError, NotADirectoryError, PermissionError) as problem:
        raise InputError(
            f"{out}: cannot be written to ({problem.strerror}); give `out` another folder"
        ) from problem


def compact(out: Path, shard: Shard | None = None) -> Path:
    """Merge the parts into one file of all rows; called when nothing is being written.

    A shard absorbs only its own parts, and the whole fleet those of its shards.
    """
    target = dataset_path(out, shard)
    taken = [path for path in _files(out, shard) if path != target]
    if taken or not target.exists():
        write_rows(target, read_rows(out, shard=shard))
        for path in taken:
            path.unlink(missing_ok=True)
    return target


def regrouped(fleet: str | Path, group: Sequence[str]) -> list[FleetCell]:
    """One cell for each group of a fleet's rows with the same values in some columns.

    Args:
        fleet: The folder of a fleet identified with `keep_factors`.
        group: Columns of its dataset, such as those copied from its manifest.

    Raises `InputError` if the dataset lacks such a column, or a row's factors do not exist.
    """
    out = located(fleet)
    rows = rows_of_others(out)
    unknown = [name for name in group if name not in rows.columns]
    if unknown or not group:
        raise InputError(
            f"`group` {listed(unknown) or 'nothing'}: no column of {out}; there are "
            f"{listed(rows.columns)}"
        )
    good = rows.filter(pl.col("error").is_null())
    if "pack" in good.columns:
        # The mean cell of a pack is not one of its cells.
        good = good.filter(~pl.col("id").is_in(good["pack"].drop_nulls().unique().to_list()))
    folder = out / FACTORS
    there = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    cells: dict[str, FleetCell] = {}
    for values, members in good.group_by(group, maintain_order=True):
        outside = [name for name in members["id"] if Path(name).name != name]
        if outside:
            raise InputError(f"{out}: has a row {outside[0]!r}, which is no name of a file in it")
        paths = [factors_path(out, name) for name in members["id"]]
        gone = [path for path in paths if path.name not in there]
        if gone:
            raise InputError(
                f"{gone[0]}: is not there; identify the fleet with `keep_factors` again"
            )
        name = ", ".join(map(str, values)).replace("/", "-").replace("\\", "-")
        carried = dict(zip(group, values, strict=True))
        if name in cells:
            others = [cells[name].carried.get(column, name) for column in group]
            raise InputError(
                f"{out}: the groups {listed(map(str, others))} and {listed(map(str, values))} "
                f"would both be called {name!r}; change these values in a column of the "
                "manifest, and `group` by that"
            )
        # The name of a cell has its own column.
        carried.pop("id", None)
        cells[name] = FleetCell(name, tuple(map(str, paths)), carried=carried)
    if not cells:
        raise InputError(f"{out}: has no rows with factors; identify it with `keep_factors`")
    return [*cells.values()]


def in_shard(cell: FleetCell, shard: Shard | None) -> bool:
    """True if a cell belongs to the k-th of N shards, by its id alone."""
    if shard is None:
        return True
    number, count = shard
    return int(hashlib.sha256(cell.id.encode()).hexdigest()[:12], 16) % count == number - 1


def parse_shard(text: str) -> Shard:
    """The shard and the number of shards, from "3/10". Raises `InputError` for anything else."""
    try:
        number, count = map(int, text.split("/"))
    except ValueError:
        number = count = 0
    if not 1 <= number <= count:
        raise InputError(f"`shard` {text!r}: write part/parts, counting from 1, such as 3/10")
    return number, count

"""The dataset of a fleet: parts while it runs, one Parquet file when it ends.

A part is written aside and put in place in one step, so that it is there whole or not at all. The
final file takes in the parts the same way; what both hold counts once.
"""

import os
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import polars as pl

from ..errors import InputError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

RESULTS = "results"
Shard = tuple[int, int]
# Columns whose type a part without any value cannot show.
TYPES = {
    "id": pl.String,
    "error": pl.String,
    "warnings": pl.List(pl.String),
    "at bound": pl.String,
    "fingerprint": pl.String,
}


def _named(name: str, shard: Shard | None) -> str:
    return name if shard is None else f"{name}-{shard[0]:05d}-of-{shard[1]:05d}"


def dataset_path(out: Path, shard: Shard | None = None) -> Path:
    """The file of the whole fleet, or of one shard of it."""
    return out / f"{_named('cells', shard)}.parquet"


def parts_folder(out: Path, shard: Shard | None = None) -> Path:
    """Where the rows of batches go until the end."""
    return out / _named("parts", shard)


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]] | pl.DataFrame) -> None:
    """The rows as a Parquet file, whole or not at all."""
    aside = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    frame = rows
    if not isinstance(frame, pl.DataFrame):
        known = {name: TYPES[name] for name in TYPES if any(name in row for row in rows)}
        frame = pl.DataFrame(rows, infer_schema_length=None, strict=False, schema_overrides=known)
    try:
        with aside.open("wb") as file:
            frame.write_parquet(file)
            file.flush()
            os.fsync(file.fileno())
        os.replace(aside, path)
    finally:
        aside.unlink(missing_ok=True)


def keep_result(out: Path, name: str, text: str) -> None:
    """A cell's result.json beside the dataset."""
    folder = out / RESULTS / name
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "result.json").write_text(text, encoding="utf-8")


@contextmanager
def marking(folder: Path, batch: str) -> Iterator[Callable[[int], None]]:
    """A note of the cell of a batch that is being computed; gone when all are."""
    path = _marker(folder, batch)
    with path.open("w") as file:

        def mark(place: int) -> None:
            file.seek(0)
            file.write(f"{place}\n")
            file.flush()

        yield mark
    path.unlink(missing_ok=True)


def marked_place(folder: Path, batch: str) -> int | None:
    """Which cell of a batch a worker was at when it died, None where it had not begun."""
    path = _marker(folder, batch)
    try:
        place = int(path.read_text().split()[0])
        path.unlink()
    except (OSError, ValueError, IndexError):
        return None
    return place


def _marker(folder: Path, batch: str) -> Path:
    return folder / f".{batch}.at"


def count_rows(part: Path) -> tuple[int, int] | None:
    """How many rows a part has, and how many of them are errors; None where it is not there."""
    if not part.exists():
        return None
    errors = pl.read_parquet(part, columns=["error"], glob=False)["error"]
    return len(errors), len(errors) - errors.null_count()


def read_rows(
    out: Path, columns: Iterable[str] | None = None, shard: Shard | None = None
) -> pl.DataFrame:
    """Every cell's newest row, in the order of their ids; of a shard, those that it wrote itself.

    Raises `InputError` for a broken file.
    """
    pattern = "" if shard is None else _named("", shard)
    found = [*out.glob(f"cells{pattern or '*'}.parquet")]
    found += out.glob(f"parts{pattern or '*'}/[!.]*.parquet")
    frames = []
    for path in sorted(found, key=lambda path: path.stat().st_mtime_ns):
        try:
            chosen = None if columns is None else [*columns]
            frames.append(pl.read_parquet(path, columns=chosen, glob=False))
        except (OSError, pl.exceptions.PolarsError) as problem:
            raise InputError(
                f"{path}: not part of a fleet's dataset ({problem}); delete it, and its cells "
                "are identified again"
            ) from problem
    if not frames:
        return pl.DataFrame(schema={"id": pl.String, "fingerprint": pl.String, "error": pl.String})
    rows = pl.concat(frames, how="diagonal_relaxed")
    return rows.unique("id", keep="last", maintain_order=True).sort("id")


def finished(out: Path) -> dict[str, tuple[str, bool]]:
    """The fingerprint of every cell that has a row, and whether that is an error."""
    rows = read_rows(out, ("id", "fingerprint", "error"))
    failed = rows["error"].is_not_null()
    return {
        name: (print_, is_failed)
        for name, print_, is_failed in zip(rows["id"], rows["fingerprint"], failed, strict=True)
    }


@contextmanager
def writing(out: Path, shard: Shard | None = None) -> Iterator[Path]:
    """The folder for parts, this process's alone, without what killed workers left half-written.

    Raises `InputError` where it cannot be written to, or another command is at work there.
    """
    folder = parts_folder(out, shard)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with (folder / ".lock").open("w") as lock:
            if fcntl is not None:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            for left in folder.glob(".?*"):
                if left.name != ".lock":
                    left.unlink(missing_ok=True)
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
    """One file of all rows in place of the parts; called when nothing is being written.

    A shard takes in its own parts alone, and the whole fleet what its shards wrote.
    """
    target = dataset_path(out, shard)
    pattern = "*" if shard is None else _named("", shard)
    taken = [*out.glob(f"parts{pattern}/[!.]*.parquet")]
    taken += [path for path in out.glob(f"cells{pattern}.parquet") if path != target]
    if taken or not target.exists():
        write_rows(target, read_rows(out, shard=shard))
        for path in taken:
            path.unlink(missing_ok=True)
    return target

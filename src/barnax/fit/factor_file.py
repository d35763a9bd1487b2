"""Factor files: records stored as the factors that fits need, as NumPy's `.npz` without objects.

A file holds a JSON header, the columns in use and the rows of every factor, each a trapezoid
without the zeros below it, and the SHA-256 of these. Nothing in it is code, nothing is compressed,
and until every size in it has been checked, no more memory is used than the file's length.
"""

import hashlib
import io
import json
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from jaxtyping import Float, Int
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from ..cell.parameters import require_nodes
from ..errors import InputError, naming, printable
from ..files import fetched
from ..model.layout import Layout
from ..model.reduced import Reduced
from .record_factors import FACTS, Grid, NodeOcv, OcvSource, RecordFactors

VERSION = 2
# Limits of a file's content: enough for any record, and small enough for memory.
LARGEST_FILE = 2_000_000_000
LONGEST_HEADER, MOST_NUMBERS = 100_000_000, 250_000_000
MOST_RECORDS, MOST_COLUMNS, MOST_NODES, LONGEST_TEXT = 10_000, 4096, 1000, 1000
_MEMBERS = ("header", "columns", "rows", "sha256")
_TYPES = dict(zip(_MEMBERS, ("|u1", "<i4", "<f8", "|u1"), strict=True))

# Beyond any cell and any log: such numbers would make a fit meaningless, or overflow.
MOST_AH, MOST_OHM, MOST_S, MOST_V = 1e6, 1e6, 1e10, 1e4
# Exceptions raised when reading a file of another kind.
_BROKEN = (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError)
_Seconds = Field(ge=0, le=MOST_S, allow_inf_nan=False)
_Finite = Annotated[float, Field(allow_inf_nan=False)]
_Volts = Annotated[float, Field(ge=-MOST_V, le=MOST_V, allow_inf_nan=False)]
_Count = Field(ge=0, lt=2**53)


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class _Part(_Strict):
    """One factor: its samples, rows and columns in use."""

    scored: int = _Count
    rows: int = Field(ge=1, le=MOST_COLUMNS)
    columns: int = Field(ge=0, le=MOST_COLUMNS)

    @property
    def size(self) -> int:
        """The number of stored values: the rows without the part below the trapezoid."""
        filled = min(self.rows, self.columns)
        return filled * self.columns - filled * (filled - 1) // 2


class _Head(_Strict):
    """The header of one record."""

    name: str = Field(max_length=LONGEST_TEXT)
    low_s: _Finite
    high_s: _Finite
    skeleton: list[int] = Field(max_length=MOST_NODES)
    circuit: str = Field(max_length=LONGEST_TEXT)
    nodes: list[_Finite] = Field(min_length=1, max_length=MOST_NODES)
    ocv: OcvSource
    capacity_ah: float = Field(ge=1 / MOST_AH, le=MOST_AH, allow_inf_nan=False)
    step_ohm: float = Field(ge=0, le=MOST_OHM, allow_inf_nan=False)
    median_interval_s: float = _Seconds
    dense_interval_s: float = _Seconds
    scored_duration_s: float = _Seconds
    visited: list[bool] = Field(max_length=MOST_NODES)
    visited_ocv: list[bool] = Field(max_length=MOST_NODES)
    ocv_v: list[_Volts] = Field(max_length=MOST_NODES)
    slopes_v: list[_Volts] = Field(max_length=MOST_NODES)
    parts: tuple[_Part, _Part]


def factors_to_bytes(records: Sequence[RecordFactors]) -> bytes:
    """The content of a factor file; equal records give equal bytes."""
    heads, columns, rows = [], [np.empty(0, "<i4")], [np.empty(0)]
    for record in records:
        parts = []
        for part in record.parts:
            order, factor = _trapezoid(part.factor)
            parts.append(_Part(scored=part.scored, rows=len(part.factor), columns=len(order)))
            columns.append(order)
            rows.append(factor[np.triu_indices(len(factor), m=len(order))])
        heads.append(_head_of(record, (parts[0], parts[1])).model_dump())
    header = json.dumps({"version": VERSION, "records": heads}).encode()
    members = {
        "header": np.frombuffer(header, np.uint8),
        "columns": np.concatenate(columns).astype("<i4"),
        "rows": np.concatenate(rows).astype("<f8"),
    }
    members["sha256"] = np.frombuffer(_digest(members), np.uint8)
    file = io.BytesIO()
    np.savez(file, allow_pickle=False, **members)
    return file.getvalue()


def _head_of(record: RecordFactors, parts: tuple[_Part, _Part]) -> _Head:
    values = vars(record) | vars(record.grid) | vars(record.cell)
    values |= {"nodes": [*record.grid.nodes], "skeleton": record.grid.span.skeleton, "parts": parts}
    named = ((name, values[name]) for name in _Head.model_fields)
    return _Head(
        **{name: each.tolist() if isinstance(each, np.ndarray) else each for name, each in named}
    )


def _trapezoid(factor: Float[np.ndarray, "rows columns"]) -> tuple[Int[np.ndarray, "used"], Any]:
    """The columns in use, the shortest first, and their rows: upper trapezoidal, because pivoting
    has permuted a triangle."""
    lengths = np.array([np.max(np.flatnonzero(c), initial=-1) for c in factor.T])
    order = np.argsort(lengths, kind="stable")
    order = order[lengths[order] >= 0].astype("<i4")
    return order, factor[: len(order), order]


def _digest(members: dict[str, np.ndarray]) -> bytes:
    digest = hashlib.sha256()
    for name in _MEMBERS[:-1]:
        digest.update(np.ascontiguousarray(members[name]).data)
    return digest.digest()


def read_factors(path: str | Path) -> list[RecordFactors]:
    """The records of a factor file.

    Args:
        path: A file written by a fleet, from any source; reading it runs nothing.

    Raises `InputError` if it is not a factor file, broken, of another version or too large.
    """
    content = fetched(path, LARGEST_FILE)
    try:
        with naming(str(path)):
            return _parsed(content)
    except InputError:
        raise
    except zipfile.BadZipFile as problem:
        raise InputError(f"{path}: is no factor file; give one that a fleet kept") from problem
    except _BROKEN as problem:
        reason = str(problem).splitlines()[0] if str(problem) else type(problem).__name__
        if isinstance(problem, ValidationError):
            first = problem.errors()[0]
            field, given = ".".join(map(str, first["loc"])), repr(first["input"])[:50]
            reason = f"{field} is {given}: {first['msg']}"
        raise InputError(
            f"{path}: is no whole factor file ({printable(reason[:200])}); keep the factors anew, "
            "from the records"
        ) from problem


def _parsed(content: bytes) -> list[RecordFactors]:
    members = _members(content)
    if len(members["header"]) > LONGEST_HEADER:
        raise ValueError(f"its header is longer than {LONGEST_HEADER:,} bytes")
    header = json.loads(members["header"].tobytes())
    if (version := header.pop("version", None)) != VERSION:
        raise InputError(
            f"is of version {printable(str(version)[:20])} of factor files, and this barnax reads "
            f"version {VERSION}; keep the factors anew, from the records"
        )
    if _digest(members) != members["sha256"].tobytes():
        raise ValueError("its checksum does not match")
    records = header.get("records")
    if not isinstance(records, list) or not 0 < len(records) <= MOST_RECORDS:
        raise ValueError(f"it has no list of 1 to {MOST_RECORDS:,} records")
    heads = [_Head.model_validate_json(json.dumps(record)) for record in records]
    return list(_records(heads, members["columns"], members["rows"]))


def _members(content: bytes) -> dict[str, np.ndarray]:
    """The arrays of a file: views of its own bytes, so that no stated size is trusted."""
    members = {}
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        infos = archive.infolist()
        if [entry.filename for entry in infos] != [f"{name}.npy" for name in _MEMBERS]:
            raise ValueError("its members are others")
        for name, info in zip(_MEMBERS, infos, strict=True):
            is_stored = info.compress_type == zipfile.ZIP_STORED
            if not is_stored or info.file_size != info.compress_size:
                raise ValueError("a member is compressed")
            stream = io.BytesIO(archive.read(info))
            if np.lib.format.read_magic(stream) != (1, 0):
                raise ValueError("an array is of another version")
            shape, _, dtype = np.lib.format.read_array_header_1_0(stream)
            values = np.frombuffer(stream.getbuffer()[stream.tell() :], _TYPES[name])
            if dtype.str != _TYPES[name] or shape != (len(values),):
                raise ValueError(f"the array {name} is another")
            members[name] = values
    return members


def _records(
    heads: Sequence[_Head], columns: Int[np.ndarray, "_"], rows: Float[np.ndarray, "_"]
) -> Iterator[RecordFactors]:
    parts = [part for head in heads for part in head.parts]
    sizes = sum(part.columns for part in parts), sum(part.size for part in parts)
    if sizes != (len(columns), len(rows)) or not np.all(np.isfinite(rows)):
        raise ValueError("its sizes or numbers do not fit")
    if any(part.rows > max(part.columns, 1) for part in parts):
        raise ValueError("a factor has more rows than columns")
    by_columns = iter(np.split(columns, np.cumsum([part.columns for part in parts])))
    by_rows = iter(np.split(rows, np.cumsum([part.size for part in parts])))
    numbers = 0
    layouts: dict[Grid, Layout] = {}
    for head in heads:
        require_nodes(head.nodes)
        if not any(part.scored for part in head.parts):
            raise ValueError("scored is 0 in both parts: no sample counts")
        grid = Grid(head.low_s, head.high_s, head.circuit, tuple(head.nodes), head.ocv)
        layout = layouts[grid] = layouts.get(grid) or grid.layout
        wide, count = len(layout.ocv_nodes), len(layout.nodes)
        if layout.in_tau.skeleton.tolist() != head.skeleton:
            raise InputError(
                f"{head.name}: its factor is on another grid of time constants than this barnax "
                "makes; keep the factors anew, from the records"
            )
        lengths = [len(column) for column in (head.visited, head.visited_ocv, head.ocv_v)]
        is_short = len(head.slopes_v) != (wide - 1 if layout.has_correction else 0)
        if lengths != [count, wide, wide] or is_short or layout.width > MOST_COLUMNS:
            raise ValueError("its nodes do not fit")
        factors = []
        for part in head.parts:
            order, values = next(by_columns), next(by_rows)
            if len(np.unique(order)) != len(order) or np.any((order < 0) | (order >= layout.width)):
                raise ValueError("its columns do not fit")
            numbers += part.rows * layout.width
            if numbers > MOST_NUMBERS:
                raise ValueError(f"its factors have more than {MOST_NUMBERS:,} numbers")
            used = np.zeros((part.rows, part.columns))
            used[np.triu_indices(min(used.shape), m=part.columns)] = values
            factor = np.zeros((part.rows, layout.width))
            factor[:, order] = used
            factors.append(Reduced(layout, part.scored, factor))
        yield RecordFactors(
            **head.model_dump(include={"name", *FACTS}),
            grid=grid,
            visited=np.array(head.visited),
            visited_ocv=np.array(head.visited_ocv),
            cell=NodeOcv(np.array(head.ocv_v), np.array(head.slopes_v)),
            parts=(factors[0], factors[1]),
        )

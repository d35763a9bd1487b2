"""From a cycler's file or a data frame to a checked record."""

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import polars as pl

from ..errors import LONGEST_NAME, InputError, cut, printable
from .findings import Finding, raise_first_error, warnings_of
from .hold import decide_hold
from .readers import read_table
from .record import Decision, Hold, Record
from .rules import examine, examine_suffix
from .samples import Samples
from .sign import CHARGE, DISCHARGE, Sign, decide_sign
from .table import Table, table_sha256

_LARGEST_FILE = 2_000_000_000


@dataclass(frozen=True, eq=False)
class Source:
    """One file, or one data frame, as it was read: what records, checks and OCV tables are of.

    `name` is what messages and results call it; `sha256` is of the file's bytes, or of the
    frame's names and values.
    """

    name: str
    table: Table
    sha256: str
    findings: tuple[Finding, ...] = ()


def read_source(path: str | Path) -> Source:
    """The table in a file, told by its content. Raises InputError where it cannot be read."""
    path = Path(path)
    name = printable(path.name)
    content = _read_content(path)
    return _clean(
        Source(
            name,
            read_table(content, name),
            hashlib.sha256(content).hexdigest(),
            examine_suffix(name, content),
        )
    )


def source_from_frame(frame: Any, name: str) -> Source:
    """The table in a data frame of pandas, Polars or another library that narwhals reads.

    A mapping of names to columns will do too. Rows count as in a file whose first row holds the
    names.
    """
    # Only data frames need it, and it takes longer to load than a file to read.
    import narwhals as nw

    table = pl.DataFrame(frame) if isinstance(frame, Mapping) else frame
    try:
        whole = nw.from_native(table)
    except TypeError as error:
        raise InputError(
            f"{name}: is no data frame, but of type {type(frame).__name__}."
        ) from error
    whole = whole.collect() if isinstance(whole, nw.LazyFrame) else whole
    columns = tuple(_series(column) for column in whole.iter_columns())
    header = tuple(str(column) for column in whole.columns)
    made = Table(header, columns, np.arange(2, len(whole) + 2))
    return _clean(Source(printable(name), made, table_sha256(made)))


def _series(column: Any) -> pl.Series:
    """A narwhals column as Polars holds it."""
    if isinstance(native := column.to_native(), pl.Series):
        return native
    kind = pl.Float64 if column.dtype.is_numeric() else None
    return pl.Series(str(column.name), column.to_list(), dtype=kind, strict=False)


def _clean(source: Source) -> Source:
    """The source with names that a message can quote."""
    table = source.table
    header = (" ".join(name.split()) if not name.isprintable() else name for name in table.header)
    return replace(
        source,
        table=replace(
            table,
            header=tuple(printable(cut(name, LONGEST_NAME)) for name in header),
            sheets=tuple((printable(cut(name, LONGEST_NAME)), n) for name, n in table.sheets),
            notes=tuple(map(printable, table.notes)),
        ),
    )


def read_record(
    source: str | Path | Source,
    *,
    current_sign: Sign | Literal["auto"] = "auto",
    current_hold: Hold | Literal["auto"] = "auto",
) -> Record:
    """The record in a cycler's file, with discharge current positive.

    `current_sign` is the file's own ("charge-positive" or "discharge-positive"), `current_hold`
    says whether a sample's current flowed "forward" or "backward" in time; "auto" finds both.

    Raises InputError when the file cannot be read or its content cannot be one cell's record,
    and when the given sign contradicts strong evidence.

    >>> import pathlib, tempfile
    >>> rows = "".join(f"{k},{-(k % 2)},{3.7 - 0.05 * (k % 2)}\\n" for k in range(20))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "pulses.csv")
    ...     _ = file.write_text("Time [s],Current [mA],Voltage [V]\\n" + rows)
    ...     record = read_record(file)
    >>> record.sign.value, float(record.current_a.max())
    ('charge-positive', 0.001)
    """
    _check_option("current_sign", current_sign, ("auto", CHARGE, DISCHARGE))
    _check_option("current_hold", current_hold, ("auto", "forward", "backward"))
    if not isinstance(source, Source):
        source = read_source(source)
    examined = examine(source.table, source.name)
    raise_first_error(examined.findings, source.name)
    samples = examined.samples
    assert samples is not None  # Where there are none, that was an error.
    sign, doubts = decide_sign(samples, current_sign, source.name)
    record = make_record(source, samples, sign, decide_hold(samples, current_hold))
    return replace(record, warnings=warnings_of((*examined.findings, *doubts), source.name))


def record_from_frame(
    frame: Any,
    *,
    name: str = "data frame",
    current_sign: Sign | Literal["auto"] = "auto",
    current_hold: Hold | Literal["auto"] = "auto",
) -> Record:
    """The record in a data frame of pandas, Polars or another library that narwhals reads.

    The same names and units of columns are understood as in a file, and the same rules hold.

    >>> record = record_from_frame(
    ...     {
    ...         "Time [s]": range(20),
    ...         "Current [A]": [0.0, 1.0] * 10,
    ...         "Voltage [V]": [3.7, 3.65] * 10,
    ...     },
    ...     name="pulses",
    ... )
    >>> record.samples, record.sign.value
    (20, 'discharge-positive')
    """
    source = source_from_frame(frame, name)
    return read_record(source, current_sign=current_sign, current_hold=current_hold)


def make_record(source: Source, samples: Samples, sign: Decision, hold: Decision) -> Record:
    """The record of a source's checked samples, turned to discharge-positive."""
    return Record(
        name=source.name,
        time_s=samples.time_s,
        # Adding zero makes the -0.0 of a resting tester a plain zero.
        current_a=samples.current_a * (-1.0 if sign.value == CHARGE else 1.0) + 0.0,
        voltage_v=samples.voltage_v,
        temperature_degc=samples.temperature_degc,
        step=samples.step,
        row=samples.row,
        sign=sign,
        hold=hold,
        sha256=source.sha256,
    )


def _check_option(option: str, value: str, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise InputError(f"`{option}` is {value!r}; it must be one of {', '.join(allowed)}.")


def _read_content(path: Path) -> bytes:
    """A file's bytes. Raises InputError where it is not there, too large, or cannot be read."""
    shown = printable(str(path))
    try:
        with path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            # A pipe or a device has no size, and the latter no end.
            content = b"" if size > _LARGEST_FILE else file.read(size or _LARGEST_FILE + 1)
    except IsADirectoryError:
        raise InputError(f"{shown}: is a directory; give one file of measured samples.") from None
    except FileNotFoundError:
        raise InputError(
            f"{shown}: there is no such file; check the name and the folder."
        ) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{shown}: cannot be read ({reason}).") from error
    if max(size, len(content)) > _LARGEST_FILE:
        raise InputError(
            f"{shown}: is larger than the {_LARGEST_FILE / 1e9:g} GB that are read; give a part "
            "of the record."
        )
    return content

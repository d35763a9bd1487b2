"""From a cycler's file or a data frame to a checked record, by rules that need no cell.

Each fault is mended as far as it can be before the next rule looks, so that one fault does not
hide another.
"""

import hashlib
import os
import sys
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePath
from typing import Any, Literal, TypeVar

import numpy as np
import polars as pl

from ..errors import LONGEST_NAME, InputError, cut, printable
from .clock import examine_clock, examine_repeats, merge_repeats, separate_steps
from .column_rules import examine_columns, read_columns
from .columns import NOTHING
from .counters import skipped_ah
from .dialects import CHARGE, DISCHARGE, Sign
from .findings import Finding, named, raise_first_error, warnings_of
from .hold import decide_hold
from .quantities import NEEDED
from .readers import read_table
from .record import Decision, Hold, Record
from .samples import Samples, samples_of
from .sign import decide_sign, examine_direction
from .table import LARGEST_FILE, Table, examine_cells, table_sha256, take_lines
from .units import (
    examine_current_unit,
    examine_time_unit,
    examine_voltage_range,
    examine_voltage_unit,
)

Values = TypeVar("Values", np.ndarray, np.ndarray | None)
# A data frame of pandas, Polars, PyArrow or another library that narwhals supports.
Frame = Any

_FEWEST_SAMPLES = 5
_SHORTEST_S = 1e-6

STDIN, STDIN_NAME = Path("-"), "standard input"
# How a shell names what another command writes.
_PIPES, _PIPE_NAME = (Path("/dev/fd"), Path("/proc/self/fd")), "piped file"
_CONTENT = {
    b"PK\x03\x04": ("an OOXML workbook", (".xlsx", ".xlsm", ".ndax", ".zip")),
    b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1": ("a workbook of the kind before OOXML", (".xls",)),
    b"PAR1": ("a Parquet table", (".parquet", ".pq")),
}


@dataclass(frozen=True, eq=False)
class Examined:
    """A table's samples, and what the rules found.

    `samples` are as the file gives them, fit for a record where no finding is an error. `mended`
    are what they would be without their faults, None where too little is left to look at.
    """

    samples: Samples | None
    mended: Samples | None
    findings: tuple[Finding, ...]


def examine(source: "Source", capacity_ah: float | None = None) -> Examined:
    """The samples of a source, and what is wrong with them; `capacity_ah` lets charge be judged.

    Raises InputError where no column is like any of a record.
    """
    columns, found = examine_columns(source.table, source.name, source.columns)
    findings = named("columns", found)
    lines, found = examine_cells(take_lines(source.table, columns))
    findings += named("cells", found)
    if not columns.keys() >= NEEDED:
        return Examined(None, None, tuple(findings))
    samples = mended = samples_of(lines)
    if short := _too_short(mended):
        # Where bad cells took the samples, that is said already.
        findings += [] if any(each.severity == "error" for each in findings) else [short]
        return Examined(None, None, tuple(findings))
    # Absurd values overflow on their way to being found absurd.
    with np.errstate(all="ignore"):
        for check, rule in (
            ("clock", examine_clock),
            ("repeats", separate_steps),
            ("sign", examine_direction),
            ("voltage unit", examine_voltage_unit),
            ("voltage unit", examine_voltage_range),
            ("repeats", examine_repeats),
            ("time unit", examine_time_unit),
            ("current unit", lambda given: examine_current_unit(given, capacity_ah)),
        ):
            if check == "time unit" and source.table.has_known_units:
                continue
            mended, found = rule(mended)
            findings += named(check, found)
            if short := _too_short(mended):
                return Examined(None, None, (*findings, short))
            # What follows judges the values, and a record keeps them.
            samples = mended if rule is examine_voltage_unit else samples
        is_usable = bool(mended.intervals_s.min() > 0 and mended.peak_a > 0)
    if not any(finding.severity == "error" for finding in findings):
        samples = merge_repeats(samples)
    return Examined(samples, mended if is_usable else None, tuple(findings))


def _too_short(samples: Samples) -> Finding | None:
    """An error where too few samples are left, or too little time."""
    count = len(samples)
    what, remedy = "", "give a longer record"
    if count == 0:
        what, remedy = "no samples stand below the header", "give the file with its data"
    elif count < _FEWEST_SAMPLES:
        what = f"a record of {count} samples is too short; at least {_FEWEST_SAMPLES} are needed"
    elif samples.time_s[-1] - samples.time_s[0] < _SHORTEST_S > np.ptp(samples.time_s):
        what = f"the record lasts {np.ptp(samples.time_s):.3g} s by '{samples.header('time')}'"
        remedy = "give the column that holds the time, with its unit"
    return Finding("error", what, remedy, check="length") if what else None


def examine_suffix(file: str, content: bytes) -> tuple[Finding, ...]:
    """A note where a file's suffix promises another format than its content is."""
    suffix = PurePath(file).suffix.lower()
    known = {own for _, suffixes in _CONTENT.values() for own in suffixes}
    kind, suffixes = next(
        (own for start, own in _CONTENT.items() if content.startswith(start)), ("text", ())
    )
    if suffix in suffixes or (suffix not in known and kind == "text"):
        return ()
    what = f"the content is {kind}, although the name ends in '{suffix}'"
    remedy = "barnax goes by the content; other programs may not"
    return (Finding("note", what, remedy, check="format"),)


@dataclass(frozen=True, eq=False)
class Source:
    """One file, or one data frame, as it was read: what records, checks and OCV tables are of.

    `name` is what messages and results call it; `sha256` is of the file's bytes, or of the
    frame's names and values. `columns` are the user's own names of columns, by quantity. A source
    with `span_s` is the part of a file between two times of its own clock.
    """

    name: str
    table: Table
    sha256: str
    findings: tuple[Finding, ...] = ()
    columns: Mapping[str, str] = field(default_factory=dict)
    span_s: tuple[float, float] | None = None

    def cut(self, samples: Samples) -> Samples:
        """The samples of the part that is meant."""
        if self.span_s is None:
            return samples
        return samples.keep((samples.time_s >= self.span_s[0]) & (samples.time_s <= self.span_s[1]))


def read_source(path: str | Path, *, columns: Mapping[str, str] | str = NOTHING) -> Source:
    """The table in a file, told by its content; "-" is the standard input.

    `columns` are names of columns where barnax does not know them, as `read_record` takes them.
    Raises InputError where the file cannot be read.
    """
    given = read_columns(columns)
    if not isinstance(path, str | os.PathLike):
        raise InputError(
            f"a {type(path).__name__} is no file; barnax.record_from_frame reads data frames"
        )
    path = Path(path)
    name = printable(path.name)
    if path == STDIN or path.parent in _PIPES:
        name = STDIN_NAME if path == STDIN else _PIPE_NAME
    content = _read_content(path)
    # Of large files the hash takes a tenth of the time, and lets another thread work.
    with ThreadPoolExecutor(1) as beside:
        hashing = beside.submit(lambda: hashlib.sha256(content).hexdigest())
        table = read_table(content, name, given)
        sha256 = hashing.result()
    return _clean(Source(name, table, sha256, examine_suffix(name, content), given))


def source_from_frame(
    frame: Any, name: str, *, columns: Mapping[str, str] | str = NOTHING
) -> Source:
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
        kind = type(frame).__name__
        raise InputError(
            f"{name}: not a data frame, but of type {kind}; give a pandas, Polars or PyArrow frame."
        ) from error
    whole = whole.collect() if isinstance(whole, nw.LazyFrame) else whole
    series = tuple(_series(column) for column in whole.iter_columns())
    header = tuple(str(column) for column in whole.columns)
    made = Table(header, series, np.arange(2, len(whole) + 2))
    given = read_columns(columns)
    return _clean(Source(printable(name), made, table_sha256(made), columns=given))


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
    columns: Mapping[str, str] | str = NOTHING,
) -> Record:
    """The record in a cycler file, with discharge current positive.

    Args:
        source: The file.
        current_sign: The sign of the file's current; "auto" decides from the data.
        current_hold: A sample's current flows until the next sample ("forward") or since the
            previous one ("backward"); "auto" decides from the data.
        columns: Names of unknown columns, with their units if the names have none: `{"time":
            "Zeit:min", "current": "I2:mA"}`, or the same as text, "time=Zeit:min,current=I2:mA".

    Raises `InputError` if the file cannot be read or is not a record of one cell, and if the given
    sign contradicts strong evidence.

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
        source = read_source(source, columns=columns)
    elif columns:
        source = replace(source, columns=read_columns(columns))
    examined = examine(source)
    raise_first_error(examined.findings, source.name)
    samples = examined.samples
    assert samples is not None  # Where there are none, that was an error.
    sign, doubts = decide_sign(samples, current_sign, source.name)
    record = make_record(source, samples, sign, decide_hold(samples, current_hold))
    return replace(record, warnings=warnings_of((*examined.findings, *doubts), source.name))


def record_from_frame(
    frame: Frame,
    *,
    name: str = "data frame",
    current_sign: Sign | Literal["auto"] = "auto",
    current_hold: Hold | Literal["auto"] = "auto",
    columns: Mapping[str, str] | str = NOTHING,
) -> Record:
    """The record in a data frame of pandas, Polars or another library that narwhals supports.

    Args:
        frame: The data frame.
        name: What messages call it.
        current_sign: The sign of its current; "auto" decides from the data.
        current_hold: When a sample's current flows, as for `read_record`.
        columns: Names of columns, as for `read_record`.

    Raises `InputError` as `read_record` does.

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
    source = source_from_frame(frame, name, columns=columns)
    return read_record(source, current_sign=current_sign, current_hold=current_hold)


def make_record(source: Source, samples: Samples, sign: Decision, hold: Decision) -> Record:
    """The record of a source's checked samples, turned to discharge-positive.

    Sign and hold are those of the whole file, of which the source may be a part.
    """
    samples = source.cut(samples)
    if short := _too_short(samples):
        raise InputError(short.sentence(source.name))
    turn = -1.0 if sign.value == CHARGE else 1.0
    held_ah = samples.begun_ah if hold.value == "forward" else samples.ended_ah
    counted_ah = samples.counters.charge_ah(held_ah, samples.is_loaded)
    hidden_ah = None if counted_ah is None else skipped_ah(counted_ah, held_ah, samples.most_ah)
    return Record(
        name=source.name,
        time_s=_own(samples.time_s),
        current_a=_own(_turned(samples.current_a, turn)),
        voltage_v=_own(samples.voltage_v),
        temperature_degc=_own(samples.values.get("temperature")),
        step=_own(samples.step),
        row=_own(samples.row),
        sign=sign,
        hold=hold,
        sha256=source.sha256,
        charge_ah=_own(_turned(counted_ah, turn)),
        skipped_ah=_own(_turned(hidden_ah, turn)),
        cycle=_own(samples.values.get("cycle")),
        state=_own(samples.state),
    )


def _turned(values: Values, turn: float) -> Values:
    # Adding zero makes the -0.0 of a resting tester a plain zero.
    return values if values is None else values * turn + 0.0


def _own(values: Values) -> Values:
    """The values, no longer to be written to, which saves a record its copy."""
    if values is not None:
        values.flags.writeable = False
    return values


def _check_option(option: str, value: str, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise InputError(f"`{option}` is {value!r}; it must be one of {', '.join(allowed)}.")


def _read_content(path: Path) -> bytes:
    """A file's bytes. Raises InputError where it is not there, too large, or cannot be read."""
    shown = printable(str(path))
    try:
        with sys.stdin.buffer if path == STDIN else path.open("rb") as file:
            size = os.fstat(file.fileno()).st_size
            # A pipe or a device has no size, and the latter no end.
            content = b"" if size > LARGEST_FILE else file.read(size or LARGEST_FILE + 1)
    except IsADirectoryError:
        raise InputError(f"{shown}: this is a folder; give one file of measured samples.") from None
    except FileNotFoundError:
        words = "there is no such file; check the name and the folder."
        raise InputError(f"{shown}: {words}") from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{shown}: cannot be read ({reason}).") from error
    if max(size, len(content)) > LARGEST_FILE:
        raise InputError(
            f"{shown}: larger than the limit of {LARGEST_FILE / 1e9:g} GB; give a part "
            "of the record."
        )
    return content

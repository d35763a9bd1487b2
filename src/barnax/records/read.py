"""From a cycler's file or a data frame to a checked record, by rules that need no cell.

Each fault is repaired as far as possible before the next rule is applied, so that one fault does
not hide another. A pack has one current and many cell voltages: it gives a record of their mean,
and each cell's deviation from it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import Any, get_args

import numpy as np
import polars as pl
from jaxtyping import Float

from ..errors import InputError, listed, require_choice
from ..notices import Notice, raise_first_error
from ..settings import AutoHold, AutoSign
from . import scale
from .clock import examine_clock, examine_repeats
from .column_rules import examine_columns, examine_twins
from .columns import NOTHING, Header
from .counters import skipped_ah
from .dialects import CHARGE
from .hold import decide_hold, evidence_of
from .lag import Scan, aligned, find_scan
from .logger import Decision
from .quantities import NEEDED
from .record import Record
from .samples import Samples, samples_of
from .sign import decide_sign, examine_direction
from .silence import examine_empty_current, flowing_shares
from .source import Source, read_source, source_from_frame
from .table import FEWEST_CELLS, examine_cells, is_of_cell, take_lines

# A data frame of pandas, Polars, PyArrow or another library that narwhals supports.
Frame = Any
Examined = tuple[Samples | None, tuple[Notice, ...]]
# A gap may hide a load of this many times the largest current that was logged.
_HEAVIER = 3


def examine(source: Source, capacity_ah: float | None = None) -> Examined:
    """The samples of a source, and findings about them; with `capacity_ah`, the charge is judged
    too.

    Repairable faults are repaired. The samples are None if too few remain, and make a record if no
    finding is an error. A table is examined once for each capacity, which saves a third of the time
    for a folder.

    Raises InputError if no column resembles any of a record.
    """
    examined, given = source.table.examined, (source.series, capacity_ah)
    if given not in examined:
        examined[given] = _examined(source, capacity_ah)
    return examined[given]


def _examined(source: Source, capacity_ah: float | None) -> Examined:
    columns, findings = examine_columns(source.table, source.name)
    lines = take_lines(source.table, columns).noting(*findings)
    lines = examine_cells(examine_empty_current(lines))
    if not columns.keys() >= NEEDED:
        return None, lines.findings
    samples = mended = samples_of(lines)
    # Absurd values overflow before they are detected.
    with np.errstate(all="ignore"):
        for rule in (
            examine_clock,
            partial(scale.examine_series, series=source.series),
            examine_direction,
            scale.examine_voltage_unit,
            partial(scale.examine_scale, capacity_ah=capacity_ah),
            examine_repeats,
            # A record keeps these as they are.
            scale.examine_voltage_range,
        ):
            samples, mended = mended, rule(mended)
            if mended.too_short:
                # If invalid cells left too few samples, that has already been reported.
                is_said = any(finding.severity == "error" for finding in mended.findings)
                return None, (*mended.findings, *(() if is_said else (mended.too_short,)))
        findings = scale.ask_once(mended.findings, columns)
        findings += scale.describe_units(mended.columns)
        findings += examine_twins(source, mended)
    return samples, tuple(findings)


def read_record(
    source: str | Path | Source,
    *,
    current_sign: AutoSign = "auto",
    current_hold: AutoHold = "auto",
    voltage_lag: float | None = None,
    columns: Mapping[str, str] | str = NOTHING,
    series: int = 1,
) -> Record:
    """The record in a cycler file, with discharge current positive.

    Args:
        source: The file, or what `read_source` read of one, which has its columns and cells in
            series already.
        current_sign: The sign of the file's current; "auto" decides from the data.
        current_hold: A sample's current flows until the next sample ("forward"), since the previous
            one ("backward"), or from half an interval before it to half an interval after it
            ("centered"): for means, and loads that change between samples. "auto" decides from the
            data.
        voltage_lag: Seconds by which the voltage is older than the current of its row, which then
            is taken so much earlier; None finds it in the data.
        columns: Names of unknown columns, with their units if the names have none: `{"time":
            "Zeit:min", "current": "I2:mA"}`, or the same as text, "time=Zeit:min,current=I2:mA".
            A unit that is given here is not doubted.
        series: How many cells are in series; the voltage is divided by it.

    Raises `InputError` if the file cannot be read or is not a record of one cell, if the given sign
    contradicts strong evidence, and if `columns` or `series` is given for what was read already.

    >>> import pathlib, tempfile
    >>> rows = "".join(f"{k},{-(k % 2)},{3.7 - 0.05 * (k % 2)}\\n" for k in range(20))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "pulses.csv")
    ...     _ = file.write_text("Time [s],Current [mA],Voltage [V]\\n" + rows)
    ...     record = read_record(file)
    >>> record.sign.value, float(record.current_a.max())
    ('charge-positive', 0.001)
    """
    require_choice("current_sign", current_sign, get_args(AutoSign))
    require_choice("current_hold", current_hold, get_args(AutoHold))
    if not isinstance(source, Source):
        source = read_source(source, columns=columns, series=series)
    elif columns or series != 1:
        raise InputError(
            f"{source.name}: has been read already; give `columns` and `series` where it is read."
        )
    samples, findings = examine(source)
    raise_first_error(findings, source.name)
    assert samples is not None  # The lack of them was an error.
    sign, doubts = decide_sign(samples, current_sign, source.name)
    record = make_record(source, samples, sign, current_hold)
    findings = [finding.about(source.name) for finding in (*findings, *doubts)]
    return replace(
        aligned(record, voltage_lag),
        warnings=tuple(finding for finding in findings if finding.severity == "warning"),
        notes=tuple(finding for finding in findings if finding.is_kept),
    )


def record_from_frame(
    frame: Frame,
    *,
    name: str = "data frame",
    current_sign: AutoSign = "auto",
    current_hold: AutoHold = "auto",
    voltage_lag: float | None = None,
    columns: Mapping[str, str] | str = NOTHING,
    series: int = 1,
) -> Record:
    """The record in a data frame of pandas, Polars or another library that narwhals supports.

    Args:
        frame: The data frame.
        name: What messages call it.
        current_sign: The sign of its current; "auto" decides from the data.
        current_hold: When a sample's current flows, as for `read_record`.
        voltage_lag: How much older its voltage is than its current, as for `read_record`.
        columns: Names of columns, as for `read_record`.
        series: How many cells are in series, as for `read_record`.

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
    source = source_from_frame(frame, name, columns=columns, series=series)
    how: dict[str, Any] = {"current_sign": current_sign, "current_hold": current_hold}
    return read_record(source, **how, voltage_lag=voltage_lag)


def make_record(source: Source, samples: Samples, sign: Decision, current_hold: AutoHold) -> Record:
    """The record of a source's checked samples, with discharge current positive.

    Sign and hold are those of the whole file, of which the source may be a part.
    """
    evidence = evidence_of(samples, source.name)
    hold = decide_hold(evidence, current_hold, source.logger)
    samples = source.cut(samples)
    if samples.too_short:
        raise samples.too_short.about(source.name).error(".")

    def turned(values: np.ndarray) -> np.ndarray:
        # Adding zero turns the -0.0 of a resting tester into 0.
        return (-1.0 if sign.value == CHARGE else 1.0) * values + 0.0

    held_ah = samples.held_ah(hold.value)
    counted_ah = samples.counters.charge_ah(held_ah, samples.is_loaded)
    max_ah = _HEAVIER * samples.peak_a * samples.intervals_s / 3600
    hidden_ah = None if counted_ah is None else skipped_ah(counted_ah, held_ah, max_ah)
    # A record copies writable arrays, and nothing writes to these any more.
    for values in (samples.time_s, samples.voltage_v, samples.row):
        values.flags.writeable = False
    record = Record(
        name=source.name,
        time_s=samples.time_s,
        current_a=turned(samples.current_a),
        voltage_v=samples.voltage_v,
        temperature_degc=samples.values.get("temperature"),
        row=samples.row,
        sign=sign,
        hold=hold,
        sha256=source.sha256,
        charge_ah=None if counted_ah is None else turned(counted_ah),
        skipped_ah=None if hidden_ah is None else turned(hidden_ah),
        step=samples.step,
        cycle=samples.values.get("cycle"),
        state=samples.state,
        zero_date_s=samples.zero_date_s,
        evidence=evidence,
    )
    return record if counted_ah is not None else replace(record, flowing=flowing_shares(record))


# The column of the mean, under a name that no file has.
MEAN = "mean of the cell voltages"


@dataclass(frozen=True, eq=False)
class PackRecord:
    """A record of the mean cell voltage, and every cell's deviation from it at each sample.

    `source` is the table of the record; `left_out` has the cells whose voltages cannot be used,
    each with the reason. `scan` has the lag of every cell if they were measured one after another;
    the voltages are then shifted to the lag of the record.
    """

    source: Source
    record: Record
    cells: tuple[str, ...]
    voltage_offsets_v: Float[np.ndarray, "samples cells"]
    left_out: Mapping[str, str]
    scan: Scan | None = None


def read_pack(source: Source, cells: str | None = None, **reading: Any) -> PackRecord:
    """The pack in a table with one current and several cell voltages.

    Args:
        source: The table.
        cells: Names of the columns of cell voltages, as patterns such as "V*", with commas between
            several; None finds them: numbered alike, and within what a cell has.
        reading: How it is read, as `read_record` takes it.

    Raises `InputError` where fewer than two cells are found, or several sets of them.
    """
    table = source.table
    columns, left_out = _voltages(source, cells), {}
    for name, cell_v in columns.items():
        bad = np.flatnonzero(~np.isfinite(cell_v))
        if len(bad):
            left_out[name] = f"no number in {len(bad)} rows, the first row {table.row[bad[0]]}"
        elif not is_of_cell(cell_v):
            middle_v = np.median(cell_v) if len(cell_v) else np.nan
            left_out[name] = f"a median of {middle_v:.4g} V, which no cell has"
    used = [name for name in columns if name not in left_out]
    if len(used) < FEWEST_CELLS:
        raise InputError(
            f"{source.name}: fewer than two cells have voltages that can be used "
            f"({'; '.join(f'{name}: {why}' for name, why in left_out.items())}); name others with "
            "`cells`"
        )
    values_v = np.column_stack([columns[name] for name in used])
    mean_v = values_v.mean(axis=1)
    given = {**table.header.given, "voltage": f"{MEAN}:V"}
    header = Header((*table.header.names, MEAN), given)
    columns_of_all = (*table.columns, pl.Series(mean_v))
    of_mean = replace(source, table=replace(table, header=header, columns=columns_of_all))
    lag_s = reading.get("voltage_lag")
    how: dict[str, Any] = {**reading, "voltage_lag": 0.0}
    logged = read_record(of_mean, **how)
    lines = np.searchsorted(table.row, logged.row)
    if np.any(np.diff(table.row) <= 0) or np.any(table.row[lines] != logged.row):
        raise InputError(f"{source.name}: its rows are not in order; give one sheet of them")
    cells_v = values_v[lines]
    scan = find_scan(logged, cells_v) if lag_s is None else None
    if scan is not None:
        cells_v, lag_s = scan.aligned_v(logged, cells_v), float(np.mean(scan.lag_s))
    voltage_offsets_v = cells_v - mean_v[lines][:, None]
    return PackRecord(
        of_mean, aligned(logged, lag_s), tuple(used), voltage_offsets_v, left_out, scan
    )


def _voltages(source: Source, pattern: str | None) -> dict[str, Float[np.ndarray, "lines"]]:
    """The columns of cell voltages by name, in V."""
    header = source.table.header.names
    if pattern is not None:
        wanted = [part.strip() for part in pattern.split(",")]
        names = [name for name in header if any(fnmatchcase(name, part) for part in wanted)]
        if len(names) < FEWEST_CELLS:
            raise InputError(
                f"{source.name}: `cells` {pattern!r} fits {listed(names) or 'no column'}; there "
                f"are {listed(header)}"
            )
        return {name: source.table.in_volts(name) for name in names}
    sets = source.table.cell_voltages
    if len(sets) != 1:
        problem = "no columns of cell voltages found"
        whole = "; for the voltage of a whole pack, identify with `series`"
        if sets:
            problem, whole = f"the cell voltages may be {' or '.join(map(listed, sets))}", ""
        raise InputError(
            f"{source.name}: {problem}; name them with `cells`, such as 'V*'{whole}; its columns "
            f"are {listed(header)}"
        )
    return sets[0]

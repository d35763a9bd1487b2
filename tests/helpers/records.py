"""Records made from a formula, the bundled ones with a fault, and the files they stand in."""

import io
import zipfile

import numpy as np
import polars as pl
import pytest
from xlsxwriter import Workbook

from barnax import InputError, bundled_file, check_file, read_record
from helpers.reference import drop_v, filtered_response

PAIRS = ((0.01, 8.0), (0.02, 90.0))


def simulated_cell(current_a, interval_s=1.0, *, r0=0.05, capacity_ah=2.0, soc=0.6, pairs=PAIRS):
    """Voltage of a cell of RC pairs for a discharge-positive current, held forward."""
    passed = np.append(0.0, np.cumsum(current_a[:-1])) * interval_s / 3600 / capacity_ah
    circuit = (r0, *zip(*pairs, strict=True))
    drop = drop_v(filtered_response, interval_s, current_a, circuit)
    return 3.3 + 0.8 * (soc - passed) - drop


def pulses_a(samples=200, amplitude_a=2.0, seed=0):
    """A discharge-positive current that jumps every few samples and rests in between."""
    rng = np.random.default_rng(seed)
    levels = rng.choice([0.0, 0.5, 1.0, -0.4], size=samples // 5 + 1)
    levels[:2] = 0.0, 1.0
    return amplitude_a * np.repeat(levels, 5)[:samples]


def remarks(record):
    """All that reading a record says of it."""
    return tuple(str(each) for each in (*record.warnings, *record.notes))


def pulse_frame(samples=200, *, charge_positive=True, interval_s=1.0, seed=0):
    """A pulse record under Battery Data Format labels."""
    current, time_s = pulses_a(samples, seed=seed), np.arange(samples) * interval_s
    filed = -current if charge_positive else current
    return logged(time_s, filed, simulated_cell(current, interval_s))


def arbin_rows(frame, start=0, stop=None):
    """The frame as cells of an Arbin channel sheet, with the counters of a backward hold."""
    time, current, voltage = (frame[name].to_numpy() for name in frame.columns[:3])
    charged = np.concatenate([[0], np.cumsum(np.maximum(current[1:], 0) * np.diff(time))]) / 3600
    taken = np.concatenate([[0], np.cumsum(np.maximum(-current[1:], 0) * np.diff(time))]) / 3600
    header = [
        "Data_Point",
        "Test_Time(s)",
        "Step_Index",
        "Cycle_Index",
        "Current(A)",
        "Voltage(V)",
        "Charge_Capacity(Ah)",
        "Discharge_Capacity(Ah)",
    ]
    step = np.cumsum(np.concatenate([[1], np.diff(current) != 0]))
    columns = (np.arange(len(time)) + 1, time, step, time * 0 + 1, current, voltage, charged, taken)
    lines = [list(map(float, line)) for line in zip(*columns, strict=True)]
    return [header, *lines[start:stop]]


def workbook(sheets):
    """The bytes of a small OOXML workbook; `sheets` maps names to rows of cells."""
    content = io.BytesIO()
    with Workbook(content, {"nan_inf_to_errors": True, "strings_to_formulas": False}) as book:
        for name, rows in sheets.items():
            page = book.add_worksheet(name)
            for line, row in enumerate(rows):
                page.write_row(line, 0, row)
    return content.getvalue()


def zipped(files):
    """The bytes of a zip archive of these files."""
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return content.getvalue()


def read(folder, content, name="cell.csv", **options):
    """The record in a file of these bytes, of this text, or of a table as CSV."""
    content = content.write_csv() if isinstance(content, pl.DataFrame) else content
    (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return read_record(folder / name, **options)


def refusal(folder, content, name="cell.csv", **options):
    """The reason for which such a file is refused."""
    with pytest.raises(InputError) as caught:
        read(folder, content, name, **options)
    return str(caught.value)


def parquet(frame, **options):
    """A table as a Parquet file's bytes."""
    file = io.BytesIO()
    frame.write_parquet(file, **options)
    return file.getvalue()


def sheet(frame, name="data"):
    """A table as the bytes of a workbook of one sheet."""
    return workbook({name: [frame.columns, *map(list, frame.rows())]})


def good_files(samples=40):
    """Good files of every format that can be written here, by its reader's name."""
    table = pulse_frame(samples)
    return {
        "Parquet table": [
            *(parquet(table, compression=kind) for kind in ("zstd", "snappy", "uncompressed")),
            parquet(table, row_group_size=7, data_page_size=64, statistics=False),
            parquet(table.with_columns(pl.lit("pause").alias("Mode"), pl.lit(7).alias("Step"))),
        ],
        "spreadsheet workbook": [
            sheet(table),
            workbook({"Info": [["x"]], "Channel_1-001": arbin_rows(table)}),
        ],
        "delimited text": [
            table.write_csv().encode(),
            table.write_csv(separator=";").encode("utf-16"),
        ],
    }


TIME, CURRENT, VOLTAGE = "Test Time / s", "Current / A", "Voltage / V"
CAPACITY_AH = 2.0


def frame(name="identification"):
    """A bundled record as a table."""
    return pl.read_parquet(bundled_file(name))


def logged(time_s, current_a, voltage_v):
    """A charge-positive record as a table."""
    return pl.DataFrame({TIME: time_s, CURRENT: current_a, VOLTAGE: voltage_v})


def changed(table, column, values, rows=None):
    """The table with other values in a column, throughout or at some places (from 0)."""
    if rows is not None:
        column_values = table[column].to_numpy().copy()
        column_values[rows] = values
        values = column_values
    return table.with_columns(pl.Series(column, values, strict=False))


def scaled(table, column, factor):
    return table.with_columns(pl.col(column) * factor)


def checked(folder, table, *, name="cell.csv", **options):
    """The check of a table written to a file."""
    path = folder / name
    table.write_parquet(path) if name.endswith(".parquet") else table.write_csv(path)
    return check_file(path, **options)


def once(look):
    """A function of a source that looks at the same content under the same name only once."""
    seen = {}

    def looked(source, **how):
        settings = (source.series, source.span_s, source.logger, source.table.header, how)
        known_as = source.name, source.sha256, repr(settings)
        if known_as not in seen:
            seen[known_as] = look(source, **how)
        return seen[known_as]

    return looked


def finding(checked_file, check):
    """The only finding of a check."""
    (one,) = [each for each in checked_file.findings if each.check == check]
    return one


def counting(checked_file):
    """The checks that found more than a note, and how severe it is."""
    return {finding.check: finding.severity for finding in checked_file.findings if finding.counts}


def with_counters(table, scale=1.0):
    """The table with a tester's counters, under the forward hold of the bundled records."""
    time_h, current_a = table[TIME].to_numpy() / 3600, table[CURRENT].to_numpy()
    moved = np.concatenate([[0], current_a[:-1] * np.diff(time_h)]) * scale
    return table.with_columns(
        pl.Series("Charging Capacity / Ah", np.cumsum(np.maximum(moved, 0))),
        pl.Series("Discharging Capacity / Ah", np.cumsum(np.maximum(-moved, 0))),
    )

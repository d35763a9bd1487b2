"""What is written in a usual form comes back as it was, discharge positive."""

import hashlib
import pickle

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barnax.errors import InputError
from barnax.records import read_record, record_from_frame
from helpers.records import arbin_rows, pulse_frame, pulses_a, read, simulated_cell, workbook

LABELS = {
    "labels": ("Test Time / s", "Current / A", "Voltage / V"),
    "machine names": ("test_time_second", "current_ampere", "voltage_volt"),
    "PyBaMM": ("Time [s]", "Current [A]", "Terminal voltage [V]"),
    "Arbin": ("Test_Time(s)", "Current(A)", "Voltage(V)"),
    "new Arbin": ("Test Time (s)", "Current (A)", "Voltage (V)"),
    "BioLogic": ("time/s", "<I>/A", "Ecell/V"),
    "letters": ("t", "I", "U"),
    "shouted": ("TIME", "CURRENT", "VOLTAGE"),
    "ampworks": ("Seconds", "Amps", "Volts"),
}
TIME_UNITS = {"s": 1, "ms": 1e-3, "min": 60, "h": 3600}
CURRENT_UNITS = {"A": 1, "mA": 1e-3, "uA": 1e-6}
VOLTAGE_UNITS = {"V": 1, "mV": 1e-3}


def renamed(frame, names):
    return frame.rename(dict(zip(frame.columns, names, strict=True)))


@pytest.mark.parametrize("names", LABELS.values(), ids=LABELS)
def test_usual_column_names_are_understood(tmp_path, names):
    frame = pulse_frame()
    record = read(tmp_path, renamed(frame, names))
    np.testing.assert_allclose(record.current_a, -frame["Current / A"].to_numpy(), atol=1e-12)
    np.testing.assert_allclose(record.voltage_v, frame["Voltage / V"].to_numpy(), rtol=1e-12)


@given(
    seed=st.integers(0, 2**32 - 1),
    charge_positive=st.booleans(),
    kind=st.sampled_from(["csv", "tsv", "semicolon", "parquet"]),
    units=st.tuples(*map(st.sampled_from, (list(TIME_UNITS), list(CURRENT_UNITS), ["V", "mV"]))),
    style=st.sampled_from(["{} / {}", "{} [{}]", "{}({})", " {} ({}) "]),
)
def test_a_record_comes_back_from_any_file_unit_and_sign(
    tmp_path_factory, seed, charge_positive, kind, units, style
):
    current = pulses_a(150, seed=seed)
    step_s = np.random.default_rng(seed).uniform(0.5, 2.0, 150)
    clock, voltage = np.cumsum(step_s), simulated_cell(current)
    columns = (clock, -current if charge_positive else current, voltage)
    scales = (TIME_UNITS[units[0]], CURRENT_UNITS[units[1]], VOLTAGE_UNITS[units[2]])
    frame = pl.DataFrame(
        {
            style.format(name, unit): values / scale
            for name, unit, values, scale in zip(
                ("Time", "Current", "Voltage"), units, columns, scales, strict=True
            )
        }
    )
    path = tmp_path_factory.mktemp("round") / "cell.dat"
    separators = {"csv": ",", "tsv": "\t", "semicolon": ";"}
    if kind == "parquet":
        frame.write_parquet(path)
    else:
        frame.write_csv(path, separator=separators[kind])
    record = read_record(path)
    np.testing.assert_allclose(record.time_s, clock, rtol=1e-12)
    np.testing.assert_allclose(record.current_a, current, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(record.voltage_v, voltage, rtol=1e-12)
    assert (record.sign.value == "charge-positive") == charge_positive
    assert list(record.row) == list(range(2, 152))


def test_temperature_and_step_are_read_where_they_are(tmp_path):
    frame = pulse_frame(30).with_columns(
        pl.lit(298.15).alias("Temperature [K]"),
        pl.Series("Step Index / 1", np.arange(30) // 5),
        pl.lit("cell A").alias("Remark"),
    )
    record = read(tmp_path, frame)
    np.testing.assert_allclose(record.temperature_degc, 25.0, rtol=1e-12)
    np.testing.assert_array_equal(record.step, np.arange(30) // 5)


def test_the_surface_is_preferred_to_the_ambient_temperature(tmp_path):
    frame = pulse_frame(30).with_columns(
        pl.lit(20.0).alias("Ambient Temperature / degC"),
        pl.lit(31.0).alias("Surface Temperature / degC"),
    )
    assert np.all(read(tmp_path, frame).temperature_degc == 31.0)


def test_the_test_time_is_preferred_to_the_step_time(tmp_path):
    frame = pulse_frame(40)
    frame.insert_column(0, pl.Series("StepTime(s)", np.arange(40) % 5))
    frame.insert_column(0, pl.Series("Step_Time(s)", np.arange(40) % 5))
    names = ("StepTime(s)", "Step_Time(s)", "Time(s)", "Current(A)", "Voltage(V)")
    assert read(tmp_path, renamed(frame, names)).time_s[-1] == 39


CSV = pulse_frame(30).write_csv()
NAMES, *LINES = CSV.splitlines()
SPARSE = "\n".join([NAMES, *LINES[:10], "", ",,", *LINES[10:], "", ""])
PADDED = "".join(f"No, {line.replace(',', ', 1, 1, ', 1)},\r\n" for line in LINES)
ABOVE = "Tester: 7, channel 3\nStarted: 2024-01-01; by hand\n\n"
CELLS = [line.split(",") for line in LINES]
IN_BLANKS = "".join(f"{a:>14}{b:>12}{c:>24}\n" for a, b, c in CELLS)
# A text, the rows of its first, its eleventh and its last sample.
TEXTS = {
    "blanks, names twice and commas at the end": (
        "Exclude,Time(s),Loop,Loop, Current(A),Voltage(V),\r\n" + PADDED,
        (2, 12, 31),
    ),
    "blank lines": (SPARSE, (2, 14, 33)),
    "blank lines above": ("\n\n" + CSV, (4, 14, 33)),
    "blank lines below the names": (CSV.replace("\n", "\n\n\n", 1), (4, 14, 33)),
    "units below blank lines": (
        "time,current,voltage\n\n(s),(A),(V)\n" + "\n".join(LINES),
        (4, 14, 33),
    ),
    "columns of blanks": (f"  {NAMES.replace(',', '   ')}\n{IN_BLANKS}", (2, 12, 31)),
    "names with a mark of comments": ("# " + CSV, (2, 12, 31)),
    "zero bytes at the end": (CSV + 1_000_000 * "\0", (2, 12, 31)),
    "a zero byte in a name": (CSV.replace("rrent", "rr\0ent", 1), (2, 12, 31)),
    "a typographic minus": (CSV.replace("-", "\u2212"), (2, 12, 31)),
    "old line ends": (CSV.replace("\n", "\r"), (2, 12, 31)),
    "decimal commas": (CSV.replace(",", ";").replace(".", ","), (2, 12, 31)),
    **{
        f"rows above the names of {name}": (ABOVE + CSV.replace(",", delimiter), (5, 15, 34))
        for name, delimiter in {"commas": ",", "semicolons": ";", "tabs": "\t"}.items()
    },
    **{
        f"names end in {names!r}, cells in {cells!r}": (
            "\n".join([NAMES + names, *(line + cells for line in LINES)]),
            (2, 12, 31),
        )
        for names in ("", ",")
        for cells in ("", ",", ",note")
    },
}


@pytest.mark.parametrize("text", TEXTS)
def test_usual_texts_are_understood_and_their_rows_counted(tmp_path, text):
    content, rows = TEXTS[text]
    record = read(tmp_path, content)
    np.testing.assert_array_equal(record.voltage_v, pulse_frame(30)["Voltage / V"].to_numpy())
    assert tuple(record.row[[0, 10, -1]]) == rows


# Two spellings of 1250.5 mA, or of 1250, and the voltage beside them.
GROUPED = {
    "commas, by a point": ("1,250.5", "1,250.5", "3.7"),
    "commas, by another column": ("1,250", "1,250", "3.7"),
    "points": ("1.250,5", "1.250,5", "3,7"),
    "blanks": ("1 250,5", "1\u00a0250,5", "3,7"),
    "apostrophes": ("1'250.5", "1\u2019250.5", "3.7"),
}


@pytest.mark.parametrize("mark", GROUPED)
def test_thousands_are_told_from_decimals(tmp_path, mark):
    one, other, voltage = GROUPED[mark]
    rows = [f"{k};{(one, other)[k % 2]};{voltage}" for k in range(20)]
    record = read(tmp_path, "\n".join(["Time / s;Current / mA;Voltage / V", *rows]))
    current_a = 1.25 if one == "1,250" else 1.2505
    np.testing.assert_allclose(np.abs(record.current_a), current_a)
    np.testing.assert_allclose(record.voltage_v, 3.7)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_usual_encodings_are_understood(tmp_path, encoding):
    frame = pulse_frame(30).with_columns(pl.lit(25.0).alias("Temperature [°C]"))
    assert np.all(read(tmp_path, frame.write_csv().encode(encoding)).temperature_degc == 25.0)


def test_the_content_and_not_the_suffix_says_what_a_file_is(tmp_path):
    pulse_frame().write_parquet(tmp_path / "cell.csv")
    (tmp_path / "cell.parquet").write_bytes(workbook({"Channel_1-001": arbin_rows(pulse_frame())}))
    pulse_frame().write_csv(tmp_path / "cell.xlsx")
    voltages = [read_record(path).voltage_v for path in sorted(tmp_path.iterdir())]
    for voltage in voltages:
        np.testing.assert_allclose(voltage, voltages[0], rtol=1e-12)


def test_channel_sheets_are_joined_by_their_clock_and_others_named(tmp_path):
    rows = arbin_rows(pulse_frame())
    sheets = {
        "Info": [["TEST REPORT"]],
        "Channel_1-001_2": [rows[0], *rows[101:]],
        "Channel_1-001": rows[:101],
        "Sheet1": [["Test_Time(s)", "Current", "Voltage"], [0.0, 1.0, 3.0]],
        "Channel_Chart": [],
    }
    record = read(tmp_path, workbook(sheets), "cell.xls")
    np.testing.assert_array_equal(record.time_s, np.arange(200))
    assert list(record.row[[0, 99, 100, 199]]) == [2, 101, 2, 101]
    assert [*map(str, record.notes)] == ["cell.xls: ignored the sheets Info, Sheet1, Channel_Chart"]
    assert record.hold.value == "backward"


def test_a_plain_workbook_is_read_from_its_only_fitting_sheet(tmp_path):
    frame = pulse_frame(30)
    sheets = {"notes": [["hello"]], "data": [frame.columns, *map(list, frame.rows())]}
    assert read(tmp_path, workbook(sheets), "cell.xlsx").samples == 30


def test_the_hash_is_of_the_file_as_it_stands(tmp_path):
    path = tmp_path / "cell.csv"
    pulse_frame().write_csv(path)
    record = read_record(str(path))
    assert record.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert record.name == "cell.csv"


def test_currents_of_either_direction_are_to_be_joined():
    table = {
        "Time [s]": range(9),
        "Charge Current [A]": [1.0] * 9,
        "Discharge Current [A]": [0.0] * 9,
    }
    with pytest.raises(InputError, match="write their difference, charge positive"):
        record_from_frame({**table, "Voltage [V]": [3.7] * 9})


def test_a_pickled_record_is_its_fields_and_cannot_be_written_to(tmp_path):
    record = read(tmp_path, pulse_frame())
    alone = pickle.dumps(record)
    assert record.segments(0.02).rests
    assert record.span_ah > 0
    assert pickle.dumps(record) == alone
    again = pickle.loads(alone)
    np.testing.assert_array_equal(again.voltage_v, record.voltage_v)
    assert (again.name, again.warnings, again.hold) == (record.name, record.warnings, record.hold)
    with pytest.raises(ValueError, match="read-only"):
        again.voltage_v[0] = 0.0

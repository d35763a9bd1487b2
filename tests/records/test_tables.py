"""Tables as testers, loggers and hands leave them: the record that was written, or the reason why
they are refused."""

import hashlib
import io
import pickle
import warnings

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barnax import InputError, check_file, record_from_frame
from helpers.records import (
    CURRENT,
    TIME,
    VOLTAGE,
    arbin_rows,
    changed,
    checked,
    parquet,
    pulse_frame,
    pulses_a,
    read,
    refusal,
    remarks,
    sheet,
    simulated_cell,
    workbook,
)

FRAME = pulse_frame(200).with_columns(pl.col(VOLTAGE).round(4))
TIMES, AMPS, VOLTS = (FRAME[name].to_numpy() for name in (TIME, CURRENT, VOLTAGE))
CSV = FRAME.write_csv()
NAMES, *LINES = CSV.splitlines()


def require_the_record(record, rows=slice(None)):
    np.testing.assert_array_equal(record.time_s, TIMES[rows])
    np.testing.assert_allclose(record.current_a, -AMPS[rows], atol=1e-12)
    np.testing.assert_allclose(record.voltage_v, VOLTS[rows], atol=1e-12)


def quoted(end):
    lines = ["[Summary]", "Cell: 7", "[Data]", CSV.replace(CURRENT, f'""{CURRENT}""', 1)]
    return "".join(f'"{line}"{end}' for line in "\n".join(lines).splitlines())


def nested(cycle):
    names = [cycle, ",Step ID,Step Name", ",,Record ID,Time(s),Current(A),Voltage(V)"]
    rows = [f",,{k},{row}" for k, row in enumerate(LINES, 1)]
    return "\n".join([*names, "1,0,100", ",1,Rest", *rows]) + "\n"


def savemat(tree):
    content = io.BytesIO()
    pytest.importorskip("scipy.io").savemat(content, tree)
    return content.getvalue()


PADDED = "".join(f"No, {line.replace(',', ', 1, 1, ', 1)},\r\n" for line in LINES)
IN_BLANKS = "".join("{:>14}{:>12}{:>24}\n".format(*line.split(",")) for line in LINES)
VARIABLES = {"t": TIMES, "I": AMPS, "V": VOLTS}
GIVEN = FRAME.rename({TIME: "Stempel", CURRENT: "Kanal 2, gemessen", VOLTAGE: "Uzelle"})
GIVEN = GIVEN.with_columns(SoC=pl.lit(0.5), OCV=pl.col("Uzelle") + 0.1)
COLUMNS = "time=Stempel:s,current=Kanal 2, gemessen,voltage=Uzelle"
STATE = FRAME.with_columns(
    pl.col(CURRENT).abs(), Zustand=np.select([AMPS > 0, AMPS < 0], ["Laden", "Entladen"], "Ruhe")
)
IMPEDANCE = FRAME.with_columns(**{"Frequency [Hz]": pl.lit(1e3), "Impedance [mOhm]": pl.lit(20.0)})
NOTHING_AT_REST = {
    filled: FRAME.with_columns(**{name: pl.lit(filled) for name in ("Freq", "Re", "-Im")})
    for filled in (None, 0.0)
}
COUNTED = FRAME.with_columns(pl.Series("Record", np.arange(7, 207)))
SHUFFLED = {"fraction": 1, "shuffle": True, "seed": 1}
LATE = changed(FRAME, TIME, [59 - 0.0015], [60])


def written(content, says="", **options):
    return content, says, options


# A table, what is said of it, and the options with which it is read.
SAME = {
    "blanks, names twice and commas at the end": written(
        "Exclude,Time(s),Loop,Loop, Current(A),Voltage(V),\r\n" + PADDED),

    "columns of blanks": written(f"  {NAMES.replace(',', '   ')}\n{IN_BLANKS}"),
    "names with a mark of comments": written("# " + CSV),
    "zero bytes at the end": written(CSV + 1_000_000 * "\0"),
    "a zero byte in a name": written(CSV.replace("rrent", "rr\0ent", 1)),
    "a zero before each line end": written(CSV.replace("\n", "\0\n")),
    "zeros between lines": written(CSV.replace("\n99.0", f"\n{512 * chr(0)}\n99.0")),
    "a typographic minus": written(CSV.replace("-", "\u2212")),
    "lines that end in CR": written(CSV.replace("\n", "\r")),
    "CR, the last CR LF": written(CSV[:-1].replace("\n", "\r") + "\r\n"),
    "CR below a line with CR LF": written("Logger 5\r\n" + CSV.replace("\n", "\r")),
    "CR CR LF": written(CSV.replace("\n", "\r\r\n")),
    "two marks of the order of bytes": written(2 * "\ufeff" + CSV),
    "a mark in a workbook": written(sheet(FRAME.rename({TIME: f"\ufeff{TIME}"}))),
    "UTF-16": written(CSV.encode("utf-16")),
    "decimal commas": written(CSV.replace(",", ";").replace(".", ",")),
    "text columns of a data frame": written(
        parquet(FRAME.select(pl.all().cast(pl.String).str.replace(".", ",", literal=True)))),
    "lines quoted whole": written(quoted("\n"), "ignored the rows above"),
    "lines quoted whole, and semicolons": written(quoted(";;\r\n"), "ignored the rows above"),
    **{f"{end!r} behind the cells": written(CSV.replace("\n", f"{end}\n"))
       for end in (",", ",ok", ",25.0", ",25")},
    **{f"{end!r} behind numbers": written("\n".join([NAMES, *(line + end for line in LINES)]))
       for end in (",", ",note", ",25.0", ",25")},
    "an index of pandas": written("," + CSV.replace("\n", "\n1,").removesuffix("1,")),
    "a line on an impedance above the names": written(
        "Cell,A1\nImpedance [mOhm],0.52,Frequency [Hz],1000\n" + CSV),
    "an impedance at one frequency": written(IMPEDANCE),
    "an impedance, and a voltage of another name": written(
        IMPEDANCE.rename({VOLTAGE: "Zelle"}), columns="voltage=Zelle:V"),
    "columns of an impedance, empty": written(NOTHING_AT_REST[None]),
    "columns of an impedance, zero": written(NOTHING_AT_REST[0.0]),
    "a count of samples as a step": written(FRAME.with_columns(pl.Series("step", np.arange(200)))),
    "thousandths of a cycle": written(FRAME.with_columns(cycle=pl.Series(np.arange(200) / 1e3))),
    "a nested report": written(nested("Cycle ID,Cap_Chg(mAh),Cap_DChg(mAh)")),
    "another nested report": written(nested("Cycle-Index,CapC(mAh),CapD(mAh)")),
    "names that are given": written(GIVEN, columns=COLUMNS),
    "names that are given, below a line": written(
        f"Pruefstand 7\n\n{GIVEN.write_csv()}", columns=COLUMNS),
    "names that are given for a workbook": written(sheet(GIVEN), columns=COLUMNS),
    "names that are given, and units below": written(
        GIVEN.write_csv().replace("\n", "\ns,A,V,-,V\n", 1), columns=COLUMNS.replace(":s", "")),
    "a state that is given": written(STATE, columns="state=Zustand"),
    "codes of a state": written(
        FRAME.with_columns(State=pl.Series(np.sign(AMPS).astype(int) % 3)),
        "the numbers under 'State' are codes without words"),
    "variables of a script": written(pl.DataFrame({f"{k}Data": v for k, v in VARIABLES.items()})),
    "variables of MATLAB": written(savemat({f"{k}_vec": v for k, v in VARIABLES.items()})),
    "a structure of MATLAB": written(
        savemat({"data": {f"{k}_data": v for k, v in VARIABLES.items()}})
    ),
    "vectors of unknown names": written(
        savemat({"x1": TIMES, "x2": AMPS, "x3": VOLTS}),
        columns="time=x1:s,current=x2:A,voltage=x3:V",
    ),
    "a slip of a millisecond": written(LATE, "row 62: time falls by 1.5 ms (1 place)"),
    "rows out of order that are counted": written(
        COUNTED.sample(**SHUFFLED), "they are sorted by 'Record'"),
    "the newest row first": written(FRAME.reverse(), "the newest row comes first"),
}  # fmt: skip


@pytest.mark.parametrize("name", SAME)
def test_a_table_is_read_as_it_was_written(tmp_path, name):
    content, says, options = SAME[name]
    require_the_record(read(tmp_path, content, **options))
    findings = check_file(tmp_path / "cell.csv", columns=options.get("columns", "")).findings
    assert says in " ".join(map(str, findings))
    assert "SOC" not in " ".join(map(str, findings)) or "columns" not in options


# A text, and the rows of its first and its last sample.
ABOVE = "Tester: 7, channel 3\nStarted: 2024-01-01; by hand\n\n"
ROWS = {
    "blank lines above": ("\n\n" + CSV, (4, 203)),
    "blank lines below the names": (CSV.replace("\n", "\n\n\n", 1), (4, 203)),
    "units below blank lines": (
        "time,current,voltage\n\n(s),(A),(V)\n" + "\n".join(LINES),
        (4, 203),
    ),
    "blank lines between": ("\n".join([NAMES, *LINES[:10], "", ",,", *LINES[10:]]), (2, 203)),
    **{
        f"rows above names with {mark!r}": (ABOVE + CSV.replace(",", mark), (5, 204))
        for mark in ",;\t"
    },
}


@pytest.mark.parametrize("name", ROWS)
def test_rows_are_counted_as_they_stand(tmp_path, name):
    text, rows = ROWS[name]
    record = read(tmp_path, text)
    require_the_record(record)
    assert tuple(record.row[[0, -1]]) == rows


def spelled(names, digits):
    """Rows of a charge in numbers of so many decimals behind commas, in as many cells."""
    forms = ("{:.2E}" if places == "E" else f"{{:.{places}f}}" for places in digits)
    row = ",".join(forms)
    lines = [
        row.format(*([1] * (len(digits) - 3)), 1.5 * k, k % 2, 3.2 + 0.05 * (k % 2)).replace(
            ".", ","
        )
        for k in range(1, 121)
    ]
    return "\n".join([names, *lines])


BARE = FRAME.select(TIME, VOLTAGE, CURRENT).with_columns(pl.lit(None).alias("event"))
BARE = BARE.write_csv(include_header=False)
NUMBERED = FRAME.with_columns(pl.lit(1).alias("count")).write_csv(include_header=False)
SPECTRUM = {"Freq": pl.lit(10.0), "Re": pl.lit(0.04), "-Im": pl.lit(0.01)}
APART = pl.concat(
    [FRAME.drop(VOLTAGE), FRAME.drop(CURRENT).with_columns(pl.col(TIME) + 0.2)], how="diagonal"
)
REFUSED = {
    **{
        f"decimal commas that split cells, {digits}": (
            spelled(names, digits), "row 2: the rows have more cells than the",
        )
        for names, digits in (
            ("step,time,current,voltage", (0, 0, 0, 4)), ("time,current,voltage", (0, 0, 4)),
            ("time,current,voltage", (0, 1, 0)), ("time,current,voltage", (1, 0, 0)),
            ("time,current,voltage", (0, 2, 4)), ("time,current,voltage", (1, 1, 4)),
            ("time,current,voltage", (0, "E", 4)),
        )
    },
    "an HDF5 file of pandas": (
        b"\x89HDF\r\n\x1a\n" + bytes(40) + b"pandas_type\0frame" + bytes(400),
        "an HDF5 file of pandas, not of MATLAB",
    ),
    "no names, but zeros": (f"0,,,Version=1.30\n{BARE}", "write a row of names above it"),
    "no names, but a word": (f"Version=1.30,,,\n{BARE}", "write a row of names above it"),
    "no names, but numbers": (f"11,3.8,0,\n{BARE}", "numbers, not names; write a row of names"),
    "names among numbers": (f"Time [s],Current [A],1,2\n{NUMBERED}", "no column for the voltage"),
    "others": (f"0,Current [A],1,Voltage [V]\n{NUMBERED}", "no column for the time"),
    "a first row of gaps": (f"Voltages,,,1\n{NUMBERED}", "no columns for the time, current"),
    "a spectrum": (FRAME.with_columns(**SPECTRUM), "an impedance spectrum"),
    "a voltage of another name beside an impedance": (
        IMPEDANCE.rename({VOLTAGE: "Zelle"}), "no column for the voltage",
    ),
    "signals in rows of their own": (
        APART.sort(TIME),
        f"'{VOLTAGE}' and '{CURRENT}' have values together in no row; join them by time",
    ),
    "open leads": (FRAME.with_columns(pl.lit(1e-6).alias(VOLTAGE)), "no cell is connected"),
    "vectors of unknown names": (
        savemat({"x1": TIMES, "x2": AMPS, "x3": VOLTS}),
        "columns='time=NAME:s,current=NAME:A,voltage=NAME:V'",
    ),
    "a page of names beside a sheet without": (
        workbook({"Info": [["Test", "Operator"], ["a", "b"]], "Data": [["x"], ["1"], ["2"]]}),
        "Sheets found: Info: Test, Operator; Data: x",
    ),
    "rows out of order": (FRAME.sample(**SHUFFLED), "sort the rows by time"),
    "a time that goes back": (changed(FRAME, TIME, [58.5], [60]), "time is out of line"),
    "all columns missing but one": (
        FRAME.rename({CURRENT: "Amp drawn", VOLTAGE: "U_cell in V"}),
        "no columns for the current, voltage",
    ),
    "currents of either direction": (
        FRAME.with_columns(Discharge_Current=AMPS).rename({CURRENT: "Charge Current [A]"}),
        "write their difference, charge positive",
    ),
    **{f"markup, {start}": (start + CSV, "HTML, XML or JSON")
       for start in ("<html><table><tr>", '<?xml version="1.0"?>', '{"time": [', "[[0")},
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_a_table_is_refused_with_the_reason(tmp_path, name):
    content, says = REFUSED[name]
    assert says in refusal(tmp_path, content)


# Two spellings of 1250.5 mA, or of 1250, and the voltage beside them.
GROUPED = {
    "commas, by a point": ("1,250.5", "1,250.5", "3.7"),
    "commas, by another column": ("1,250", "1,250", "3.7"),
    "points": ("1.250,5", "1.250,5", "3,7"),
    "blanks": ("1 250,5", "1\u00a0250,5", "3,7"),
    "apostrophes": ("1'250.5", "1\u2019250.5", "3.7"),
}


@pytest.mark.parametrize("mark", GROUPED)
def test_thousands_are_distinguished_from_decimals(tmp_path, mark):
    one, other, voltage = GROUPED[mark]
    rows = [f"{k};{(one, other)[k % 2]};{voltage}" for k in range(20)]
    record = read(tmp_path, "\n".join(["Time / s;Current / mA;Voltage / V", *rows]))
    current_a = 1.25 if one == "1,250" else 1.2505
    np.testing.assert_allclose(np.abs(record.current_a), current_a)
    np.testing.assert_allclose(record.voltage_v, 3.7)


def table_of(names, lines):
    return "\n".join([names, *lines])


# A text, and the code and row of its first finding; a word leaves the thousands of its column.
FINDINGS = {
    "a word": (
        table_of("Time / s,Current / A,Voltage / mV",
                 [f'{k}.5,1.5,"3,6{k:02}"' if k != 7 else "7.5,1.5,---" for k in range(20)]),
        ("cells.no-number", 9),
    ),
    "a number that is too large": (
        table_of(f"{NAMES},Temperature [degC]",
                 [f"{line},{1e30 if k == 7 else 25.0}" for k, line in enumerate(LINES)]),
        ("cells.left-out", 9),
    ),
    "signals in rows of their own": (
        table_of("Zeit,Current / A,Voltage / V",
                 [f"{k},{'' if k % 2 else 1.5},{3.7 if k % 2 else ''}" for k in range(40)]),
        ("cells.apart", 0),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FINDINGS)
def test_a_cell_that_cannot_be_used_is_a_finding_with_its_row(tmp_path, name):
    text, expected = FINDINGS[name]
    (tmp_path / "cell.csv").write_text(text)
    first, *_ = check_file(tmp_path / "cell.csv").findings
    assert (first.code, first.row or 0) == expected


UNITS = {
    "s": 1, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60, "h": 3600, "A": 1, "mA": 1e-3,
    "uA": 1e-6, "V": 1, "mV": 1e-3,
}  # fmt: skip


@given(
    seed=st.integers(0, 2**32 - 1),
    charge_positive=st.booleans(),
    kind=st.sampled_from([",", "\t", ";", "parquet"]),
    units=st.tuples(
        st.sampled_from(["s", "ms", "us", "ns", "min", "h"]),
        st.sampled_from(["A", "mA", "uA"]),
        st.sampled_from(["V", "mV"]),
    ),
    style=st.sampled_from(["{} / {}", "{} [{}]", "{}({})", " {} ({}) "]),
)
def test_a_record_comes_back_from_any_file_unit_and_sign(
    tmp_path_factory, seed, charge_positive, kind, units, style
):
    current = pulses_a(150, seed=seed)
    step_s = np.random.default_rng(seed).uniform(0.5, 2.0, 150)
    clock, voltage = np.cumsum(step_s), simulated_cell(current)
    filed = zip(
        ("Time", "Current", "Voltage"),
        units,
        (clock, -current if charge_positive else current, voltage),
        strict=True,
    )
    frame = pl.DataFrame({style.format(name, unit): v / UNITS[unit] for name, unit, v in filed})
    content = parquet(frame) if kind == "parquet" else frame.write_csv(separator=kind)
    record = read(tmp_path_factory.mktemp("round"), content, "cell.dat")
    np.testing.assert_allclose(record.time_s, clock, rtol=1e-12)
    np.testing.assert_allclose(record.current_a, current, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(record.voltage_v, voltage, rtol=1e-12)
    assert (record.sign.value == "charge-positive") == charge_positive
    assert list(record.row) == list(range(2, 152))


@given(st.integers(50, 4000), st.integers(2, 600))
def test_a_block_of_zeros_within_a_line_is_never_read_over(tmp_path_factory, at, count):
    text = CSV.encode()
    try:
        record = read(
            tmp_path_factory.mktemp("zeros"), text[:at] + bytes(count) + text[at + count :]
        )
    except InputError:
        return
    # Whole lines are gone.
    require_the_record(record, np.searchsorted(TIMES, record.time_s))


def test_what_is_beside_time_current_and_voltage_is_read_by_its_best_name(tmp_path):
    table = FRAME.with_columns(
        pl.lit(293.15).alias("Ambient Temperature / K"),
        pl.lit(298.15).alias("Surface Temperature [K]"),
        pl.Series("Step Index / 1", np.arange(200) // 5),
        pl.lit("cell A").alias("Remark"),
        pl.Series("StepTime(s)", np.arange(200) % 5),
    )
    record = read(tmp_path, table)
    require_the_record(record)
    np.testing.assert_allclose(record.temperature_degc, 25.0, rtol=1e-12)
    np.testing.assert_array_equal(record.step, np.arange(200) // 5)
    assert record.sha256 == hashlib.sha256((tmp_path / "cell.csv").read_bytes()).hexdigest()


@pytest.mark.parametrize(("name", "is_soc"), [("SOC [%]", True), ("Soak / min", False)])
def test_a_state_of_charge_is_counted_and_not_read(tmp_path, name, is_soc):
    record = read(tmp_path, FRAME.with_columns(pl.lit(50).alias(name)))
    unused = [each.values["column"] for each in record.notes if each.code == "columns.soc-unused"]
    assert unused == ([name] if is_soc else [])


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


def test_a_pickled_record_is_its_fields_and_cannot_be_written_to(tmp_path):
    record = read(tmp_path, FRAME)
    alone = pickle.dumps(record)
    assert record.segments(0.02).rests
    assert record.span_ah > 0
    assert pickle.dumps(record) == alone
    again = pickle.loads(alone)
    np.testing.assert_array_equal(again.voltage_v, record.voltage_v)
    assert (again.name, again.warnings, again.hold) == (record.name, record.warnings, record.hold)
    with pytest.raises(ValueError, match="read-only"):
        again.voltage_v[0] = 0.0


@pytest.mark.parametrize("mark", [".", ","])
@pytest.mark.parametrize(
    "names", [("freq/Hz", "Re(Z)/Ohm"), ("freq/Hz", "|Z|/Ohm"), ("Freq", "Zreal"), ("Freq", "-Im")]
)
def test_a_spectrum_among_samples_is_left_out_whatever_the_decimal_mark(tmp_path, mark, names):
    hertz = np.where((TIMES > 90) & (TIMES <= 130), 1e3 / (1 + TIMES), 0.0)
    table = FRAME.with_columns(**{names[0]: hertz, names[1]: 0.04 * (hertz > 0)})
    text = table.write_csv(separator="\t", float_scientific=True).replace(".", mark)
    record = read(tmp_path, text)
    require_the_record(record, hertz == 0)
    assert "40 rows of an impedance measurement" in " ".join(remarks(record))


def test_a_state_that_says_no_charge_is_reported(tmp_path):
    letters = STATE.with_columns(pl.col("Zustand").str.head(1).replace({"R": "P"}))
    findings = checked(tmp_path, letters, columns="state=Zustand").findings
    assert {"cells.state-words", "sign.none"} <= {finding.code for finding in findings}


def test_excels_lock_file_is_named(tmp_path):
    lock = b"\x04Jane" + b" " * 50 + b"\x04\0J\0a\0n\0e\0" + b" \0" * 50
    assert "lock file of an open workbook" in refusal(tmp_path, lock, "~$cell.xlsx")


STEP_S = np.tile([3600.0, 600.0, 3300.0, 900.0], 12) * (1 + 0.01 * np.cos(np.arange(48)))
END_S = np.cumsum(STEP_S)
STEP_A, STEP_V = np.tile([1.0, 0, -1, 0], 12), np.tile([4.2, 4.1, 2.8, 3.2], 12)
STEP, CYCLE = np.tile([1, 2, 3, 4], 12), np.repeat(np.arange(12), 4)
CLOCK = [f"{s // 3600:02.0f}:{s % 3600 // 60:02.0f}:{s % 60:02.0f}" for s in STEP_S]
ARBIN = pl.DataFrame({
    "Test_Time(s)": END_S, "Step_Time(s)": STEP_S, "Step_Index": STEP, "Cycle_Index": CYCLE,
    "Current(A)": STEP_A, "Voltage(V)": STEP_V, "Charge_Capacity(Ah)": STEP_V,
})  # fmt: skip
NEWARE = pl.DataFrame({
    "Cycle Index": CYCLE, "Step Index": np.arange(48), "Step Time": CLOCK,
    "Step Type": np.tile(["CC Chg", "Rest", "CC DChg", "Rest"], 12), "Capacity(Ah)": STEP_V,
    "Oneset Volt.(V)": STEP_V, "Starting current(A)": STEP_A,
})  # fmt: skip
ROWS_OF = {
    "Arbin by step": (ARBIN, "step"),
    "Arbin by cycle": (ARBIN[3::4], "cycle"),
    "Neware's layer of steps": (NEWARE, "step"),
    "Neware's, with a voltage": (
        NEWARE.with_columns(**{"Voltage(V)": STEP_V, "Current(A)": STEP_A}),
        "step",
    ),
    "Maccor's statistics": (
        ARBIN.select(
            Cycle="Cycle_Index", **{"Test Time": "Test_Time(s)"}, Current="Current(A)",
            Voltage="Voltage(V)",
        )[3::4],
        "cycle",
    ),
    "a charge and a discharge a cycle": (
        pl.DataFrame({"cycle": CYCLE, "t [h]": END_S / 3600, "I [A]": STEP_A, "V": STEP_V})[::2],
        "cycle",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", ROWS_OF)
def test_rows_of_steps_or_cycles_are_no_samples_in_any_format(tmp_path, kind):
    table, unit = ROWS_OF[kind]
    says = f"a table of one row a {unit}, not a record"
    assert says in refusal(tmp_path, table)
    assert says in refusal(tmp_path, parquet(table))
    if kind != "Neware's layer of steps":
        # No sheet of that one has a voltage or a current.
        assert says in refusal(tmp_path, sheet(table, "StatisticByStep"))


# Names of other tables, and what each is said to be.
OTHER = {
    "Frequency (Hz),Z' (Ohm),Z'' (Ohm)": "an impedance spectrum",
    "Frequency,Zreal,Zimag": "an impedance spectrum",
    "freq/Hz,Re(Z)/Ohm,-Im(Z)/Ohm": "an impedance spectrum",
    "Cycle ID,Cap_Chg(mAh),Cap_DChg(mAh),Efficiency(%)": "a table of one row a cycle",
    "Cycle-Index,CapC(mAh),CapD(mAh),Efficiency(%)": "a table of one row a cycle",
    "Cycle,Capacity (Ah),SOH (%)": "a table of one row a cycle",
    "Cycle Index,Chg. Cap.(Ah),DChg. Cap.(Ah)": "a table of one row a cycle",
}


@pytest.mark.parametrize("write", [pl.DataFrame.write_csv, sheet])
@pytest.mark.parametrize("names", OTHER)
def test_another_table_is_called_what_it_is_in_text_and_in_a_workbook(tmp_path, names, write):
    first, *others = names.split(",")
    number = np.arange(1.0, 21)
    table = pl.DataFrame({first: number, **dict.fromkeys(others, 0.5 + number)})
    said = refusal(tmp_path, write(table))
    assert f"{OTHER[names]}, not a record of time, current and voltage" in said


@pytest.mark.parametrize("rows", [slice(0, 1), slice(0, 3), slice(60, 61), slice(199, 200)])
@pytest.mark.parametrize("value", [0.0, -0.0, 1e-5])
def test_a_voltage_of_nothing_is_reported_wherever_it_stands(tmp_path, rows, value):
    record = read(tmp_path, changed(FRAME, VOLTAGE, value, rows))
    (outside,) = [each for each in record.warnings if each.code == "voltage-unit.outside"]
    assert (outside.row, outside.values["samples"]) == (rows.start + 2, rows.stop - rows.start)


def test_what_a_library_warns_of_is_reported_once(tmp_path, monkeypatch, recwarn):
    fastnda = pytest.importorskip("fastnda")

    def read_with_warnings(path, cycle_mode):
        for _ in range(2):
            warnings.warn("this version has not been verified", UserWarning, stacklevel=1)
        table = pl.DataFrame({"index": np.arange(1, 201), "total_time_s": TIMES})
        return table.with_columns(voltage_V=pl.Series(VOLTS), current_mA=pl.Series(1e3 * AMPS))

    monkeypatch.setattr(fastnda, "read", read_with_warnings)
    record = read(tmp_path, b"NEWARE" + bytes(300))
    says = "the library that reads this format warns: this version has not been verified"
    assert [says in str(one) for one in record.warnings] == [True]
    assert not recwarn.list


def test_a_name_for_two_quantities_is_refused_with_its_file():
    with pytest.raises(InputError, match=r"two: `columns`: 'Voltage / V' is given for"):
        record_from_frame(FRAME, name="two", columns=f"current={VOLTAGE},voltage={VOLTAGE}")

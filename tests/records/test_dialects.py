"""Every make's dialect gives the record that was written, from small files of our own."""

import datetime
import gzip
import io
import os
import threading
import zipfile

import numpy as np
import polars as pl
import pytest

from barnax.checks import check_file
from barnax.errors import InputError
from barnax.records import read_record, record_from_frame
from barnax.records.columns import Header, read_columns
from barnax.records.dialects import DIALECTS
from barnax.records.readers import read_table
from helpers.dialects import WRITERS, maccor_text, neware_csv, novonix_csv, pulse_table
from helpers.records import CURRENT, TIME, VOLTAGE, read, workbook

TABLE = pulse_table()
ROWS = TABLE.select(TIME, CURRENT, VOLTAGE).rows()
# Minutes and hours are divided, and multiplied again.
PRINTED = {"rtol": 1e-12, "atol": 1e-9}


def require_the_record(record):
    np.testing.assert_allclose(record.time_s, TABLE[TIME].to_numpy(), **PRINTED)
    np.testing.assert_allclose(record.current_a, -TABLE[CURRENT].to_numpy(), **PRINTED)
    np.testing.assert_allclose(record.voltage_v, TABLE[VOLTAGE].to_numpy(), **PRINTED)


@pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)
def test_a_dialect_gives_the_record_that_was_written_without_a_fault(tmp_path, write):
    require_the_record(read(tmp_path, write(TABLE)))
    assert not [
        each for each in check_file(tmp_path / "cell.csv").findings if each.severity == "error"
    ]


@pytest.mark.parametrize("dialect", DIALECTS, ids=lambda dialect: dialect.name)
def test_a_mark_is_first_of_its_own_make(dialect):
    for mark in dialect.marks:
        assert Header(tuple(mark.split(" & "))).dialect is dialect


# Names as other programs and languages write them: whose they are, and seconds and amperes a unit.
HEADERS = {
    "Schritt Nr.,Zeitstempel,Programm Zeit,Schritt Zeit,Spannung,Strom": ("Digatron", 1, 1),
    "Record number,State,Current(A),Voltage(V),Relative Time(h:min:s.ms)": ("Neware", 1, 1),
    "step,time s,voltage V,current mA": ("plain", 1, 1e-3),
    "DataSequence,StepNo,Type,TotTime(H:M:S),Voltage(V),Current(A)": ("plain", 1, 1),
    "Date_Time,Test_Time(s),Step_Index,Current(mA),Voltage(V)": ("Arbin", 1, 1e-3),
    "Data Point,Test Time (s),Step Index,Current (A),Voltage (V)": ("Arbin", 1, 1),
    "数据序号,循环号,工步号,工步类型,时间,总时间,电流(A),电压(V),容量(Ah)": ("Neware", 1, 1),
    "序号,工步类型,时间（h:min:s.ms）,电流（mA）,电压（V）": ("Neware", 1, 1e-3),
    "记录序号,状态,跳转,循环,步次,电流(mA),电压(V),相对时间(h:min:s.ms)": ("Neware", 1, 1e-3),
    "Rec#,Cyc#,Step,Test(Sec),Step(Sec),Amp-hr,Amps,Volts,State,DPt-Time": ("Maccor", 1, 1),
    "Rec,Cycle,Step,Test Time (Hr),Capacity (AHr),Current (A),Voltage (V),Md": ("Maccor", 3600, 1),
    "Rec#,Cyc#,Step,Test (Min),Step (Min),Amp-hr,mAmps,Volts,State": ("Maccor", 60, 1e-3),
    "Timestamp,Step,Program Duration#s,Step Duration#s,Voltage#V,Current#A": ("Digatron", 1, 1),
    "Schritt,Zustand,Programmdauer,Schrittdauer,Strom,Spannung": ("Digatron", 1e-3, 1),
    "~Time[s],DataSet,t-Step[s],Line,Command,U[V],I[A],Ah[Ah]": ("Basytec", 1, 1),
    "Index,TestTime/Sec.,StepTime/Sec.,Voltage/V,Current/mA": ("Landt", 1, 1e-3),
    "记录,测试时间,系统时间,工步序号,电压/V,电流/mA": ("Landt", 1, 1e-3),
    "mode,ox/red,error,time/ms,Ecell/mV,I/µA": ("BioLogic", 1e-3, 1e-6),
    "Zeit [min],Strom [mA],Spannung [V]": ("German", 60, 1e-3),
    "time /s,I /A,E /V": ("Ivium", 1, 1),
    "Time (s),WE(1).Current (A),WE(1).Potential (V)": ("plain", 1, 1),
    "Elapsed Time (s),Working Electrode (V),Current (A)": ("plain", 1, 1),
}


@pytest.mark.parametrize("header", HEADERS)
def test_names_of_other_programs_and_languages_are_known(header):
    names = Header(tuple(header.split(",")))
    dialect, second, ampere = HEADERS[header]
    assert names.is_record
    assert names.dialect.name == dialect
    found = names.columns
    clock = found.get("time") or found["step time"]
    assert (clock.unit.factor, found["current"].unit.factor) == (second, ampere)


def test_a_sensor_that_is_not_there_is_left_out():
    record = record_from_frame(TABLE.with_columns(pl.lit(-9999.0).alias("Temperature / degC")))
    assert record.temperature_degc is None
    assert "the column is left out" in " ".join(map(str, record.notes))


def test_two_files_joined_are_told_by_their_names(tmp_path):
    content = novonix_csv(TABLE)
    with pytest.raises(InputError, match=r"row 319: .*clock starts again .*split joined tests"):
        read(tmp_path, content + content)
    table = read_table(content + content, "cell")
    assert table.row[299:301].tolist() == [309, 309 + 10]
    assert "names" in {note.values["part"] for note in table.notes}


def test_states_and_counters_of_a_step_are_read(tmp_path):
    record = read(tmp_path, maccor_text(TABLE))
    np.testing.assert_array_equal(record.state, np.sign(record.current_a))
    flowed_ah = np.concatenate([[0], np.cumsum(record.current_a[1:])]) / 3600
    np.testing.assert_allclose(record.charge_ah, flowed_ah, atol=1e-12)


def test_a_clock_of_the_steps_is_joined_with_a_warning():
    table = TABLE.with_columns(pl.Series("Step Index / 1", np.arange(300) // 50))
    steps = np.arange(300) % 50 + (np.arange(300) >= 50)
    record = record_from_frame(table.with_columns(pl.Series(TIME, steps)))
    require_the_record(record)
    assert "starts again with each step (5 times)" in " ".join(map(str, record.warnings))


def test_both_sides_of_a_step_are_kept_under_one_stamp():
    step = np.arange(300) // 50
    time = np.arange(300.0) - step
    table = TABLE.with_columns(pl.Series(TIME, time), pl.Series("Step Index / 1", step))
    record = record_from_frame(table)
    assert record.samples == 300
    np.testing.assert_allclose(record.time_s, time, rtol=0, atol=1e-3)
    np.testing.assert_allclose(record.current_a, -TABLE[CURRENT].to_numpy())


UNITS = [("min", "minutes", 60), ("h", "hours", 3600), ("ms", "milliseconds", 1e-3)]


@pytest.mark.parametrize(("symbol", "words", "factor"), UNITS)
def test_dates_beside_a_clock_name_its_unit(symbol, words, factor):
    time = np.arange(300) * 30.0
    dates = pl.Series(time).cast(pl.Int64) * 1000
    table = {
        "Time": time / factor,
        CURRENT: TABLE[CURRENT],
        VOLTAGE: TABLE[VOLTAGE],
        "Date Time": dates.cast(pl.Datetime("ms")).dt.strftime("%m/%d/%Y %H:%M:%S"),
    }
    record = record_from_frame(table)
    np.testing.assert_allclose(record.time_s, time)
    (warning,) = [one for one in record.warnings if one.code == "unit.reading"]
    assert f"is taken in {words}" in str(warning)
    assert f"intervals by 'Date Time' are {factor:g} times as long" in str(warning)
    table["Time / s"] = table.pop("Time")
    with pytest.raises(InputError, match=f"'Time / s' looks like {words}"):
        record_from_frame(table)
    record = record_from_frame(table, columns=f"time=Time / s:{symbol}")
    np.testing.assert_allclose(record.time_s, time)


GIVEN = {"time": "Zeit:min", "current": "I2, gemessen:mA", "voltage": "Klemme [V]"}
AS_TEXT = "time=Zeit:min,current=I2, gemessen:mA,voltage=Klemme [V]"


@pytest.mark.parametrize("given", [AS_TEXT, GIVEN], ids=["text", "mapping"])
def test_columns_are_the_way_out_for_what_nobody_knows(tmp_path, given):
    table = pl.DataFrame(
        {
            "Zeit": TABLE[TIME] / 60,
            "I2, gemessen": 1e3 * TABLE[CURRENT],
            "Klemme [V]": TABLE[VOLTAGE],
        }
    )
    above = b"Pruefstand 7\n\n"
    require_the_record(read(tmp_path, above + table.write_csv().encode(), columns=given))
    require_the_record(record_from_frame(table, columns=given))
    assert check_file(tmp_path / "cell.csv", columns=given).facts.samples == 300


def test_columns_that_a_file_lacks_are_warned_of():
    record = record_from_frame(TABLE, columns={"current": "Strom"})
    assert "no column is called 'Strom'" in " ".join(map(str, record.warnings))
    require_the_record(record)


@pytest.mark.parametrize("given", ["strom=I", "nonsense", "time=", {"colour": "red"}])
def test_columns_of_no_quantity_are_refused(given):
    with pytest.raises(InputError, match=r"^`columns`: .* write them as"):
        read_columns(given)


def test_durations_of_a_workbook_and_dates_are_times():
    seconds = pl.Series(np.arange(300)).cast(pl.Int64)
    durations = (1000 * seconds).cast(pl.Duration("ms"))
    for times in (durations, (seconds * 1000).cast(pl.Datetime("ms"))):
        require_the_record(record_from_frame(TABLE.with_columns(times.alias(TIME))))


# What stands above and in every row of exports that have no writer of their own.
EXPORTS = {
    "Bitrode": (
        '"Total Time, (h:m:s)","Cycle","Loop Counter #1","Step","Current, A","Voltage, V","Mode"',
        '"{clock}",1,0,1,{ampere},{volt},"CHRG"',
    ),
    "units behind commas": (
        "Time,s;Test step;E,J;I,A;P,W;Q,As;U,V",
        "{second};1;0;{ampere};0;0;{volt}",
    ),
    "mV and mA": ("Time\tmV\tmA\tTemperature", "{clock}\t{millivolt}\t{milliampere}\t25"),
    "Basytec with dates": (
        "~Time[s] DataSet DateTime Line U[V] I[A]",
        "{second} 1 2026-01-01 00:00:00 1 {volt} {ampere}",
    ),
    "Neware in millivolts": (
        "Record ID,Step ID,Status,Time(H:M:S:ms),Vol(mV),Cur(mA)",
        "1,1,CC,{clock}:000,{millivolt},{milliampere}",
    ),
    "Wonik": (
        "StepNo,Type,StepTime(H:M:S),TotTime(H:M:S),Voltage(V),Current(A)",
        "1,Rest,00:00:00,{clock},{volt},{ampere}",
    ),
    "VersaStudio": ("Segment,Point,E(V),I(A),Elapsed Time(s)", "0,1,{volt},{ampere},{second}"),
    "a clock in words": (
        "Record_number,current_A,voltage_V,Relative_Time_h_min_s.ms_",
        "1,{ampere},{volt},{clock}.000",
    ),
    "channels": (
        "Testtime,StepID,Steptime,Channel Voltage,Channel Current",
        "{second},1,0,{volt},{ampere}",
    ),
    "German dates": ("Datum;Strom [A];Spannung [V]", "01.02.2026 1{clock};{ampere};{volt}"),
    "Chinese": ("总时间(s),电流(A),电压(V)", "{second},{ampere},{volt}"),
    "an index without a name": (f",{TIME},{CURRENT},{VOLTAGE}", "1,{second},{ampere},{volt}"),
    # Of three electrodes, Ewe is the voltage that an .mpr of the same record has too.
    "three electrodes": (
        "time/s\tEwe/V\tEce/V\tEwe-Ece/V\tI/A",
        "{second}\t{volt}\t0.1\t3.9\t{ampere}",
    ),
}


def exported(name):
    header, row = EXPORTS[name]
    rows = [
        row.format(
            second=second,
            clock=f"{int(second) // 3600}:{int(second) // 60:02d}:{int(second) % 60:02d}",
            ampere=repr(ampere),
            milliampere=repr(1e3 * ampere),
            volt=repr(volt),
            millivolt=repr(1e3 * volt),
        )
        for second, ampere, volt in ROWS
    ]
    text = "\n".join(rows)
    return f"{header}\n{text.replace('.', ',') if name == 'units behind commas' else text}\n"


@pytest.mark.parametrize("name", EXPORTS)
def test_an_export_of_another_program_is_read(tmp_path, name):
    require_the_record(read(tmp_path, exported(name).encode()))


# What a text may be wrapped or coded in.
WRAPPED = {
    "the encoding of Chinese computers": exported("Chinese").encode("gb18030"),
    "line ends of Windows": maccor_text(TABLE).replace(b"\n", b"\r\n"),
    "gzip": gzip.compress(maccor_text(TABLE)),
}


@pytest.mark.parametrize("content", WRAPPED.values(), ids=WRAPPED)
def test_a_text_is_read_however_it_is_wrapped(tmp_path, content):
    require_the_record(read(tmp_path, content))


@pytest.mark.parametrize("form", ["%M:%S.%f", "%I:%M:%S %p", "%H:%M:%S"])
def test_a_clock_of_the_day_or_of_the_hour_runs_on(form):
    evening = datetime.datetime(2026, 1, 1, 23, 10)
    seconds = np.arange(300) * 20
    clock = [(evening + datetime.timedelta(seconds=int(each))).strftime(form) for each in seconds]
    record = record_from_frame(TABLE.with_columns(pl.Series(TIME, clock)))
    np.testing.assert_allclose(record.time_s - record.time_s[0], seconds)


def test_a_clock_of_two_parts_without_a_fraction_is_refused():
    clock = [f"{k // 60:02d}:{k % 60:02d}" for k in range(300)]
    with pytest.raises(InputError, match="'00:00' stands under 'Test Time / s'"):
        record_from_frame(TABLE.with_columns(pl.Series(TIME, clock)))


def test_a_clock_of_the_steps_need_not_begin_at_zero():
    step = np.arange(300) // 3
    table = TABLE.with_columns(
        pl.Series("Step Index / 1", step), pl.Series(TIME, 1.0 + np.arange(300) % 3)
    )
    record = record_from_frame(table)
    np.testing.assert_allclose(np.diff(record.time_s), 1)


def test_units_below_the_names_of_a_workbook_are_theirs(tmp_path):
    rows = [[second, 1e3 * ampere, volt] for second, ampere, volt in ROWS]
    content = workbook({"cell": [["Time", "Current", "Voltage"], ["s", "mA", "V"], *rows]})
    record = read(tmp_path, content, "cell.xlsx")
    require_the_record(record)
    assert record.row[0] == 3


def test_lines_of_words_between_the_rows_are_left_out(tmp_path):
    """As Repower writes one where a step begins; the state, not a sign, tells a rest."""
    text = "Cycle ID,Step ID,Record ID,Step State,System Time,Relative Time(Sec),Voltage(V),"
    text += "Current(A),\n"
    for k, (_, ampere, volt) in enumerate(ROWS):
        if k % 100 == 0:
            text += f"\u25a1{k // 100}: 1 Still(1--6001): 0.000Ah [0.000Wh],,,,,,,,\n"
        stamp = f"2024-04-30 12:{k // 60:02d}:{k % 60:02d}"
        text += f"1,{k // 100},{k},Still,{stamp},{k % 100},{volt!r},{ampere!r},\n"
    record = read(tmp_path, text.encode("gb18030"))
    require_the_record(record)
    assert "left out 3 lines of words between the rows" in " ".join(map(str, record.notes))
    assert record.row[[0, 99, 100]].tolist() == [3, 102, 104]


def test_a_table_without_names_is_told_to_have_none(tmp_path):
    rows = "".join(f"11/27/2018 8:41:{k} PM,{k},PAU,0:00:0{k}.0,3.7,0.1,{k}\n" for k in range(9))
    with pytest.raises(InputError, match="numbers, not names; write a row of names above it"):
        read(tmp_path, rows.encode())


def test_cells_of_a_workbook_shown_as_durations_are_times(tmp_path):
    """Excel stores days; the style of the cells says that they are a duration."""
    names = ["Time", "Current (A)", "Voltage (V)"]
    days = TABLE.with_columns(pl.col(TIME) / 86400).select(TIME, CURRENT, VOLTAGE)
    main = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
    styles = f'<styleSheet xmlns="{main}"><cellXfs><xf/><xf numFmtId="46"/></cellXfs></styleSheet>'
    with zipfile.ZipFile(tmp_path / "cell.xlsx", "w") as styled:
        with zipfile.ZipFile(io.BytesIO(workbook({"cell": [names, *days.rows()]}))) as plain:
            for part in plain.namelist():
                text = plain.read(part).decode()
                styled.writestr(part, text.replace("<row><c><v>", '<row><c s="1"><v>'))
        styled.writestr("xl/styles.xml", styles)
    record = read_record(tmp_path / "cell.xlsx")
    np.testing.assert_allclose(record.time_s, TABLE[TIME].to_numpy(), atol=1e-3)
    assert not any("assumed s" in str(each) for each in [*record.warnings, *record.notes])


def test_numbers_cut_by_their_own_commas_are_refused(tmp_path):
    text = "Zeit [s],Strom [A],Spannung [V],Time / s,Current / A,Voltage / V\n"
    rows = "".join(f"{k},0,1,5,3,7,0,1,5,3,7,1\n" for k in range(30))
    with pytest.raises(InputError, match="commas separate cells and also decimals"):
        read(tmp_path, (text + rows).encode())


def test_a_pipe_and_the_standard_input_are_read_once(tmp_path, monkeypatch):
    for name in ("/dev/fd/{}", "-"):
        reading, writing = os.pipe()

        def write(writing=writing):
            with os.fdopen(writing, "wb") as pipe:
                pipe.write(neware_csv(TABLE))

        threading.Thread(target=write).start()
        with os.fdopen(reading) as stream:
            monkeypatch.setattr("sys.stdin", stream)
            record = read_record(name.format(reading))
            require_the_record(record)
            assert record.name == ("standard input" if name == "-" else "piped file")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"NEWARE\0\0\0\0\0" + bytes(500), "\\.nda file is damaged"),
        (b"BIO-LOGIC MODULAR FILE\x1a" + bytes(500), "BioLogic \\.mpr"),
        (b"\0\1\0\0Standard Jet DB\0" + bytes(500), "Arbin \\.res"),
        (gzip.compress(b"Time,Current\n" * 999)[:-30], "gzipped file is damaged"),
    ],
    ids=["nda", "mpr", "res", "gz"],
)
def test_a_binary_file_that_cannot_be_read_says_what_to_export(tmp_path, content, words):
    with pytest.raises(InputError, match=f"{words}.*(export|copy)"):
        read(tmp_path, content)


def test_a_bad_cell_in_the_clock_of_the_steps_is_refused_with_its_row(tmp_path):
    content = WRITERS["Neware CSV, step clock"](TABLE).replace(b"00:00:3.0", b"00:00:three", 1)
    with pytest.raises(InputError, match=r"row \d+: .*Time\(h:min:s\.ms\)"):
        read(tmp_path, content)

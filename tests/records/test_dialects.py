"""Every make's dialect gives the record that was written, from small files of our own."""

import gzip
import os
import threading

import numpy as np
import polars as pl
import pytest

from barnax import InputError, check_file, read_record, record_from_frame
from barnax.records.columns import Header, read_columns
from barnax.records.dialects import DIALECTS
from barnax.records.readers import read_table
from helpers.dialects import WRITERS, maccor_text, neware_csv, novonix_csv, pulse_table
from helpers.records import CURRENT, TIME, VOLTAGE, read, refusal, remarks, zipped

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
def test_a_mark_is_first_of_its_make(dialect):
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
    "~Time[s],DataSet,DateTime,Line,U[V],I[A]": ("Basytec", 1, 1),
    "Record ID,Step ID,Status,Time(H:M:S:ms),Vol(mV),Cur(mA)": ("Neware", 1, 1e-3),
    "Segment,Point,E(V),I(A),Elapsed Time(s)": ("Ivium", 1, 1),
    "Record_number,current_A,voltage_V,Relative_Time_h_min_s.ms_": ("plain", 1, 1),
    "Testtime,StepID,Steptime,Channel Voltage,Channel Current": ("plain", 1, 1),
    "总时间(s),电流(A),电压(V)": ("Neware", 1, 1),
    "Zeit [min],Strom [mA],Spannung [V]": ("plain", 60, 1e-3),
    "Time (s),Strom (mA),電圧 (V)": ("plain", 1, 1e-3),
    "시간(s),전류(A),전압(V)": ("plain", 1, 1),
    "time /s,I /A,E /V": ("Ivium", 1, 1),
    "Time (s),WE(1).Current (A),WE(1).Potential (V)": ("plain", 1, 1),
    "Elapsed Time (s),Working Electrode (V),Current (A)": ("plain", 1, 1),
}


@pytest.mark.parametrize("header", HEADERS)
def test_names_of_other_programs_and_languages_are_recognized(header):
    names = Header(tuple(header.split(",")))
    dialect, second, ampere = HEADERS[header]
    assert names.is_record
    assert names.dialect.name == dialect
    actual = names.columns
    clock = actual.get("time") or actual["step time"]
    assert (clock.unit.factor, actual["current"].unit.factor) == (second, ampere)


def test_two_files_joined_are_recognized_by_their_names(tmp_path):
    content = novonix_csv(TABLE)
    with pytest.raises(InputError, match=r"row 319: .*clock starts again .*split joined tests"):
        read(tmp_path, content + content)
    table = read_table(content + content, "cell")
    assert table.row[299:301].tolist() == [309, 309 + 10]
    assert "names" in {note.values["part"] for note in table.notes}


def test_both_sides_of_a_step_are_kept_under_one_stamp():
    step = np.arange(300) // 50
    time = np.arange(300.0) - step
    table = TABLE.with_columns(pl.Series(TIME, time), pl.Series("Step Index / 1", step))
    record = record_from_frame(table)
    assert record.samples == 300
    np.testing.assert_allclose(record.time_s, time, rtol=0, atol=1e-3)
    np.testing.assert_allclose(record.current_a, -TABLE[CURRENT].to_numpy())


@pytest.mark.parametrize("given", ["strom=I", "junk", "time=", "time=a,amps=b", {"colour": "red"}])
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
    "German dates": ("Datum;Strom [A];Spannung [V]", "01.02.2026 1{clock};{ampere};{volt}"),
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


# Time, current, voltage and state, and its words for discharge, charge and rest.
JAPANESE = ("経過時間[s]", "電流(A)", "電圧［V］", "状態", "放電", "充電", "休止")
ENCODED = {
    "euc_jp": JAPANESE,
    "shift_jis": JAPANESE,
    "utf-16-le": JAPANESE,
    "utf-16-be": ("Zeit", "Strom", "Spannung", "Modus", "Entladevorgang", "Ladevorgang", "Ruhe"),
    "cp949": ("시간(s)", "전류(A)", "전압(V)", "상태", "방전", "충전", "휴지"),
    "gb18030": ("时间(s)", "电流(A)", "电压(V)", "状态", "放电", "充电", "静置"),
    "big5": ("測試時間(s)", "電流(A)", "電壓(V)", "狀態", "放電", "充電", "靜置"),
    "latin-1": ("Zeit[s]", "Strom[A]", "Spannung[V]", "Zustand", "Entladung", "Ladung", "Ruhe"),
}


@pytest.mark.parametrize("encoding", ENCODED)
def test_a_text_of_another_encoding_says_the_same(tmp_path, encoding):
    *names, state, discharge, charge, rest = ENCODED[encoding]
    word = {1: charge, -1: discharge, 0: rest}
    words = [word[sign] for sign in np.sign(TABLE[CURRENT].to_numpy()).astype(int).tolist()]
    table = TABLE.select(TIME, pl.col(CURRENT).abs(), VOLTAGE).with_columns(pl.Series(state, words))
    table.columns = [*names, state]
    record = read(tmp_path, table.write_csv().encode(encoding))
    require_the_record(record)
    np.testing.assert_array_equal(record.state, np.sign(record.current_a))


@pytest.mark.parametrize(
    "pack", [gzip.compress, lambda own: zipped({"c": own, "__MACOSX/._c": b""})]
)
def test_a_packed_file_is_that_file(tmp_path, pack):
    packed = pack(maccor_text(TABLE).replace(b"\n", b"\r\n"))
    require_the_record(read(tmp_path, packed, "c.zip"))


@pytest.mark.parametrize("files", [{}, {"a.csv": b"1", "b.csv": b"2"}, {"a.bin": bytes(99)}])
def test_a_zip_archive_of_anything_else_is_to_be_unpacked(tmp_path, files):
    archive = zipped(files) if files else zipped({"a": b"1" * 99})[:60]
    with pytest.raises(InputError, match=r"c\.zip: .*(unpack it|Export the record)"):
        read(tmp_path, archive, "c.zip")


def ec_lab(**columns):
    table = {"mode": 1.0, "ox/red": 1.0, "time/s": TABLE[TIME], **columns}
    rows = pl.DataFrame(table).write_csv(separator="\t", float_scientific=True)
    return f"EC-Lab ASCII FILE\nNb header lines : 3\n{rows}"


SECONDS, VOLTS = TABLE[TIME].to_numpy(), TABLE[VOLTAGE].to_numpy()
MILLIAMPERES = 1e3 * TABLE[CURRENT].to_numpy()


def test_the_sign_of_an_instrument_yields_to_clear_evidence_only(tmp_path):
    # In a hold the current decays while the voltage rises, and nothing else steps.
    hold = {"Ewe/V": np.r_[3.5, np.full(299, 3.6)], "I/mA": 1e3 * np.exp(-SECONDS / 20)}
    record = read(tmp_path, ec_lab(**hold), voltage_lag=0.0)
    assert (record.sign.value, record.warnings) == ("charge-positive", ())
    record = read(tmp_path, ec_lab(**{"Ewe/V": VOLTS, "I/mA": -MILLIAMPERES}))
    assert record.sign.value == "discharge-positive"
    assert "promise" in " ".join(map(str, record.warnings))


@pytest.mark.parametrize("name", ["<Ewe>/V", "Ewe/V", "Ecell/V"])
def test_zero_volts_of_ec_lab_are_no_measurement(tmp_path, name):
    said = refusal(tmp_path, ec_lab(**{name: VOLTS * (SECONDS < 150), "I/mA": MILLIAMPERES}))
    assert f"row 154: EC-Lab wrote 0 under '{name}' for a voltage that it did not" in said


@pytest.mark.parametrize(
    ("beside", "is_said"),
    [
        ({"Ece/V": 0.1}, True),
        ({"Ece/V": 0.1, "Ewe-Ece/V": VOLTS - 0.1}, True),
        ({"Ece/V": 0.1, "<Ewe>/V": VOLTS}, True),
        ({"Ece/V": 0.0}, False),
    ],
)
def test_the_voltage_of_a_working_electrode_is_said_to_be_that(tmp_path, beside, is_said):
    record = read(tmp_path, ec_lab(**{"Ewe/V": VOLTS, "I/mA": MILLIAMPERES, **beside}))
    says = "of the working electrode against the reference"
    assert (says in " ".join(remarks(record))) == is_said
    np.testing.assert_allclose(record.voltage_v, VOLTS, rtol=1e-5)
    if "Ewe-Ece/V" in beside:
        record = read_record(tmp_path / "cell.csv", columns="voltage=Ewe-Ece/V")
        np.testing.assert_allclose(record.voltage_v, VOLTS - 0.1, rtol=1e-5)


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

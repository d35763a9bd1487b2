"""Tables as testers, loggers and scripts leave them: text, names, kinds of table and makes.

The shared cases are read against their `truth.json`; what is written here is of the same kinds.
"""

import json
import warnings

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barnax.checks import check_file
from barnax.errors import InputError
from barnax.records import read_record
from helpers.records import (
    CURRENT,
    TIME,
    VOLTAGE,
    parquet,
    pulse_frame,
    read,
    refusal,
    sheet,
    told,
    workbook,
)
from helpers.shared import CASES, SHARED, needs_cases, needs_data

FILES = CASES / "files"
FRAME = pulse_frame(200).with_columns(pl.col(VOLTAGE).round(4))
TIMES, AMPS, VOLTS = (FRAME[name].to_numpy() for name in (TIME, CURRENT, VOLTAGE))


def require_the_record(record, rows: slice | np.ndarray = slice(None)):
    np.testing.assert_array_equal(record.time_s, TIMES[rows])
    np.testing.assert_allclose(record.current_a, -AMPS[rows], atol=1e-12)
    np.testing.assert_allclose(record.voltage_v, VOLTS[rows], atol=1e-12)


# Files that are read, and with what.
READ = {
    "mb_with_spectrum_comma.mpt": {},
    "ca_hold.mpt": {},
    "cr_lines_last_crlf.csv": {},
    "soc_beside_named_time.csv": {"columns": "time=t_vec:s"},
    "vrm_three_header_rows.csv": {"columns": "time=Europe/Berlin (+01:00)", "series": 4},
}
# Files that are refused, and what is said.
REFUSED = {
    "eis_nb3_comma.mpt": "an impedance spectrum",
    "maccor_stats.txt": "a table of one row a cycle",
    "load_tester_no_names.csv": "write a row of names above it",
    "ev_sparse_rows.csv": "stand together in no row; join them by time",
    "open_leads_mV.csv": "no cell is connected",
    "cp_zero_ewe.mpt": "row 34: EC-Lab wrote 0 under '<Ewe>/V'",
    "vrm_three_header_rows.csv": "no column for the time",
}


@needs_cases
@pytest.mark.parametrize("name", READ)
def test_a_shared_case_is_read_as_it_is(name):
    files = json.loads((FILES / "truth.json").read_text())["files"]
    (truth,) = [one for one in files if one["file"] == name]
    record = read_record(FILES / name, voltage_lag=0.0, **READ[name])
    series = READ[name].get("series", 1)
    assert record.samples == truth["n_rows"]
    assert record.sign.value == "charge-positive"
    assert np.ptp(record.time_s) == pytest.approx(truth["t_last_s"] - truth["t_first_s"])
    ends_a = -record.current_a.max(), -record.current_a.min()
    # As many digits as the file has.
    digits_a, digits_v = (5e-3, 5e-3) if series > 1 else (1e-12, 1e-8)
    assert ends_a == pytest.approx((truth["i_min_A"], truth["i_max_A"]), abs=digits_a)
    ends_v = series * record.voltage_v.min(), series * record.voltage_v.max()
    assert ends_v == pytest.approx((truth["v_min_V"], truth["v_max_V"]), abs=digits_v)
    assert not record.warnings


@needs_cases
@pytest.mark.parametrize("name", REFUSED)
def test_a_shared_case_is_refused_with_what_it_is(name):
    with pytest.raises(InputError) as caught:
        read_record(FILES / name)
    assert REFUSED[name] in str(caught.value)


@needs_cases
def test_a_record_with_a_named_clock_and_an_soc_is_checked_as_a_record():
    name, options = "soc_beside_named_time.csv", READ["soc_beside_named_time.csv"]
    check = check_file(FILES / name, columns=options["columns"])
    assert check.is_clean
    assert "validation" in [role.name for role in check.roles if role.is_usable]


LINE_ENDS = {
    "CR": lambda text: text.replace(b"\n", b"\r"),
    "CR, the last CR LF": lambda text: text[:-1].replace(b"\n", b"\r") + b"\r\n",
    "CR below a line with CR LF": lambda text: b"Logger 5\r\n" + text.replace(b"\n", b"\r"),
    "CR CR LF": lambda text: text.replace(b"\n", b"\r\r\n"),
    "a zero before each line end": lambda text: text.replace(b"\n", b"\0\n"),
    "a block of zeros between lines": lambda text: text.replace(
        b"\n99.0", b"\n" + bytes(512) + b"\n99.0"
    ),
    "a zero in the names": lambda text: text.replace(b"Volt", b"Vo\0lt"),
    "two marks of the order of bytes": lambda text: 2 * b"\xef\xbb\xbf" + text,
}


@pytest.mark.parametrize("kind", LINE_ENDS)
def test_text_is_read_however_its_lines_end(tmp_path, kind):
    content = LINE_ENDS[kind](FRAME.write_csv().encode())
    assert content != FRAME.write_csv().encode()
    require_the_record(read(tmp_path, content))


@given(st.integers(50, 4000), st.integers(2, 600))
def test_a_block_of_zeros_within_a_line_is_never_read_over(tmp_path_factory, at, count):
    text = FRAME.write_csv().encode()
    content = text[:at] + bytes(count) + text[at + count :]
    try:
        record = read(tmp_path_factory.mktemp("zeros"), content)
    except InputError:
        return
    # Whole lines are gone.
    require_the_record(record, np.searchsorted(TIMES, record.time_s))


def decimal_commas(frame, numbers):
    return "\n".join(
        ["\t".join(frame.columns), *("\t".join(map(numbers, row)) for row in frame.rows())]
    )


@pytest.mark.parametrize("mark", [".", ","])
@pytest.mark.parametrize(
    "names", [("freq/Hz", "Re(Z)/Ohm"), ("freq/Hz", "|Z|/Ohm"), ("Freq", "Zreal"), ("Freq", "-Im")]
)
def test_a_spectrum_among_samples_is_left_out_whatever_the_decimal_mark(tmp_path, mark, names):
    hertz = np.where((TIMES > 90) & (TIMES <= 130), 1e3 / (1 + TIMES), 0.0)
    table = FRAME.with_columns(**{names[0]: hertz, names[1]: 0.04 * (hertz > 0)})
    text = decimal_commas(table, lambda value: f"{value:.7E}".replace(".", mark))
    record = read(tmp_path, text)
    require_the_record(record, hertz == 0)
    assert "40 rows of an impedance measurement" in " ".join(told(record))
    spectrum = table.with_columns(pl.lit(10.0).alias(names[0]))
    text = decimal_commas(spectrum, lambda value: f"{value:.7E}".replace(".", mark))
    assert "an impedance spectrum" in refusal(tmp_path, text)


def test_text_columns_of_a_data_frame_are_numbers_before_any_rule(tmp_path):
    texts = FRAME.select(
        pl.col(name).cast(pl.String).str.replace(".", ",", literal=True) for name in FRAME.columns
    )
    require_the_record(read(tmp_path, parquet(texts), "cell.parquet"))


@pytest.mark.parametrize("kind", ["csv", "units below", "workbook"])
def test_a_given_name_is_the_header_for_every_rule(tmp_path, kind):
    columns = (
        f"time=Stempel{':s' if kind != 'units below' else ''},current=Messkanal 2,voltage=Uzelle"
    )
    table = FRAME.rename({TIME: "Stempel", CURRENT: "Messkanal 2", VOLTAGE: "Uzelle"})
    table = table.with_columns(SoC=pl.lit(0.5), OCV=pl.col("Uzelle") + 0.1)
    if kind == "workbook":
        require_the_record(read(tmp_path, sheet(table), "c.xlsx", columns=columns))
        return
    text = table.write_csv()
    if kind == "units below":
        text = text.replace("\n", "\ns,A,V,-,V\n", 1)
    require_the_record(read(tmp_path, text, columns=columns))
    assert "SOC" not in "".join(
        str(one) for one in check_file(tmp_path / "cell.csv", columns=columns).findings
    )


def test_a_given_state_tells_the_direction_or_is_said_to_tell_none(tmp_path):
    words = np.select([AMPS > 0, AMPS < 0], ["Laden", "Entladen"], "Ruhe")
    table = FRAME.with_columns(pl.col(CURRENT).abs(), Zustand=words)
    require_the_record(read(tmp_path, table, columns="state=Zustand"))
    letters = table.with_columns(pl.col("Zustand").str.head(1).replace({"R": "P"}))
    letters.write_csv(tmp_path / "cell.csv")
    findings = check_file(tmp_path / "cell.csv", columns="state=Zustand").findings
    assert {"cells.state-words", "sign.none"} <= {finding.code for finding in findings}


@pytest.mark.parametrize("form", ["{}Data", "{}_vec", "data.{}_data"])
def test_names_of_script_variables_are_those_of_quantities(tmp_path, form):
    savemat = pytest.importorskip("scipy.io").savemat
    names = [form.format(letter) for letter in ("t", "I", "V")]
    columns = dict(zip(names, (TIMES, AMPS, VOLTS), strict=True))
    if form.startswith("data."):
        columns = {"data": {name.removeprefix("data."): values for name, values in columns.items()}}
    else:
        require_the_record(read(tmp_path, pl.DataFrame(columns)))
    savemat(tmp_path / "cell.mat", columns)
    require_the_record(read_record(tmp_path / "cell.mat"))


@pytest.mark.slow
def test_vectors_of_unknown_names_are_asked_for_by_names_that_work(tmp_path):
    savemat = pytest.importorskip("scipy.io").savemat
    savemat(tmp_path / "cell.mat", {"x1": TIMES, "x2": AMPS, "x3": VOLTS})
    with pytest.raises(InputError, match="columns='time=NAME:s,current=NAME:A,voltage=NAME:V'"):
        read_record(tmp_path / "cell.mat")
    columns = "time=x1:s,current=x2:A,voltage=x3:V"
    require_the_record(read_record(tmp_path / "cell.mat", columns=columns))


def test_what_is_beside_a_workbook_or_by_pandas_is_named(tmp_path):
    lock = b"\x04Jane" + b" " * 50 + b"\x04\0J\0a\0n\0e\0" + b" \0" * 50
    assert "lock file of an open workbook" in refusal(tmp_path, lock, "~$cell.xlsx")
    store = b"\x89HDF\r\n\x1a\n" + bytes(40) + b"pandas_type\0frame" + bytes(400)
    assert "an HDF5 file of pandas, not of MATLAB" in refusal(tmp_path, store, "cell.h5")


STEP_S = np.tile([3600.0, 600.0, 3300.0, 900.0], 12) * (1 + 0.01 * np.cos(np.arange(48)))
END_S = np.cumsum(STEP_S)
STEP_A, STEP_V = np.tile([1.0, 0, -1, 0], 12), np.tile([4.2, 4.1, 2.8, 3.2], 12)
STEP, CYCLE = np.tile([1, 2, 3, 4], 12), np.repeat(np.arange(12), 4)
CLOCK = [f"{s // 3600:02.0f}:{s % 3600 // 60:02.0f}:{s % 60:02.0f}" for s in STEP_S]
ARBIN = {
    "Test_Time(s)": END_S,
    "Step_Time(s)": STEP_S,
    "Step_Index": STEP,
    "Cycle_Index": CYCLE,
    "Current(A)": STEP_A,
    "Voltage(V)": STEP_V,
    "Charge_Capacity(Ah)": STEP_V,
    "Discharge_Capacity(Ah)": STEP_V,
}
NEWARE = {
    "Cycle Index": CYCLE,
    "Step Index": np.arange(48),
    "Step Type": np.tile(["CC Chg", "Rest", "CC DChg", "Rest"], 12),
    "Step Time": CLOCK,
    "Capacity(Ah)": STEP_V,
    "Oneset Volt.(V)": STEP_V,
    "Starting current(A)": STEP_A,
}
MACCOR = {
    "Cycle": CYCLE[::4],
    "Test Time": END_S[3::4],
    "Current": STEP_A[::4],
    "Voltage": STEP_V[::4],
}
ROWS_OF = {
    "Arbin by step": (pl.DataFrame(ARBIN), "step"),
    "Arbin by cycle": (pl.DataFrame(ARBIN)[3::4], "cycle"),
    "Neware's layer of steps": (pl.DataFrame(NEWARE), "step"),
    "Neware's, with a voltage": (
        pl.DataFrame(NEWARE).with_columns(
            pl.Series("Voltage(V)", STEP_V), pl.Series("Current(A)", STEP_A)
        ),
        "step",
    ),
    "Maccor's statistics": (pl.DataFrame(MACCOR), "cycle"),
    "a charge and a discharge a cycle": (
        pl.DataFrame(
            {
                "cycle": CYCLE[::2],
                "time [h]": END_S[1::2] / 3600,
                "I [A]": STEP_A[::2],
                "U [V]": STEP_V[::2],
            }
        ),
        "cycle",
    ),
}


@pytest.mark.parametrize("kind", ROWS_OF)
def test_rows_of_steps_or_cycles_are_no_samples_in_any_format(tmp_path, kind):
    table, unit = ROWS_OF[kind]
    says = f"a table of one row a {unit}, not a record"
    assert says in refusal(tmp_path, table)
    assert says in refusal(tmp_path, parquet(table), "cell.parquet")
    if kind != "Neware's layer of steps":
        # No sheet of that one has a voltage or a current.
        assert says in refusal(tmp_path, sheet(table, "StatisticByStep"), "cell.xlsx")


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


@pytest.mark.parametrize("is_workbook", [False, True])
@pytest.mark.parametrize("names", OTHER)
def test_another_table_is_called_what_it_is_in_text_and_in_a_workbook(tmp_path, names, is_workbook):
    header = names.split(",")
    rows = [[number, *np.full(len(header) - 1, 0.5 + number)] for number in range(1, 21)]
    text = "\n".join([names, *(",".join(map(str, row)) for row in rows)])
    content = workbook({"Sheet1": [header, *(list(map(float, row)) for row in rows)]})
    said = refusal(tmp_path, content if is_workbook else text)
    assert f"{OTHER[names]}, not a record of time, current and voltage" in said


def test_an_impedance_at_one_frequency_beside_samples_is_no_spectrum(tmp_path):
    beside = FRAME.with_columns(pl.lit(1e3).alias("Frequency [Hz]"), pl.lit(0.02).alias("Z [Ohm]"))
    require_the_record(read(tmp_path, beside))


def test_a_count_of_samples_is_no_count_of_steps(tmp_path):
    for name in ("step", "cycle"):
        counted = FRAME.with_columns(pl.Series(name, np.arange(200)))
        require_the_record(read(tmp_path, counted))
    record = read(tmp_path, FRAME.with_columns(pl.Series("cycle", np.arange(200) / 1e3)))
    require_the_record(record)


@pytest.mark.parametrize("first", ["0,,,Version=1.30", "Version=1.30,,,", "11,3.8,0,"])
def test_rows_without_names_are_told_to_need_them_and_read_with_them(tmp_path, first):
    rows = FRAME.select(TIME, VOLTAGE, CURRENT).with_columns(pl.lit(None).alias("event"))
    text = f"{first}\n{rows.write_csv(include_header=False)}"
    assert "write a row of names above it" in refusal(tmp_path, text)
    require_the_record(read(tmp_path, f"time,voltage,current,event\n{text.split(chr(10), 1)[1]}"))


@pytest.mark.parametrize("names", ["Time [s],Current [A],1,2", "0,Current [A],1,Voltage [V]"])
def test_names_among_numbers_are_names_of_which_one_is_missing(tmp_path, names):
    rows = FRAME.select(TIME, CURRENT, VOLTAGE).with_columns(pl.lit(1).alias("count"))
    said = refusal(tmp_path, f"{names}\n{rows.write_csv(include_header=False)}")
    assert "no column for the" in said
    assert "holds numbers" not in said


def test_a_first_row_of_numbers_and_gaps_is_counted_with_its_gaps(tmp_path):
    rows = FRAME.select(TIME, CURRENT, VOLTAGE).with_columns(pl.lit(1).alias("count"))
    said = refusal(tmp_path, f"Voltages,,,1\n{rows.write_csv(include_header=False)}")
    assert "no columns for the time, current" in said
    assert "holds numbers" not in said


@pytest.mark.parametrize("shared", [0, 3])
def test_signals_in_rows_of_their_own_are_to_be_joined_by_time(tmp_path, shared):
    times_s = np.sort(np.concatenate([TIMES, TIMES + 0.2]))
    amps, volts = (np.full(400, np.nan) for _ in range(2))
    amps[::2], volts[1::2] = AMPS, VOLTS
    volts[: 2 * shared : 2] = VOLTS[:shared]
    rows = pl.DataFrame({TIME: times_s, CURRENT: amps, VOLTAGE: volts}).fill_nan(None)
    said = refusal(tmp_path, rows)
    stand = f"{shared} rows only" if shared else "no row"
    assert f"'{VOLTAGE}' and '{CURRENT}' stand together in {stand}; join them by time" in said
    joined = rows.with_columns(pl.col(CURRENT).forward_fill()).filter(pl.col(VOLTAGE).is_not_null())
    obeyed = read(tmp_path, joined[shared:], current_sign="charge-positive")
    np.testing.assert_allclose(obeyed.current_a, -AMPS)


@pytest.mark.parametrize(
    ("name", "value"), [("Voltage(mV)", 0.2), ("Voltage / V", 2e-4), ("Voltage / V", 1e-6)]
)
def test_open_leads_are_no_kilovolts(tmp_path, name, value):
    table = FRAME.with_columns(pl.lit(value).alias(VOLTAGE)).rename({VOLTAGE: name}, strict=False)
    assert "no cell is connected" in refusal(tmp_path, table)
    kilovolts = FRAME.with_columns(pl.col(VOLTAGE) / 1000)
    assert "kilovolts, not volts" in refusal(tmp_path, kilovolts)


def ec_lab(**columns):
    names = "\t".join(columns)
    rows = "\n".join(
        "\t".join(f"{value:.7E}" for value in row) for row in zip(*columns.values(), strict=True)
    )
    return f"EC-Lab ASCII FILE\nNb header lines : 3\n{names}\n{rows}\n"


MODES = {"mode": np.ones(200), "ox/red": np.ones(200), "time/s": TIMES}


def test_the_sign_of_an_instrument_yields_to_clear_evidence_only(tmp_path):
    # In a hold the current decays while the voltage rises, and nothing else steps.
    decay = {"Ewe/V": np.r_[3.5, np.full(199, 3.6)], "I/mA": 1e3 * np.exp(-TIMES / 20)}
    record = read(tmp_path, ec_lab(**MODES, **decay), "cell.mpt", voltage_lag=0.0)
    assert record.sign.value == "charge-positive"
    assert not record.warnings
    turned = {"Ewe/V": VOLTS, "I/mA": -1e3 * AMPS}
    record = read(tmp_path, ec_lab(**MODES, **turned), "cell.mpt")
    assert record.sign.value == "discharge-positive"
    assert "promise" in " ".join(map(str, record.warnings))


@pytest.mark.parametrize("name", ["<Ewe>/V", "Ewe/V", "Ecell/V"])
def test_zero_volts_of_ec_lab_are_no_measurement(tmp_path, name):
    columns = {name: np.where(TIMES < 150, VOLTS, 0.0), "I/mA": 1e3 * AMPS}
    said = refusal(tmp_path, ec_lab(**MODES, **columns), "cell.mpt")
    assert (
        f"row 154: EC-Lab wrote 0 under '{name}' for a voltage that it did not record (50 rows)"
        in said
    )


def test_the_voltage_of_a_working_electrode_is_said_to_be_that(tmp_path):
    electrodes = {"Ewe/V": VOLTS, "Ece/V": np.full(200, 0.1), "I/mA": 1e3 * AMPS}
    says = "the voltage is 'Ewe/V', of the working electrode against the reference"
    of_mpr = read(tmp_path, ec_lab(**MODES, **electrodes), "cell.mpt")
    of_mpt = read(tmp_path, ec_lab(**MODES, **electrodes, **{"Ewe-Ece/V": VOLTS - 0.1}), "cell.mpt")
    for record in (of_mpr, of_mpt):
        require_the_record(record)
        assert says in " ".join(told(record))
    between = read_record(tmp_path / "cell.mpt", columns="voltage=Ewe-Ece/V")
    np.testing.assert_allclose(between.voltage_v, VOLTS - 0.1)
    both = read(tmp_path, ec_lab(**MODES, **electrodes, **{"<Ewe>/V": VOLTS}), "cell.mpt")
    assert says in " ".join(told(both))
    none = read(tmp_path, ec_lab(**MODES, **electrodes | {"Ece/V": np.zeros(200)}), "cell.mpt")
    assert says not in " ".join(told(none))


@needs_data
@pytest.mark.parametrize("share", [0.3, 0.5, 0.8])
@pytest.mark.parametrize("name", ["nda_v22.nda", "TestFile.nda", "2-1-6_61[07005012].nda"])
def test_rows_that_a_neware_file_has_lost_are_missed_by_its_counter(tmp_path, name, share):
    whole = (SHARED / "formats" / "neware" / name).read_bytes()
    at = int(len(whole) * share)
    damages = {
        "repeated": whole[:at] + whole[at : at + 97] + whole[at:],
        "zeros": whole[:at] + bytes(970) + whole[at + 970 :],
    }
    for content in damages.values():
        said = refusal(tmp_path, content, "cell.nda")
        assert "is damaged: by its own counter of rows, some are missing from row " in said
    if (name, share) == ("nda_v22.nda", 0.3):
        assert "from row 302 on" in refusal(tmp_path, damages["repeated"], "cell.nda")


def test_what_a_library_warns_of_is_told_once(tmp_path, monkeypatch, recwarn):
    fastnda = pytest.importorskip("fastnda")

    def read_with_warnings(path, cycle_mode):
        for _ in range(2):
            warnings.warn("this version has not been verified", UserWarning, stacklevel=1)
        table = pl.DataFrame(
            {"index": np.arange(1, 201), "total_time_s": TIMES, "voltage_V": VOLTS}
        )
        return table.with_columns(pl.Series("current_mA", 1e3 * AMPS))

    monkeypatch.setattr(fastnda, "read", read_with_warnings)
    record = read(tmp_path, b"NEWARE" + bytes(300), "cell.nda")
    says = "the library that reads this format warns: this version has not been verified"
    assert [says in str(one) for one in record.warnings] == [True]
    assert not recwarn.list


SAMPLES = [f"{t},{a},{v}" for t, a, v in zip(TIMES, AMPS, VOLTS, strict=True)]


@pytest.mark.parametrize(
    "cycle", ["Cycle ID,Cap_Chg(mAh),Cap_DChg(mAh)", "Cycle-Index,CapC(mAh),CapD(mAh)"]
)
def test_the_records_of_a_nested_report_are_read_below_its_cycles_and_steps(tmp_path, cycle):
    names = [cycle, ",Step ID,Step Name", ",,Record ID,Time(s),Current(A),Voltage(V)"]
    rows = [f",,{k},{row}" for k, row in enumerate(SAMPLES, 1)]
    path = tmp_path / "nested.csv"
    path.write_text("\n".join([*names, "1,0,100", ",1,Rest", *rows]) + "\n")
    require_the_record(read_record(path))


def test_a_line_on_an_impedance_above_the_names_is_no_spectrum(tmp_path):
    above = "Cell,A1\nImpedance [mOhm],0.52,Frequency [Hz],1000\n"
    path = tmp_path / "above.csv"
    path.write_text(above + "\n".join([f"{TIME},{CURRENT},{VOLTAGE}", *SAMPLES]) + "\n")
    require_the_record(read_record(path))


def test_a_voltage_of_another_name_beside_an_impedance_is_asked_for(tmp_path):
    path = tmp_path / "named.csv"
    rows = [f"{row},1000,20" for row in SAMPLES]
    names = f"{TIME},{CURRENT},Zelle,Frequency [Hz],Impedance [mOhm]"
    path.write_text("\n".join([names, *rows]) + "\n")
    with pytest.raises(InputError, match="no column for the voltage"):
        read_record(path)
    require_the_record(read_record(path, columns="voltage=Zelle:V"))


def test_a_page_of_names_beside_a_sheet_without_is_not_taken_for_the_record(tmp_path):
    path = tmp_path / "cover.xlsx"
    sheets = {"Info": [["Test", "Operator"], ["a", "b"]], "Data": [["x"], ["1"], ["2"]]}
    path.write_bytes(workbook(sheets))
    with pytest.raises(InputError, match="Sheets found: Info: Test, Operator; Data: x"):
        read_record(path)


def test_a_name_for_two_quantities_is_refused_with_its_file(tmp_path):
    path = tmp_path / "two.csv"
    path.write_text("\n".join([f"{TIME},{CURRENT},{VOLTAGE}", *SAMPLES]) + "\n")
    with pytest.raises(InputError, match=r"two\.csv: `columns`: 'Voltage / V' is given for"):
        read_record(path, columns=f"current={VOLTAGE},voltage={VOLTAGE}")

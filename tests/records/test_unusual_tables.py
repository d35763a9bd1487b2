"""Tables as computers and hands leave them: read as they are meant, or refused with the reason."""

import numpy as np
import polars as pl
import pytest

from helpers.records import CURRENT, TIME, VOLTAGE, changed, pulse_frame, read, refusal, told

FRAME = pulse_frame(120).with_columns(pl.col(VOLTAGE).round(4))
TRUTH = {name: FRAME[name].to_numpy() for name in FRAME.columns}


def require_the_record(record):
    np.testing.assert_array_equal(record.time_s, TRUTH[TIME])
    np.testing.assert_allclose(record.current_a, -TRUTH[CURRENT], atol=1e-12)
    np.testing.assert_allclose(record.voltage_v, TRUTH[VOLTAGE], atol=1e-12)


# Names and digits behind the decimal commas of time, current and voltage.
SPLIT = {
    "voltage": ("step,time,current,voltage", (None, 0, 0, 4)),
    "voltage, and nothing before it": ("time,current,voltage", (0, 0, 4)),
    "current": ("time,voltage,current", (0, 0, 1)),
    "time": ("time,current,voltage", (1, 0, 0)),
    "current and voltage": ("time,current,voltage", (0, 2, 4)),
    "all": ("time,current,voltage", (1, 1, 4)),
    "of numbers with exponents": ("time,current,voltage", (0, "E", 4)),
}


def spelled(value, places):
    form = f"{value:.2E}" if places == "E" else f"{value:.{places}f}"
    return form.replace(".", ",")


@pytest.mark.parametrize("kind", SPLIT)
def test_decimal_commas_that_split_cells_are_told(tmp_path, kind):
    names, digits = SPLIT[kind]
    values = {"time": np.arange(1, 121) * 1.5, "current": np.tile([1.0, 0.0], 60)}
    values["voltage"] = 3.2 + 0.05 * values["current"]
    lines = [
        ",".join(
            "1" if places is None else spelled(values[name][k], places)
            for name, places in zip(names.split(","), digits, strict=True)
        )
        for k in range(120)
    ]
    said = refusal(tmp_path, "\n".join([names, *lines]))
    assert "cell.csv: row 2: the rows have more cells than the" in said
    assert "export it with semicolons" in said


def test_a_remark_or_a_number_behind_the_cells_splits_none(tmp_path):
    for behind in (",ok", ",25.0", ",25"):
        require_the_record(read(tmp_path, FRAME.write_csv().replace("\n", f"{behind}\n")[:-1]))
        text = FRAME.write_csv().replace("\n", f"{behind}\n").replace(behind, "", 1)
        require_the_record(read(tmp_path, text))


@pytest.mark.parametrize("end", ["\n", "\r\n", ";;\r\n"])
def test_lines_quoted_whole_are_the_lines(tmp_path, end):
    lines = ["[Summary]", "Cell: 7", "[Data]", *FRAME.write_csv().splitlines()]
    lines[3] = lines[3].replace(CURRENT, f'""{CURRENT}""')
    record = read(tmp_path, "".join(f'"{line}"{end}' for line in lines))
    require_the_record(record)
    assert record.row[0] == 5


JAPANESE = ("経過時間[s]", "電流(A)", "電圧［V］", "状態", "放電", "充電", "休止")
ENCODED = {
    "euc_jp": JAPANESE,
    "utf-16-le": JAPANESE,
    "utf-16-be": (
        "Zeit",
        "Strom",
        "Spannung",
        "Modus",
        "Entladevorgang",
        "Ladevorgang",
        "Ruhephase",
    ),
    "shift_jis": JAPANESE,
    "cp949": ("시간(s)", "전류(A)", "전압(V)", "상태", "방전", "충전", "휴지"),
    "gb18030": ("时间(s)", "电流(A)", "电压(V)", "状态", "放电", "充电", "静置"),
    "big5": ("測試時間(s)", "電流(A)", "電壓(V)", "狀態", "放電", "充電", "靜置"),
    "latin-1": ("Zeit[s]", "Strom[A]", "Spannung[V]", "Zustand", "Entladung", "Ladung", "Ruhe"),
}


@pytest.mark.parametrize("encoding", ENCODED)
def test_a_text_of_another_encoding_says_the_same(tmp_path, encoding):
    *names, state, discharge, charge, rest = ENCODED[encoding]
    word = {1: charge, -1: discharge, 0: rest}
    words = [word[sign] for sign in np.sign(TRUTH[CURRENT]).astype(int).tolist()]
    table = FRAME.with_columns(pl.col(CURRENT).abs(), pl.Series(state, words))
    table.columns = [*names, state]
    record = read(tmp_path, table.write_csv().encode(encoding))
    require_the_record(record)
    assert set(record.state) == {-1, 0, 1}


def test_codes_of_a_state_are_left_out_and_told_as_such(tmp_path):
    codes = np.where(TRUTH[CURRENT] == 0, 0, np.where(TRUTH[CURRENT] > 0, 1, 2))
    record = read(tmp_path, FRAME.with_columns(pl.Series("State", codes)))
    require_the_record(record)
    assert record.state is None
    assert "the numbers under 'State' are codes without words" in " ".join(told(record))


def test_a_slip_of_a_millisecond_is_put_in_order(tmp_path):
    late = read(tmp_path, changed(FRAME, TIME, [59 - 0.0015], [60]))
    require_the_record(late)
    assert "row 62: time falls by 1.5 ms (1 place)" in " ".join(told(late))
    last = read(tmp_path, changed(FRAME, TIME, [118 - 0.0015], [119]))
    require_the_record(last)
    # One that goes back by more is out of line.
    assert "time is out of line" in refusal(tmp_path, changed(FRAME, TIME, [58.5], [60]))


def test_both_sides_of_a_step_in_the_wrong_order_stay_close(tmp_path):
    table = pl.concat([FRAME[:60], FRAME[59:]])
    record = read(tmp_path, changed(table, TIME, [59 - 0.0015], [60]))
    assert record.samples == 121
    assert 0 < record.time_s[60] - record.time_s[59] < 1e-3


@pytest.mark.parametrize("seed", [1, 2])
def test_rows_out_of_order_are_sorted_by_what_counts_them(tmp_path, seed):
    order = {"fraction": 1, "shuffle": True, "seed": seed}
    counted = FRAME.with_columns(pl.Series("Record", np.arange(7, 127))).sample(**order)
    record = read(tmp_path, counted)
    require_the_record(record)
    assert "they are sorted by 'Record'" in " ".join(told(record))
    assert "sort the rows by time" in refusal(tmp_path, FRAME.sample(**order))


def test_the_newest_row_first_is_turned_around(tmp_path):
    record = read(tmp_path, FRAME.reverse())
    require_the_record(record)
    assert "the newest row comes first" in " ".join(told(record))


@pytest.mark.parametrize("filled", [None, 0.0])
def test_columns_of_impedance_without_a_frequency_are_no_spectrum(tmp_path, filled):
    empty = {name: pl.Series([filled] * 120, dtype=pl.Float64) for name in ("Freq", "Re", "-Im")}
    require_the_record(read(tmp_path, FRAME.with_columns(**empty)))
    spectrum = FRAME.with_columns(**empty).with_columns(Freq=pl.lit(10.0))
    assert "an impedance spectrum" in refusal(tmp_path, spectrum)
    measured = [10.0] * 20 + [filled] * 100
    mixed = FRAME.with_columns(**empty).with_columns(Freq=pl.Series(measured, dtype=pl.Float64))
    record = read(tmp_path, mixed)
    assert record.samples == 100
    assert "20 rows of an impedance measurement" in " ".join(told(record))


def test_all_missing_columns_are_told_at_once(tmp_path):
    said = refusal(tmp_path, FRAME.rename({CURRENT: "Amp drawn", VOLTAGE: "U_cell in V"}))
    assert "no columns for the current, voltage" in said
    assert "'current=NAME:UNIT,voltage=NAME:UNIT'" in said


@pytest.mark.parametrize("rows", [slice(0, 1), slice(0, 3), slice(60, 61), slice(119, 120)])
@pytest.mark.parametrize("value", [0.0, -0.0, 1e-5])
def test_no_voltage_is_told_wherever_it_stands(tmp_path, rows, value):
    volts = TRUTH[VOLTAGE].copy()
    volts[rows] = value
    record = read(tmp_path, FRAME.with_columns(pl.Series(VOLTAGE, volts)))
    (outside,) = [each for each in record.warnings if each.code == "voltage-unit.outside"]
    assert (outside.row, outside.values["samples"]) == (rows.start + 2, rows.stop - rows.start)

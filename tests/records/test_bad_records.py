"""Each bad file has a message that names file, place, value and remedy."""

import numpy as np
import polars as pl
import pytest

from barnax.errors import InputError
from barnax.records import read_record

from .synthetic_records import arbin_rows, pulse_frame, workbook


def refusal(path, **options):
    with pytest.raises(InputError) as caught:
        read_record(path, **options)
    return str(caught.value)


def csv(folder, frame, name="cell.csv"):
    frame.write_csv(folder / name)
    return folder / name


def with_cell(frame, column, line, value):
    values = frame[column].to_list()
    values[line] = value
    return frame.with_columns(pl.Series(column, values, strict=False))


def test_a_missing_column_is_named_with_candidates_and_accepted_names(tmp_path):
    frame = pulse_frame().rename({"Current / A": "Current (C-rate)"})
    message = refusal(csv(tmp_path, frame))
    assert "cell.csv: no column for current." in message
    assert "Test Time / s, Current (C-rate), Voltage / V" in message
    assert "Likely candidates for the current: 'Current (C-rate)'" in message
    assert "'current_ampere'" in message
    assert "Rename the columns" in message


def test_a_row_with_nan_is_named_by_its_row_and_column(tmp_path):
    message = refusal(csv(tmp_path, with_cell(pulse_frame(), "Voltage / V", 40, float("nan"))))
    assert "cell.csv: row 42: 'NaN' stands under 'Voltage / V'" in message
    assert "delete the row" in message


def test_an_empty_cell_is_named_by_its_row_and_column(tmp_path):
    path = tmp_path / "cell.parquet"
    with_cell(pulse_frame(), "Current / A", 7, None).write_parquet(path)
    assert "cell.parquet: row 9: nothing stands under 'Current / A'" in refusal(path)


def test_a_word_among_the_numbers_is_quoted(tmp_path):
    path = tmp_path / "cell.csv"
    lines = pulse_frame().write_csv().splitlines()
    lines[5] = "4.0,OVERFLOW,3.7"
    path.write_text("\n".join(lines))
    assert "cell.csv: row 6: 'OVERFLOW' stands under 'Current / A'" in refusal(path)


def test_a_row_cut_off_at_the_end_of_the_file_is_named(tmp_path):
    path = tmp_path / "cell.csv"
    path.write_text(pulse_frame(20).write_csv() + "20.0,-0.1")
    assert "row 22: nothing stands under 'Voltage / V'" in refusal(path)


def test_time_running_backwards_is_named_with_row_and_values(tmp_path):
    message = refusal(csv(tmp_path, with_cell(pulse_frame(), "Test Time / s", 50, 12.5)))
    assert "cell.csv: row 52: time runs backwards, from 49 s to 12.5 s" in message
    assert "Sort the rows by time" in message


def test_two_values_at_one_time_are_named_with_row_and_values(tmp_path):
    frame = with_cell(pulse_frame(), "Test Time / s", 5, 4.0)
    message = refusal(csv(tmp_path, frame))
    assert "cell.csv: row 7: time 4 s stands twice with different values" in message
    assert "delete one" in message


@pytest.mark.parametrize("rate_a", [1.0, 2.0, 4.0])
def test_milliamperes_under_an_ampere_name_are_refused(tmp_path, rate_a):
    frame = pulse_frame().with_columns(pl.col("Current / A") * 1000 * rate_a)
    message = refusal(csv(tmp_path, frame))
    assert "looks like milliamperes" in message
    assert "rename the column to 'Current / mA'" in message
    assert "row " in message


def test_a_slow_sweep_in_milliamperes_is_refused_by_its_ampere_hours(tmp_path):
    hours = np.linspace(0, 20, 2000)
    frame = pl.DataFrame(
        {"Time [s]": hours * 3600, "Current [A]": 0 * hours - 100, "Voltage [V]": 4.1 - hours / 20}
    )
    assert "moves 1999 Ah one way" in refusal(csv(tmp_path, frame))


def test_counters_that_disagree_a_thousandfold_betray_milliamperes(tmp_path):
    frame = pulse_frame(400)
    header, *rows = arbin_rows(frame)
    table = pl.DataFrame(rows, schema=header, orient="row")
    table = table.with_columns(pl.col("Current(A)") * 100 * 10)
    assert "the tester's own ampere-hours" in refusal(csv(tmp_path, table))


@pytest.mark.parametrize("peak_a", [91.8, 300.0, 450.0])
def test_a_large_cell_at_full_load_is_no_milliampere_file(tmp_path, peak_a):
    frame = pulse_frame().with_columns(pl.col("Current / A") * (peak_a / 2))
    assert np.abs(read_record(csv(tmp_path, frame)).current_a).max() == pytest.approx(peak_a)


def test_millivolts_under_a_volt_name_are_refused(tmp_path):
    frame = pulse_frame().with_columns(pl.col("Voltage / V") * 1000)
    message = refusal(csv(tmp_path, frame))
    assert "looks like millivolts" in message
    assert "rename the column to 'Voltage / mV'" in message


def test_the_voltage_of_a_module_is_refused(tmp_path):
    frame = pulse_frame().with_columns(pl.col("Voltage / V") * 12)
    assert "too much for one cell" in refusal(csv(tmp_path, frame))


def test_a_reversed_voltage_is_refused(tmp_path):
    frame = pulse_frame().with_columns(-pl.col("Voltage / V"))
    assert "the sense leads were swapped" in refusal(csv(tmp_path, frame))


def test_a_column_of_dates_asks_for_plain_numbers(tmp_path):
    frame = pulse_frame().with_columns(pl.lit("2020-01-01 00:00:00").alias("Test Time / s"))
    message = refusal(csv(tmp_path, frame))
    assert "row 2: '2020-01-01 00:00:00' stands under 'Test Time / s'" in message
    assert "plain numbers in s" in message


def test_a_parquet_column_of_durations_is_no_number(tmp_path):
    seconds = pl.duration(seconds=pl.col("Test Time / s")).alias("Test Time / s")
    pulse_frame().with_columns(seconds).write_parquet(tmp_path / "cell.parquet")
    assert "plain numbers in s" in refusal(tmp_path / "cell.parquet")


def test_a_long_header_is_shortened_in_the_message(tmp_path):
    (tmp_path / "cell.csv").write_text("<td>nothing</td> " * 500 + "\n1\n")
    assert len(refusal(tmp_path / "cell.csv")) < 1500


def test_a_single_impossible_voltage_is_named_by_its_row(tmp_path):
    message = refusal(csv(tmp_path, with_cell(pulse_frame(), "Voltage / V", 9, 6553.5)))
    assert "row 11: 6553.5 V in 'Voltage / V'" in message


def test_a_record_of_nothing_but_rest_is_refused(tmp_path):
    frame = pulse_frame().with_columns(pl.col("Current / A") * 0)
    assert "every current in 'Current / A' is zero" in refusal(csv(tmp_path, frame))


def test_a_record_of_few_samples_is_refused(tmp_path):
    assert "holds 9 samples" in refusal(csv(tmp_path, pulse_frame(9)))


def test_a_header_without_samples_is_refused(tmp_path):
    assert "no samples below" in refusal(csv(tmp_path, pulse_frame(10)[:0]))


@pytest.mark.parametrize("content", [b"", b"\n\n  \n"])
def test_an_empty_file_is_refused(tmp_path, content):
    path = tmp_path / "empty.csv"
    path.write_bytes(content)
    assert "empty.csv: the file is empty" in refusal(path)


def test_a_directory_is_refused(tmp_path):
    assert "is a directory; give one file" in refusal(tmp_path)


def test_a_name_too_long_for_any_file_is_refused(tmp_path):
    assert "x.csv: cannot be read (File name too long)" in refusal(tmp_path / f"{300 * 'x'}.csv")


def test_a_missing_file_is_refused(tmp_path):
    assert "nowhere.csv: there is no such file" in refusal(tmp_path / "nowhere.csv")


@pytest.mark.parametrize(
    "content",
    [
        bytes(range(256)) * 20,
        b"\x89PNG\r\n\x1a\n" + bytes(100),
        b"PK\x03\x04" + bytes(100),
        b"\x01\x02\x03\x04 without a zero byte\n" * 10,
    ],
)
def test_a_binary_file_named_csv_is_refused(tmp_path, content):
    path = tmp_path / "cell.csv"
    path.write_bytes(content)
    message = refusal(path)
    assert "cell.csv" in message
    assert "suffix says" in message


def test_a_parquet_file_cut_short_is_refused(tmp_path):
    path = tmp_path / "cell.parquet"
    pulse_frame().write_parquet(path)
    path.write_bytes(path.read_bytes()[:-40])
    assert "the Parquet file is damaged" in refusal(path)


@pytest.mark.parametrize("name", ["cell.xlsx", "cell.xls"])
def test_a_workbook_cut_short_is_refused(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(workbook({"Channel_1-001": arbin_rows(pulse_frame())})[:-200])
    assert "the workbook is damaged" in refusal(path)


def test_a_damaged_workbook_of_the_old_kind_is_refused(tmp_path):
    path = tmp_path / "cell.xls"
    path.write_bytes(b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + bytes(600))
    assert "the workbook is damaged" in refusal(path)


def test_a_workbook_without_a_record_lists_its_sheets(tmp_path):
    path = tmp_path / "cell.xlsx"
    path.write_bytes(workbook({"Info": [["TEST REPORT"], [1.0]], "Notes": []}))
    message = refusal(path)
    assert "no sheet has columns for time, current and voltage" in message
    assert "Info: TEST REPORT; Notes: empty" in message


def test_a_workbook_that_lacks_one_column_has_it_named(tmp_path):
    frame = pulse_frame(20).rename({"Current / A": "Strom (A)"})
    path = tmp_path / "cell.xlsx"
    rows = [frame.columns, *map(list, frame.rows())]
    path.write_bytes(workbook({"Info": [["TEST REPORT"]], "data": rows}))
    message = refusal(path)
    assert "no column for current" in message
    assert "Likely candidates for the current: 'Strom (A)'" in message


def test_a_workbook_of_two_channels_is_refused(tmp_path):
    rows = arbin_rows(pulse_frame())
    path = tmp_path / "cell.xlsx"
    path.write_bytes(workbook({"Channel_1-001": rows, "Channel_1-002": rows}))
    assert "2 channels" in refusal(path)


def test_a_workbook_of_two_plain_records_is_refused(tmp_path):
    frame = pulse_frame(20)
    rows = [frame.columns, *map(list, frame.rows())]
    path = tmp_path / "cell.xlsx"
    path.write_bytes(workbook({"first": rows, "second": rows}))
    assert "several sheets could be the record (first, second)" in refusal(path)


def test_a_bad_row_on_a_later_sheet_names_the_sheet(tmp_path):
    rows = arbin_rows(pulse_frame())
    second = [rows[0], *rows[101:]]
    second[30] = [*second[30][:5], "fault", *second[30][6:]]
    path = tmp_path / "cell.xlsx"
    path.write_bytes(workbook({"Channel_1-001": rows[:101], "Channel_1-001_2": second}))
    assert "row 31 of sheet 'Channel_1-001_2': 'fault' stands under 'Voltage(V)'" in refusal(path)


@pytest.mark.parametrize("given", ["charge-positive", "discharge-positive"])
def test_a_sign_given_against_strong_evidence_is_refused(tmp_path, given):
    path = csv(tmp_path, pulse_frame(charge_positive=given == "discharge-positive"))
    message = refusal(path, current_sign=given)
    found = read_record(path).sign.value
    assert given != found
    assert f"given as {given}, but the data are {found}" in message
    assert "--current-sign" in message
    assert "steps" in message


@pytest.mark.parametrize("option", ["current_sign", "current_hold"])
def test_an_unknown_option_value_is_refused_with_the_allowed_ones(tmp_path, option):
    message = refusal(csv(tmp_path, pulse_frame()), **{option: "sideways"})
    assert "'sideways'" in message
    assert "auto" in message

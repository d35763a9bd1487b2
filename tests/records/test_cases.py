"""The shared cases of small files that were read wrongly once, against their own truth."""

import json

import numpy as np
import pytest

from barnax import check_file, read_record
from helpers.records import refusal, remarks
from helpers.shared import CASES, SHARED, needs_cases, needs_data

FILES = CASES / "files"
# Tables that are read, and with what.
TABLES = {
    "mb_with_spectrum_comma.mpt": {},
    "ca_hold.mpt": {},
    "cr_lines_last_crlf.csv": {},
    "soc_beside_named_time.csv": {"columns": "time=t_vec:s"},
    "vrm_three_header_rows.csv": {"columns": "time=Europe/Berlin (+01:00)", "series": 4},
}
# Clocks and counters that are read, and what is said of them.
CLOCKS = {
    "time_ms_no_unit.csv": "'Time' has no unit, and is taken in milliseconds",
    "timestamp_us.csv": "'timestamp' has no unit, and is taken in microseconds",
    "time_excel_serial.csv": "its numbers are dates, as Excel days",
    "iso_offset_spring.csv": "time is taken from the date",
    "dst_autumn_no_offset.csv": "the end of summer time",
    "twelve_hour_clock.csv": "a clock of twelve hours",
    "bdf_zero_clock.bdf.csv": "is 0 in 12 rows between good values: left out",
    "capacity_mAh_countdown.csv": "'capacity' is taken in milliampere-hours",
}
# What would be wrong of any of them.
NEVER = ("sort the rows", "starts again", "milliamperes, not amperes", "times the current")


def truth_of(name):
    files = json.loads((FILES / "truth.json").read_text())["files"]
    (truth,) = [one for one in files if one["file"] == name]
    return truth


@needs_cases
@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_read_as_it_is(name):
    truth, series = truth_of(name), TABLES[name].get("series", 1)
    record = read_record(FILES / name, voltage_lag=0.0, **TABLES[name])
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
@pytest.mark.parametrize("name", CLOCKS)
def test_a_clock_is_read_with_its_span_and_what_was_odd_is_said(name):
    truth = truth_of(name)
    span_s = truth.get("t_last_s", 636.0) - truth.get("t_first_s", 0.0)
    record = read_record(FILES / name)
    assert np.ptp(record.time_s) == pytest.approx(span_s, rel=1e-6)
    words = " ".join((*remarks(record), *map(str, check_file(FILES / name).findings)))
    assert CLOCKS[name] in words
    assert not [phrase for phrase in NEVER if phrase in words]


@needs_cases
def test_seconds_since_a_start_are_no_days():
    one, other = (
        read_record(CASES / "systems" / f"{name}.csv") for name in ("timestamp_s", "time_s")
    )
    np.testing.assert_array_equal(one.time_s, other.time_s)


@needs_cases
def test_a_wrong_count_of_cells_in_series_is_said_and_the_one_that_fits():
    file = CASES / "cells" / "09_wrong_series" / "pack.csv"
    words = " ".join(map(str, read_record(file, series=192).warnings))
    assert "no known lithium-ion cell" in words
    assert "with 144 to 147, cells would have" in words
    assert "in series" not in " ".join(map(str, read_record(file, series=144).warnings))


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
        said = refusal(tmp_path, content)
        assert "is damaged: by its own counter of rows, some are missing from row " in said
    if (name, share) == ("nda_v22.nda", 0.3):
        assert "from row 302 on" in refusal(tmp_path, damages["repeated"])

"""Files that cannot be used: exit status 2, a message to act on, nothing written."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from barnax.bundled import BUNDLED

from .conftest import BUDGET, OCV

TIME, CURRENT, VOLTAGE = "Test Time / s", "Current / A", "Voltage / V"


def inputs(samples: int = 2000) -> pl.DataFrame:
    return pl.read_parquet(BUNDLED.record).head(samples)


def changed(column: str, line: int, value: float) -> pl.DataFrame:
    frame = inputs()
    values = frame[column].to_numpy().copy()
    values[line] = value
    return frame.with_columns(pl.Series(column, values))


def no_current(path: Path) -> None:
    inputs().drop(CURRENT).write_csv(path)


def nan_row(path: Path) -> None:
    changed(VOLTAGE, 98, np.nan).write_csv(path)


def backward_time(path: Path) -> None:
    changed(TIME, 98, 3.5).write_csv(path)


def milliamperes(path: Path) -> None:
    inputs().with_columns(pl.col(CURRENT) * 1000).write_csv(path)


def nothing(path: Path) -> None:
    path.write_bytes(b"")


def header_alone(path: Path) -> None:
    inputs(0).write_csv(path)


def zero_voltage(path: Path) -> None:
    changed(VOLTAGE, 98, 0.0).write_csv(path)


def folder(path: Path) -> None:
    path.mkdir()


def noise(path: Path) -> None:
    path.write_bytes(np.random.default_rng(0).bytes(4096))


def not_there(path: Path) -> None:
    """Writes nothing."""


BAD_FILES = {
    no_current: ("no column for current", "Rename the columns"),
    nan_row: ("row 100: 'NaN' stands under 'Voltage / V'", "delete the row"),
    backward_time: ("row 100: time runs backwards, from 97 s to 3.5 s", "Sort the rows by time"),
    milliamperes: ("looks like milliamperes", "rename the column to 'Current / mA'"),
    nothing: ("empty", "give"),
    header_alone: ("no samples", "give the file with its data"),
    folder: ("is a directory", "give one file"),
    noise: ("the content is binary", "Export the record as one of them"),
    not_there: ("no such file", "check the name"),
}


@pytest.mark.parametrize("make", BAD_FILES, ids=lambda make: make.__name__)
@pytest.mark.parametrize("role", ["record", "ocv", "validate"])
def test_a_bad_file_is_refused_in_every_role(refuse, tmp_path, role, make):
    bad = tmp_path / "cell.csv"
    make(bad)
    words = {
        "record": (bad, *OCV),
        "ocv": (BUNDLED.record, "--ocv", bad),
        "validate": (BUNDLED.record, *OCV, "--validate", bad),
    }[role]
    message = refuse("identify", *words, *BUDGET)
    assert message.startswith("error: ")
    for part in ("cell.csv", *BAD_FILES[make]):
        assert part in message


@pytest.mark.parametrize("role", ["record", "ocv", "validate"])
def test_a_name_too_long_for_a_file_is_refused_in_every_role(refuse, role):
    name = 300 * "x"
    words = {
        "record": (name, *OCV),
        "ocv": (BUNDLED.record, "--ocv", name),
        "validate": (BUNDLED.record, *OCV, "--validate", name),
    }[role]
    assert f"{name}: cannot be read (File name too long)" in refuse("identify", *words, *BUDGET)


@pytest.mark.parametrize("role", ["record", "validate"])
def test_a_sample_of_zero_volts_is_refused_before_the_search(refuse, tmp_path, role):
    zero_voltage(tmp_path / "cell.csv")
    words = {
        "record": ("cell.csv", *OCV),
        "validate": (BUNDLED.record, *OCV, "--validate", "cell.csv"),
    }[role]
    message = refuse("identify", *words, *BUDGET, "--seeds", "100000")
    assert "cell.csv: row 100 is scored at 0 V" in message
    assert "delete the row, or leave it out with --score-from" in message


@pytest.mark.parametrize(
    ("option", "name"),
    [
        ("--current-sign", "identification.parquet"),
        ("--ocv-current-sign", "ocv_charge.parquet"),
        ("--validate-current-sign", "validation.parquet"),
    ],
)
def test_a_sign_against_the_data_is_refused_with_the_evidence(refuse, option, name):
    message = refuse("identify", *BUDGET, option, "discharge-positive")
    assert f"{name}: the sign was given as discharge-positive" in message
    assert "the voltage rises with the current at" in message
    assert "Leave --current-sign at auto, or give charge-positive" in message


def test_an_ocv_test_without_rests_is_refused(refuse, tmp_path):
    discharge = pl.read_parquet(BUNDLED.ocv[1])
    moving = discharge.filter(pl.col(CURRENT).abs() > 0.02)
    even = moving.with_columns(pl.Series(TIME, np.arange(len(moving)) * 2.0))
    even.write_csv(tmp_path / "no_rests.csv")
    message = refuse("identify", BUNDLED.record, "--ocv", "no_rests.csv", *BUDGET)
    assert "no_rests.csv is not an OCV test: it has no rests" in message
    assert "needs rests of at least 30 min" in message


def test_a_drive_record_given_as_the_ocv_test_is_refused(refuse):
    message = refuse("identify", BUNDLED.record, "--ocv", BUNDLED.validation, *BUDGET)
    assert "validation.parquet" in message
    assert "OCV test" in message


@pytest.mark.parametrize("capacity_ah", ["0.2", "20", "2000"])
def test_a_capacity_off_by_a_factor_is_refused_with_the_measured_charge(refuse, capacity_ah):
    message = refuse("identify", *BUDGET, "--capacity", capacity_ah)
    assert f"capacity {capacity_ah} Ah was given, but the OCV test passed 2.006 Ah" in message
    assert "leave --capacity out" in message


def test_samples_scored_far_outside_the_ocv_are_refused_by_row(refuse):
    message = refuse("identify", *BUDGET, "--initial-soc", "0.02")
    assert "identification.parquet: row " in message
    assert "the OCV points span only 0.000 to 1.000" in message
    assert "check --capacity (2 Ah) and --initial-soc" in message


def test_a_validation_record_outside_the_ocv_is_refused_before_the_search(refuse, tmp_path):
    low = pl.read_parquet(BUNDLED.validation)
    low.with_columns(pl.col(CURRENT) - 8.0).write_csv(tmp_path / "deep.csv")
    words = (BUNDLED.record, *OCV, "--validate", "deep.csv", "--seeds", "100000")
    message = refuse("identify", *words, "--score-to", "1500", "--initial-soc", "0.9")
    assert "deep.csv: row " in message
    assert "is scored at a state of charge of" in message


def test_a_bracket_in_a_file_name_is_shown_as_it_is(refuse, tmp_path):
    nan_row(tmp_path / "cell [v2].csv")
    assert "error: cell [v2].csv: row 100" in refuse("identify", "cell [v2].csv", *OCV, *BUDGET)

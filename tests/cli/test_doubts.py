"""A run says what barnax check would have said of its files, before it is believed."""

import numpy as np
import pytest

from barnax.bundled import BUNDLED
from barnax.cli.doubts import warn_of_doubts
from barnax.cli.inputs import Files
from barnax.cli.session import Session
from barnax.records import read_record


@pytest.fixture
def told(capsys, tmp_path):
    """What is warned of for a file of these columns, as the record to identify on."""

    def warnings(time, current_a, voltage_v, header="time,current,voltage", **settings):
        path = tmp_path / "drive.csv"
        np.savetxt(
            path, np.column_stack([time, current_a, voltage_v]), delimiter=",", header=header,
            comments="",
        )  # fmt: skip
        files = Files([path], [*BUNDLED.ocv], [], "auto", "auto", "auto", "auto")
        warn_of_doubts(Session(is_quiet=True), files, None, **{"has_window": True} | settings)
        return capsys.readouterr().err

    return warnings


@pytest.fixture(scope="module")
def measured():
    return read_record(BUNDLED.record)


def test_a_sound_record_is_in_no_doubt(told, measured):
    assert told(measured.time_s, -measured.current_a, measured.voltage_v) == ""


def test_a_current_without_a_sign_is_an_error_of_the_file(told, measured):
    assert "barnax check: drive.csv:" in told(
        measured.time_s, np.abs(measured.current_a), measured.voltage_v
    )


def test_a_slow_sweep_is_no_record_to_identify_on(told):
    time_s = np.arange(0.0, 72_000.0, 30.0)
    current_a = np.where((time_s > 600) & (time_s < 70_000), -0.1, 0.0)
    said = told(time_s, current_a, 4.18 - 1.2 * np.cumsum(-current_a) / 240)
    assert "drive.csv is not fit for identification" in said


def test_the_bundled_cell_is_not_looked_at(capsys):
    files = Files([BUNDLED.record], [*BUNDLED.ocv], [], "auto", "auto", "auto", "auto")
    warn_of_doubts(Session(is_quiet=True), files, None, has_window=False)
    assert capsys.readouterr().err == ""


def test_a_window_is_proposed_where_none_is_given(real_data, capsys):
    (path,) = real_data.glob("calce*/us06_25degC_80soc*.parquet")
    for has_window in (False, True):
        files = Files([path], [*BUNDLED.ocv], [], "auto", "auto", "auto", "auto")
        warn_of_doubts(Session(is_quiet=True), files, 2.0, has_window=has_window)
        said = " ".join(capsys.readouterr().err.split())
        assert ("--start-after-step 3 --initial-soc 1 --score-steps 7,8" in said) != has_window

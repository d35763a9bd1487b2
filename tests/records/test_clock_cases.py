"""Times as loggers, phones and scripts write them: read, or refused by the right name."""

import json
from pathlib import Path

import numpy as np
import pytest

import barnax
from barnax import InputError
from barnax.records import read_record

CASES = Path(__file__).parents[3] / "shared" / "cases"
needs_cases = pytest.mark.skipif(not CASES.is_dir(), reason="the shared cases are not here")
SECONDS = np.arange(160) * 4.0


def frame(name, values):
    """A load that switches, and a voltage that answers: the unit of the time is all that varies."""
    current_a = np.where(np.arange(160) // 20 % 2, -1.0, 0.0)
    return {name: values, "Current [A]": current_a, "Voltage [V]": 3.9 + 0.05 * current_a}


def time_of(name, values):
    record = barnax.record_from_frame(frame(name, values))
    return record.time_s - record.time_s[0], [one.code for one in record.warnings]


@pytest.mark.parametrize(
    ("unit", "factor"),
    [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9), ("min", 1 / 60), ("h", 1 / 3600)],
)
def test_a_unit_that_is_named_is_taken(unit, factor):
    time_s, codes = time_of(f"Time [{unit}]", SECONDS * factor)
    np.testing.assert_allclose(time_s, SECONDS, rtol=1e-9)
    assert codes == []


@pytest.mark.parametrize("start_s", [1.0e9, 1.7e9])
@pytest.mark.parametrize("factor", [1.0, 1e3, 1e6, 1e9])
def test_unix_times_tell_their_unit_by_their_size(start_s, factor):
    time_s, _ = time_of("timestamp", (start_s + SECONDS) * factor)
    np.testing.assert_allclose(time_s, SECONDS, atol=1e-5)


def test_days_of_a_spreadsheet_are_dates_and_a_time_since_a_start_is_none():
    np.testing.assert_allclose(
        time_of("DateTime", 45352.4 + SECONDS / 86400)[0], SECONDS, atol=1e-4
    )
    np.testing.assert_allclose(time_of("timestamp_s", SECONDS)[0], SECONDS)


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "ms"), (1e6, "us"), (1e9, "ns")])
def test_a_time_without_a_unit_is_never_seconds_that_no_logger_waits(factor, unit):
    with pytest.raises(InputError, match=rf"'Time' looks like .*columns='time=Time:{unit}'"):
        time_of("Time", SECONDS * factor)
    # What the message asks for is right.
    record = barnax.record_from_frame(frame("Time", SECONDS * factor), columns=f"time=Time:{unit}")
    np.testing.assert_allclose(record.time_s - record.time_s[0], SECONDS, rtol=1e-9)


def test_minutes_without_a_unit_are_asked_for():
    _, codes = time_of("Time", np.round(SECONDS / 60, 5))
    assert "time-unit.doubtful" in codes


def test_stamps_with_an_offset_are_instants():
    stamps = np.datetime64("2024-03-31T00:54:40") + (SECONDS * 1e3).astype("timedelta64[ms]")
    spring = np.datetime64("2024-03-31T01:00:00")
    local = [
        f"{np.datetime_as_string(at + np.timedelta64(2 if at >= spring else 1, 'h'), 's')}"
        f"{'+02:00' if at >= spring else '+01:00'}"
        for at in stamps
    ]
    np.testing.assert_allclose(time_of("timestamp", local)[0], SECONDS)


@pytest.mark.parametrize(
    ("back_s", "what"), [(3600, "the end of summer time"), (43200, "a clock of twelve hours")]
)
def test_a_clock_that_is_set_back_is_named(back_s, what):
    time_s = 40000.0 + np.where(SECONDS < 300, SECONDS, SECONDS - back_s)
    with pytest.raises(InputError, match=what):
        time_of("Time [s]", time_s)


def test_single_zeros_of_a_clock_are_no_steps():
    time_s = 100.0 + SECONDS
    time_s[[20, 31, 90]] = 0.0
    kept_s, codes = time_of("Time [s]", time_s)
    assert (len(kept_s), kept_s[-1]) == (157, SECONDS[-1])
    assert "clock.steps" not in codes


def cases():
    truth = CASES / "files" / "truth.json"
    return json.loads(truth.read_text())["files"] if truth.is_file() else []


REFUSED = {
    "time_ms_no_unit.csv": "looks like milliseconds",
    "time_excel_serial.csv": "dates in days",
    "timestamp_us.csv": "looks like microseconds",
    "dst_autumn_no_offset.csv": "end of summer time",
    "twelve_hour_clock.csv": "twelve hours",
}
READ = ("iso_offset_spring.csv", "bdf_zero_clock.bdf.csv", "capacity_mAh_countdown.csv")


@needs_cases
@pytest.mark.parametrize("name", REFUSED)
def test_a_case_is_refused_by_the_name_of_its_clock(name):
    with pytest.raises(InputError, match=REFUSED[name]):
        read_record(CASES / "files" / name)


@needs_cases
@pytest.mark.parametrize("name", READ)
def test_a_case_is_read_with_its_own_span(name):
    (true,) = [case for case in cases() if case["file"] == name]
    record = read_record(CASES / "files" / name)
    assert record.time_s[-1] - record.time_s[0] == pytest.approx(true["t_last_s"], rel=1e-3)
    assert "time-unit" not in " ".join(one.code for one in record.warnings)


@needs_cases
def test_seconds_since_a_start_are_no_days():
    one, other = (
        read_record(CASES / "systems" / f"{name}.csv") for name in ("timestamp_s", "time_s")
    )
    np.testing.assert_array_equal(one.time_s, other.time_s)

"""Times as loggers spell them, and what files come wrapped in, against what was written."""

import datetime

import numpy as np
import pytest

from barnax.errors import InputError
from helpers.dialects import neware_csv, pulse_table
from helpers.records import CURRENT, VOLTAGE, read, zipped

TABLE = pulse_table()
BEGIN = datetime.datetime(2024, 3, 9, 21, 30)


def clock(form):
    """Hours, minutes and seconds in a form of their own."""
    return lambda s: form.format(d=s // 86400, h=s // 3600, m=s // 60 % 60, s=s % 60)


def hundredths(s):
    return f"{clock('{h:02d}:{m:02d}:{s:02d}')(int(s))}:{round(100 * (s % 1)):02d}"


def date(form):
    return lambda s: (BEGIN + datetime.timedelta(seconds=s)).strftime(form)


# What names the times, how they are spelled, and their interval in seconds.
SPELLINGS = {
    "month in letters": ("Date Time", date("%d-%b-%Y %H:%M:%S"), 97),
    "minutes of half a day": ("Date Time", date("%m/%d/%Y %I:%M %p"), 120),
    "milliseconds behind a comma": ("Date Time", date("%Y-%m-%d %H:%M:%S,000"), 97),
    "milliseconds behind a colon": ("Date Time", date("%Y-%m-%d %H:%M:%S:000"), 97),
    "Unix microseconds": ("Timestamp", lambda s: str(1_700_000_000_000_000 + 10**6 * s), 97),
    "Unix nanoseconds": ("Timestamp", lambda s: str(10**9 * (1_700_000_000 + s)), 97),
    "days before the hours": ("Time", clock("{d:02d}:{h:02d}:{m:02d}:{s:02d}"), 97),
    "hundredths": ("Time", clock("{h:02d}:{m:02d}:{s:02d}:00"), 97),
    "hundredths of which none is past 59": ("Time", hundredths, 0.5),
    "two digits of a year": ("Time", date("%d-%b-%y %H:%M:%S"), 97),
}


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_a_time_is_read_as_it_is_spelled(tmp_path, spelling):
    name, spell, interval_s = SPELLINGS[spelling]
    rows = "".join(
        f'"{spell(interval_s * k)}",{ampere!r},{volt!r}\n'
        for k, (ampere, volt) in enumerate(TABLE.select(CURRENT, VOLTAGE).iter_rows())
    )
    record = read(tmp_path, f"{name},Current (A),Voltage (V)\n{rows}")
    time_s = record.time_s - record.time_s[0]
    assert record.time_s[0] >= 0
    np.testing.assert_allclose(time_s, interval_s * np.arange(len(TABLE)), atol=1e-3)
    if name == "Time" and "year" not in spelling:
        assert record.zero_date_s is None


@pytest.mark.parametrize("header", ["Date", "Timestamp", "Time", "Test Time"])
@pytest.mark.parametrize("form", ["%Y-%m-%d %H:%M:%S", "%d/%m/%Y %H:%M:%S"])
def test_a_clock_of_dates_starts_at_zero_and_keeps_its_date(tmp_path, header, form):
    """The day stands before the month, as days that follow on each other tell."""
    half_days = [43_200 * k for k in range(30)]
    rows = "".join(f"{date(form)(s)},{s // 43_200 % 2},3.7\n" for s in half_days)
    record = read(tmp_path, f"{header},Current (A),Voltage (V)\n" + rows)
    assert record.time_s[0] == 0
    assert record.zero_date_s == BEGIN.replace(tzinfo=datetime.UTC).timestamp()


def test_the_order_of_day_and_month_is_told_by_all_dates(tmp_path):
    """From 1 March to 2 April; as months before days, the two would be only a month apart."""
    begin = datetime.datetime(2026, 3, 1, tzinfo=datetime.UTC)
    dates = (begin + datetime.timedelta(hours=12 * k) for k in range(65))
    rows = "".join(f"{at:%d/%m/%Y %H:%M:%S},{k % 2},3.7\n" for k, at in enumerate(dates))
    record = read(tmp_path, "Time,Current (A),Voltage (V)\n" + rows)
    assert record.time_s[-1] == 32 * 86_400
    assert record.zero_date_s == begin.timestamp()


@pytest.mark.parametrize(("name", "is_soc"), [("SOC [%]", True), ("Soak / min", False)])
def test_a_state_of_charge_is_counted_and_not_read(tmp_path, name, is_soc):
    rows = "".join(f"{k},{k % 2},3.{7 + k % 2},50\n" for k in range(30))
    record = read(tmp_path, f"Time [s],Current [A],Voltage [V],{name}\n" + rows)
    told = [each.values["column"] for each in record.notes if each.code == "columns.soc-unused"]
    assert told == ([name] if is_soc else [])


@pytest.mark.parametrize(("form", "interval_s"), [("{:.0f}.", 21.0), ("{:g}", 10.5)])
def test_a_word_far_below_leaves_seconds_what_they_are(tmp_path, form, interval_s):
    """It makes all cells text, of which times with colons are clocks."""
    time_s = interval_s * np.arange(1500)
    rows = "".join(f"{form.format(s)},{k % 2},3.{7 + k % 2},24\n" for k, s in enumerate(time_s))
    text = "Time [s],Current [A],Voltage [V],Temperature [degC]\n" + rows
    record = read(tmp_path, (text[:-3] + "OVERFLOW\n"))
    np.testing.assert_array_equal(record.time_s, time_s)


@pytest.mark.parametrize("form", ["%Y%m%d%H%M%S", "%Y%m%d %H%M%S"])
def test_a_date_in_digits_alone_is_no_number_of_seconds(tmp_path, form):
    rows = "".join(f"{date(form)(97 * k)},{k % 2},3.{7 + k % 2}\n" for k in range(30))
    with pytest.raises(InputError, match="stands under 'Date', where a number is needed"):
        read(tmp_path, ("Date,Current (A),Voltage (V)\n" + rows))


def test_a_zip_archive_of_one_file_is_that_file(tmp_path):
    content = neware_csv(TABLE)
    record = read(tmp_path, zipped({"cell.csv": content, "__MACOSX/._cell.csv": b"\0"}), "c.zip")
    np.testing.assert_allclose(record.voltage_v, TABLE[VOLTAGE].to_numpy(), rtol=1e-12)
    assert "format.suffix" not in {each.code for each in (*record.warnings, *record.notes)}


@pytest.mark.parametrize("files", [{}, {"a.csv": b"1", "b.csv": b"2"}, {"a.bin": bytes(99)}])
def test_a_zip_archive_of_anything_else_is_to_be_unpacked(tmp_path, files):
    archive = zipped(files) if files else zipped({"a": b"1" * 99})[:60]
    with pytest.raises(InputError, match=r"c\.zip: .*(unpack it|Export the record)"):
        read(tmp_path, archive, "c.zip")


@pytest.mark.parametrize(
    "start", ["<html><table><tr>", '<?xml version="1.0"?>', '{"time": [', "[[0"]
)
def test_markup_is_no_table(tmp_path, start):
    with pytest.raises(InputError, match=r"HTML, XML or JSON, .* save it as CSV"):
        read(tmp_path, (start + "Time,Current,Voltage\n0,0,3.7\n"), "cell.xls")


ISO = date("%Y-%m-%d")


def in_two_columns(time_s, day, time, header="Date,Time"):
    rows = (f"{day(s)},{time(s)},{k % 2},3.{7 + k % 2}" for k, s in enumerate(time_s.tolist()))
    return "\n".join([f"{header},Current (A),Voltage (V)", *rows, ""])


PAUSED = {"%d.%m.%Y": "%H:%M:%S", "%Y-%m-%d": "%I:%M:%S %p", "%m/%d/%Y": "%H:%M:%S.000"}


@pytest.mark.parametrize("day", PAUSED)
def test_a_date_and_a_time_of_day_in_two_columns_are_one_clock(tmp_path, day):
    """Over midnight, and over a pause of 31 hours, in which the time of day rises."""
    time_s = np.cumsum(np.where(np.arange(300) == 200, 31 * 3600, 60.0)) + 79_000
    for header in ("Date,Time", "Date,Time of Day"):
        record = read(tmp_path, in_two_columns(time_s, date(day), date(PAUSED[day]), header))
        np.testing.assert_array_equal(np.diff(record.time_s), np.diff(time_s))
        assert "time of day" in {each.values.get("clock") for each in record.notes}
        began = BEGIN.replace(tzinfo=datetime.UTC).timestamp() + time_s[0]
        assert record.time_s[0] + record.zero_date_s == began


@pytest.mark.parametrize("interval_s", [60, 1])
def test_a_clock_of_the_test_beside_dates_runs_on(tmp_path, interval_s):
    """Also where it is logged every minute at midnight, and mostly every second."""
    time_s = np.cumsum(np.where(np.arange(300) < 200, interval_s, 60))
    seconds = clock("{h:02d}:{m:02d}:{s:02d}")
    record = read(tmp_path, in_two_columns(time_s, lambda s: ISO(s + 4_000), seconds))
    np.testing.assert_array_equal(record.time_s, time_s)


def test_a_date_that_jumps_by_days_is_no_clock_of_the_test(tmp_path):
    """The time of day rises throughout; no clock of a test takes so many days over it."""
    time_s = np.cumsum(np.where(np.arange(300) == 200, 49 * 3600, 60)) + 10_000
    record = read(tmp_path, in_two_columns(time_s, ISO, date("%H:%M:%S")))
    np.testing.assert_array_equal(np.diff(record.time_s), np.diff(time_s))

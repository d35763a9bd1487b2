"""Times as loggers, phones and scripts spell and count them: read, or refused by the right name."""

import datetime
import re

import hypothesis
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import barnax
from barnax import InputError, check_file
from barnax.records import read_record, source_from_frame
from helpers.dialects import pulse_table
from helpers.records import CURRENT, VOLTAGE, read

SECONDS = np.arange(160) * 4.0
TABLE = pulse_table()
BEGIN = datetime.datetime(2024, 3, 9, 21, 30)


def frame(name, values):
    """A load that switches, and a voltage that answers: the unit of the time is all that varies."""
    current_a = np.where(np.arange(160) // 20 % 2, -1.0, 0.0)
    return {name: values, "Current [A]": current_a, "Voltage [V]": 3.9 + 0.05 * current_a}


def time_of(name, values):
    record = barnax.record_from_frame(frame(name, values))
    return record.time_s - record.time_s[0], [one.code for one in record.warnings]


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
    "two digits of a year": ("Time", date("%d-%b-%y %H:%M:%S"), 97),
    "days before the hours": ("Time", clock("{d:02d}:{h:02d}:{m:02d}:{s:02d}"), 97),
    "hundredths": ("Time", clock("{h:02d}:{m:02d}:{s:02d}:00"), 97),
    "hundredths of which none is past 59": ("Time", hundredths, 0.5),
    "an hour of a day": ("Time", date("%I:%M:%S %p"), 20),
    "minutes of an hour": ("Time", date("%M:%S.%f"), 20),
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
@pytest.mark.parametrize("count", [30, 65])
def test_a_clock_of_dates_starts_at_zero_and_keeps_its_date(tmp_path, header, form, count):
    """The day stands before the month, as all dates tell together: from March to April."""
    half_days = [43_200 * k for k in range(count)]
    rows = "".join(f"{date(form)(s)},{s // 43_200 % 2},3.7\n" for s in half_days)
    record = read(tmp_path, f"{header},Current (A),Voltage (V)\n" + rows)
    assert (record.time_s[0], record.time_s[-1]) == (0, half_days[-1])
    assert record.zero_date_s == BEGIN.replace(tzinfo=datetime.UTC).timestamp()


@pytest.mark.parametrize(("form", "interval_s"), [("{:.0f}.", 21.0), ("{:g}", 10.5)])
def test_a_word_far_below_leaves_seconds_what_they_are(tmp_path, form, interval_s):
    """It makes all cells text, of which times with colons are clocks."""
    time_s = interval_s * np.arange(1500)
    rows = "".join(f"{form.format(s)},{k % 2},3.{7 + k % 2},24\n" for k, s in enumerate(time_s))
    text = "Time [s],Current [A],Voltage [V],Temperature [degC]\n" + rows
    record = read(tmp_path, (text[:-3] + "OVERFLOW\n"))
    np.testing.assert_array_equal(record.time_s, time_s)


def in_two_columns(time_s, day, time, header="Date,Time"):
    rows = (f"{day(s)},{time(s)},{k % 2},3.{7 + k % 2}" for k, s in enumerate(time_s.tolist()))
    return "\n".join([f"{header},Current (A),Voltage (V)", *rows, ""])


PAUSED = {"%d.%m.%Y": "%H:%M:%S", "%Y-%m-%d": "%I:%M:%S %p", "%m/%d/%Y": "%H:%M:%S.000"}


@pytest.mark.parametrize("day", PAUSED)
@pytest.mark.parametrize("hours", [31, 49])
def test_a_date_and_a_time_of_day_in_two_columns_are_one_clock(tmp_path, day, hours):
    """Over midnight, and over a pause in which the time of day rises, be it of two days."""
    time_s = np.cumsum(np.where(np.arange(300) == 200, hours * 3600, 60.0)) + 79_000
    record = read(
        tmp_path, in_two_columns(time_s, date(day), date(PAUSED[day]), "Date,Time of Day")
    )
    np.testing.assert_array_equal(np.diff(record.time_s), np.diff(time_s))
    assert "time of day" in {each.values.get("clock") for each in record.notes}
    began = BEGIN.replace(tzinfo=datetime.UTC).timestamp() + time_s[0]
    assert record.time_s[0] + record.zero_date_s == began


@pytest.mark.parametrize("interval_s", [60, 1])
def test_a_clock_of_the_test_beside_dates_runs_on(tmp_path, interval_s):
    """Also where it is logged every minute at midnight, and mostly every second."""
    time_s = np.cumsum(np.where(np.arange(300) < 200, interval_s, 60))
    seconds, day = clock("{h:02d}:{m:02d}:{s:02d}"), date("%Y-%m-%d")
    record = read(tmp_path, in_two_columns(time_s, lambda s: day(s + 4_000), seconds))
    np.testing.assert_array_equal(record.time_s, time_s)


MINUTES = np.round(SECONDS / 60, 5)
FEW_DIGITS = np.round(np.arange(160) * 0.1 / 60, 3)


@pytest.mark.parametrize(
    ("values", "units", "first"),
    [
        (MINUTES, {"s": 1.0, "min": 60.0, "h": 3600.0}, "s' (samples 0.0667 s"),
        (SECONDS * 25, {"s": 1.0, "ms": 1e-3}, "s' (samples 100 s"),
        # By their mean interval.
        (FEW_DIGITS, {"s": 1.0, "min": 60.0, "h": 3600.0}, "min'` (samples 0.1 s"),
    ],
)
def test_what_nothing_decides_is_asked_for_and_every_answer_is_taken(values, units, first):
    with pytest.raises(InputError, match="the unit of 'Time' is in doubt") as caught:
        time_of("Time", values)
    offered = re.findall(r"columns='(time=Time:(\w+))'", str(caught.value))
    assert [unit for _, unit in offered] == list(units)
    for option, unit in offered:
        record = barnax.record_from_frame(frame("Time", values), columns=option)
        np.testing.assert_allclose(record.time_s, values * units[unit])
        assert "unit" not in " ".join(one.code for one in record.warnings)


# What a unit of the time is in s, and the decimals with which loggers write it.
UNITS = {
    "s": (1.0, 3), "ms": (1e-3, 1), "us": (1e-6, 0), "ns": (1e-9, 0), "min": (60.0, 5),
    "h": (3600.0, 7), "d": (86400.0, 9),
}  # fmt: skip


@given(
    unit=st.sampled_from(list(UNITS)),
    interval_s=st.sampled_from([0.1, 0.5, 1.0, 2.0, 4.0, 10.0, 60.0]),
    start_s=st.sampled_from([0.0, 61.234567]),
    name=st.sampled_from(["time", "Time", "timestamp", "t"]),
    swing=st.sampled_from([0.1, 0.8]),
)
def test_a_bare_time_is_read_as_it_was_or_not_at_all(unit, interval_s, start_s, name, swing):
    """A cell of 2 Ah and 50 mohm, whatever its logger counts; of integers from one minute to the
    next, and of a swing that shows no voltage, nothing tells."""
    samples = max(120, round(swing * 3600 / interval_s)) if interval_s > 1 else 400
    current_a = np.where(np.arange(samples) // 10 % 3, -2.0, 0.5)
    time_s = start_s + np.arange(samples) * interval_s
    soc = 0.95 + np.append(0, np.cumsum(current_a[:-1])) * interval_s / 7200
    voltage_v = np.round(3.2 + np.clip(soc, 0, 1) + 0.05 * current_a, 4)
    unit_s, decimals = UNITS[unit]
    table = {name: np.round(time_s / unit_s, decimals), "current": current_a, "voltage": voltage_v}
    hypothesis.assume(not (unit in ("min", "h") and interval_s >= 60))
    findings = check_file(source_from_frame(table, "log")).findings
    said = [one for one in findings if one.check == "unit"]
    assert {one.values["quantity"] for one in said} <= {"time"}
    if any(one.severity == "error" for one in findings):
        assert f":{unit}'" in " ".join(map(str, said))
        return
    record = barnax.record_from_frame(table)
    assert record.time_s[-1] - record.time_s[0] == pytest.approx(np.ptp(time_s), rel=2e-2)
    assert [one.values["case"] for one in said] == ([] if unit == "s" else ["taken"])


@pytest.mark.parametrize(
    ("symbol", "words", "unit_s"),
    [("min", "minutes", 60.0), ("h", "hours", 3600.0), ("ms", "milliseconds", 1e-3)],
)
@pytest.mark.parametrize("name", ["Step Time / s", "Date Time"])
def test_a_clock_beside_the_time_tells_its_unit(symbol, words, unit_s, name):
    seconds = SECONDS * 2
    dates = [str(np.datetime64("2024-03-01T00:00:00") + int(at)) for at in seconds]
    # Nothing else tells: intervals of 8 s are 0.1333 min.
    beside = {name: seconds % 160 if name.startswith("Step") else dates}
    record = barnax.record_from_frame(frame("Time", seconds / unit_s) | beside)
    np.testing.assert_allclose(record.time_s, seconds)
    (warning,) = [one for one in record.warnings if one.code == "unit.reading"]
    assert f"is taken in {words}" in str(warning)
    assert f"intervals by '{name}' are {unit_s:g} times as long" in str(warning)
    table = frame("Time / s", seconds / unit_s) | beside
    with pytest.raises(InputError, match=f"'Time / s' looks like {words}"):
        barnax.record_from_frame(table)
    record = barnax.record_from_frame(table, columns=f"time=Time / s:{symbol}")
    np.testing.assert_allclose(record.time_s, seconds)


def stamps_of_spring(form):
    """Local stamps with their offset, which goes on by an hour."""
    stamps = np.datetime64("2024-03-31T00:54:40") + (SECONDS * 1e3).astype("timedelta64[ms]")
    for at in stamps:
        hours = 2 if at >= np.datetime64("2024-03-31T01:00:00") else 1
        shown = np.datetime_as_string(at + np.timedelta64(hours, "h"), "s")
        yield f"{shown}{form.format(hours)}"


def over_midnight(first_s, day_s):
    shown_s = first_s + SECONDS - day_s * (SECONDS >= 300)
    return [clock("{h:02d}:{m:02d}:{s:02d}")(int(at)) for at in shown_s]


# What a column is called and holds; it is `SECONDS` from the first sample on.
READ = {
    **{f"Unix {start_s:g}, 1/{factor:g} s": ("timestamp", (start_s + SECONDS) * factor)
       for start_s in (1.0e9, 1.7e9) for factor in (1.0, 1e3, 1e6, 1e9)},
    "days of a spreadsheet": ("DateTime", 45352.4 + SECONDS / 86400),
    **{f"stamps with {form}": ("timestamp", [*stamps_of_spring(form)])
       for form in ("+{:02d}:00", "+{:02d}00", "+{:02d}", " +{:02d}:00", " +{:02d}00")},
    "a time of day over midnight": ("Time", over_midnight(86_100, 86_400)),
    "a time of day over one o'clock": ("Time", over_midnight(46_500, 43_200)),
}  # fmt: skip


@pytest.mark.parametrize("case", READ)
def test_a_clock_is_read_in_seconds(case):
    np.testing.assert_allclose(time_of(*READ[case])[0], SECONDS, atol=1e-4)


def test_rows_logged_twice_a_minute_are_no_days():
    """The median interval is zero, and a minute is an interval of days as well."""
    twice = np.repeat(np.arange(80) * 60.0 + 20_000, 2)
    assert time_of("time", twice)[0][-1] == 79 * 60


SET_BACK = [(3600, "the end of summer time"), (43200, "a clock of twelve hours")]


# Of one interval; and ten samples a second in a pulse, and one in half a minute at rest.
LOGS = {f"{one} s": np.arange(160) * one for one in (1.0, 4.0, 60.0)}
LOGS["uneven"] = np.cumsum(np.where(np.arange(160) % 80 < 60, 0.1, 30.0))


@pytest.mark.parametrize(("back_s", "what"), SET_BACK)
@pytest.mark.parametrize("log", LOGS)
def test_dates_that_are_set_back_run_on_and_that_is_said(back_s, what, log):
    shown_ms = 1e3 * (LOGS[log] - back_s * (np.arange(160) >= 71))
    stamps = np.datetime64("2024-10-27T12:30:00") + shown_ms.round().astype("timedelta64[ms]")
    record = barnax.record_from_frame(frame("Date Time", [str(stamp) for stamp in stamps]))
    np.testing.assert_allclose(np.diff(record.time_s), np.diff(LOGS[log]), atol=1e-3)
    assert what in " ".join(map(str, record.warnings))


def local_stamps(seconds, change, on_s=3600):
    """Stamps of a local clock that goes on by an hour at `change`, after the 70th sample."""
    shown_s = seconds - seconds[70] + on_s * (np.arange(len(seconds)) >= 70)
    stamps = np.datetime64(change) + np.round(1e3 * shown_s).astype("timedelta64[ms]")
    return [str(stamp) for stamp in stamps]


SPRINGS = ["2024-03-31T02:00:00", "2024-03-10T02:00:00", "2024-10-06T02:00:00"]


@pytest.mark.parametrize("change", [*SPRINGS, "2024-03-31T01:00:00.7"])
@pytest.mark.parametrize("interval_s", [0.5, 4, 60])
def test_the_hour_of_spring_is_taken_off_and_that_is_said(change, interval_s):
    seconds = np.arange(160) * interval_s
    record = barnax.record_from_frame(frame("Date Time", local_stamps(seconds, change)))
    np.testing.assert_allclose(record.time_s, seconds, atol=1e-6)
    assert [one.values["change"] for one in record.warnings] == ["hour-on"]


# At noon, in summer, by instants, and for longer than an hour.
@pytest.mark.parametrize(
    ("change", "zone", "on_s"),
    [
        ("2024-03-31T12:00:00", "", 3600),
        ("2024-07-07T02:00:00", "", 3600),
        ("2024-03-31T02:00:00", "Z", 3600),
        ("2024-03-31T02:00:00", "+01:00", 3600),
        ("2024-03-31T02:00:00", "", 7200),
    ],
)
def test_an_hour_that_passes_is_left_alone(change, zone, on_s):
    passed = np.arange(160) >= 70
    table = frame("Date Time", [at + zone for at in local_stamps(SECONDS, change, on_s)])
    # The cell recovers from its load.
    table["Current [A]"] = np.where(np.arange(160) % 20 < 15, -1.0, 0.0)
    table["Voltage [V]"] = 3.9 + 0.05 * table["Current [A]"] + 0.01 * passed
    record = barnax.record_from_frame(table)
    np.testing.assert_allclose(record.time_s, SECONDS + on_s * passed)
    assert not record.warnings


def test_a_load_that_goes_on_did_not_wait_an_hour():
    """On any day, where neither current nor voltage changed."""
    table = frame("Date Time", local_stamps(SECONDS, "2024-07-03T14:23:11"))
    assert table["Current [A]"][69] == table["Current [A]"][70] == -1
    np.testing.assert_allclose(barnax.record_from_frame(table).time_s, SECONDS)


def dates_of_twelve_hours():
    """Dates every ten minutes, whose hours run from 12 to 11 twice a day."""
    seconds = np.arange(160) * 600
    hours = (11 + (seconds + 1800) // 3600) % 12 + 1
    shown = zip(map(str, np.datetime64("2024-03-01T00:30:00") + seconds), hours, strict=True)
    return [f"{at[:11]}{hour:02d}{at[13:]}" for at, hour in shown]


# What a column is called and holds, and why it is refused.
REFUSED = {
    "hours and minutes": (
        "Time", [f"{k // 60:02d}:{k % 60:02d}" for k in range(160)], "'Time' contains '00:00'",
    ),
    **{f"dates in digits, {form}": (
           "Date", [date(form)(97 * k) for k in range(160)], "'Date' contains .*, where a number")
       for form in ("%Y%m%d%H%M%S", "%Y%m%d %H%M%S")},
    **{what: ("Time [s]", 50000.0 + SECONDS - back_s * (SECONDS >= 300), what)
       for back_s, what in SET_BACK},
    "dates of twelve hours": ("Date Time", dates_of_twelve_hours(), "a clock of twelve hours"),
    **{f"a counter of {unit} that is full": (
           f"Time [{unit}]", (SECONDS * per_s + 2**bits - 40 * per_s) % 2**bits,
           "the clock starts again")
       for unit, per_s, bits in (("ms", 1e3, 16), ("us", 1e6, 32))},
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_no_clock_is_refused_with_the_reason(case):
    name, values, reason = REFUSED[case]
    with pytest.raises(InputError, match=reason):
        time_of(name, values)


def test_a_zero_where_the_step_changes_begins_a_step():
    """Between a step's first row and its next one, samples were not logged."""
    shown_s = np.concatenate([[0, 10, 20], *2 * [[0, *range(40, 580, 10)]]]).astype(float)
    step = np.repeat([1, 2, 3], [3, 55, 55])
    current_a = np.where(step == 2, -1.0, 0.0)
    table = {"Step Time [s]": shown_s, "Current [A]": current_a}
    table |= {"Voltage [V]": 3.7 + current_a / 20, "Step Index / 1": step}
    record = barnax.record_from_frame(table)
    assert record.samples == len(shown_s)
    assert "clock.zeros" not in {one.code for one in record.warnings}


@pytest.mark.parametrize("has_steps", [True, False])
@pytest.mark.parametrize("zeros", [[70], [130, 131], [70, 250], [118], [178, 297, 298]])
def test_a_zero_within_a_step_does_not_begin_another(has_steps, zeros):
    """The clock of each of five steps begins anew, a second after the step before it ended."""
    within_s, step = np.tile(np.arange(60.0), 5), np.repeat(np.arange(5), 60)
    current_a = np.where(step % 2 == 1, -1.0, 0.0)
    table = {"Step Time / s": within_s, "Current / A": current_a}
    table |= {"Voltage / V": 3.7 + current_a / 20} | ({"Step Index / 1": step} if has_steps else {})
    whole = read_record(source_from_frame(table, "whole"), voltage_lag=0.0)
    table["Step Time / s"] = np.where(np.isin(np.arange(300), zeros), 0.0, within_s)
    record = read_record(source_from_frame(table, "zeros"), voltage_lag=0.0)
    is_left = ~np.isin(whole.row, np.array(zeros) + 2)
    np.testing.assert_array_equal(record.time_s, whole.time_s[is_left])
    left_out = [each for each in record.warnings if each.code == "clock.zeros"]
    assert [(each.row, each.values["rows"]) for each in left_out] == [(zeros[0] + 2, len(zeros))]

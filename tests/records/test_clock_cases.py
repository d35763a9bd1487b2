"""Times as loggers, phones and scripts write them: read, or refused by the right name."""

import json
import re

import hypothesis
import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

import barnax
from barnax import InputError
from barnax.cell import characterize, read_ocv_test
from barnax.checks import check_file
from barnax.checks.against_cell import compare_with_cell
from barnax.records import read_record, source_from_frame
from barnax.settings import Window
from helpers.shared import CASES, needs_cases

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


@pytest.mark.parametrize("name", ["Time", "timestamp"])
@pytest.mark.parametrize("factor", [1e3, 1e6, 1e9])
def test_a_time_without_a_unit_is_never_seconds_that_no_logger_waits(name, factor):
    time_s, codes = time_of(name, SECONDS * factor)
    np.testing.assert_allclose(time_s, SECONDS, rtol=1e-9)
    assert codes == ["unit.reading"]


@pytest.mark.parametrize(
    ("values", "units"),
    [
        (np.round(SECONDS / 60, 5), {"s": 1.0, "min": 60.0, "h": 3600.0}),
        (SECONDS * 25, {"s": 1.0, "ms": 1e-3}),
    ],
)
def test_what_nothing_decides_is_asked_for_and_every_answer_is_taken(values, units):
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


@pytest.mark.parametrize("name", ["Capacity", "Discharging Capacity / Ah"])
def test_a_counter_in_mah_is_the_odd_one_out(name):
    """A tester that counts mAh, beside a current and a time that nothing speaks against."""
    current_a = np.full(160, -3.4)
    counted_mah = 3.4e3 / 3600 * SECONDS
    others = {} if name == "Capacity" else {"Charging Capacity / Ah": 0 * SECONDS}
    table = {"time": SECONDS, "current": current_a, "voltage": 4.0 - SECONDS / 1e3}
    record = barnax.record_from_frame({**table, name: counted_mah, **others})
    assert record.charge_ah is not None
    assert np.ptp(record.charge_ah) == pytest.approx(3.4 * SECONDS[-1] / 3600)
    codes = [one.code for one in record.warnings]
    assert not any(code.startswith("counters") for code in codes)
    (warning,) = [one for one in record.warnings if one.code == "unit.reading"]
    (option,) = re.findall(r"columns='(.*?)'`", str(warning))
    obeyed = barnax.record_from_frame({**table, name: counted_mah, **others}, columns=option)
    np.testing.assert_allclose(obeyed.charge_ah, record.charge_ah)
    assert "unit" not in " ".join(one.code for one in obeyed.warnings)


@pytest.mark.parametrize(
    ("unit_s", "unit_a", "option"),
    [(1e-3, 1.0, "time=Time:ms"), (1.0, 1e-3, "current=current:mA")],
)
def test_a_counter_without_a_unit_does_not_vouch_for_the_others(unit_s, unit_a, option):
    """Ten samples a second in ms, or a load in mA, beside a counter in mAh: the product agrees."""
    seconds = np.arange(2000) * 0.1
    current_a = np.where(np.arange(2000) // 100 % 2, -2.0, 0.0)
    counted_mah = np.append(0, np.cumsum(current_a[:-1])) * 0.1 / 3.6
    table = {
        "Time": seconds / unit_s,
        "current": current_a / unit_a,
        "voltage": 3.9 + 0.05 * current_a,
        "capacity": counted_mah,
    }
    findings = check_file(source_from_frame(table, "log")).findings
    assert option in " ".join(map(str, findings))
    record = barnax.record_from_frame(table, columns=option)
    assert record.time_s[-1] == pytest.approx(seconds[-1])
    assert record.current_a.max() == pytest.approx(2.0)
    assert record.charge_ah is not None
    assert np.ptp(record.charge_ah) == pytest.approx(np.ptp(counted_mah) / 1e3)


def test_minutes_of_few_digits_are_told_by_their_mean_interval():
    seconds = np.arange(2000) * 0.1
    current_a = np.where(np.arange(2000) // 100 % 2, -2.0, 0.0)
    voltage_v = 3.9 + 0.05 * current_a
    table = {"time": np.round(seconds / 60, 3), "current": current_a, "voltage": voltage_v}
    with pytest.raises(InputError, match=r"columns='time=time:min'` \(samples 0.1 s apart\)"):
        barnax.record_from_frame(table)
    record = barnax.record_from_frame(table, columns="time=time:min")
    np.testing.assert_allclose(record.time_s, seconds, atol=0.04)


def test_rows_that_are_logged_twice_are_no_days_of_a_spreadsheet():
    """The median interval is zero, and a minute is an interval of days as well."""
    values = np.repeat(np.arange(700) * 60.0 + 20_000, 2)
    current_a = np.where(np.arange(1400) // 40 % 2, -1.0, 0.0)
    table = {"time": values, "current": current_a, "voltage": 3.9 + 0.05 * current_a}
    record = barnax.record_from_frame(table)
    assert np.ptp(record.time_s) == 699 * 60


@pytest.mark.parametrize("unit_s", [60.0, 3600.0])
@pytest.mark.parametrize("clock", ["Step Time / s", "Date Time"])
def test_a_clock_beside_a_bare_time_tells_its_unit(unit_s, clock):
    seconds = SECONDS[:, None].repeat(2, 1).ravel()[::2] * 2
    dates = [str(np.datetime64("2024-03-01T00:00:00") + int(at)) for at in seconds]
    beside = seconds % 160 if clock.startswith("Step") else dates
    # Nothing else tells: intervals of 8 s are 0.1333 min.
    table = frame("Time", seconds / unit_s) | {clock: beside}
    record = barnax.record_from_frame(table)
    np.testing.assert_allclose(record.time_s, seconds)
    (warning,) = [one for one in record.warnings if one.code == "unit.reading"]
    assert f"intervals by '{clock}' are {unit_s:.0f} times as long" in str(warning)


OFFSETS = ["+{:02d}:00", "+{:02d}00", "+{:02d}", " +{:02d}:00", " +{:02d}00"]


@pytest.mark.parametrize("form", OFFSETS)
def test_stamps_with_an_offset_are_instants(form):
    stamps = np.datetime64("2024-03-31T00:54:40") + (SECONDS * 1e3).astype("timedelta64[ms]")
    spring = np.datetime64("2024-03-31T01:00:00")
    local = [
        f"{np.datetime_as_string(at + np.timedelta64(2 if at >= spring else 1, 'h'), 's')}"
        f"{form.format(2 if at >= spring else 1)}"
        for at in stamps
    ]
    np.testing.assert_allclose(time_of("timestamp", local)[0], SECONDS)


SET_BACK = [(3600, "the end of summer time"), (43200, "a clock of twelve hours")]


@pytest.mark.parametrize(("back_s", "what"), SET_BACK)
def test_a_clock_that_is_set_back_is_named(back_s, what):
    time_s = 50000.0 + np.where(SECONDS < 300, SECONDS, SECONDS - back_s)
    with pytest.raises(InputError, match=what):
        time_of("Time [s]", time_s)


@pytest.mark.parametrize(("back_s", "what"), SET_BACK)
@pytest.mark.parametrize("interval_s", [1, 4, 60])
def test_dates_that_are_set_back_run_on_and_that_is_said(back_s, what, interval_s):
    seconds = np.arange(160) * interval_s
    shown_s = seconds - back_s * (seconds > 70 * interval_s)
    stamps = np.datetime64("2024-10-27T12:58:00") + shown_s.astype("timedelta64[s]")
    record = barnax.record_from_frame(frame("Date Time", [str(stamp) for stamp in stamps]))
    np.testing.assert_allclose(record.time_s, seconds)
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


def test_an_hour_that_passes_is_left_alone():
    pause_s = 3600.0 * (np.arange(160) >= 70)
    # At noon, in summer, by instants, and for longer than an hour.
    for change, zone, on_s in (
        ("2024-03-31T12:00:00", "", 3600),
        ("2024-07-07T02:00:00", "", 3600),
        ("2024-03-31T02:00:00", "Z", 3600),
        ("2024-03-31T02:00:00", "+01:00", 3600),
        ("2024-03-31T02:00:00", "", 7200),
    ):
        stamps = [stamp + zone for stamp in local_stamps(SECONDS, change, on_s)]
        table = frame("Date Time", stamps)
        # The cell recovers from its load.
        table["Current [A]"] = np.where(np.arange(160) % 20 < 15, -1.0, 0.0)
        table["Voltage [V]"] = 3.9 + 0.05 * table["Current [A]"] + 0.01 * pause_s / 3600
        record = barnax.record_from_frame(table)
        np.testing.assert_allclose(record.time_s, SECONDS + on_s / 3600 * pause_s)
        assert not record.warnings


def test_a_load_that_goes_on_did_not_wait_an_hour():
    """On any day, where neither current nor voltage changed."""
    table = frame("Date Time", local_stamps(SECONDS, "2024-07-03T14:23:11"))
    assert table["Current [A]"][69] == table["Current [A]"][70] == -1
    np.testing.assert_allclose(barnax.record_from_frame(table).time_s, SECONDS)


@pytest.mark.parametrize(("back_s", "what"), SET_BACK)
def test_a_clock_of_irregular_intervals_is_set_back_too(back_s, what):
    """Ten samples a second in a pulse, and one in half a minute at rest, where it is set back."""
    seconds = np.cumsum(np.where(np.arange(160) % 80 < 60, 0.1, 30.0))
    shown_ms = 1e3 * (seconds - back_s * (np.arange(160) >= 70))
    stamps = np.datetime64("2024-10-27T12:30:00") + shown_ms.round().astype("timedelta64[ms]")
    record = barnax.record_from_frame(frame("Date Time", [str(stamp) for stamp in stamps]))
    late_s = np.abs(np.diff(record.time_s) - np.diff(seconds))
    assert late_s.max() < 1e-3
    assert what in " ".join(map(str, record.warnings))


def test_dates_of_twelve_hours_that_leap_at_midnight_are_refused():
    seconds = np.arange(160) * 600
    hours = (11 + (seconds + 1800) // 3600) % 12 + 1
    dates = np.datetime64("2024-03-01T00:30:00") + seconds
    shown = zip(map(str, dates), hours, strict=True)
    stamps = [f"{at[:11]}{hour:02d}{at[13:]}" for at, hour in shown]
    with pytest.raises(InputError, match="a clock of twelve hours"):
        barnax.record_from_frame(frame("Date Time", stamps))


def test_a_time_of_day_runs_on_over_midnight_and_over_one_oclock():
    for first_s, day_s in ((86_100, 86_400), (46_500, 43_200)):
        shown_s = first_s + SECONDS
        shown_s = np.where(shown_s < first_s + 300, shown_s, shown_s - day_s).astype(int)
        clock = [f"{at // 3600:02d}:{at // 60 % 60:02d}:{at % 60:02d}" for at in shown_s]
        np.testing.assert_allclose(time_of("Time", clock)[0], SECONDS)


def test_single_zeros_of_a_clock_are_no_steps():
    time_s = 100.0 + SECONDS
    time_s[[20, 31, 90]] = 0.0
    kept_s, codes = time_of("Time [s]", time_s)
    assert (len(kept_s), kept_s[-1]) == (157, SECONDS[-1])
    assert "clock.steps" not in codes
    unix_s = 1.71e9 + SECONDS
    unix_s[[20, 31, 90]] = 0.0
    kept_s, codes = time_of("timestamp", unix_s)
    assert (len(kept_s), kept_s[-1]) == (157, SECONDS[-1])
    assert "clock.zeros" in codes


def test_a_zero_where_the_step_changes_begins_a_step():
    """Between a step's first row and its next one, samples were not logged."""
    shown_s = np.concatenate([[0, 10, 20], *2 * [[0, *range(40, 580, 10)]]]).astype(float)
    step = np.repeat([1, 2, 3], [3, 55, 55])
    current_a = np.where(step == 2, -1.0, 0.0)
    table = {
        "Step Time [s]": shown_s,
        "Current [A]": current_a,
        "Voltage [V]": 3.7 + current_a / 20,
    }
    record = barnax.record_from_frame(pl.DataFrame({**table, "Step Index / 1": step}))
    assert record.samples == len(shown_s)
    assert "clock.zeros" not in {one.code for one in record.warnings}


def cases():
    truth = CASES / "files" / "truth.json"
    return json.loads(truth.read_text())["files"] if truth.is_file() else []


# What is said of each case that is read, and of the one that is refused.
READ = {
    "time_ms_no_unit.csv": "'Time' has no unit, and is taken in milliseconds",
    "timestamp_us.csv": "'timestamp' has no unit, and is taken in microseconds",
    "time_excel_serial.csv": "its numbers are dates, as Excel days",
    "iso_offset_spring.csv": "the time is by the date",
    "dst_autumn_no_offset.csv": "the end of summer time",
    "twelve_hour_clock.csv": "a clock of twelve hours",
    "bdf_zero_clock.bdf.csv": "is 0 in 12 rows between good values: left out",
    "capacity_mAh_countdown.csv": "'capacity' is taken in milliampere-hours",
}
# What would be wrong of any of them.
NEVER = ("sort the rows", "starts again", "milliamperes, not amperes", "times the current")


@needs_cases
@pytest.mark.parametrize("name", READ)
def test_a_case_is_read_with_its_own_span_and_what_was_odd_is_said(name):
    (true,) = [case for case in cases() if case["file"] == name]
    span_s = true.get("t_last_s", 636.0) - true.get("t_first_s", 0.0)
    record = read_record(CASES / "files" / name)
    assert record.time_s[-1] - record.time_s[0] == pytest.approx(span_s, rel=1e-6)
    findings = check_file(CASES / "files" / name).findings
    words = " ".join(map(str, (*record.warnings, *record.notes, *findings)))
    assert READ[name] in words
    assert not [phrase for phrase in NEVER if phrase in words]


@needs_cases
def test_a_case_that_nothing_decides_asks_for_its_unit():
    with pytest.raises(InputError, match=r"columns='time=Time:min'` \(samples 4 s apart\)"):
        read_record(CASES / "files" / "time_min_no_unit.csv")
    record = read_record(CASES / "files" / "time_min_no_unit.csv", columns="time=Time:min")
    assert record.time_s[-1] == pytest.approx(636.0, rel=1e-4)


@needs_cases
def test_seconds_since_a_start_are_no_days():
    one, other = (
        read_record(CASES / "systems" / f"{name}.csv") for name in ("timestamp_s", "time_s")
    )
    np.testing.assert_array_equal(one.time_s, other.time_s)


@needs_cases
def test_nanoseconds_of_pandas_are_dates():
    """As the case's program writes them."""
    rows = np.arange(2000)
    stamps = 1_700_000_000_000_000_000 + rows * 10**9
    current_a = np.repeat(np.random.default_rng(3).normal(0, 1, 100), 20)
    voltage_v = 4.0 - np.cumsum(current_a) / 7200 - 0.05 * current_a
    table = {"time": stamps, "Current / A": -current_a, "Voltage / V": voltage_v}
    record = barnax.record_from_frame(table)
    np.testing.assert_allclose(record.time_s, rows, atol=1e-6)


@needs_cases
def test_a_wrong_count_of_cells_in_series_is_said_and_the_one_that_fits():
    file = CASES / "cells" / "09_wrong_series" / "pack.csv"
    words = " ".join(map(str, read_record(file, series=192).warnings))
    assert "no known lithium-ion cell" in words
    assert "144 to 147 would be" in words
    assert "in series" not in " ".join(map(str, read_record(file, series=144).warnings))


@needs_cases
def test_a_wrong_capacity_is_named_before_half_the_current():
    folder = CASES / "cells" / "10_wrong_capacity"
    cell = characterize([read_ocv_test(folder / "ocv.csv")], capacity_ah=5.0)
    (warning,) = compare_with_cell(read_record(folder / "log.csv"), cell, 5.0)
    assert "held 2.5 Ah, not 5 Ah, or the current were half of what flowed" in str(warning)


@pytest.mark.parametrize("amplitude_a", [1.0, 5.0])
def test_exchanged_columns_are_told_and_what_is_advised_reads_them(amplitude_a):
    current_a = amplitude_a * np.where(np.arange(160) // 20 % 2, -1.0, 0.5)
    voltage_v = 3.7 + 0.05 * current_a
    table = {"time [s]": SECONDS, "Current [A]": voltage_v, "Voltage [V]": current_a}
    with pytest.raises(InputError, match="they look exchanged") as caught:
        barnax.record_from_frame(table)
    (option,) = re.findall(r"columns='(.*)'`", str(caught.value))
    np.testing.assert_allclose(barnax.record_from_frame(table, columns=option).voltage_v, voltage_v)


def test_a_steady_charge_in_the_column_of_the_voltage_is_told_too():
    current_a = np.where(np.arange(160) < 150, 1.0, 0.0)
    table = {"Time [s]": SECONDS, "Current": 3.5 + SECONDS / 1e3, "Voltage": current_a}
    with pytest.raises(InputError, match="they look exchanged"):
        barnax.record_from_frame(table)


def test_a_voltage_that_never_moves_is_said():
    table = frame("Time [s]", SECONDS) | {"Voltage [V]": np.full(160, 3.7)}
    words = " ".join(map(str, barnax.record_from_frame(table).warnings))
    assert "every voltage in 'Voltage [V]' is 3.7 V" in words


def test_a_temperature_in_kelvin_is_refused_with_how_to_convert_it():
    with pytest.raises(InputError, match=r"`temperature` 298 is no cell's in degC; subtract 273"):
        Window(temperature_degc=298.0)


@pytest.mark.parametrize("has_steps", [True, False])
@pytest.mark.parametrize("zeros", [[70], [130, 131], [70, 250], [118], [178, 297, 298]])
def test_a_zero_within_a_step_does_not_begin_another(has_steps, zeros):
    """The clock of each of five steps begins anew, a second after the step before it ended."""
    within_s = np.tile(np.arange(60.0), 5)
    step = np.repeat(np.arange(5), 60)
    current_a = np.where(step % 2 == 1, -1.0, 0.0)
    table = {
        "Step Time / s": within_s,
        "Current / A": current_a,
        "Voltage / V": 3.7 + current_a / 20,
    }
    table |= {"Step Index / 1": step} if has_steps else {}
    whole = read_record(source_from_frame(table, "whole"), voltage_lag=0.0)
    table["Step Time / s"] = np.where(np.isin(np.arange(300), zeros), 0.0, within_s)
    record = read_record(source_from_frame(table, "zeros"), voltage_lag=0.0)
    is_left = ~np.isin(whole.row, np.array(zeros) + 2)
    np.testing.assert_array_equal(record.time_s, whole.time_s[is_left])
    left_out = [each for each in record.warnings if each.code == "clock.zeros"]
    assert [(each.row, each.values["rows"]) for each in left_out] == [(zeros[0] + 2, len(zeros))]


@pytest.mark.parametrize("late", [0, 1])
def test_what_relaxes_within_a_minute_is_no_resistance_of_a_time_converted_twice(late):
    """A sweep at C/40 and back, logged every minute: half a volt of its ends goes in a minute."""
    hours = np.arange(0.0, 86.0, 1 / 60)
    is_down, is_up = (hours >= 1) & (hours < 41), (hours >= 43) & (hours < 83)
    current_a = np.where(is_down, -0.0625, np.where(is_up, 0.0625, 0.0))
    soc = 1 + np.append(0, np.cumsum(current_a[:-1])) / 60 / 2.5
    voltage_v = 3.2 + soc + 0.03 * current_a
    for sign, last in ((-1, np.flatnonzero(is_down)[-1]), (1, np.flatnonzero(is_up)[-1])):
        minutes = np.arange(len(hours)) - last
        grown = np.clip(1 + minutes / 60, 0, 1) ** 3
        voltage_v += sign * 0.5 * grown * np.exp(-np.maximum(minutes, 0))
    voltage_v = np.append(np.repeat(voltage_v[0], late), voltage_v)[: len(hours)]
    table = {"Time [s]": 3600 * hours, "Current [A]": current_a, "Voltage [V]": voltage_v}
    findings = check_file(source_from_frame(table, "sweep")).findings
    assert not [one for one in findings if one.check == "unit"]


@pytest.mark.parametrize("bits", [16, 32])
def test_a_counter_that_is_full_begins_anew_and_is_not_sorted(bits):
    """Of milliseconds in 16 bits, and of microseconds in 32."""
    unit, per_s = ("ms", 1e3) if bits == 16 else ("us", 1e6)
    counted = (SECONDS * per_s + 2**bits - 40 * per_s) % 2**bits
    with pytest.raises(InputError, match="the clock starts again"):
        time_of(f"Time [{unit}]", counted)

"""Every fault is found where it is, by its own check and no other; the words are in `findings.txt`.

They are written anew with BARNAX_WRITE_GOLDEN=1.
"""

import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy.signal import lfilter

from barnax import InputError, check_file, read_record
from barnax.bundled import BUNDLED_NAMES
from barnax.records.source import read_source
from helpers.golden import require_golden
from helpers.records import (
    CURRENT,
    TIME,
    VOLTAGE,
    changed,
    checked,
    counting,
    finding,
    frame,
    logged,
    scaled,
    simulated_cell,
    with_counters,
)

DRIVES = ("identification", "validation")
CHARGED, DISCHARGED = "Charging Capacity / Ah", "Discharging Capacity / Ah"
STEP, TEMPERATURE = "Step Index / 1", "Surface Temperature / degC"
DRIVE, OUT = frame(), frame("ocv_discharge")
LINES = np.arange(DRIVE.height)


def array(table, column):
    return table[column].to_numpy()


def cut(table, first, last):
    return pl.concat([table[:first], table[last:]])


def with_words(column, line, word):
    words = DRIVE.with_columns(pl.all().cast(str))
    values = words[column].to_list()
    values[line] = word
    return words.with_columns(pl.Series(column, values))


def unclosed_test():
    hours = np.arange(0, 40, 0.02)
    is_charge = hours >= 20
    voltage_v = 4.1 - 0.08 * np.where(is_charge, 40 - hours, hours) / 2
    current_a = np.where(is_charge, 0.092, -0.1)
    return logged(hours * 3600, current_a, voltage_v)


def rest_with_a_gap():
    # A second of each half minute is logged at rest; ten of them are missing.
    middle = int(np.flatnonzero(np.diff(array(OUT, TIME)) > 29)[100])
    return cut(OUT, middle, middle + 10)


def silent_voltage():
    current_a = np.tile([0.0, 1.0], 50)
    return logged(np.arange(100.0), current_a, 0 * current_a + 3.7)


def coarse_log():
    return DRIVE[np.concatenate([LINES[:9000], LINES[9000::60]])]


def late_voltage():
    voltage_v = array(DRIVE, VOLTAGE)
    return changed(DRIVE, VOLTAGE, (voltage_v + np.append(voltage_v[0], voltage_v[:-1])) / 2)


def smoothed_voltage():
    voltage_v = array(DRIVE, VOLTAGE)
    smooth_v = voltage_v[0] + lfilter([0.4], [1, -0.6], voltage_v - voltage_v[0])
    return changed(DRIVE, VOLTAGE, smooth_v)


def smoothed_current():
    smooth_a = lfilter([0.3], [1, -0.7], array(DRIVE, CURRENT))
    return changed(DRIVE, CURRENT, smooth_a)


def pulses_and_charges():
    """Pulses of one current, and charges at another that is then held at a voltage."""
    pulse = np.repeat([0.0, 2.0], [60, 30])
    taper = np.concatenate([np.full(300, -1.0), -np.exp(-np.arange(1, 400) / 150)])
    charge = np.concatenate([taper, np.repeat([0.0, 2.0, 0.0], [120, 60, 60])])
    current_a = np.concatenate([np.tile(pulse, 20), np.zeros(300), np.tile(charge, 3)])
    return logged(1.0 * np.arange(len(current_a)), -current_a, simulated_cell(current_a))


def fast_load():
    """The cell under a load that changes every second, logged every ten."""
    current_a = np.random.default_rng(0).uniform(-1, 2, 6000)
    return logged(np.arange(6000.0), -current_a, simulated_cell(current_a))[::10]


def rebuilt_clock():
    step = LINES // 2000
    clock = np.cumsum(1 + 1e-4 * step)
    return changed(DRIVE, TIME, clock).with_columns(pl.Series(STEP, step))


def with_net(table, factor):
    """The table with a counter of the net charge, times a factor."""
    counters = with_counters(table)
    net_ah = factor * (counters[CHARGED] - counters[DISCHARGED])
    return table.with_columns(net_ah.alias("Net Capacity / Ah"))


def two_runs():
    return pl.concat([DRIVE, DRIVE.with_columns(pl.col(TIME) + DRIVE.height)])


def exchanged_counters():
    return with_counters(DRIVE).rename({CHARGED: DISCHARGED, DISCHARGED: CHARGED})


def doubled_stamp():
    jump = int(np.argmax(np.abs(np.diff(array(DRIVE, CURRENT)))))
    return changed(DRIVE, TIME, DRIVE[TIME][jump], [jump + 1])


def paused_under_load():
    """A quarter of an hour without samples in the middle of a steady load."""
    current = DRIVE[CURRENT].to_numpy()
    spread = np.ptp(np.lib.stride_tricks.sliding_window_view(current, 8), axis=1)
    place = int(np.flatnonzero((spread < 0.02) & (np.abs(current[:-7]) > 0.5))[0])
    return DRIVE.with_columns(pl.col(TIME) + 900.0 * (pl.int_range(pl.len()) > place + 3))


def in_order(*pieces):
    return pl.concat([DRIVE[first:last] for first, last in pieces])


def step_clock():
    clock = array(DRIVE, TIME)
    steps = pl.Series(STEP, (clock // 600).astype(int))
    return changed(DRIVE, TIME, clock % 600).with_columns(steps)


def noisy_rest():
    noise_a = np.random.default_rng(0).normal(0, 0.012, OUT.height)
    return changed(OUT, CURRENT, array(OUT, CURRENT) + noise_a)


# Every fault: a table, and all findings of it that count.
FAULTS = {
    "none": (DRIVE, {}),
    "no time": (DRIVE.drop(TIME), {"columns": "error"}),
    "a likely name, and its values looked at": (
        changed(DRIVE, VOLTAGE, 6.5, [99]).rename({VOLTAGE: "Tension [V]"}),
        {"columns": "error", "voltage unit": "warning"},
    ),
    "a foreign name": (DRIVE.rename({CURRENT: "corriente(A)"}), {"columns": "error"}),
    "the unit of a likely name": (
        scaled(DRIVE, CURRENT, 1000.0).rename({CURRENT: "Courant [mA]"}),
        {"columns": "error"},
    ),
    "several likely names": (
        DRIVE.rename({CURRENT: "Current (C-rate)"}).with_columns(pl.lit(1).alias("Current set")),
        {"columns": "error"},
    ),
    "no units": (DRIVE.rename({TIME: "time", CURRENT: "current", VOLTAGE: "voltage"}), {}),
    "a word": (with_words(CURRENT, 77, "OVERFLOW"), {"cells": "error"}),
    "a column of words": (DRIVE.with_columns(pl.lit("x").alias(CURRENT)), {"cells": "error"}),
    "five samples": (DRIVE[:4], {"length": "error"}),
    "no samples": (DRIVE[:0], {"length": "error"}),
    "a stamp twice": (doubled_stamp(), {"repeats": "warning"}),
    "a coarse clock": (changed(DRIVE, TIME, np.floor(LINES / 10) * 10.0), {"repeats": "error"}),
    "a row twice": (in_order((0, 100), (99, None)), {}),
    "a piece in the wrong place": (
        in_order((0, 5000), (8000, 9000), (5000, 8000), (9000, None)),
        {"clock": "error"},
    ),
    "two tests in one file": (
        pl.concat([DRIVE, frame("validation")]),
        {"clock": "error", "breaks": "warning"},
    ),
    "a clock of the steps": (step_clock(), {"clock": "warning"}),
    "a time of day": (
        changed(DRIVE, TIME, (array(DRIVE, TIME) + 80_000) % 86_400),
        {"clock": "error"},
    ),
    "an absurd voltage": (changed(DRIVE, VOLTAGE, 65535.0, [77]), {"voltage unit": "error"}),
    "a large cell": (scaled(DRIVE, CURRENT, 100.0), {}),
    "milliamperes by the capacity": (
        scaled(DRIVE[:2500], CURRENT, 100.0),
        {"unit": "warning", "capacity": "warning"},
    ),
    "a discharge-positive current": (scaled(DRIVE, CURRENT, -1.0), {"sign": "warning"}),
    "no evidence of the sign": (silent_voltage(), {"sign": "warning", "voltage unit": "warning"}),
    "a noisy rest": (noisy_rest(), {}),
    "an open sensor": (
        DRIVE.with_columns(pl.lit(850.0).alias(TEMPERATURE)),
        {"temperature": "warning"},
    ),
    "kelvin": (DRIVE.with_columns(pl.lit(298.15).alias(TEMPERATURE)), {"temperature": "warning"}),
    "fahrenheit": (DRIVE.with_columns(pl.lit(77.0).alias(TEMPERATURE)), {"temperature": "warning"}),
    "two chambers": (
        DRIVE.with_columns(pl.Series(TEMPERATURE, np.where(LINES < 9840, -10.0, 25.0))),
        {"temperature": "warning"},
    ),
    "a pause under load": (paused_under_load(), {"gaps": "warning"}),
    "coarse readings": (DRIVE.with_columns(pl.col(VOLTAGE).round(2), pl.col(CURRENT).round(2)), {}),
    "counters that agree": (with_counters(DRIVE), {}),
    "counters that disagree": (with_counters(DRIVE, 1.06), {"counters": "warning"}),
    "counters in mAh": (with_counters(DRIVE, 1000.0), {"unit": "warning"}),
    "exchanged counters": (exchanged_counters(), {"sign": "warning"}),
    "counters that began before": (
        with_counters(DRIVE).with_columns(pl.col(DISCHARGED) + 1.25),
        {},
    ),
    "more charge than the capacity": (DRIVE, {"capacity": "warning"}),
    "a little more": (DRIVE, {}),
    "a current far too small": (scaled(DRIVE, CURRENT, 1e-3), {"capacity": "warning"}),
    "a net counter of twice the charge": (with_net(DRIVE, 2.0), {"counters": "warning"}),
    "a net counter that agrees": (with_net(DRIVE, -1.0), {}),
    "two runs behind each other": (two_runs(), {"breaks": "warning"}),
    "a voltage against another electrode": (
        DRIVE.with_columns(pl.col(VOLTAGE) - 4.4),
        {"voltage unit": "warning"},
    ),
    "an unclosed test": (unclosed_test(), {"closure": "warning"}),
    "a gap under load": (cut(DRIVE, 3000, 3600), {"gaps": "warning"}),
    "a gap at rest": (rest_with_a_gap(), {}),
    "a coarse log at rest": (frame("ocv_charge"), {}),
    "a coarse log under load": (coarse_log(), {}),
    "a voltage half a sample late": (late_voltage(), {"late voltage": "warning"}),
    "pulses and charges at set currents": (pulses_and_charges(), {}),
    "a voltage that was filtered": (smoothed_voltage(), {"late voltage": "warning"}),
    "a current that was filtered": (smoothed_current(), {"smoothed current": "warning"}),
    "a load faster than the log": (fast_load(), {"fast load": "warning"}),
    "a rebuilt clock": (rebuilt_clock(), {}),
    "a steady clock": (DRIVE.with_columns(pl.Series(STEP, LINES // 2000)), {}),
}
CAPACITY_AH = {
    "a large cell": 200.0,
    "milliamperes by the capacity": 0.2,
    "a noisy rest": 2.0,
    "more charge than the capacity": 1.7,
    "a current far too small": 2.0,
    "a little more": 1.9,
}
TEXTS = {}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_detected_by_its_check_and_its_errors_are_what_the_reader_raises(
    tmp_path, fault
):
    table, expected = FAULTS[fault]
    table.write_csv(tmp_path / "cell.csv")
    source = read_source(tmp_path / "cell.csv")
    outcome = check_file(source, capacity_ah=CAPACITY_AH.get(fault))
    assert counting(outcome) == expected
    assert all(each.remedy or not each.counts for each in outcome.findings)
    TEXTS[fault] = "".join(f"  {each.severity} {each.check}: {each}\n" for each in outcome.findings)
    if (seen := outcome.traits) is not None:
        moved = f"{seen.charged_ah:.4f} Ah in, {seen.discharged_ah:.4f} Ah out"
        TEXTS[fault] += f"  seen: {seen.facts['samples']} samples, {moved}\n"
    errors = [each for each in outcome.findings if each.severity == "error"]
    # Reading knows of no capacity.
    if not errors or fault == "milliamperes by the capacity":
        read_record(source)
        return
    with pytest.raises(InputError) as caught:
        read_record(source)
    assert str(caught.value) in {f"{each.about('cell.csv')}." for each in errors}


def test_every_finding_is_worded_as_it_was_written_down():
    if len(TEXTS) < len(FAULTS):
        pytest.skip("needs all faults in one process")
    text = "".join(f"{fault}\n{lines}" for fault, lines in TEXTS.items())
    assert "--" not in text
    for quoted in re.findall(r"`([^`]*)`", text):
        assert re.fullmatch(r"[a-z_]+(='?[\w.,-]+'?|='[a-z ]+=[^']+')?", quoted)
    require_golden(Path(__file__).with_name("findings.txt"), text)


# Every kind of spike on every record; of widths, each on each record.
@pytest.mark.parametrize(
    ("name", "column", "height", "width"),
    [
        (name, *spike, 1 + (index + number) % 3)
        for index, name in enumerate(BUNDLED_NAMES)
        for number, spike in enumerate([(VOLTAGE, 0.5), (VOLTAGE, -0.4), (CURRENT, 8.0)])
    ],
)
def test_a_spike_is_detected_at_its_row(tmp_path, name, column, height, width):
    table = frame(name)
    line = 3001 if name != "ocv_charge" else 4001
    lines = np.arange(line, line + width)
    outcome = checked(tmp_path, changed(table, column, array(table, column)[lines] + height, lines))
    assert counting(outcome) == {"spikes": "warning"}
    spikes = finding(outcome, "spikes")
    assert (spikes.row, spikes.values["samples"]) == (line + 2, width)
    assert spikes.values["channel"] == ("voltage" if column == VOLTAGE else "current")


@pytest.mark.parametrize("late", [3, -3, 5])
@pytest.mark.parametrize("column", [VOLTAGE, CURRENT])
def test_a_spike_beside_a_late_voltage_is_detected_at_its_row(tmp_path, late, column):
    table = DRIVE.with_columns(pl.col(VOLTAGE).shift(late)).drop_nulls()
    height = 0.5 if column == VOLTAGE else 8.0
    outcome = checked(tmp_path, changed(table, column, array(table, column)[3001] + height, 3001))
    assert finding(outcome, "spikes").row == 3003


def test_a_short_pulse_that_the_voltage_answers_is_no_spike(tmp_path):
    current_a = np.where(np.arange(3000) % 100 == 50, 4.0, 0.5 * (np.arange(3000) // 500 % 2))
    table = logged(np.arange(3000.0), -current_a, simulated_cell(current_a))
    assert checked(tmp_path, table).is_clean


@pytest.mark.parametrize("name", DRIVES)
@pytest.mark.parametrize(("column", "value"), [(VOLTAGE, None), (CURRENT, 0.0), (CURRENT, 0.5538)])
def test_a_channel_that_stands_still_is_detected(tmp_path, name, column, value):
    table = frame(name)
    value = array(table, column)[3000] if value is None else value
    outcome = checked(tmp_path, changed(table, column, value, np.arange(3000, 3400)))
    assert counting(outcome) == {"stuck": "error"}
    assert finding(outcome, "stuck").row == pytest.approx(3002, abs=3)
    assert finding(outcome, "stuck").values["channel"] == column.split(" ")[0].lower()


@pytest.mark.parametrize("name", BUNDLED_NAMES)
def test_a_clipped_voltage_is_detected(tmp_path, name):
    table = frame(name)
    clipped = changed(table, VOLTAGE, np.clip(array(table, VOLTAGE), 3.3, 3.9))
    assert "stops at" in finding(checked(tmp_path, clipped), "stuck").what


@pytest.mark.parametrize("name", DRIVES)
def test_a_clipped_current_is_detected_at_both_ends(tmp_path, name):
    table = frame(name)
    table = changed(table, CURRENT, np.clip(array(table, CURRENT), -1.5, 1.5))
    findings = checked(tmp_path, table).findings
    clipped = [finding.what for finding in findings if finding.check == "clipped current"]
    assert [re.findall(r"-?[\d.]+ A", what)[0] for what in clipped] == ["-1.5 A", "1.5 A"]


@pytest.mark.parametrize("noise_a", [0.0, 0.01])
def test_a_held_voltage_is_not_stuck(tmp_path, noise_a):
    # 4.2 V held to the last digit while the charging current tapers, then rest.
    seconds = np.arange(9000.0)
    current_a = np.where(seconds < 3000, 1.0, np.exp(-(seconds - 3000) / 900))
    current_a += np.random.default_rng(0).normal(0, noise_a, 9000)
    current_a[seconds >= 7000] = 0.0
    voltage_v = np.where(seconds < 3000, 3.9 + 0.3 * seconds / 3000, 4.2)
    voltage_v[seconds >= 7000] = 4.19
    for start in range(0, 2000, 200):
        current_a[start : start + 20] = 0.0
        voltage_v[start : start + 20] -= 0.06
    table = logged(seconds, np.round(current_a, 3), voltage_v)
    assert not counting(checked(tmp_path, table)).keys() & {"stuck"}


def test_a_step_of_the_current_that_the_voltage_answers_late_is_no_break(tmp_path):
    current_a = np.concatenate([np.tile(np.repeat([0.0, 1.0], 15), 20), np.repeat([0.0, 5.8], 60)])
    voltage_v = simulated_cell(current_a)
    voltage_v[1:] -= 0.85 * np.diff(voltage_v)
    table = logged(np.arange(720.0), -current_a, np.round(voltage_v, 4))
    assert counting(checked(tmp_path, table)) == {"late voltage": "warning"}
    shifted_v = np.where(np.arange(720) < 640, voltage_v, voltage_v - 0.2)
    assert "breaks" in counting(checked(tmp_path, changed(table, VOLTAGE, shifted_v)))


@pytest.mark.parametrize("name", BUNDLED_NAMES)
@pytest.mark.parametrize("offset_a", [0.05, -0.05, 0.005])
def test_a_current_offset_at_rest_is_detected_with_its_size(tmp_path, name, offset_a):
    table = frame(name)
    outcome = checked(tmp_path, changed(table, CURRENT, array(table, CURRENT) + offset_a))
    rests = finding(outcome, "rests")
    assert rests.severity == "warning"
    size_ma = float(rests.what.removeprefix("the current is ").split(" mA")[0])
    assert size_ma == pytest.approx(1e3 * offset_a, abs=1.0)
    # Only what is taken as an OCV test misplaces an OCV.
    if offset_a == 0.005:
        assert ("which R0 and the other" in rests.what) == name.startswith("ocv")
    # Past C/100 barnax would not see the rests.
    assert ("`rest_current" in rests.remedy) == (abs(offset_a) > 0.02)


@pytest.mark.parametrize("name", DRIVES)
def test_a_current_without_a_sign_is_an_error(tmp_path, name):
    table = frame(name)
    outcome = checked(tmp_path, changed(table, CURRENT, np.abs(array(table, CURRENT))))
    assert counting(outcome) == {"sign": "error"}


@pytest.mark.parametrize("name", BUNDLED_NAMES)
def test_a_sign_that_turns_is_detected_where_it_does(tmp_path, name):
    table = frame(name)
    half = table.height // 2
    turned = np.where(np.arange(table.height) < half, 1.0, -1.0) * array(table, CURRENT)
    outcome = checked(tmp_path, changed(table, CURRENT, turned))
    assert counting(outcome) == {"sign": "error"}
    # The first clear step after the turn, or the turn's own.
    assert 0 <= finding(outcome, "sign").row - half < 500


def test_a_hard_drive_cycle_without_its_sign_is_detected(tmp_path, real_data):
    """US06 charges so seldom that few of its steps contradict the others."""
    (path,) = real_data.glob("calce*/us06_25degC_80soc*.parquet")
    table = pl.read_parquet(path)[[TIME, CURRENT, VOLTAGE]]
    outcome = checked(tmp_path, table.with_columns(pl.col(CURRENT).abs()))
    assert counting(outcome) == {"sign": "error"}


def test_a_hole_that_the_counters_saw_is_no_wrong_unit(tmp_path):
    outcome = checked(tmp_path, cut(with_counters(DRIVE), 3000, 9000))
    assert "throughout" not in finding(outcome, "counters").what


def test_a_gap_between_two_rests_is_not_in_doubt(tmp_path):
    """300 s of a rest that the tester left out, just before the load that follows."""
    current_a = array(OUT, CURRENT)
    load = 1 + int(np.flatnonzero(np.abs(np.diff(current_a)) > 0.5)[2])
    clock = array(OUT, TIME)
    last = int(np.searchsorted(clock, clock[load] - 320))
    outcome = checked(tmp_path, cut(OUT, last, load - 1))
    assert outcome.is_clean
    assert "nothing seems to happen" in finding(outcome, "gaps").what


def in_bursts(usual_s, within_s):
    """Intervals of a drive, often short for a while, with a long one in the middle of that."""
    interval_s = np.full(len(DRIVE) - 1, usual_s)
    for start in range(1000, 9000, 200):
        interval_s[start : start + 20] = 0.1
        interval_s[start + 10] = within_s(start)
    return interval_s


def spaced(folder, interval_s):
    return checked(folder, changed(DRIVE, TIME, np.concatenate([[0], np.cumsum(interval_s)])))


def test_an_interval_as_long_as_the_usual_ones_elsewhere_is_no_gap(tmp_path):
    """A log every 5 s, and every 0.1 s on both sides of some of its intervals."""
    interval_s = in_bursts(5.0, lambda start: 5.018)
    assert "gaps" not in {each.check for each in spaced(tmp_path, interval_s).findings}
    interval_s[3010] = 31.0
    assert "a gap of 31 s" in finding(spaced(tmp_path, interval_s), "gaps").what


def test_no_more_charge_is_in_doubt_than_passed(tmp_path):
    """A day without samples, after a minute of pulses, and the voltage is lower after it."""
    cut_s = np.where(LINES[:120] < 60, LINES[:120], LINES[:120] + 86400.0)
    after = LINES[60:120]
    lower = changed(DRIVE[:120], VOLTAGE, array(DRIVE, VOLTAGE)[after] - 0.05, after)
    what = finding(checked(tmp_path, changed(lower, TIME, cut_s)), "gaps").what
    assert "what passed meanwhile was not logged" in what

"""Values in other units than their names say: found, and the rest seen in the right ones."""

import numpy as np
import polars as pl
import pytest

from barnax.bundled import BUNDLED_NAMES
from helpers.records import (
    CAPACITY_AH,
    CURRENT,
    TIME,
    VOLTAGE,
    changed,
    checked,
    counting,
    found,
    frame,
    with_counters,
)

CLEAN = {}


def scaled(table, column, factor):
    return changed(table, column, table[column].to_numpy() * factor)


def assert_seen_through(folder, name, diagnosis):
    """The facts are those of the clean record."""
    if name not in CLEAN:
        CLEAN[name] = checked(folder, frame(name)).facts
    mine, clean = diagnosis.facts, CLEAN[name]
    assert mine.samples == clean.samples
    assert mine.charged_ah == pytest.approx(clean.charged_ah, rel=1e-6)
    assert mine.discharged_ah == pytest.approx(clean.discharged_ah, rel=1e-6)
    assert mine.interval_s == pytest.approx(clean.interval_s, rel=1e-6)
    assert mine.voltage_v == pytest.approx(clean.voltage_v, rel=1e-6)


@pytest.mark.parametrize("counters", [False, True], ids=["alone", "with counters"])
@pytest.mark.parametrize(
    ("unit", "symbol", "seconds"),
    [("minutes", "min", 60), ("hours", "h", 3600), ("milliseconds", "ms", 1e-3)],
)
@pytest.mark.parametrize("name", BUNDLED_NAMES)
def test_time_in_another_unit_is_named(tmp_path, name, unit, symbol, seconds, counters):
    table = with_counters(frame(name)) if counters else frame(name)
    diagnosis = checked(tmp_path, scaled(table, TIME, 1 / seconds))
    assert counting(diagnosis) == {"time unit": "error"}
    assert f"looks like {unit}" in found(diagnosis, "time unit").what
    assert found(diagnosis, "time unit").remedy == f"rename the column to 'Test Time / {symbol}'"
    assert_seen_through(tmp_path, name, diagnosis)


@pytest.mark.parametrize("unit", ["h", "min"])
@pytest.mark.parametrize("name", BUNDLED_NAMES)
def test_seconds_under_a_longer_unit_s_name_are_named(tmp_path, name, unit):
    diagnosis = checked(tmp_path, frame(name).rename({TIME: f"Test Time / {unit}"}))
    assert counting(diagnosis) == {"time unit": "error"}
    assert "looks like seconds" in found(diagnosis, "time unit").what
    assert_seen_through(tmp_path, name, diagnosis)


@pytest.mark.parametrize("name", BUNDLED_NAMES)
def test_milliamperes_are_named_at_the_largest(tmp_path, name):
    table = scaled(frame(name), CURRENT, 1e3)
    diagnosis = checked(tmp_path, table)
    assert counting(diagnosis) == {"current unit": "error"}
    assert found(diagnosis, "current unit").remedy == "rename the column to 'Current / mA'"
    assert found(diagnosis, "current unit").row == 2 + int(
        np.argmax(np.abs(table[CURRENT].to_numpy()))
    )
    assert_seen_through(tmp_path, name, diagnosis)


def test_milliamperes_of_a_short_record_are_told_by_the_capacity(tmp_path):
    # 400 mA pulses over 0.3 Ah look like a large cell's amperes.
    table = scaled(frame()[:2500], CURRENT, 1e2)
    assert checked(tmp_path, table).facts.discharged_ah > 20
    diagnosis = checked(tmp_path, table, capacity_ah=0.2)
    assert "of a cell of 0.2 Ah" in found(diagnosis, "current unit").what


@pytest.mark.parametrize("evidence", ["capacity", "counters"])
def test_amperes_under_a_milliampere_s_name_are_named(tmp_path, evidence):
    table = with_counters(frame()) if evidence == "counters" else frame()
    capacity_ah = CAPACITY_AH if evidence == "capacity" else None
    diagnosis = checked(tmp_path, table.rename({CURRENT: "Current / mA"}), capacity_ah=capacity_ah)
    assert counting(diagnosis) == {"current unit": "error"}
    assert "amperes, not milliamperes" in found(diagnosis, "current unit").what
    assert_seen_through(tmp_path, "identification", diagnosis)


@pytest.mark.parametrize(
    ("factor", "words", "remedy"),
    [
        (1e3, "millivolts", "'Voltage / mV'"),
        (-1.0, "negative", "turn its sign"),
        (12.0, "about 12 in series", "one cell"),
        (1e-3, "kilovolts", "multiply"),
    ],
)
def test_a_voltage_no_cell_has_is_named(tmp_path, factor, words, remedy):
    diagnosis = checked(tmp_path, scaled(frame(), VOLTAGE, factor))
    assert counting(diagnosis) == {"voltage unit": "error"}
    assert words in found(diagnosis, "voltage unit").what
    assert remedy in found(diagnosis, "voltage unit").remedy
    assert_seen_through(tmp_path, "identification", diagnosis)


@pytest.mark.parametrize(("wrong_v", "severity"), [(0.0, "warning"), (65_535.0, "error")])
def test_a_single_voltage_no_cell_has_is_named_by_its_row(tmp_path, wrong_v, severity):
    diagnosis = checked(tmp_path, changed(frame(), VOLTAGE, wrong_v, [77]))
    assert counting(diagnosis) == {"voltage unit": severity}
    assert found(diagnosis, "voltage unit").row == 79


def test_a_current_of_nothing_but_zeros_is_an_error(tmp_path):
    diagnosis = checked(tmp_path, scaled(frame(), CURRENT, 0.0))
    assert "every current in 'Current / A' is zero" in found(diagnosis, "current unit").what


def test_units_that_names_state_are_converted_with_a_note(tmp_path):
    table = scaled(scaled(frame(), TIME, 1 / 3600), CURRENT, 1e3)
    diagnosis = checked(tmp_path, table.rename({TIME: "Time [h]", CURRENT: "Current [mA]"}))
    assert diagnosis.is_clean
    assert "from h to s" in found(diagnosis, "units").what
    assert_seen_through(tmp_path, "identification", diagnosis)


def test_a_large_cell_is_no_milliampere_file(tmp_path):
    table = scaled(frame(), CURRENT, 100.0)
    assert checked(tmp_path, table, capacity_ah=200.0).is_clean


def test_a_slow_log_in_seconds_is_no_millisecond_file(tmp_path):
    hours = np.linspace(0, 40, 241)
    table = pl.DataFrame(
        {TIME: hours * 3600, CURRENT: 0 * hours - 0.05, VOLTAGE: 4.1 - 0.03 * hours}
    )
    assert "error" not in counting(checked(tmp_path, table, capacity_ah=2.0)).values()

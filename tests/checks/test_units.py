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


def assert_seen_through(folder, name, outcome):
    """The facts are those of the clean record."""
    if name not in CLEAN:
        CLEAN[name] = checked(folder, frame(name)).facts
    mine, clean = outcome.facts, CLEAN[name]
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
    outcome = checked(tmp_path, scaled(table, TIME, 1 / seconds))
    assert counting(outcome) == {"time unit": "error"}
    assert f"looks like {unit}" in found(outcome, "time unit").what
    assert found(outcome, "time unit").remedy == f"rename the column to 'Test Time / {symbol}'"
    assert_seen_through(tmp_path, name, outcome)


@pytest.mark.parametrize("unit", ["h", "min"])
@pytest.mark.parametrize("name", BUNDLED_NAMES)
def test_seconds_under_a_longer_unit_s_name_are_named(tmp_path, name, unit):
    outcome = checked(tmp_path, frame(name).rename({TIME: f"Test Time / {unit}"}))
    assert counting(outcome) == {"time unit": "error"}
    assert "looks like seconds" in found(outcome, "time unit").what
    assert_seen_through(tmp_path, name, outcome)


@pytest.mark.parametrize("name", BUNDLED_NAMES)
def test_milliamperes_are_named_at_the_largest(tmp_path, name):
    table = scaled(frame(name), CURRENT, 1e3)
    outcome = checked(tmp_path, table)
    assert counting(outcome) == {"current unit": "error"}
    assert found(outcome, "current unit").remedy == "rename the column to 'Current / mA'"
    assert found(outcome, "current unit").row == 2 + int(
        np.argmax(np.abs(table[CURRENT].to_numpy()))
    )
    assert_seen_through(tmp_path, name, outcome)


@pytest.mark.parametrize("evidence", ["capacity", "counters"])
def test_amperes_under_a_milliampere_s_name_are_named(tmp_path, evidence):
    table = with_counters(frame()) if evidence == "counters" else frame()
    capacity_ah = CAPACITY_AH if evidence == "capacity" else None
    outcome = checked(tmp_path, table.rename({CURRENT: "Current / mA"}), capacity_ah=capacity_ah)
    assert counting(outcome) == {"current unit": "error"}
    assert "amperes, not milliamperes" in found(outcome, "current unit").what
    assert_seen_through(tmp_path, "identification", outcome)


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
    outcome = checked(tmp_path, scaled(frame(), VOLTAGE, factor))
    assert counting(outcome) == {"voltage unit": "error"}
    assert words in found(outcome, "voltage unit").what
    assert remedy in found(outcome, "voltage unit").remedy
    assert_seen_through(tmp_path, "identification", outcome)


def test_units_that_names_state_are_converted_with_a_note(tmp_path):
    table = scaled(scaled(frame(), TIME, 1 / 3600), CURRENT, 1e3)
    outcome = checked(tmp_path, table.rename({TIME: "Time [h]", CURRENT: "Current [mA]"}))
    assert outcome.is_clean
    assert "from h to s" in found(outcome, "columns").what
    assert_seen_through(tmp_path, "identification", outcome)


def test_a_slow_log_in_seconds_is_no_millisecond_file(tmp_path):
    hours = np.linspace(0, 40, 241)
    table = pl.DataFrame(
        {TIME: hours * 3600, CURRENT: 0 * hours - 0.05, VOLTAGE: 4.1 - 0.03 * hours}
    )
    assert "error" not in counting(checked(tmp_path, table, capacity_ah=2.0)).values()

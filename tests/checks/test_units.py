"""Values in other units than their names say: found, and the rest seen in the right ones."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from barnax import InputError, check_file
from barnax.bundled import BUNDLED_NAMES
from barnax.records import record_from_frame, source_from_frame
from helpers.records import (
    CAPACITY_AH,
    CURRENT,
    TIME,
    VOLTAGE,
    checked,
    counting,
    finding,
    frame,
    logged,
    pulse_frame,
    remarks,
    scaled,
    with_counters,
)

CLEAN = {}
FACTS = "samples", "charged [A.h]", "discharged [A.h]", "median interval [s]", "voltage [V]"


def test_the_units_of_a_testers_format_are_not_in_doubt():
    source = source_from_frame(times(TIME, 1 / 60)(frame()), "cell.ndax")
    assert counting(check_file(source)) == {"unit": "error"}
    known = replace(source, table=replace(source.table, has_fixed_units=True))
    assert "unit" not in counting(check_file(known))


def assert_seen_through(folder, name, outcome):
    """The facts are those of the clean record."""
    if name not in CLEAN:
        CLEAN[name] = checked(folder, frame(name)).traits
    mine, clean = outcome.traits.facts, CLEAN[name].facts
    for fact in FACTS:
        assert mine[fact] == pytest.approx(clean[fact], rel=1e-6)


def times(column, factor):
    return lambda table: scaled(table, column, factor)


def named(column, name):
    return lambda table: table.rename({column: name})


# What is done to a record, the check that finds it, and words of what it says and advises.
FAULTS = {
    "minutes": (times(TIME, 1 / 60), "unit", "minutes", "'Test Time / min'"),
    "hours": (times(TIME, 1 / 3600), "unit", "hours", "'Test Time / h'"),
    "milliseconds": (times(TIME, 1e3), "unit", "milliseconds", "'Test Time / ms'"),
    "no hours": (named(TIME, "Test Time / h"), "unit", "seconds", "'Test Time / s'"),
    "no minutes": (named(TIME, "Test Time / min"), "unit", "seconds", "'Test Time / s'"),
    "milliamperes": (times(CURRENT, 1e3), "unit", "milliamperes", "'Current / mA'"),
    "no milliamperes": (
        named(CURRENT, "Current / mA"),
        "unit",
        "amperes, not milliamperes",
        "'Current / A'",
    ),
    "millivolts": (times(VOLTAGE, 1e3), "voltage unit", "millivolts", "'Voltage / mV'"),
    "swapped leads": (times(VOLTAGE, -1.0), "voltage unit", "negative", "turn its sign"),
    "a module": (times(VOLTAGE, 12.0), "voltage unit", "about 12 in series", "one cell"),
    "kilovolts": (times(VOLTAGE, 1e-3), "voltage unit", "kilovolts", "multiply"),
}

# How many cells a module has shows by their voltage near its middle, and currents too small for
# their name by counters, or beside a capacity where much of it moves.
ONCE = {"a module", "no milliamperes"}
# Every second record has a tester's counters.
# With counters and without; other records are slow tests.
CASES = [
    pytest.param(name, fault, bool(place % 2), marks=[pytest.mark.slow] if place > 1 else [])
    for fault in FAULTS
    for place, name in enumerate(BUNDLED_NAMES)
    if fault not in ONCE
]
CASES += [("identification", fault, counters) for fault in sorted(ONCE) for counters in (0, 1)]


@pytest.mark.parametrize(("name", "fault", "counters"), CASES)
def test_another_unit_is_named_and_the_rest_seen_through(tmp_path, name, fault, counters):
    change, check, words, remedy = FAULTS[fault]
    capacity_ah = CAPACITY_AH if fault == "no milliamperes" and not counters else None
    table = change(with_counters(frame(name)) if counters else frame(name))
    outcome = checked(tmp_path, table, capacity_ah=capacity_ah)
    assert counting(outcome) == {check: "error"}
    assert words in finding(outcome, check).what
    assert remedy in finding(outcome, check).remedy
    if "amperes" in words:
        largest = int(np.argmax(np.abs(table[table.columns[1]].to_numpy())))
        assert finding(outcome, check).row == 2 + largest
    assert_seen_through(tmp_path, name, outcome)


def test_units_that_names_state_are_converted_with_a_note(tmp_path):
    table = scaled(scaled(frame(), TIME, 1 / 3600), CURRENT, 1e3)
    outcome = checked(tmp_path, table.rename({TIME: "Time [h]", CURRENT: "Current [mA]"}))
    assert outcome.is_clean
    assert "from h to s" in finding(outcome, "columns").what
    assert_seen_through(tmp_path, "identification", outcome)


def test_a_slow_log_in_seconds_is_no_millisecond_file(tmp_path):
    hours = np.linspace(0, 40, 241)
    table = logged(hours * 3600, 0 * hours - 0.05, 4.1 - 0.03 * hours)
    assert "error" not in counting(checked(tmp_path, table, capacity_ah=2.0)).values()


def swept(interval_s, late, relaxing_v):
    """A C/20 discharge between two rests, with a voltage so many rows late, and what it relaxes by
    within minutes after it."""
    rest, load = int(1800 / interval_s), int(72_000 / interval_s)
    current_a = np.concatenate([np.zeros(rest), np.full(load, -0.1), np.zeros(rest)])
    soc = 1 + np.append(0, np.cumsum(current_a[:-1])) * interval_s / 3600 / 2
    voltage_v = 3.05 + 1.1 * soc - 0.25 * np.exp(-soc / 0.03) + 0.05 * current_a
    after_s = interval_s * np.arange(1, rest + 1)
    voltage_v[-rest:] += relaxing_v * -np.expm1(-after_s / 60)
    voltage_v = np.append(np.full(late, voltage_v[0]), voltage_v)[: len(current_a)]
    return logged(interval_s * np.arange(len(current_a)), current_a, np.round(voltage_v, 5))


@pytest.mark.parametrize(
    ("interval_s", "late", "relaxing_v"), [(2.0, 1, 0.0), (300.0, 0, 0.5), (300.0, 1, 0.5)]
)
def test_a_slow_sweep_whose_steps_are_hidden_is_not_in_minutes(interval_s, late, relaxing_v):
    """A voltage that is late by a row shows no step, and one that is logged slowly shows what it
    relaxes by in its place."""
    outcome = check_file(source_from_frame(swept(interval_s, late, relaxing_v), "sweep"))
    assert "unit" not in counting(outcome)


def test_a_time_converted_twice_is_detected_by_a_load_whose_current_is_of_means():
    """An hour of 0, C/2, 1C or 2C each second, the current the mean of two rows: many of its steps
    show little of the resistance."""
    rng = np.random.default_rng(1)
    current_a = -CAPACITY_AH * rng.choice([0, 0.5, 1, 2], 3600, p=[0.6, 0.1, 0.1, 0.2])
    soc = 1 + np.append(0, np.cumsum(current_a[:-1])) / 3600 / 2.4
    voltage_v = 3.2 + soc + 0.03 * current_a + 5e-4 * rng.standard_normal(3600)
    mean_a = np.append(current_a[0], (current_a[1:] + current_a[:-1]) / 2)
    table = logged(60 * np.arange(3600.0), mean_a, np.round(voltage_v, 3))
    outcome = check_file(source_from_frame(table.rename({TIME: "Time [s]"}), "drive"))
    assert "minutes, converted to seconds twice" in finding(outcome, "unit").what


def test_a_current_named_in_milliamperes_is_not_taken_for_them_again(tmp_path):
    """Whatever the capacity, which may be another cell's."""
    table = scaled(frame(), CURRENT, 1e3).rename({CURRENT: "Current [mA]"})
    found_checks = {each.check for each in checked(tmp_path, table, capacity_ah=0.05).findings}
    assert "unit" not in found_checks
    assert "capacity" in found_checks


def test_a_charge_of_the_interval_too_small_for_the_cell_is_reported_by_its_name():
    table = pulse_frame().select(
        pl.col(TIME).alias("time/s"),
        (pl.col(CURRENT) / 3600).alias("dq/mA.h"),
        (pl.col(VOLTAGE) - pl.col(TIME) / 200).alias("Ewe/V"),
    )
    findings = check_file(source_from_frame(table, "cell"), capacity_ah=CAPACITY_AH).findings
    remedies = {one.values["quantity"]: one.remedy for one in findings if one.check == "unit"}
    assert remedies["current"] == "correct the unit of 'dq/mA.h'"


# Two columns of one quantity that disagree as only a wrong one does.


@pytest.mark.parametrize("name", ["Sense Voltage / V", "Aux_Voltage_1(V)"])
def test_a_voltage_at_the_leads_is_distinguished_from_one_at_the_cell(tmp_path, name):
    drop_v = 0.02 * pl.col(CURRENT)
    outcome = checked(tmp_path, frame().with_columns((pl.col(VOLTAGE) + drop_v).alias(name)))
    assert counting(outcome) == {"twin columns": "warning"}
    twin = finding(outcome, "twin columns")
    assert f"'Voltage / V' and '{name}' differ by 20 mohm" in twin.what


@pytest.mark.parametrize("factor", [1.0, 1000.0, 0.5])
def test_currents_that_disagree_are_reported(tmp_path, factor):
    """A column in mA beside one in A agrees with it where its values are a thousand times it."""
    table = frame().with_columns((pl.col(CURRENT) * factor).alias("I / mA"))
    outcome = checked(tmp_path, table)
    ratio = factor / 1000
    expected = {} if ratio == 1 else {"twin columns": "warning"}
    assert counting(outcome) == expected
    if expected:
        assert f"{ratio:.4g} times the first" in finding(outcome, "twin columns").what


def test_other_columns_are_no_twins(tmp_path):
    rng = np.random.default_rng(0)
    table = frame().with_columns(
        pl.col(VOLTAGE).cum_max().alias("Maximum Voltage / V"),
        pl.Series("Voltage noise / V", rng.normal(3.7, 1e-3, frame().height)),
        pl.lit(4.2).alias("Voltage limit / V"),
        pl.col(CURRENT).sign().alias("Current direction"),
        (pl.col(VOLTAGE) * 96).alias("Pack Voltage / V"),
        (pl.col(VOLTAGE) * 1.02).alias("Set Voltage / V"),
        (pl.col(VOLTAGE) + 0.001).alias("Cell Voltage 2 / V"),
    )
    assert counting(checked(tmp_path, table)) == {}


@pytest.mark.parametrize("apart_v", [0.03, -1.0])
def test_two_voltages_that_differ_are_to_be_chosen_from(apart_v):
    other = (pl.col(VOLTAGE) + apart_v).alias("Cell Voltage / V")
    table = pulse_frame().with_columns(other).rename({VOLTAGE: "voltage"})
    with pytest.raises(InputError, match=r"'Cell Voltage / V' and 'voltage' differ by .* mV, and"):
        record_from_frame(table)
    for name, extra_v in (("voltage", 0.0), ("Cell Voltage / V", apart_v)):
        record = record_from_frame(table, columns={"voltage": name})
        np.testing.assert_allclose(record.voltage_v, table["voltage"].to_numpy() + extra_v)


def test_a_second_voltage_beside_the_one_that_a_tester_names_is_reported_where_it_reads_alike():
    aux = (pl.col(VOLTAGE) + 0.03).alias("Aux_Voltage_1(V)")
    table = pulse_frame().with_columns(aux, pl.lit(1).alias("Step_Index"))
    table.columns = ["Test_Time(s)", "Current(A)", "Voltage(V)", *table.columns[3:]]
    assert "'Aux_Voltage_1(V)' differ by 30 mV" in " ".join(remarks(record_from_frame(table)))

"""Ampere-hours by integration, by counters and against the capacity; gaps and odd clocks."""

import numpy as np
import polars as pl
import pytest

from barnax.records import read_record
from helpers.records import (
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

CHARGED, DISCHARGED = "Charging Capacity / Ah", "Discharging Capacity / Ah"


def test_the_integrated_charge_is_that_of_a_plain_sum(tmp_path):
    table = frame()
    moved_ah = table[CURRENT].to_numpy()[:-1] * np.diff(table[TIME].to_numpy()) / 3600
    facts = checked(tmp_path, table).facts
    assert facts.charged_ah == pytest.approx(moved_ah[moved_ah > 0].sum())
    assert facts.discharged_ah == pytest.approx(-moved_ah[moved_ah < 0].sum())


def test_counters_that_agree_are_clean(tmp_path):
    assert not checked(tmp_path, with_counters(frame())).findings


def test_counters_that_disagree_are_a_warning_with_both_figures(tmp_path):
    counters = found(checked(tmp_path, with_counters(frame(), 1.06)), "counters")
    assert counters.severity == "warning"
    assert "2.822 Ah out by integration" in counters.what
    assert "2.991 by the tester's counters" in counters.what


def test_counters_that_disagree_a_little_are_a_note(tmp_path):
    counters = found(checked(tmp_path, with_counters(frame(), 1.03)), "counters")
    assert counters.severity == "note"


def test_counters_in_milliampere_hours_are_a_warning(tmp_path):
    counters = found(checked(tmp_path, with_counters(frame(), 1000.0)), "counters")
    assert counters.severity == "warning"
    assert "look like mAh" in counters.what


def test_exchanged_counters_are_a_note(tmp_path):
    table = with_counters(frame()).rename({CHARGED: "x"}).rename({DISCHARGED: CHARGED})
    counters = found(checked(tmp_path, table.rename({"x": DISCHARGED})), "counters")
    assert "are exchanged" in counters.what


def test_counters_that_began_earlier_are_a_note(tmp_path):
    table = with_counters(frame()).with_columns(pl.col(DISCHARGED) + 1.25)
    diagnosis = checked(tmp_path, table)
    assert diagnosis.is_clean
    assert "begins within a test: the tester had counted 1.25 Ah out" in (
        found(diagnosis, "counters").what
    )


@pytest.mark.parametrize(("capacity_ah", "severity"), [(1.7, "warning"), (1.9, None), (2.5, None)])
def test_more_charge_than_the_capacity_is_a_warning(tmp_path, capacity_ah, severity):
    diagnosis = checked(tmp_path, frame(), capacity_ah=capacity_ah)
    assert counting(diagnosis).get("capacity") == severity


def test_an_ocv_test_that_does_not_close_is_a_warning_where_the_second_half_begins(tmp_path):
    hours = np.arange(0, 40, 0.02)
    is_charge = hours >= 20
    current_a = np.where(is_charge, 0.092, -0.1)
    voltage_v = 4.1 - 0.08 * np.where(is_charge, 40 - hours, hours) / 2
    table = pl.DataFrame({TIME: hours * 3600, CURRENT: current_a, VOLTAGE: voltage_v})
    closure = found(checked(tmp_path, table), "closure")
    assert closure.severity == "warning"
    assert "-8" in closure.what
    assert closure.row == pytest.approx(2 + np.argmax(is_charge), abs=1)


def test_a_gap_under_load_is_a_warning_with_the_charge_in_doubt(tmp_path):
    table = frame()
    gaps = found(checked(tmp_path, pl.concat([table[:3000], table[3600:]])), "gaps")
    assert (gaps.severity, gaps.row) == ("warning", 3002)
    assert "the longest 601 s" in gaps.what
    assert "Ah are in doubt" in gaps.what
    assert "`start_time`" in gaps.remedy


def test_a_gap_inside_a_rest_is_a_note(tmp_path):
    table = frame("ocv_discharge")
    clock = table[TIME].to_numpy()
    rests = np.flatnonzero(np.diff(clock) > 29)
    # A second of each half minute is logged there; ten of them are missing.
    middle = int(rests[100])
    diagnosis = checked(tmp_path, pl.concat([table[:middle], table[middle + 10 :]]))
    assert diagnosis.is_clean
    assert "nothing happens" in found(diagnosis, "gaps").what


def test_a_gap_in_which_a_rested_cell_was_moved_is_a_warning(tmp_path):
    table = frame("ocv_discharge")
    low = table.filter(pl.col(TIME) > 100_000)
    diagnosis = checked(tmp_path, pl.concat([table.filter(pl.col(TIME) < 4000), low]))
    assert counting(diagnosis)["gaps"] == "warning"


def test_a_coarser_log_at_rest_is_no_gap(tmp_path):
    table = frame("ocv_charge")
    assert np.diff(table[TIME].to_numpy()).max() > 29
    checks = [finding.check for finding in checked(tmp_path, table).findings]
    assert "gaps" not in checks


def test_a_long_interval_under_load_is_a_note(tmp_path):
    table = frame()
    kept = np.concatenate([np.arange(9000), np.arange(9000, 19_680, 60)])
    diagnosis = checked(tmp_path, table[kept])
    assert "intervals of 60 s under load" in found(diagnosis, "coarse intervals").what


def test_a_clock_laid_evenly_in_each_step_is_a_note(tmp_path):
    table = frame()
    step = np.arange(table.height) // 2000
    pace_s = 1 + 1e-4 * step
    table = changed(table, TIME, np.cumsum(pace_s)).with_columns(pl.Series("Step Index / 1", step))
    diagnosis = checked(tmp_path, table)
    assert diagnosis.is_clean
    assert "it was rebuilt, not logged" in found(diagnosis, "rebuilt clock").what


def test_a_steady_clock_with_steps_is_not_called_rebuilt(tmp_path):
    table = frame().with_columns(pl.Series("Step Index / 1", np.arange(19_680) // 2000))
    assert not checked(tmp_path, table).findings


def test_both_sides_of_a_step_are_a_note(tmp_path):
    diagnosis = checked(tmp_path, frame("ocv_charge"))
    assert "60 samples within" in found(diagnosis, "repeats").what
    clock = read_record(tmp_path / "cell.csv").time_s
    assert int((np.diff(clock) < 0.05).sum()) == 60

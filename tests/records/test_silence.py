"""Loggers that write no rows, or no current, while no current flows."""

import numpy as np
import polars as pl
import pytest

from barnax import InputError, check_file
from barnax.records import record_from_frame, source_from_frame
from barnax.records.log import in_means
from helpers.problems import drive_a
from helpers.records import simulated_cell

LOADED, CAPACITY_AH = 6000, 2.0


def drive(rests=60, resting_s=(5, 900), seed=0):
    """Time, current (discharge positive) and voltage of a known cell, with so many rests."""
    draw = np.random.default_rng(seed)
    current_a = drive_a(LOADED, seed=seed, interval=20)
    # Every load is one, so that only rests have no current.
    current_a = np.where(np.abs(current_a) < 0.05, 0.3, current_a)
    current_a *= 0.9 * 3600 * CAPACITY_AH / np.sum(current_a)
    # A rest ends with another load: gaps between rows of one current are of a steady one.
    places = np.sort(draw.choice(np.arange(100, LOADED - 100, 20), rests, replace=False))
    parts = [
        part
        for load in np.split(current_a, places)
        for part in (load, np.zeros(draw.integers(*resting_s)))
    ]
    current_a = np.concatenate(parts)
    voltage_v = simulated_cell(current_a, capacity_ah=CAPACITY_AH, soc=1.0)
    voltage_v += 3e-4 * draw.standard_normal(len(voltage_v))
    return np.arange(len(current_a), dtype=float), current_a, voltage_v


def table(time_s, current_a, voltage_v, is_written=slice(None)):
    columns = {"Time [s]": time_s, "Current [A]": -current_a, "Voltage [V]": voltage_v}
    return pl.DataFrame({name: values[is_written] for name, values in columns.items()})


@pytest.mark.parametrize(("rests", "resting_s"), [(60, (5, 900)), (4, (600, 3000))])
@pytest.mark.parametrize("resolution_v", [1e-4, 5e-3])
def test_gaps_of_a_logger_that_writes_nothing_at_rest_are_rests(rests, resting_s, resolution_v):
    time_s, current_a, voltage_v = drive(rests, resting_s)
    voltage_v = resolution_v * np.round(voltage_v / resolution_v)
    is_written = current_a != 0
    record = record_from_frame(table(time_s, current_a, voltage_v, is_written))
    assert np.sum(record.flowing < 1) > 0.9 * rests
    assert record.discharged_ah[-1] == pytest.approx(np.sum(current_a) / 3600, rel=0.01)
    # What the rows alone would tell.
    held_ah = np.sum(record.current_a[:-1] * record.interval_s) / 3600
    assert abs(held_ah / record.discharged_ah[-1] - 1) > 0.2


def test_a_logger_that_writes_nothing_at_rest_is_reported():
    time_s, current_a, voltage_v = drive()
    is_written = current_a != 0
    source = source_from_frame(table(time_s, current_a, voltage_v, is_written), "log")
    findings = check_file(source, capacity_ah=CAPACITY_AH).findings
    gaps = [each.values["charge"] for each in findings if each.code == "gaps.missing"]
    assert "resting" in gaps
    assert set(gaps) <= {"resting", "idle"}


def test_a_current_that_is_empty_at_rest_is_zero():
    time_s, current_a, voltage_v = drive()
    is_loaded = pl.when(pl.col("Current [A]") != 0)
    rows = table(time_s, current_a, voltage_v)
    record = record_from_frame(rows.with_columns(is_loaded.then(pl.col("Current [A]"))))
    np.testing.assert_allclose(record.current_a, current_a, atol=1e-12)
    assert [each.code for each in record.warnings] == ["cells.empty-current"]


def test_a_current_that_is_empty_under_load_is_refused():
    time_s, current_a, voltage_v = drive(rests=3, resting_s=(1, 3))
    is_full = pl.when((pl.col("Time [s]") % 2000).is_between(1000, 1100).not_())
    rows = table(time_s, current_a, voltage_v)
    with pytest.raises(InputError, match=r"'Current.*' contains nothing"):
        record_from_frame(rows.with_columns(is_full.then(pl.col("Current [A]"))))


@pytest.mark.parametrize(
    ("load_a", "gap_s", "gaps"), [(0.3, 600, 20), (0.1, 3600, 8), (1.0, 600, 9)]
)
def test_gaps_of_a_logger_that_writes_changes_alone_are_no_rests(load_a, gap_s, gaps):
    """Bursts, and between them a steady load of which nothing is written."""
    burst_a = np.where((np.arange(120) // 20) % 2 == 0, 2.0, load_a)
    burst_a[[0, -1]] = load_a
    current_a = np.tile(np.append(burst_a, np.full(gap_s, load_a)), gaps)
    is_written = np.tile(np.append(np.ones(120, bool), np.zeros(gap_s, bool)), gaps)
    voltage_v = 4.0 - 0.33 * np.append(0.0, np.cumsum(current_a[:-1])) / 3600 - 0.03 * current_a
    voltage_v += 3e-4 * np.random.default_rng(0).standard_normal(len(voltage_v))
    time_s = np.arange(len(current_a), dtype=float)
    record = record_from_frame(table(time_s, current_a, voltage_v, is_written))
    assert record.flowing is None


def test_in_means_a_rest_that_is_not_written_stays_one():
    time_s, current_a, voltage_v = drive(4, (600, 3000))
    is_written = current_a != 0
    record = record_from_frame(table(time_s, current_a, voltage_v, is_written))
    means = in_means(record, 10.0)
    assert means.discharged_ah[-1] == pytest.approx(
        np.interp(means.time_s[-1], record.time_s, record.discharged_ah), abs=2e-3
    )
    rests = means.interval_s > 500
    assert np.count_nonzero(rests) == 4
    assert np.max(np.abs(means.interval_current_a[rests])) < 0.1

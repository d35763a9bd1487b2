"""Loads that the logger left out: the tester's counters tell the charge."""

import numpy as np
import polars as pl
import pytest

from barnax import bundled_file, characterize, check_file, read_record
from helpers.records import checked, parquet, read

PULSES = bundled_file("hppc_25degC")
COUNTER = "Net Capacity / Ah"


def slow_discharges(record):
    """Where the pulse test moves from one level to the next: the loads of more than a minute."""
    is_loaded = record.current_a > 0.05
    edges = np.flatnonzero(np.diff(np.concatenate([[0], is_loaded.astype(int), [0]])))
    chosen = np.zeros(record.samples, bool)
    for first, stop in zip(edges[::2], edges[1::2], strict=True):
        chosen[first:stop] = (
            record.time_s[min(stop, record.samples - 1)] > record.time_s[first] + 60
        )
    return chosen


@pytest.fixture(scope="module")
def whole():
    return read_record(PULSES)


@pytest.fixture(scope="module")
def skipping(whole, tmp_path_factory):
    """The pulse test with its discharges between the levels left out, and a net counter."""
    table = pl.read_parquet(PULSES).with_columns(pl.Series(COUNTER, -whole.discharged_ah))
    path = tmp_path_factory.mktemp("skipping") / "pulses.parquet"
    table.filter(pl.Series(~slow_discharges(whole))).write_parquet(path)
    return path


def test_the_counters_are_the_charge_where_the_samples_show_nothing(whole, skipping):
    record = read_record(skipping)
    integrated = np.cumsum(record.interval_current_a * record.interval_s) / 3600
    assert np.ptp(integrated) < 0.2
    kept = whole.discharged_ah[~slow_discharges(whole)]
    np.testing.assert_allclose(record.discharged_ah, kept, atol=5e-4)
    assert characterize([record]).capacity_ah == pytest.approx(
        characterize([whole]).capacity_ah, rel=5e-4
    )


def test_skipped_loads_are_reported_and_the_file_serves_as_what_it_is(skipping):
    outcome = check_file(skipping)
    (notice,) = (each for each in outcome.findings if each.check == "skipped")
    assert notice.severity == "warning"
    assert "in 10 intervals the tester counted 1.81" in notice.what
    assert not [each for each in outcome.findings if each.code == "unit.reading"]
    (test,) = (role for role in outcome.roles if role.name == "OCV test")
    assert "discharge with 11 rests, 1.986 Ah" in test.reason


def test_without_counters_it_is_no_ocv_test_and_nothing_is_put_to_the_clock(skipping, tmp_path):
    outcome = checked(tmp_path, pl.read_parquet(skipping).drop(COUNTER), name="pulses.parquet")
    (gaps,) = (each for each in outcome.findings if each.check == "gaps")
    assert "what passed meanwhile was not logged" in gaps.what
    assert not [each for each in outcome.findings if each.code == "unit.reading"]
    assert "OCV test" not in [role.name for role in outcome.roles if role.is_usable]


def test_a_whole_record_has_nothing_skipped_however_coarse_or_late_its_counter(whole, tmp_path):
    charge_ah = -whole.discharged_ah
    late = charge_ah[np.arange(len(charge_ah)) // 30 * 30]
    for counter_ah in (charge_ah, np.round(charge_ah, 2), late):
        table = pl.read_parquet(PULSES).with_columns(pl.Series(COUNTER, counter_ah))
        record = read(tmp_path, parquet(table), "whole.parquet")
        assert record.skipped_ah is None
        np.testing.assert_array_equal(record.discharged_ah, whole.discharged_ah)

"""Slow constant-current sweeps of a cell whose OCV is known."""

from dataclasses import replace

import numpy as np
import pytest

from barnax.cell import characterize
from barnax.cell.ocv_points import find_slow_sweeps
from helpers.ocv_tests import CAPACITY_AH, RESISTANCE_OHM, branch_v, driven, record_of

HOURS = 20
CURRENT_A = CAPACITY_AH / HOURS
SWEEP = np.ones(HOURS * 360)
REST = np.zeros(360)
INNER = np.linspace(0.02, 0.98, 49)


def sweep(direction: int, **changes) -> object:
    start_soc = 1.0 if direction < 0 else 0.0
    options = {"interval_s": 10.0, "start_soc": start_soc, "direction": direction} | changes
    return driven(REST, -direction * CURRENT_A * SWEEP, REST, **options)


def under_load_v(soc: np.ndarray, direction: int) -> np.ndarray:
    return branch_v(soc, direction) + direction * RESISTANCE_OHM * CURRENT_A


def slow_sweeps(record):
    return find_slow_sweeps(record.segments(record.span_ah / 100))


@pytest.mark.parametrize("hold", ["forward", "backward"])
@pytest.mark.parametrize("direction", [-1, 1])
def test_a_slow_sweep_gives_its_branch(direction, hold):
    cell = characterize([sweep(direction, hold=hold)], ocv_fit="interpolated")
    curve = cell.charge if direction > 0 else cell.discharge
    np.testing.assert_allclose(curve(INNER), under_load_v(INNER, direction), atol=1e-4)


def test_each_slow_sweep_is_scaled_by_its_charge():
    shorter = sweep(+1)
    shorter = replace(shorter, current_a=shorter.current_a * 0.9)
    cell = characterize([sweep(-1), shorter], ocv_fit="interpolated")
    assert cell.charge_points[-1].soc == pytest.approx(1.0, abs=2e-4)
    assert "ocv-test.open" in {each.code for each in cell.warnings}


@pytest.mark.parametrize(("returned", "end"), [(0.985, 0.985), (0.9, 1.0)])
def test_a_charge_that_nearly_closes_in_its_record_ends_where_the_charge_says(returned, end):
    down = CURRENT_A * SWEEP
    record = driven(REST, down, REST, -returned * down, REST, interval_s=10.0)
    cell = characterize([record], capacity_ah=1.01 * CAPACITY_AH)
    assert cell.charge_points[-1].soc == pytest.approx(end, abs=2e-4)
    assert cell.discharge_points[0].soc == pytest.approx(0.0, abs=2e-4)


@pytest.mark.parametrize("direction", [-1, 1])
def test_noise_is_averaged(direction):
    # From half the way a fast current brings the cell to where the sweep begins.
    there = np.full(360, direction * CAPACITY_AH / 2)
    current_a = np.concatenate([there, REST, -direction * CURRENT_A * SWEEP, REST])
    record = record_of(current_a, interval_s=10.0, start_soc=0.5, direction=-direction)
    rng = np.random.default_rng(0)
    noisy = replace(record, voltage_v=record.voltage_v + 1e-3 * rng.standard_normal(record.samples))
    cell = characterize([noisy], ocv_fit="interpolated")
    curve = cell.charge if direction > 0 else cell.discharge
    errors_v = curve(INNER) - under_load_v(INNER, direction)
    # Fourteen samples to a point.
    assert np.sqrt(np.mean(errors_v**2)) < 0.35e-3


@pytest.mark.parametrize("hold", ["forward", "backward"])
def test_a_record_of_few_samples_gives_a_point_a_sample(hold):
    samples, interval_s = 3 * HOURS, 1200.0
    loaded_a, rest = np.full(samples, CURRENT_A), np.zeros(3)
    record = driven(rest, loaded_a, rest, interval_s=interval_s, hold=hold)
    points = characterize([record], ocv_fit="interpolated").discharge_points
    assert len(points) == samples
    soc = np.array([point.soc for point in points])
    np.testing.assert_allclose(np.diff(soc), 1 / samples)
    np.testing.assert_allclose([p.voltage_v for p in points], under_load_v(soc, -1), atol=1e-12)


@pytest.mark.parametrize("size", [0.01, 100.0])
def test_a_slow_sweep_takes_ten_hours_or_more_whatever_the_cell(size):
    def sweeps_in(hours):
        current_a = np.full(hours * 60, size * CAPACITY_AH / hours)
        record = record_of(current_a, capacity_ah=size * CAPACITY_AH)
        return slow_sweeps(record)

    assert (len(sweeps_in(10)), len(sweeps_in(9))) == (1, 0)


@pytest.mark.parametrize("hold", ["forward", "backward"])
@pytest.mark.parametrize("between", [REST[:0], REST])
def test_each_sweep_of_a_file_passes_all_of_its_charge(between, hold):
    # Loaded from its first to its last sample.
    down = CURRENT_A * SWEEP
    out, back = slow_sweeps(driven(down, between, -down, interval_s=10.0, hold=hold))
    assert (out.direction, back.direction) == (-1, 1)
    assert (out.passed_ah, back.passed_ah) == pytest.approx((CAPACITY_AH, CAPACITY_AH), rel=1e-9)


def test_a_current_that_pauses_every_ten_minutes_is_no_sweep():
    minutes = np.tile([1.0] * 9 + [0.0], 100)
    assert slow_sweeps(record_of(CAPACITY_AH / 15 * minutes)) == []


def test_an_hour_that_the_logger_missed_does_not_end_a_sweep():
    interval_s = np.full(HOURS * 360 - 359, 10.0)
    interval_s[1000] = 3600.0
    current_a = np.full(len(interval_s), CURRENT_A)
    (actual,) = slow_sweeps(record_of(current_a, interval_s=interval_s))
    assert actual.passed_ah == pytest.approx(CAPACITY_AH, rel=1e-9)


@pytest.mark.parametrize("samples", [1, 360])
def test_an_hour_of_rest_ends_a_sweep_however_few_its_samples(samples):
    half = CURRENT_A * SWEEP[: len(SWEEP) // 2]
    current_a = np.concatenate([half, np.zeros(samples), half])
    interval_s = np.where(current_a == 0, 3600 / samples, 10.0)
    actual = slow_sweeps(record_of(current_a, interval_s=interval_s))
    assert [each.passed_ah for each in actual] == pytest.approx([CAPACITY_AH / 2] * 2, rel=1e-9)

"""Slow constant-current sweeps of a cell whose OCV is known."""

from dataclasses import replace

import numpy as np
import pytest

from barnax.cell import characterize
from barnax.errors import InputError

from .pulse_rest import (
    CAPACITY_AH,
    RESISTANCE_OHM,
    branch_v,
    charge_only,
    discharge_only,
    record_of,
)

HOURS = 20
CURRENT_A = CAPACITY_AH / HOURS
SWEEP = np.ones(HOURS * 360)
REST = np.zeros(360)
INNER = np.linspace(0.02, 0.98, 49)


def sweep(direction: int, **changes) -> object:
    current_a = np.concatenate([REST, -direction * CURRENT_A * SWEEP, REST])
    start_soc = 1.0 if direction < 0 else 0.0
    options = {"interval_s": 10.0, "start_soc": start_soc, "direction": direction} | changes
    return record_of(current_a, **options)


def under_load_v(soc: np.ndarray, direction: int) -> np.ndarray:
    return branch_v(soc, direction) + direction * RESISTANCE_OHM * CURRENT_A


@pytest.mark.parametrize("hold", ["forward", "backward"])
@pytest.mark.parametrize("direction", [-1, 1])
def test_a_slow_sweep_gives_its_branch(direction, hold):
    cell = characterize([sweep(direction, hold=hold)], ocv_fit="interpolated")
    curve = cell.charge if direction > 0 else cell.discharge
    np.testing.assert_allclose(curve(INNER), under_load_v(INNER, direction), atol=1e-4)


@pytest.mark.parametrize("hold", ["forward", "backward"])
def test_a_slow_sweep_measures_the_capacity(hold):
    cell = characterize([sweep(-1, hold=hold)])
    assert cell.capacity_ah == pytest.approx(CAPACITY_AH, rel=1e-9)


def test_a_slow_sweep_is_thinned_to_101_points_from_empty_to_full():
    points = characterize([sweep(-1)]).discharge_points
    assert len(points) == 101
    np.testing.assert_allclose([p.soc for p in points], np.linspace(0, 1, 101), atol=2e-4)


def test_one_file_may_hold_both_sweeps():
    down, up = -CURRENT_A * SWEEP, CURRENT_A * SWEEP
    both = np.concatenate([REST, -down, REST, -up, REST])
    record = record_of(both, interval_s=10.0, start_soc=1.0, direction=1)
    cell = characterize([record], ocv_fit="interpolated")
    overpotential_v = 2 * RESISTANCE_OHM * CURRENT_A
    gap_v = cell.charge(INNER) - cell.discharge(INNER)
    expected_v = branch_v(INNER, 1) - branch_v(INNER, -1) + overpotential_v
    np.testing.assert_allclose(gap_v, expected_v, atol=1e-4)


def test_each_slow_sweep_is_scaled_by_its_own_charge():
    shorter = sweep(+1)
    shorter = replace(shorter, current_a=shorter.current_a * 0.9)
    cell = characterize([sweep(-1), shorter], ocv_fit="interpolated")
    assert cell.charge_points[-1].soc == pytest.approx(1.0, abs=2e-4)
    assert any("does not close" in text for text in cell.warnings)


def test_a_short_pause_does_not_end_a_slow_sweep():
    record = sweep(-1)
    current_a = record.current_a.copy()
    current_a[4000:4006] = 0.0
    cell = characterize([replace(record, current_a=current_a)], ocv_fit="interpolated")
    assert len(cell.discharge_points) == 101


def test_noise_is_averaged():
    record = sweep(-1)
    rng = np.random.default_rng(0)
    noisy = replace(record, voltage_v=record.voltage_v + 1e-3 * rng.standard_normal(record.samples))
    cell = characterize([noisy], ocv_fit="interpolated")
    errors_v = cell.discharge(INNER) - under_load_v(INNER, -1)
    assert np.sqrt(np.mean(errors_v**2)) < 0.5e-3


def test_a_discharge_at_one_c_is_no_slow_sweep():
    current_a = np.concatenate([np.zeros(60), np.full(60, 2.0), np.zeros(60)])
    record = record_of(current_a, start_soc=1.0, direction=1)
    with pytest.raises(InputError, match="not an OCV test"):
        characterize([record])


def test_two_slow_sweeps_of_one_direction_are_refused():
    with pytest.raises(InputError, match="give one of them only"):
        characterize([sweep(-1), sweep(-1)])


def test_a_slow_sweep_beside_rests_is_a_warning():
    cell = characterize([discharge_only(), sweep(+1)], ocv_fit="interpolated")
    assert any("overpotential of the slow current" in text for text in cell.warnings)


def test_a_capacity_off_by_a_factor_is_refused():
    with pytest.raises(InputError, match="20 Ah was given"):
        characterize([sweep(-1), charge_only()], capacity_ah=20.0)

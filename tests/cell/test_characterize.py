"""Pulse-rest tests of a cell whose OCV and hysteresis are known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barnax.cell import characterize
from helpers.ocv_tests import (
    CAPACITY_AH,
    W_NODES_V,
    average_v,
    both_ways,
    branch_v,
    charge_only,
    discharge_only,
    pulses,
    record_of,
)

GRID = np.linspace(0.0, 1.0, 21)
NODE_SOC = np.array([0.0, 0.1, 0.35, 0.95, 1.0])


@pytest.mark.parametrize("hold", ["forward", "backward"])
def test_a_test_both_ways_gives_branches_capacity_and_hysteresis_back(hold):
    cell = characterize([both_ways(hold)], ocv_fit="interpolated")
    np.testing.assert_allclose(cell.discharge(GRID), branch_v(GRID, -1), atol=1e-9)
    np.testing.assert_allclose(cell.charge(GRID), branch_v(GRID, +1), atol=1e-9)
    assert cell.capacity_ah == pytest.approx(CAPACITY_AH, rel=1e-9)
    np.testing.assert_allclose(cell.hysteresis_v(NODE_SOC), W_NODES_V, atol=1e-7)


def test_two_files_in_any_order_give_the_same_as_one():
    one = characterize([both_ways()], ocv_fit="interpolated")
    for records in ([discharge_only(), charge_only()], [charge_only(), discharge_only()]):
        two = characterize(records, ocv_fit="interpolated")
        np.testing.assert_allclose(two.average_ocv_v(GRID), one.average_ocv_v(GRID), atol=1e-9)
        np.testing.assert_allclose(two.hysteresis_v(GRID), one.hysteresis_v(GRID), atol=1e-9)


@settings(max_examples=20)
@given(st.integers(8, 40), st.floats(0.3, 100.0))
def test_any_number_of_pulses_and_any_capacity_recover_the_average(count, size):
    record = both_ways(count=count)
    scaled = replace(record, current_a=record.current_a * size)
    cell = characterize([scaled], ocv_fit="interpolated")
    soc = np.array([point.soc for point in cell.discharge_points])
    assert cell.capacity_ah == pytest.approx(CAPACITY_AH * size, rel=1e-9)
    np.testing.assert_allclose(cell.average_ocv_v(soc), average_v(soc), atol=1e-8)


@pytest.mark.parametrize(("returned", "capacity_ah"), [(0.98, None), (0.5, 2.0)])
def test_one_file_keeps_one_axis_when_the_recharge_stops_short(returned, capacity_ah):
    test = both_ways(returned=returned)
    cell = characterize([test], capacity_ah=capacity_ah, ocv_fit="interpolated")
    assert cell.charge_points[0].soc == pytest.approx(0.0, abs=1e-9)
    assert cell.charge_points[-1].soc == pytest.approx(returned, abs=1e-9)


def test_a_given_capacity_scales_the_axis_of_one_file():
    cell = characterize([both_ways()], capacity_ah=2.02, ocv_fit="interpolated")
    assert cell.discharge_points[-1].soc == 1.0
    assert cell.discharge_points[0].soc == pytest.approx(1 - CAPACITY_AH / 2.02, abs=1e-9)


def test_a_test_split_over_files_is_joined_at_the_rest_they_share():
    half = np.concatenate([np.zeros(60), pulses(-1, 10, share=0.5)])
    upper = record_of(half, start_soc=1.0, direction=1, name="upper.csv")
    lower = record_of(half, start_soc=0.5, direction=-1, name="lower.csv")
    whole = characterize([discharge_only()])
    joined = characterize([lower, upper])
    np.testing.assert_allclose(joined.discharge(GRID), whole.discharge(GRID), atol=1e-9)


def test_conditioning_before_the_test_is_left_out():
    before = np.concatenate([np.zeros(60), pulses(+1, 1, share=0.4)])
    current_a = np.concatenate([before, pulses(-1), pulses(+1)])
    cell = characterize([record_of(current_a, start_soc=0.6, direction=-1)], ocv_fit="interpolated")
    np.testing.assert_allclose(cell.charge(GRID), branch_v(GRID, +1), atol=1e-9)


def test_a_small_top_up_belongs_to_the_sweep_of_its_direction():
    top_up = np.concatenate([np.full(6, -0.2), np.zeros(60)])
    current_a = np.concatenate([np.zeros(60), pulses(+1, share=0.99), top_up])
    cell = characterize([record_of(current_a, start_soc=0.0, direction=-1)])
    assert len(cell.charge_points) == 22


def test_points_name_their_file_row_and_rest():
    point = characterize([discharge_only()]).discharge_points[0]
    assert (point.source, point.rest_s) == ("discharge.csv", 3600.0)
    assert point.row == discharge_only().row[-1]


def test_offsets_and_noise_below_the_rest_current_do_not_matter():
    record = both_ways()
    rng = np.random.default_rng(3)
    noisy = replace(record, current_a=record.current_a + 1e-4 * rng.standard_normal(record.samples))
    cell = characterize([noisy], ocv_fit="interpolated")
    assert len(cell.discharge_points) == 21
    np.testing.assert_allclose(cell.average_ocv_v(GRID), average_v(GRID), atol=5e-4)


@pytest.mark.parametrize("kind", ["continuous", "independent"])
def test_both_hysteresis_fits_stay_near_the_known_gap(kind):
    cell = characterize([both_ways()], ocv_fit="interpolated", hysteresis_fit=kind)
    assert cell.errors["hysteresis"].max_v < 1e-3


def test_the_errors_of_the_branches_cancel_in_the_average():
    # The average is a cubic, which its polynomial meets; the kinks of the hysteresis it misses.
    errors = characterize([both_ways()]).errors
    assert set(errors) == {"charge", "discharge", "average", "hysteresis"}
    assert errors["average"].max_v < 1e-9
    assert errors["charge"].max_v > 1e-4


def test_the_average_of_one_direction_has_its_errors():
    errors = characterize([discharge_only()]).errors
    assert set(errors) == {"discharge", "average"}
    assert errors["average"] == errors["discharge"]

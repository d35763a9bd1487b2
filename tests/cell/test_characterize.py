"""OCV tests of a cell whose OCV and hysteresis are known: branches, SOC and capacity."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barnax.cell import OcvPoint, OcvTable, characterize
from barnax.errors import InputError
from helpers.ocv_tests import (
    CAPACITY_AH,
    REST,
    W_NODES_V,
    average_v,
    between_cutoffs,
    both_ways,
    branch_v,
    charge_only,
    conditioned,
    discharge_only,
    driven,
    pulses,
    slow_sweep,
    steady,
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
    gap_v = branch_v(GRID, +1) - branch_v(GRID, -1)
    np.testing.assert_allclose(cell.branch_gap_v(GRID), gap_v, atol=1e-9)


def test_between_branches_lies_what_was_measured_unless_they_are_polynomials():
    """A bump that five segments cannot follow, as LFP has one at 30 %, and branches that cross."""
    soc = np.linspace(0.0, 1.0, 41)
    half_v = 0.01 + 0.03 * np.exp(-(((soc - 0.3) / 0.05) ** 2)) - 0.02 * (soc > 0.9)
    branches = {
        way: tuple(
            OcvPoint(x, v, "", 1, 3600.0)
            for x, v in zip(soc.tolist(), (3 + soc + way * half_v).tolist(), strict=True)
        )
        for way in (1, -1)
    }
    tests = [OcvTable("known", branches, "")]
    cell = characterize(tests, capacity_ah=2.0)
    np.testing.assert_allclose(cell.branch_gap_v(soc), np.maximum(2 * half_v, 0.0), atol=1e-12)
    assert cell.hysteresis_v(soc)[12] < 0.6 * cell.branch_gap_v(soc)[12]
    fitted = characterize(tests, capacity_ah=2.0, ocv_fit="polynomial")
    np.testing.assert_array_equal(fitted.branch_gap_v(soc), fitted.hysteresis_v(soc))
    # So between two temperatures.
    both = replace(
        fitted, temperature_degc=0.0, elsewhere=(replace(fitted, temperature_degc=25.0),)
    )
    np.testing.assert_allclose(both.at(12.5).branch_gap_v(soc), fitted.hysteresis_v(soc), atol=1e-9)


def test_between_temperatures_the_measured_points_are_those_of_the_nearer_test():
    cold, warm = (
        replace(characterize([OcvTable(name, branches, "")], capacity_ah=ah), temperature_degc=degc)
        for name, low, ah, degc in (("cold", 0.1, 1.8, 0.0), ("warm", 0.0, 2.0, 25.0))
        for soc in [np.linspace(low, 1.0, 41)]
        for branches in [{0: tuple(OcvPoint(x, 3 + x, name, 1, 3600.0) for x in soc.tolist())}]
    )
    cell = replace(cold, elsewhere=(warm,))
    for degc, low in ((10.0, 0.1), (15.0, 0.0)):
        between = cell.at(degc)
        assert between.temperature_degc == pytest.approx(degc)
        assert between.capacity_ah == pytest.approx(1.8 + 0.2 * degc / 25)
        assert between.soc_range == (low, 1.0)


def test_two_files_in_any_order_give_the_same_as_one():
    one = characterize([both_ways()], ocv_fit="interpolated")
    for records in ([discharge_only(), charge_only()], [charge_only(), discharge_only()]):
        two = characterize(records, ocv_fit="interpolated")
        np.testing.assert_allclose(two.average_ocv_v(GRID), one.average_ocv_v(GRID), atol=1e-9)
        np.testing.assert_allclose(two.hysteresis_v(GRID), one.hysteresis_v(GRID), atol=1e-9)


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


def test_the_errors_of_the_branches_cancel_in_the_average():
    # The average is a cubic, which its polynomial meets; the kinks of the hysteresis it misses.
    errors = characterize([both_ways()], ocv_fit="polynomial").errors
    assert set(errors) == {"charge", "discharge", "average", "hysteresis"}
    assert errors["average"].max_v < 1e-9
    assert errors["charge"].max_v > 1e-4


@pytest.mark.parametrize("minutes", [0, 10, 60])
def test_a_slow_conditioning_discharge_does_not_hide_the_pulses(minutes):
    cell = characterize([conditioned(np.zeros(minutes))], ocv_fit="interpolated")
    assert (len(cell.discharge_points), len(cell.charge_points)) == (21, 21)
    np.testing.assert_allclose(cell.discharge(GRID), branch_v(GRID, -1), atol=1e-9)
    np.testing.assert_allclose(cell.charge(GRID), branch_v(GRID, +1), atol=1e-9)


@pytest.mark.parametrize("slow", [steady(-1, 20), [*steady(-1, 20), *steady(+1, 20), *REST]])
def test_rests_of_both_directions_come_before_slow_sweeps(slow):
    full = [] if len(slow) > 1200 else steady(+1, 2)
    down, up = pulses(-1, 16, share=0.85), pulses(+1, 16, share=0.85)
    record = driven(REST, slow, full, REST, down, up)
    cell = characterize([record], capacity_ah=CAPACITY_AH, ocv_fit="interpolated")
    assert (len(cell.discharge_points), len(cell.charge_points)) == (17, 17)


# Records that hold more than their OCV test, and testers that never read zero


def test_a_tester_that_reads_30_ma_at_rest_is_served_by_the_rest_current():
    clean = driven(REST, pulses(-1, rest=31))
    reads = np.where(clean.current_a == 0, 0.03, clean.current_a)
    record = replace(clean, current_a=reads)
    with pytest.raises(InputError, match="not an OCV test"):
        characterize([record])
    cell = characterize([record], rest_current_a=0.05)
    expected = characterize([clean])
    assert [p.voltage_v for p in cell.discharge_points] == [
        p.voltage_v for p in expected.discharge_points
    ]


# When a test tells the capacity, and what its SOC is scaled by


def half_discharge():
    return np.concatenate([REST, pulses(-1, 10, share=0.5)])


def scaled(record, factor: float):
    return replace(record, current_a=record.current_a * factor)


@pytest.mark.parametrize("test", [between_cutoffs, lambda: slow_sweep(-1)])
@pytest.mark.parametrize("ratio", [0.6, 0.9, 1.1, 1.9])
def test_the_record_s_capacity_does_not_stretch_a_test_that_spans_both_ends(test, ratio):
    whole = characterize([test()], ocv_fit="interpolated")
    other = characterize([test()], capacity_ah=ratio * whole.capacity_ah, ocv_fit="interpolated")
    assert other.capacity_ah == ratio * whole.capacity_ah
    assert other.discharge_points == whole.discharge_points
    assert other.charge_points == whole.charge_points


def test_the_capacity_of_the_ocv_test_scales_one_that_does_not_span_both_ends():
    test = driven(half_discharge())
    cell = characterize([test], capacity_ah=1.8, ocv_capacity_ah=2.0)
    assert cell.capacity_ah == 1.8
    assert cell.soc_range == pytest.approx((0.5, 1.0))
    alone = characterize([test], ocv_capacity_ah=2.0)
    assert (alone.capacity_ah, alone.discharge_points) == (2.0, cell.discharge_points)


@pytest.mark.parametrize("share", [0.92, 0.979])
def test_a_charge_that_stops_short_is_scaled_by_the_capacity(share):
    records = [discharge_only(), scaled(charge_only(), share)]
    cell = characterize(records, capacity_ah=CAPACITY_AH, ocv_fit="interpolated")
    assert cell.charge_points[-1].soc == pytest.approx(share, abs=1e-9)
    (told,) = [each for each in cell.warnings if each.code == "ocv-test.scaled"]
    assert " Ah, the capacity is 2 Ah: its SOC is scaled by the capacity" in told.what


@pytest.mark.parametrize("share", [0.981, 1.0, 1.019])
def test_a_charge_within_two_percent_is_scaled_by_its_own_without_a_word(share):
    records = [discharge_only(), scaled(charge_only(), share)]
    cell = characterize(records, capacity_ah=CAPACITY_AH, ocv_fit="interpolated")
    assert cell.charge_points[-1].soc == pytest.approx(1.0, abs=1e-9)
    assert "ocv-test.scaled" not in {each.code for each in cell.warnings}

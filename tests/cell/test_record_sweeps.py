"""Records that hold more than their OCV test, and testers that never read zero."""

from dataclasses import replace

import numpy as np
import pytest

from barnax.cell import characterize
from barnax.errors import InputError
from helpers.ocv_tests import (
    CAPACITY_AH,
    branch_v,
    charge_only,
    discharge_only,
    pulses,
    record_of,
)

GRID = np.linspace(0.0, 1.0, 21)
REST = np.zeros(60)


def steady(direction: int, hours: float, share: float = 1.0) -> np.ndarray:
    """`share` of the capacity in one go, by the minute."""
    current_a = -direction * share * CAPACITY_AH / hours
    return np.full(round(60 * hours), current_a)


def conditioned(rest: np.ndarray = REST):
    """A C/20 discharge, a C/2 charge, then pulses down and up."""
    slow, back = steady(-1, 20), steady(+1, 2)
    parts = [REST, slow, rest, back, REST, pulses(-1), pulses(+1)]
    return record_of(np.concatenate(parts), start_soc=1.0, direction=1, name="long.csv")


@pytest.mark.parametrize("minutes", [0, 10, 60])
def test_a_slow_conditioning_discharge_does_not_hide_the_pulses(minutes):
    cell = characterize([conditioned(np.zeros(minutes))], ocv_fit="interpolated")
    assert (len(cell.discharge_points), len(cell.charge_points)) == (21, 21)
    np.testing.assert_allclose(cell.discharge(GRID), branch_v(GRID, -1), atol=1e-9)
    np.testing.assert_allclose(cell.charge(GRID), branch_v(GRID, +1), atol=1e-9)


def test_slow_sweeps_of_both_directions_come_before_rests_of_one():
    parts = [REST, steady(-1, 20), steady(+1, 20), REST, pulses(-1)]
    record = record_of(np.concatenate(parts), start_soc=1.0, direction=1)
    cell = characterize([record], ocv_fit="interpolated")
    assert (len(cell.discharge_points), len(cell.charge_points)) == (101, 101)
    assert any("the discharge by rests between pulses" in text for text in cell.warnings)


@pytest.mark.parametrize("slow", [steady(-1, 20), [*steady(-1, 20), *steady(+1, 20), *REST]])
def test_rests_of_both_directions_come_before_slow_sweeps(slow):
    full = [] if len(slow) > 1200 else steady(+1, 2)
    down, up = pulses(-1, 16, share=0.85), pulses(+1, 16, share=0.85)
    parts = [REST, slow, full, REST, down, up]
    record = record_of(np.concatenate(parts), start_soc=1.0, direction=1)
    cell = characterize([record], capacity_ah=CAPACITY_AH, ocv_fit="interpolated")
    assert (len(cell.discharge_points), len(cell.charge_points)) == (17, 17)


def test_a_few_pulses_after_a_slow_discharge_are_not_the_test():
    parts = [REST, steady(-1, 20), REST, pulses(+1, 5, share=0.3), pulses(-1, 5, share=0.3)]
    cell = characterize([record_of(np.concatenate(parts), start_soc=1.0, direction=1)])
    assert len(cell.discharge_points) == 101


def test_a_tester_that_reads_30_ma_at_rest_is_served_by_the_rest_current():
    clean = record_of(np.concatenate([REST, pulses(-1, rest=31)]), start_soc=1.0, direction=1)
    reads = np.where(clean.current_a == 0, 0.03, clean.current_a)
    record = replace(clean, current_a=reads)
    with pytest.raises(InputError, match="not an OCV test"):
        characterize([record])
    cell = characterize([record], rest_current_a=0.05)
    expected = characterize([clean])
    assert [p.voltage_v for p in cell.discharge_points] == [
        p.voltage_v for p in expected.discharge_points
    ]


@pytest.mark.parametrize("test", [discharge_only, charge_only])
@pytest.mark.parametrize("rest_current_a", [0.02, 1.0])
def test_a_rest_current_up_to_that_of_the_pulses_serves(test, rest_current_a):
    assert np.abs(test().current_a).max() == 1.0
    assert characterize([test()], rest_current_a=rest_current_a) == characterize([test()])

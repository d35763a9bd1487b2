"""What a record does to a hysteresis, counted by hand on a made-up current."""

import numpy as np
import pytest
from benchmarks.real_cells.conditions import condition_of

from barnax.model.prepared import prepare_record
from barnax.model.window import Window
from helpers.reference import make_record


@pytest.fixture
def condition(bundled_cell):
    """An hour of 60 s at 1 A out, then 60 s at 0.5 A in, from 80 % SOC."""
    time_s = np.arange(3601.0)
    current_a = np.where(time_s % 120 < 60, 1.0, -0.5)
    prepared = prepare_record(
        make_record(time_s, current_a), bundled_cell, "so-rc", Window(initial_soc=0.8)
    )
    return condition_of(prepared, bundled_cell)


def test_the_charging_share_is_what_came_back(condition):
    assert condition.charging_share == pytest.approx(0.5, rel=1e-3)


def test_switches_are_counted_by_the_hour(condition):
    # The last sample begins a further discharge.
    assert condition.switches_per_hour == pytest.approx(60)


def test_between_two_switches_passes_what_the_current_carries(condition, bundled_cell):
    either_ah = (60 * 1.0 / 3600, 60 * 0.5 / 3600)
    between_ah = condition.soc_between_switches * bundled_cell.capacity_ah
    assert min(either_ah) * 0.98 <= between_ah <= max(either_ah) * 1.02


def test_the_gap_is_the_cells(condition, bundled_cell):
    half_v = bundled_cell.hysteresis_v(np.linspace(0.67, 0.8, 200)) / 2
    assert condition.half_gap_v == pytest.approx(np.sqrt(np.mean(half_v**2)), rel=0.1)

"""When a test tells the capacity, and what its SOC is scaled by."""

from dataclasses import replace

import numpy as np
import pytest

from barnax.bundled import BUNDLED
from barnax.cell import characterize
from barnax.records import read_record
from helpers.ocv_tests import (
    CAPACITY_AH,
    REST,
    between_cutoffs,
    charge_only,
    discharge_only,
    pulses,
    record_of,
    slow_sweep,
)


def half_discharge():
    return np.concatenate([REST, pulses(-1, 10, share=0.5)])


def assumptions(cell):
    return [text for text in cell.warnings if "no capacity was given" in text]


def scaled(record, factor: float):
    return replace(record, current_a=record.current_a * factor)


def test_a_test_between_cutoffs_measures_its_capacity():
    cell = characterize([between_cutoffs()])
    assert assumptions(cell) == []
    assert cell.capacity_origin.startswith("measured")


def test_a_test_that_only_reaches_empty_does_not_show_that_it_began_full():
    current_a = np.concatenate([half_discharge()[:-63], REST, pulses(+1, 10, share=0.475)])
    cell = characterize([record_of(current_a, start_soc=0.5, direction=1)])
    assert len(assumptions(cell)) == 1


@pytest.mark.parametrize("test", [between_cutoffs, lambda: slow_sweep(-1)])
@pytest.mark.parametrize("ratio", [0.6, 0.9, 1.1, 1.9])
def test_the_record_s_capacity_does_not_stretch_a_test_that_spans_both_ends(test, ratio):
    whole = characterize([test()], ocv_fit="interpolated")
    other = characterize([test()], capacity_ah=ratio * whole.capacity_ah, ocv_fit="interpolated")
    assert other.capacity_ah == ratio * whole.capacity_ah
    assert other.discharge_points == whole.discharge_points
    assert other.charge_points == whole.charge_points


def test_the_capacity_of_the_ocv_test_scales_one_that_does_not_span_both_ends():
    test = record_of(half_discharge(), start_soc=1.0, direction=1)
    cell = characterize([test], capacity_ah=1.8, ocv_capacity_ah=2.0)
    assert cell.capacity_ah == 1.8
    assert cell.soc_range == pytest.approx((0.5, 1.0))
    alone = characterize([test], ocv_capacity_ah=2.0)
    assert (alone.capacity_ah, alone.discharge_points) == (2.0, cell.discharge_points)


def test_a_slow_sweep_measures_its_capacity_and_scales_itself():
    measured = characterize([slow_sweep(-1)])
    assert measured.capacity_origin.startswith("measured")
    given = characterize([slow_sweep(-1)], capacity_ah=CAPACITY_AH / 0.96)
    # The last loaded sample is one minute of twenty hours short of empty.
    assert given.soc_range == pytest.approx((0.0, 1.0), abs=1e-3)
    assert not any("scaled" in text for text in given.warnings)


def test_the_bundled_test_measures_its_capacity():
    cell = characterize([read_record(path) for path in BUNDLED.ocv])
    assert cell.capacity_origin.startswith("measured")
    assert cell.capacity_ah == pytest.approx(1.9997, abs=5e-5)
    assert assumptions(cell) == []


def test_a_charge_that_stops_at_92_percent_is_scaled_by_the_capacity():
    records = [discharge_only(), scaled(charge_only(), 0.92)]
    cell = characterize(records, capacity_ah=CAPACITY_AH, ocv_fit="interpolated")
    assert cell.charge_points[-1].soc == pytest.approx(0.92, abs=1e-9)
    assert any(
        "1.84 Ah, the capacity is 2 Ah: its SOC is scaled by the capacity" in text
        for text in cell.warnings
    )


def test_two_files_that_agree_are_scaled_by_their_own_charge_and_say_so():
    records = [scaled(discharge_only(), 0.92), scaled(charge_only(), 0.92)]
    cell = characterize(records, capacity_ah=CAPACITY_AH, ocv_fit="interpolated")
    assert cell.soc_range == pytest.approx((0.0, 1.0), abs=1e-9)
    assert sum("scaled by its own charge" in text for text in cell.warnings) == 2


@pytest.mark.parametrize("share", [0.981, 1.0, 1.019])
def test_a_charge_within_two_percent_is_scaled_by_its_own_without_a_word(share):
    records = [discharge_only(), scaled(charge_only(), share)]
    cell = characterize(records, capacity_ah=CAPACITY_AH, ocv_fit="interpolated")
    assert cell.charge_points[-1].soc == pytest.approx(1.0, abs=1e-9)
    assert not any("scaled" in text for text in cell.warnings)

"""When a test tells the capacity, and what its SOC is scaled by."""

from dataclasses import replace

import numpy as np
import pytest

from barnax.bundled import BUNDLED
from barnax.cell import characterize
from barnax.records import read_record

from .pulse_rest import CAPACITY_AH, both_ways, charge_only, discharge_only, pulses, record_of

REST = np.zeros(60)


def half_discharge():
    return np.concatenate([REST, pulses(-1, 10, share=0.5)])


def assumptions(cell):
    return [text for text in cell.warnings if "no capacity was given" in text]


def between_cutoffs(discharged: float = 0.97):
    """A test whose last pulse stops short at empty and at full."""
    minutes = round(0.5 * 6)
    last_out, last_in = (
        np.concatenate([pulses(way, 1, share=0.05, rest=0)[:minutes], REST]) for way in (-1, +1)
    )
    out, back = (pulses(way, 10, share=discharged) for way in (-1, +1))
    return record_of(np.concatenate([REST, out, last_out, back, last_in]), start_soc=1, direction=1)


def scaled(record, factor: float):
    return replace(record, current_a=record.current_a * factor)


@pytest.mark.parametrize("way", ["there", "there and back"])
def test_half_a_discharge_without_capacity_is_warned_about_with_its_voltages(way):
    back = pulses(+1, 10, share=0.5) if way == "there and back" else []
    current_a = np.concatenate([half_discharge(), back])
    record = record_of(current_a, start_soc=1.0, direction=1)
    cell = characterize([record])
    high_v, low_v = record.voltage_v[0], cell.discharge_points[0].voltage_v
    (text,) = assumptions(cell)
    assert f"{high_v:.4g} to {low_v:.4g} V and 1 Ah, is taken as full to empty" in text
    assert "--capacity" in text
    assert cell.capacity_origin.startswith("assumed")


def test_a_lone_charge_without_capacity_is_taken_as_empty_to_full():
    (text,) = assumptions(characterize([charge_only()]))
    assert "is taken as empty to full" in text


def test_a_test_between_cutoffs_measures_its_capacity():
    cell = characterize([between_cutoffs()])
    assert assumptions(cell) == []
    assert cell.capacity_origin.startswith("measured")


def test_a_test_that_only_reaches_empty_does_not_show_that_it_began_full():
    current_a = np.concatenate([half_discharge()[:-63], REST, pulses(+1, 10, share=0.475)])
    cell = characterize([record_of(current_a, start_soc=0.5, direction=1)])
    assert len(assumptions(cell)) == 1


def test_a_given_capacity_is_no_assumption():
    assert assumptions(characterize([both_ways()], capacity_ah=CAPACITY_AH)) == []


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

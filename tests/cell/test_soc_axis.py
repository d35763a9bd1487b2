"""When a test tells the capacity, and what its SOC is scaled by."""

from dataclasses import replace

import numpy as np
import pytest

from barnax.bundled import BUNDLED
from barnax.cell import characterize
from barnax.errors import InputError
from barnax.records import read_record
from helpers.ocv_tests import CAPACITY_AH, both_ways, charge_only, discharge_only, pulses, record_of

REST = np.zeros(60)


def half_discharge():
    return np.concatenate([REST, pulses(-1, 10, share=0.5)])


def slow_discharge():
    hours = 20
    slow = np.full(hours * 60, CAPACITY_AH / hours)
    return record_of(np.concatenate([REST, slow, REST]), start_soc=1.0, direction=1)


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
    assert "`capacity`" in text
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


def test_a_given_capacity_that_the_test_passes_is_taken_without_a_word():
    cell = characterize([both_ways()], capacity_ah=CAPACITY_AH)
    assert (cell.capacity_origin, cell.warnings) == ("given", ())


def test_a_given_capacity_off_by_more_than_a_fifth_is_refused():
    for ratio in (0.79, 1.21):
        with pytest.raises(InputError, match="check the capacity"):
            characterize([both_ways()], capacity_ah=CAPACITY_AH / ratio)


@pytest.mark.parametrize("test", [between_cutoffs, slow_discharge])
def test_only_a_factor_of_two_is_refused_of_a_test_that_spans_both_ends(test):
    whole = characterize([test()], ocv_fit="interpolated")
    for ratio in (0.49, 2.05):
        with pytest.raises(InputError, match="check the capacity"):
            characterize([test()], capacity_ah=whole.capacity_ah / ratio)


@pytest.mark.parametrize("test", [between_cutoffs, slow_discharge])
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


def test_the_capacity_of_an_ocv_test_that_spans_both_ends_is_not_used_and_said_so():
    cell = characterize([between_cutoffs()], ocv_capacity_ah=1.5)
    assert cell.soc_range == characterize([between_cutoffs()]).soc_range
    assert any("`ocv_capacity` is not used" in text for text in cell.warnings)


@pytest.mark.parametrize("test", [both_ways, slow_discharge])
@pytest.mark.parametrize(
    ("ratio", "warned"), [(0.81, 1), (0.94, 1), (0.96, 0), (1.04, 0), (1.06, 1), (1.19, 1)]
)
def test_a_given_capacity_off_by_more_than_a_twentieth_is_a_warning(test, ratio, warned):
    cell = characterize([test()], capacity_ah=CAPACITY_AH / ratio)
    assert sum("was given, but the discharge" in text for text in cell.warnings) == warned


def test_a_lone_discharge_may_stop_early_but_not_pass_a_fifth_more_than_the_capacity():
    assert characterize([discharge_only()], capacity_ah=CAPACITY_AH / 0.6).soc_range[1] == 1.0
    with pytest.raises(InputError, match="passed 2 Ah"):
        characterize([discharge_only()], capacity_ah=CAPACITY_AH / 1.21)


def test_directions_within_a_tenth_tell_the_capacity_and_others_do_not():
    assert characterize([both_ways(returned=0.91)]).capacity_ah == pytest.approx(CAPACITY_AH)
    with pytest.raises(InputError, match="`capacity`"):
        characterize([both_ways(returned=0.89)])


@pytest.mark.parametrize(("returned", "warned"), [(0.97, 1), (0.985, 0), (1.0, 0)])
def test_a_charge_balance_that_misses_by_more_than_two_percent_is_a_warning(returned, warned):
    cell = characterize([both_ways(returned=returned)])
    assert sum("does not close" in text for text in cell.warnings) == warned


def test_a_slow_sweep_measures_its_capacity_and_scales_itself():
    measured = characterize([slow_discharge()])
    assert measured.capacity_origin.startswith("measured")
    given = characterize([slow_discharge()], capacity_ah=CAPACITY_AH / 0.96)
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

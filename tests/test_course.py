import numpy as np
import pytest

from barnax.cell import CIRCUITS
from barnax.errors import InputError
from barnax.model.inputs import Window, prepare_record
from reference import make_record

TIME_S = 50.0 + np.arange(100) * 10.0
CURRENT_A = np.repeat([0.0, 2.0, 0.0, -1.0], 25)
FULL = Window(initial_soc=0.8)


def course_of(cell, window=FULL, circuit="iso-rc", **changes):
    return prepare_record(make_record(TIME_S, CURRENT_A, **changes), cell, circuit, window)


def test_the_simulation_ends_with_the_last_scored_sample(bundled_cell):
    window = Window(start_time_s=100.0, initial_soc=0.8, score_from_s=200.0, score_to_s=500.0)
    prepared = course_of(bundled_cell, window)
    assert (prepared.time_s[0], prepared.time_s[-1]) == (100.0, 500.0)
    assert prepared.scored.sum() == 31
    assert prepared.scored_duration_s == 300.0
    assert prepared.median_interval_s == 10.0


def test_state_of_charge_counts_ampere_hours_from_the_start(bundled_cell):
    prepared = course_of(bundled_cell, hold="forward")
    assert prepared.soc[0] == 0.8
    discharged_ah = 2.0 * 250 / 3600
    assert prepared.soc[60] == pytest.approx(0.8 - discharged_ah / bundled_cell.capacity_ah)


def test_the_current_before_the_start_does_not_count(bundled_cell):
    prepared = course_of(bundled_cell, Window(start_time_s=400.0, initial_soc=0.8))
    assert prepared.first == 35
    assert prepared.soc[0] == 0.8


def test_the_direction_lasts_through_rests(bundled_cell):
    direction = course_of(bundled_cell).direction
    np.testing.assert_array_equal(direction, np.repeat([1.0, -1.0, -1.0, 1.0], 25))


def test_the_initial_direction_holds_until_current_flows(bundled_cell):
    window = Window(initial_soc=0.8, initial_direction=-1)
    assert (course_of(bundled_cell, window).direction[:25] == -1).all()


def test_a_current_below_the_resting_one_is_no_direction(bundled_cell):
    window = Window(initial_soc=0.8, rest_current_a=1.5)
    prepared = course_of(bundled_cell, window)
    assert prepared.rest_current_a == 1.5
    assert (prepared.direction[75:] == -1).all()


def test_the_direction_before_the_start_is_remembered(bundled_cell):
    # The simulation starts in the second rest, after a discharge.
    prepared = course_of(bundled_cell, Window(start_time_s=600.0, initial_soc=0.8))
    assert prepared.direction[0] == -1


@pytest.mark.parametrize("circuit", CIRCUITS)
def test_the_source_is_the_circuits_open_circuit_voltage(bundled_cell, circuit):
    prepared = course_of(bundled_cell, circuit=circuit)
    expected_v = bundled_cell.average_ocv_v(prepared.soc)
    if circuit == "iso-rc":
        expected_v = expected_v + prepared.direction * bundled_cell.hysteresis_v(prepared.soc) / 2
    if circuit == "esc":  # the state that moves starts at the last direction before the record
        expected_v = expected_v + bundled_cell.hysteresis_v(prepared.soc) / 2
    np.testing.assert_allclose(prepared.source_v, expected_v, rtol=1e-15)


@pytest.mark.parametrize(("hold", "expected_a"), [("forward", [0, 2]), ("backward", [2, 2])])
def test_the_drive_holds_the_current_as_the_record_says(bundled_cell, hold, expected_a):
    inputs = course_of(bundled_cell, hold=hold).inputs(1.0)
    assert inputs.held_a[24:26].tolist() == expected_a
    np.testing.assert_array_equal(inputs.current_a, CURRENT_A)


def test_the_drive_weighs_scored_samples_only(bundled_cell):
    prepared = course_of(bundled_cell, Window(initial_soc=0.8, score_from_s=200.0))
    np.testing.assert_array_equal(prepared.inputs(1.0).weight, prepared.scored * 1.0)


def test_the_start_says_where_its_state_of_charge_came_from(bundled_cell):
    assert course_of(bundled_cell).initial_soc_reason == "given"
    rested = course_of(bundled_cell, Window())
    assert "from the rested voltage 3.7000 V at row 2" in rested.initial_soc_reason


@pytest.mark.parametrize("voltage_v", [0.0, -0.5])
def test_a_scored_voltage_that_is_not_positive_is_refused_with_row_and_remedy(
    bundled_cell, voltage_v
):
    voltages_v = np.full(100, 3.7)
    voltages_v[40] = voltage_v
    with pytest.raises(
        InputError,
        match=rf"made.csv: row 42 is scored at {voltage_v:g} V.*delete the row, or leave it out",
    ):
        course_of(bundled_cell, voltage_v=voltages_v)
    later = Window(initial_soc=0.8, score_from_s=500.0)
    assert course_of(bundled_cell, later, voltage_v=voltages_v).scored.sum() == 55


def test_samples_a_little_outside_the_ocv_points_are_warned_about_with_their_count(bundled_cell):
    # The discharge takes 7 % in all; from 4 % it ends 3 % below the points.
    prepared = course_of(bundled_cell, Window(initial_soc=0.04))
    outside = np.count_nonzero(prepared.soc < bundled_cell.soc_range[0])
    (warning,) = prepared.warnings
    assert 0 < outside < 100
    farthest = bundled_cell.soc_range[0] - prepared.soc.min()
    assert 0.02 < farthest < 0.04
    assert f"made.csv: {outside} of 100 scored samples lie up to {farthest:.2g} SOC" in warning


def test_rounding_at_the_ends_of_the_ocv_points_is_not_warned_about(bundled_cell):
    soc = course_of(bundled_cell, Window(initial_soc=0.5)).soc
    lowest = bundled_cell.soc_range[0]
    start = Window(initial_soc=float(lowest - 2e-5 + soc[0] - soc.min()))
    prepared = course_of(bundled_cell, start)
    assert prepared.soc.min() < lowest
    assert prepared.warnings == ()


def test_samples_far_outside_the_ocv_points_are_refused_with_row_and_remedies(bundled_cell):
    prepared = course_of(bundled_cell, Window(initial_soc=0.5))
    taken = prepared.soc[0] - prepared.soc
    row = 2 + int(np.flatnonzero(taken > 0.01 - bundled_cell.soc_range[0] + 0.05)[0])
    with pytest.raises(
        InputError,
        match=rf"made.csv: row {row} is scored at a state of charge of -0.05\d, but .*"
        r"--capacity \(2.* Ah\) and --initial-soc, give an OCV test .*--score-steps, --score-to",
    ):
        course_of(bundled_cell, Window(initial_soc=0.01))


def test_samples_far_outside_that_are_not_scored_are_let_pass(bundled_cell):
    prepared = course_of(bundled_cell, Window(initial_soc=0.01, score_to_s=250.0))
    assert prepared.warnings == ()


@pytest.mark.parametrize(
    "window",
    [
        Window(initial_soc=0.8, score_to_s=120.0),
        Window(initial_soc=0.8, score_from_s=990.0),
        Window(initial_soc=0.8, start_time_s=1000.0),
    ],
)
def test_fewer_than_ten_scored_samples_are_refused(bundled_cell, window):
    with pytest.raises(InputError, match=r"made.csv: fewer than 10 samples .* widen the window"):
        course_of(bundled_cell, window)


def test_an_unknown_circuit_is_refused_with_the_known_ones(bundled_cell):
    with pytest.raises(ValueError, match="no circuit is called 'rint'; there are iso-rc, so-rc"):
        course_of(bundled_cell, circuit="rint")

"""Which part of a record is simulated, from which state, and what is said where it does not fit."""

from dataclasses import replace

import numpy as np
import pytest

from barnax import InputError, make_problem
from barnax.cell import CIRCUITS, CircuitParameters
from barnax.cell.circuits import loops
from barnax.model.prepared import prepare_record, soc_along
from barnax.model.window import Window, first_sample, scored_samples
from barnax.search.evaluate import both_directions, evaluate
from barnax.settings import Registration
from helpers.problems import R0_OHM, R_OHM, TAU_S, simulated_record
from helpers.reference import make_record

# Four blocks with steps of their own: rest, discharge, rest, charge.
TIME_S = 50.0 + np.arange(100) * 10.0
CURRENT_A = np.repeat([0.0, 2.0, 0.0, -1.0], 25)
STEP = np.repeat([1, 2, 3, 2], 25)
FULL = Window(initial_soc=0.8)
# Samples of rest before the current of a simulated record flows.
REST = 200
CIRCUIT = CircuitParameters.constant(
    R0_OHM, R_OHM, tuple(t / r for r, t in zip(R_OHM, TAU_S, strict=True))
)


def made(current_a=CURRENT_A, **changes):
    return make_record(TIME_S, current_a, **({"step": STEP} | changes))


def prepared(cell, window=FULL, circuit="iso-rc", **changes):
    return prepare_record(made(**changes), cell, circuit, window)


def ocv_v(curve, soc):
    return float(curve(np.array([soc]))[0])


# Where a simulation starts, and what is scored


@pytest.mark.parametrize(
    ("window", "first"),
    [
        (Window(), 0),
        (Window(start_time_s=75.0), 3),
        (Window(start_after_step=1), 24),
        # Step 2 stands in two blocks; the last one ends the record.
        (Window(start_after_step=2), 99),
    ],
)
def test_a_simulation_starts_at_a_time_or_after_the_last_block_of_a_step(window, first):
    assert first_sample(made(), window, 0.01) == first


def test_a_range_that_cannot_be_read_is_refused_with_an_example():
    with pytest.raises(InputError, match=r"`score_soc` '0.2:0.8' is not as in 0.1,1"):
        Window(score_soc="0.2:0.8")


@pytest.mark.parametrize(
    ("window", "first", "expected"),
    [
        (Window(), 0, range(100)),
        (Window(), 7, range(7, 100)),
        # Both ends of the times are inside, and steps and times must both hold.
        (Window(score_from_s=60.0, score_to_s=80.0), 0, [1, 2, 3]),
        (Window(score_steps=(2, 3), score_from_s=400.0, score_to_s=830.0), 0, range(35, 79)),
        (Window(score_soc="-1,2", score_from_s=60.0, score_to_s=80.0), 0, [1, 2, 3]),
        # As a warning prints it.
        (Window(score_steps="2,3", score_from_s=400.0, score_to_s=830.0), 0, range(35, 79)),
    ],
)
def test_samples_are_scored_after_the_start_in_the_chosen_steps_and_times(window, first, expected):
    scored = scored_samples(made(), window, first, np.zeros(100))
    assert np.flatnonzero(scored).tolist() == list(expected)


def test_samples_outside_the_chosen_states_of_charge_are_not_scored(bundled_cell):
    low, high = 0.75, 0.78
    course = prepared(bundled_cell, Window(initial_soc=0.8, score_soc=(low, high)))
    soc = prepared(bundled_cell).soc
    expected = np.flatnonzero((soc >= low) & (soc <= high))
    assert 10 < len(expected) < 80
    assert np.flatnonzero(course.scored).tolist() == expected.tolist()


def test_the_simulation_ends_with_the_last_scored_sample(bundled_cell):
    window = Window(start_time_s=100.0, initial_soc=0.8, score_from_s=200.0, score_to_s=500.0)
    course = prepared(bundled_cell, window)
    assert (course.time_s[0], course.time_s[-1]) == (100.0, 500.0)
    assert course.scored.sum() == 31
    assert course.scored_duration_s == 300.0
    assert course.median_interval_s == 10.0
    inputs = course.simulation_input(1.0)
    np.testing.assert_array_equal(inputs.weight, course.scored * 1.0)


@pytest.mark.parametrize(
    ("window", "changes", "message"),
    [
        (Window(start_time_s=49.0), {}, "`start_time` 49.0 s .* from 50 to 1040 s"),
        (Window(start_time_s=1041.0), {}, "`start_time` 1041.0 s .* from 50 to 1040 s"),
        (Window(start_after_step=9), {}, "there is no step 9; the file has steps 1, 2, 3"),
        (Window(score_steps=(3, 8)), {}, "there is no step 8; the file has steps 1, 2, 3"),
        (Window(start_after_step=1), {"step": None}, "`start_after_step` needs .*`start_time`"),
        (Window(score_steps=(1,)), {"step": None}, "`score_steps` needs .*`score_from`"),
        (Window(start_time_s=120.0, score_to_s=90.0), {}, "no sample .* 120 s; widen `score_steps"),
        (Window(score_soc=(0.1, 0.2)), {}, "no sample .*`score_soc`"),
        (Window(score_to_s=120.0), {}, "the current of every scored sample is zero.* widen the"),
        (Window(start_time_s=1000.0), {}, "fewer than 10 samples"),
    ],
)
def test_a_window_that_does_not_fit_the_record_is_refused_with_the_remedy(
    bundled_cell, window, changes, message
):
    window = Window(**(vars(window) | {"initial_soc": 0.8}))
    with pytest.raises(InputError, match="made.csv: " + message):
        prepared(bundled_cell, window, **changes)


def test_records_identified_together_have_a_window_each(bundled_cell):
    windows = [FULL, Window(initial_soc=0.6, start_time_s=600.0, capacity_ah=1.5)]
    voltage_v = 3.7 - 0.05 * CURRENT_A
    records = [made(voltage_v=voltage_v, name=name) for name in ("first.csv", "second.csv")]
    problem = make_problem(records, bundled_cell, window=windows)
    assert [each.window for each in problem.prepared_records] == windows
    assert [each.start.soc for each in problem.prepared_records] == [0.8, 0.6]
    assert [each.time_s[0] for each in problem.prepared_records] == [50.0, 600.0]
    assert problem.prepared_records[1].capacity_ah == 1.5
    with pytest.raises(ValueError, match="1 windows for 2 records; give one for all, or one for"):
        make_problem(records, bundled_cell, window=windows[:1])


# The state of charge


@pytest.mark.parametrize(("hold", "last_before"), [("forward", 25), ("backward", 24)])
def test_the_state_of_charge_falls_by_the_ampere_hours_taken_from_the_start_on(hold, last_before):
    soc = soc_along(made(hold=hold), 2.0, 3, 0.9)
    assert soc[3] == soc[last_before] == 0.9
    assert soc[last_before + 1] == pytest.approx(0.9 - 10 * 2 / 3600 / 2.0, rel=1e-12)
    assert soc[60] == pytest.approx(0.9 - 250 * 2 / 3600 / 2.0, rel=1e-12)
    assert soc[99] - soc[90] == pytest.approx(90 * 1 / 3600 / 2.0, rel=1e-9)


@pytest.mark.parametrize("given_ah", [None, 1.0])
def test_the_capacity_of_a_window_replaces_the_cell_s(bundled_cell, given_ah):
    course = prepared(bundled_cell, Window(initial_soc=0.8, capacity_ah=given_ah))
    expected_ah = given_ah or bundled_cell.capacity_ah
    assert course.capacity_ah == expected_ah
    assert course.soc[60] == pytest.approx(0.8 - 2.0 * 250 / 3600 / expected_ah)
    # A hundredth of the capacity an hour is rest.
    assert course.rest_current_a == pytest.approx(expected_ah / 100)


@pytest.mark.parametrize("direction", [1, -1])
def test_a_rested_voltage_is_read_on_the_branch_of_the_last_direction(bundled_cell, direction):
    branch = bundled_cell.charge if direction == 1 else bundled_cell.discharge
    window = Window(initial_direction=direction)
    start = prepared(bundled_cell, window, voltage_v=ocv_v(branch, 0.6)).start
    assert start.soc == pytest.approx(0.6, abs=1e-4)
    assert (start.soc_source, start.row) == ("rested voltage", 2)
    assert start.voltage_v == pytest.approx(ocv_v(branch, 0.6), rel=1e-15)


@pytest.mark.parametrize(
    ("window", "voltage_v", "message"),
    [
        (Window(start_time_s=300.0), 2.0, r"row 27 under \+2 A .* give `initial_soc`"),
        (Window(start_time_s=600.0), 2.0, r"row 57, .* has rested for only 60 s.*`initial_soc`"),
        (Window(), 5.0, r"row 2: .* 5\.0000 V is outside .* `initial_soc`"),
    ],
)
def test_a_start_that_does_not_tell_the_state_of_charge_asks_for_it(
    bundled_cell, window, voltage_v, message
):
    with pytest.raises(InputError, match="made.csv: .*" + message):
        prepared(bundled_cell, window, voltage_v=voltage_v)


# What a rested voltage has against it


def rested_at(cell, voltage_v, **window):
    return prepared(cell, Window(**window), voltage_v=voltage_v)


@pytest.mark.parametrize(("given_soc", "is_doubted"), [(0.95, True), (0.99, False), (None, False)])
def test_a_given_state_of_charge_that_the_rested_voltage_denies_is_doubted(
    bundled_cell, given_soc, is_doubted
):
    rested_v = ocv_v(bundled_cell.charge, 0.999)
    warnings = rested_at(bundled_cell, rested_v, initial_soc=given_soc).warnings
    socs = [(each.code, each.values["rested_soc"], each.values["given_soc"]) for each in warnings]
    assert socs == [("start.other-soc", pytest.approx(0.999, abs=5e-4), 0.95)] * is_doubted


@pytest.mark.parametrize("given_soc", [None, 0.95])
def test_a_start_that_other_records_moved_is_doubted_as_it_was_given(bundled_cell, given_soc):
    rested_v, told = ocv_v(bundled_cell.charge, 0.999), Window(initial_soc=given_soc)
    known = Registration(told, given_soc or 0.999, 2.0, "rested voltage", 0.93, 0.97, 1.9, 2.1)
    moved = {"initial_soc": 0.951, "soc_source": "registered", "registration": known}
    # By the OCV test alone, or then by other records too.
    again = moved | {"registration": replace(known, given=Window(**moved))}
    for window in (moved, again):
        warnings = rested_at(bundled_cell, rested_v, **window).warnings
        given = [warning.values["given_soc"] for warning in warnings]
        assert given == [0.95] * (given_soc is not None)


def test_a_start_under_load_denies_nothing(bundled_cell):
    voltage_v = ocv_v(bundled_cell.charge, 0.999)
    assert rested_at(bundled_cell, voltage_v, initial_soc=0.95, start_time_s=310.0).warnings == ()


@pytest.mark.parametrize("given_soc", [None, 1.0])
@pytest.mark.parametrize(("above_v", "is_doubted"), [(0.047, True), (0.004, False)])
def test_a_rested_voltage_beyond_the_ocv_of_a_full_cell_is_doubted(
    bundled_cell, above_v, is_doubted, given_soc
):
    full_v = ocv_v(bundled_cell.charge, 1.0)
    warnings = rested_at(bundled_cell, full_v + above_v, initial_soc=given_soc).warnings
    beyond = [(each.code, each.values["beyond_v"]) for each in warnings]
    assert beyond == [("start.beyond-ocv", pytest.approx(0.047))] * is_doubted


def test_a_given_soc_is_not_asked_for_where_the_other_branch_ends_far_away(bundled_cell):
    cell = replace(bundled_cell, discharge=lambda soc: bundled_cell.charge(soc) - 0.06)
    assert rested_at(cell, ocv_v(cell.charge, 1.0), initial_soc=1.0).start.soc == 1.0


# The direction before the start


@pytest.mark.parametrize(
    ("window", "direction", "source"),
    [
        (Window(initial_soc=0.8), 1, "assumed"),
        (Window(initial_soc=0.8, initial_direction=-1), -1, "given"),
        # So near an end, the current that came last is the one that leads there.
        (Window(initial_soc=0.985), 1, "full or empty"),
        (Window(initial_soc=0.979), 1, "assumed"),
        (Window(initial_soc=0.015, score_to_s=320.0), -1, "full or empty"),
        (Window(initial_soc=0.1), 1, "assumed"),
        # In the second rest, after a discharge, whatever is said.
        (Window(initial_soc=0.8, start_time_s=600.0), -1, "load before"),
        (Window(initial_soc=0.8, start_time_s=600.0, initial_direction=1), -1, "load before"),
    ],
)
def test_the_direction_comes_from_the_load_before_or_is_given_or_assumed(
    bundled_cell, window, direction, source
):
    course = prepared(bundled_cell, window, "esc")
    assert (course.start.direction, course.start.direction_source) == (direction, source)
    assert course.direction[0] == direction
    # Only what is assumed may be the other one.
    assert (both_directions(course)[1] is not None) == (source == "assumed")


def test_a_record_cut_in_the_middle_of_a_discharge_is_met_from_the_other_direction(bundled_cell):
    # The rest tells 60 % after a discharge; read as after a charge it would be another state.
    time_s, current_a = np.arange(400.0), np.where(np.arange(400) < REST, 0, 2.0)
    record = simulated_record(bundled_cell, time_s, current_a, soc=0.6, direction=-1)
    assumed = prepare_record(record, bundled_cell, "iso-rc")
    other = both_directions(assumed)[1]
    assert [each.start.direction for each in (assumed, other)] == [1, -1]
    assert [each.start.direction_source for each in (assumed, other)] == ["assumed"] * 2
    assert other.window == assumed.window == Window()
    # The branches lie 10 mV apart, and the segments of the hysteresis within 0.5 mV of them.
    assert other.start.soc == pytest.approx(0.6, abs=5e-4)
    assert assumed.start.soc == pytest.approx(0.6 - 0.01 / 0.87, abs=1e-3)
    assert evaluate(other, CIRCUIT).metrics.max_v < 0.5e-3
    assert evaluate(assumed, CIRCUIT).metrics.max_v > 8e-3


@pytest.mark.parametrize(("circuit", "is_open"), [("iso-rc", False), ("esc", True)])
def test_of_a_start_under_load_only_a_state_that_moves_keeps_what_was_before(
    bundled_cell, circuit, is_open
):
    record = made(current_a=np.roll(CURRENT_A, -25))
    course = prepare_record(record, bundled_cell, circuit, FULL)
    assert (course.start.direction, course.start.direction_source) == (-1, "assumed")
    other = both_directions(course)[1]
    assert (other is not None) == is_open
    if is_open:
        gap_v = other.source_v - course.source_v
        np.testing.assert_allclose(gap_v, bundled_cell.hysteresis_v(course.soc), rtol=1e-9)


@pytest.mark.parametrize("hold", ["forward", "backward"])
def test_the_load_that_the_start_begins_is_not_the_load_before(bundled_cell, hold):
    # Sample 25 is the first of the discharge: its current flows after it, or before it.
    window = Window(initial_soc=0.8, start_time_s=300.0, initial_direction=1)
    start = prepared(bundled_cell, window, "esc", hold=hold).start
    expected = (1, "given") if hold == "forward" else (-1, "load before")
    assert (start.direction, start.direction_source) == expected


# The source, the current and the scored samples


@pytest.mark.parametrize("circuit", CIRCUITS)
def test_the_source_is_the_circuits_open_circuit_voltage(bundled_cell, circuit):
    course = prepared(bundled_cell, circuit=circuit)
    expected_v = bundled_cell.average_ocv_v(course.soc)
    if circuit == "iso-rc":
        expected_v = expected_v + course.direction * bundled_cell.hysteresis_v(course.soc) / 2
    if circuit == "takacs":
        turned = loops(course.soc, course.direction)
        expected_v = expected_v + turned * bundled_cell.hysteresis_v(course.soc) / 2
    if circuit == "esc":  # the state that moves starts at the last direction before the record
        expected_v = expected_v + bundled_cell.hysteresis_v(course.soc) / 2
    np.testing.assert_allclose(course.source_v, expected_v, rtol=1e-15)


@pytest.mark.parametrize("voltage_v", [0.0, -0.5])
def test_a_scored_voltage_that_is_not_positive_is_refused_with_row_and_remedy(
    bundled_cell, voltage_v
):
    dropped_v = np.where(np.arange(100) == 40, voltage_v, 3)
    with pytest.raises(InputError, match=rf"made.csv: row 42 is scored at {voltage_v:g} V.*delete"):
        prepared(bundled_cell, voltage_v=dropped_v)
    later = Window(initial_soc=0.8, score_from_s=500.0)
    assert prepared(bundled_cell, later, voltage_v=dropped_v).scored.sum() == 55


@pytest.mark.parametrize(
    ("farthest", "severities"),
    # Rounding, what full charges differ by, and more.
    [(2e-5, []), (0.005, ["note"]), (0.03, ["warning"])],
)
def test_samples_outside_the_ocv_points_are_reported_with_their_count(
    bundled_cell, farthest, severities
):
    soc = prepared(bundled_cell, Window(initial_soc=0.5)).soc
    lowest = bundled_cell.soc_range[0]
    begun = float(lowest - farthest + soc[0] - soc.min())
    course = prepared(bundled_cell, Window(initial_soc=begun, start_time_s=300.0))
    outside = np.count_nonzero(course.soc < lowest)
    assert 0 < outside < 75
    assert [warning.severity for warning in course.warnings] == severities
    for warning in course.warnings:
        assert warning.code == "soc.outside-ocv"
        assert warning.values["farthest_soc"] == pytest.approx(lowest - course.soc.min())
        assert f"made.csv: {outside} of 75 scored samples" in str(warning)


def test_samples_where_an_ocv_test_has_no_points_are_left_out_unless_the_voltage_is_of_its_points(
    bundled_cell,
):
    partial = {
        branch: tuple(point for point in getattr(bundled_cell, branch) if point.soc >= 0.1)
        for branch in ("charge_points", "discharge_points")
    }
    cell = replace(bundled_cell, **partial)
    low, start = cell.soc_range[0], Window(initial_soc=0.115)
    whole = prepared(bundled_cell, start, voltage_v=2.9)
    course = prepared(cell, start, voltage_v=2.9)
    is_known = whole.soc >= low
    assert whole.soc.min() < low - 0.05
    assert 10 < is_known.sum() < len(is_known)
    assert course.scored.sum() == is_known.sum()
    assert course.soc[course.scored].min() >= low
    (warning,) = [notice for notice in course.warnings if notice.code == "soc.without-ocv"]
    assert warning.values["left_out"] == np.count_nonzero(~is_known)
    with pytest.raises(InputError, match="by it the cell is empty before row"):
        prepared(cell, start, voltage_v=3.8)
    with pytest.raises(InputError, match="its charge takes this cell to"):
        prepared(cell, Window(initial_soc=0.09), voltage_v=2.9)


def identified_ocv(cell):
    """The cell with an OCV that was identified: its points are of no row."""
    points = tuple(replace(point, row=0) for point in cell.discharge_points)
    return replace(cell, charge_points=(), discharge_points=points)


@pytest.mark.parametrize(("capacity_ah", "shown"), [(None, "2"), (1.9, "1.9")])
def test_samples_far_outside_the_ocv_points_are_refused_with_row_and_remedies(
    bundled_cell, capacity_ah, shown
):
    taken_ah = np.append(0.0, np.cumsum(CURRENT_A[:-1] * 10)) / 3600
    taken = taken_ah / (capacity_ah or bundled_cell.capacity_ah)
    row = 2 + int(np.flatnonzero(taken > 0.01 - bundled_cell.soc_range[0] + 0.05)[0])
    start = Window(initial_soc=0.01, capacity_ah=capacity_ah)
    remedy = (
        rf"`capacity` \({shown} Ah\) or `initial_soc` .* charge of -0.05\d at row {row}, .*`sco"
    )
    with pytest.raises(
        InputError, match=rf"made.csv: it looks like a record of another .*{remedy}"
    ):
        prepared(bundled_cell, start, voltage_v=2.7)
    # Where the OCV is the identified records' own, they may have gone less far.
    with pytest.raises(
        InputError, match=r"made.csv: it goes beyond the states of charge that were"
    ):
        prepared(identified_ocv(bundled_cell), start, voltage_v=2.7)
    # What is not scored is let pass.
    unscored = Window(initial_soc=0.01, start_time_s=60.0, score_to_s=300.0)
    assert prepared(bundled_cell, unscored, voltage_v=2.8).scored.sum() == 25


@pytest.mark.parametrize(("sign", "end"), [(1, "empty"), (-1, "full")])
def test_a_record_that_its_charge_empties_but_not_its_voltage_is_called_another_cells(
    bundled_cell, sign, end
):
    start = Window(initial_soc=0.5 - 0.49 * sign)
    with pytest.raises(InputError, match=rf"by it the cell is {end} before row \d+.*another cell"):
        prepared(bundled_cell, start, current_a=sign * CURRENT_A, voltage_v=3.6)
    with pytest.raises(InputError, match=r"give their `capacity` if 2 Ah is not the cell's"):
        prepared(identified_ocv(bundled_cell), start, current_a=sign * CURRENT_A, voltage_v=3.6)

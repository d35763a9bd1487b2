"""Clocks that run backwards: each kind is told from the others, and seen through."""

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barnax.records import read_record
from helpers.records import CURRENT, TIME, changed, checked, counting, found, frame


@pytest.fixture
def inputs():
    return frame()


@pytest.mark.parametrize(
    ("line", "wrong_s"), [(0, 1e7), (1, 1e7), (500, 12.5), (500, -1e7), (500, 1e7), (19_679, 3.5)]
)
def test_a_stamp_out_of_line_is_found_at_its_row(tmp_path, inputs, line, wrong_s):
    outcome = checked(tmp_path, changed(inputs, TIME, wrong_s, [line]))
    assert counting(outcome) == {"clock": "error"}
    assert found(outcome, "clock").row == line + 2
    assert "delete these rows" in found(outcome, "clock").remedy


@settings(max_examples=30)
@given(
    line=st.integers(5, 1990),
    off_s=st.floats(100, 1e8),
    is_late=st.booleans(),
    run=st.integers(1, 4),
)
def test_a_slip_of_the_clock_anywhere_is_found_and_seen_through(
    tmp_path_factory, line, off_s, is_late, run
):
    inputs = frame()[:2000]
    clock = inputs[TIME].to_numpy()
    lines = np.arange(line, line + run)
    wrong = (clock[-1] + off_s if is_late else clock[0] - off_s) + np.arange(run) / 8
    outcome = checked(tmp_path_factory.mktemp("slip"), changed(inputs, TIME, wrong, lines))
    assert found(outcome, "clock").row == line + 2
    assert outcome.facts.samples == 2000 - run
    assert outcome.facts.last_s == clock[-1]


def test_two_rows_exchanged_are_out_of_order(tmp_path, inputs):
    table = pl.concat([inputs[:100], inputs[101:102], inputs[100:101], inputs[102:]])
    clock = found(checked(tmp_path, table), "clock")
    assert "out of order (1 place)" in clock.what
    assert (clock.row, clock.remedy) == (103, "sort the rows by time")


@pytest.mark.parametrize("seed", [1, 2])
def test_shuffled_rows_are_sorted_and_the_rest_is_as_it_was(tmp_path, inputs, seed):
    table = inputs.sample(fraction=1, shuffle=True, seed=seed)
    outcome = checked(tmp_path, table)
    assert counting(outcome) == {"clock": "error"}
    assert outcome.facts == checked(tmp_path, inputs).facts


def test_a_piece_of_the_record_in_the_wrong_place_is_out_of_order(tmp_path, inputs):
    table = pl.concat([inputs[:5000], inputs[8000:9000], inputs[5000:8000], inputs[9000:]])
    clock = found(checked(tmp_path, table), "clock")
    assert "from 8999 s to 5000 s: rows stand out of order" in clock.what
    assert clock.row == 6002


def test_two_tests_in_one_file_are_told_from_rows_out_of_order(tmp_path, inputs):
    outcome = checked(tmp_path, pl.concat([inputs, frame("validation")]))
    clock = found(outcome, "clock")
    assert "the clock starts again (1 time)" in clock.what
    assert "split joined tests" in clock.remedy
    assert clock.row == inputs.height + 2
    assert outcome.facts.samples == 19_680 + 15_000


def test_a_step_clock_is_told_by_the_steps(tmp_path, inputs):
    clock = inputs[TIME].to_numpy()
    table = changed(inputs, TIME, clock % 600).with_columns(
        pl.Series("Step Index / 1", (clock // 600).astype(int))
    )
    outcome = checked(tmp_path, table)
    assert "starts again with each step (32 times)" in found(outcome, "clock").what
    assert "the test's own clock" in found(outcome, "clock").remedy
    assert outcome.facts.discharged_ah == pytest.approx(2.8221, abs=1e-3)


def test_a_time_of_day_is_told_by_midnight(tmp_path, inputs):
    clock = (inputs[TIME].to_numpy() + 80_000) % 86_400
    outcome = checked(tmp_path, changed(inputs, TIME, clock))
    assert "a time of day, past midnight 1 time" in found(outcome, "clock").what
    assert counting(outcome) == {"clock": "error"}


def test_a_row_logged_twice_is_no_more_than_a_note(tmp_path, inputs):
    outcome = checked(tmp_path, pl.concat([inputs[:100], inputs[99:100], inputs[100:]]))
    assert outcome.is_clean
    assert found(outcome, "repeats").row == 102


def test_a_row_logged_twice_with_the_tester_s_noise_is_no_more_than_a_note(tmp_path, inputs):
    outcome = checked(tmp_path, changed(inputs, TIME, inputs[TIME][99], [100]))
    assert outcome.is_clean
    assert "within the tester's resolution" in found(outcome, "repeats").what


@settings(max_examples=30)
@given(lines=st.sets(st.integers(1, 400).map(lambda number: 40 * number), max_size=20))
def test_single_doubled_stamps_are_merged_and_the_first_of_two_kept(tmp_path_factory, lines):
    inputs = frame().with_columns(pl.Series(CURRENT, np.sin(np.arange(19_680.0))))
    places = sorted(lines)
    clock = inputs[TIME].to_numpy().copy()
    clock[places] = clock[np.array(places, int) - 1]
    folder = tmp_path_factory.mktemp("twice")
    changed(inputs, TIME, clock).write_csv(folder / "cell.csv")
    record = read_record(folder / "cell.csv")
    kept = np.setdiff1d(np.arange(19_680), places)
    np.testing.assert_array_equal(record.row, kept + 2)
    assert (np.diff(record.time_s) > 0).all()


def stamps_of_three(inputs, starts):
    """The table with three different values under one stamp, in some places."""
    table = inputs
    for start in starts:
        table = changed(table, CURRENT, [0.1, 0.2], [start + 1, start + 2])
        table = changed(table, TIME, inputs[TIME][start], [start + 1, start + 2])
    return table


def test_one_stamp_of_three_values_is_mended_with_a_warning_that_names_it(tmp_path, inputs):
    outcome = checked(tmp_path, stamps_of_three(inputs, [100]))
    assert counting(outcome) == {"repeats": "warning"}
    assert found(outcome, "repeats").row == 103
    record = read_record(tmp_path / "cell.csv")
    assert record.samples == inputs.height - 2
    assert any("time 100 s stands twice" in text for text in record.warnings)


def test_many_stamps_of_three_values_are_an_error(tmp_path, inputs):
    outcome = checked(tmp_path, stamps_of_three(inputs, range(50, 19_000, 50)))
    assert counting(outcome)["repeats"] == "error"


def test_a_clock_of_too_few_digits_is_seen_through(tmp_path, inputs):
    coarse = np.floor(inputs[TIME].to_numpy() / 10) * 10
    outcome = checked(tmp_path, changed(inputs, TIME, coarse))
    assert counting(outcome) == {"repeats": "error"}
    assert outcome.facts.discharged_ah == pytest.approx(2.8221, abs=1e-3)

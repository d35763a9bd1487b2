"""Clocks that run backwards: each kind is told from the others, and seen through."""

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from helpers.records import CURRENT, TIME, changed, checked, counting, found, frame


@pytest.fixture
def inputs():
    return frame()


@pytest.mark.parametrize(
    ("line", "wrong_s"), [(0, 1e7), (1, 1e7), (500, 12.5), (500, -1e7), (500, 1e7), (19_679, 3.5)]
)
def test_a_stamp_out_of_line_is_found_at_its_row(tmp_path, inputs, line, wrong_s):
    diagnosis = checked(tmp_path, changed(inputs, TIME, wrong_s, [line]))
    assert counting(diagnosis) == {"clock": "error"}
    assert found(diagnosis, "clock").row == line + 2
    assert "delete these rows" in found(diagnosis, "clock").remedy


@settings(max_examples=30, deadline=None)
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
    diagnosis = checked(tmp_path_factory.mktemp("slip"), changed(inputs, TIME, wrong, lines))
    assert found(diagnosis, "clock").row == line + 2
    assert diagnosis.facts.samples == 2000 - run
    assert diagnosis.facts.last_s == clock[-1]


def test_two_rows_exchanged_are_out_of_order(tmp_path, inputs):
    table = pl.concat([inputs[:100], inputs[101:102], inputs[100:101], inputs[102:]])
    clock = found(checked(tmp_path, table), "clock")
    assert "out of order (1 place)" in clock.what
    assert (clock.row, clock.remedy) == (103, "sort the rows by time")


@pytest.mark.parametrize("seed", [1, 2])
def test_shuffled_rows_are_sorted_and_the_rest_is_as_it_was(tmp_path, inputs, seed):
    table = inputs.sample(fraction=1, shuffle=True, seed=seed)
    diagnosis = checked(tmp_path, table)
    assert counting(diagnosis) == {"clock": "error"}
    assert diagnosis.facts == checked(tmp_path, inputs).facts


def test_a_piece_of_the_record_in_the_wrong_place_is_out_of_order(tmp_path, inputs):
    table = pl.concat([inputs[:5000], inputs[8000:9000], inputs[5000:8000], inputs[9000:]])
    clock = found(checked(tmp_path, table), "clock")
    assert "from 8999 s to 5000 s: rows stand out of order" in clock.what
    assert clock.row == 6002


def test_two_tests_in_one_file_are_told_from_rows_out_of_order(tmp_path, inputs):
    diagnosis = checked(tmp_path, pl.concat([inputs, frame("validation")]))
    clock = found(diagnosis, "clock")
    assert "the clock starts again 1 time" in clock.what
    assert "split joined tests" in clock.remedy
    assert clock.row == inputs.height + 2
    assert diagnosis.facts.samples == 19_680 + 15_000


def test_a_step_clock_is_told_by_the_steps(tmp_path, inputs):
    clock = inputs[TIME].to_numpy()
    table = changed(inputs, TIME, clock % 600).with_columns(
        pl.Series("Step Index / 1", (clock // 600).astype(int))
    )
    diagnosis = checked(tmp_path, table)
    assert "starts again with each step (32 times)" in found(diagnosis, "clock").what
    assert "the test's own clock" in found(diagnosis, "clock").remedy
    assert diagnosis.facts.discharged_ah == pytest.approx(2.8221, abs=1e-3)


def test_a_time_of_day_is_told_by_midnight(tmp_path, inputs):
    clock = (inputs[TIME].to_numpy() + 80_000) % 86_400
    diagnosis = checked(tmp_path, changed(inputs, TIME, clock))
    assert "a time of day, past midnight 1 time" in found(diagnosis, "clock").what
    assert counting(diagnosis) == {"clock": "error"}


def test_a_row_logged_twice_is_no_more_than_a_note(tmp_path, inputs):
    diagnosis = checked(tmp_path, pl.concat([inputs[:100], inputs[99:100], inputs[100:]]))
    assert diagnosis.is_clean
    assert found(diagnosis, "repeats").row == 102
    assert "1 row logged twice: exactly the row before" in found(diagnosis, "repeats").what


def test_a_row_logged_twice_with_the_tester_s_noise_is_no_more_than_a_note(tmp_path, inputs):
    diagnosis = checked(tmp_path, changed(inputs, TIME, inputs[TIME][99], [100]))
    assert diagnosis.is_clean
    assert "within the tester's resolution" in found(diagnosis, "repeats").what


def test_one_time_with_two_values_is_an_error_with_both(tmp_path, inputs):
    jump = int(np.argmax(np.abs(np.diff(inputs[CURRENT].to_numpy()))))
    table = changed(inputs, TIME, inputs[TIME][jump], [jump + 1])
    repeats = found(checked(tmp_path, table), "repeats")
    assert (repeats.severity, repeats.row) == ("error", jump + 3)
    assert f"time {jump} s stands twice with different values" in repeats.what


def test_a_clock_of_too_few_digits_is_named_as_such(tmp_path, inputs):
    coarse = np.floor(inputs[TIME].to_numpy() / 10) * 10
    diagnosis = checked(tmp_path, changed(inputs, TIME, coarse))
    assert counting(diagnosis) == {"repeats": "error"}
    assert "about 10 rows a stamp" in found(diagnosis, "repeats").what
    assert found(diagnosis, "repeats").remedy == "export the time with more digits"
    assert diagnosis.facts.discharged_ah == pytest.approx(2.8221, abs=1e-3)

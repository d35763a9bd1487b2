"""Clocks that run backwards: each kind is told from the others, and seen through."""

import numpy as np
import polars as pl
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from barnax.checks import check_file
from barnax.records import read_record, record_from_frame, source_from_frame
from helpers.records import CURRENT, TIME, changed, checked, counting, finding, frame

from .test_findings import stamps_of_three


@pytest.fixture
def inputs():
    return frame()


@example(line=0, off_s=1e7, is_late=True, run=1)
@example(line=1, off_s=1e7, is_late=True, run=1)
@example(line=5, off_s=3237.0, is_late=False, run=1)  # About an hour, which comes back.
@example(line=5, off_s=1247.0, is_late=True, run=1)  # And one that comes before it falls.
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
    assert finding(outcome, "clock").row == line + 2
    assert outcome.facts.samples == 2000 - run
    assert outcome.facts.time_s[1] == clock[-1]


@pytest.mark.parametrize("seed", [1, 2])
def test_shuffled_rows_are_sorted_and_the_rest_is_as_it_was(tmp_path, inputs, seed):
    table = inputs.sample(fraction=1, shuffle=True, seed=seed)
    outcome = checked(tmp_path, table)
    assert counting(outcome) == {"clock": "error"}
    assert outcome.facts == checked(tmp_path, inputs).facts


@pytest.mark.parametrize("gap_s", [60.0, 900.0])
def test_files_in_the_wrong_order_are_sorted_though_the_log_paused_between_them(gap_s):
    whole = frame()[:4000].with_columns(pl.Series(TIME, np.arange(4000.0)))
    pieces = [whole[:2000], whole[2000:].with_columns(pl.col(TIME) + gap_s)]
    outcome = check_file(source_from_frame(pl.concat(pieces[::-1]), "joined"))
    assert finding(outcome, "clock").values["cause"] == "shuffled"
    assert outcome.facts.time_s == (0.0, 3999.0 + gap_s)


@given(lines=st.sets(st.integers(1, 49).map(lambda number: 40 * number), max_size=20))
def test_single_doubled_stamps_are_merged_and_the_first_of_two_kept(lines):
    inputs = frame()[:2000].with_columns(pl.Series(CURRENT, np.sin(np.arange(2000.0))))
    places = np.array(sorted(lines), int)
    record = record_from_frame(changed(inputs, TIME, inputs[TIME].to_numpy()[places - 1], places))
    kept = np.setdiff1d(np.arange(2000), places)
    np.testing.assert_array_equal(record.row, kept + 2)
    assert (np.diff(record.time_s) > 0).all()


def test_one_stamp_of_three_values_is_mended_with_a_warning_that_names_it(tmp_path, inputs):
    outcome = checked(tmp_path, stamps_of_three([100]))
    assert counting(outcome) == {"repeats": "warning"}
    assert finding(outcome, "repeats").row == 103
    record = read_record(tmp_path / "cell.csv")
    assert record.samples == inputs.height - 2
    assert "repeats.differ" in {each.code for each in record.warnings}

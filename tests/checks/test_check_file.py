"""The check as a whole: nothing hides behind anything, and it agrees with the reader."""

import json

import numpy as np
import polars as pl
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import barnax.records.source
from barnax import InputError, check_file
from barnax.bundled import BUNDLED_NAMES, bundled_file
from barnax.records import read_record, read_source, record_from_frame, source_from_frame
from helpers.records import CURRENT, TIME, VOLTAGE, changed, checked, counting, finding, frame


@pytest.mark.parametrize("name", BUNDLED_NAMES)
@pytest.mark.parametrize("capacity_ah", [None, 2.0])
def test_the_bundled_records_are_clean(name, capacity_ah):
    assert check_file(bundled_file(name), capacity_ah=capacity_ah).is_clean


def test_one_read_of_a_file_gives_its_record_and_its_check(tmp_path, monkeypatch):
    path = tmp_path / "cell.csv"
    frame().write_csv(path)
    source = read_source(path)
    expected = check_file(path), read_record(path).sha256
    monkeypatch.setattr(barnax.records.source, "read_table", None)
    path.unlink()
    assert (check_file(source), read_record(source).sha256) == expected


@pytest.mark.parametrize("capacity_ah", [0.0, float("nan")])
def test_a_capacity_that_is_none_is_refused(capacity_ah):
    with pytest.raises(InputError, match=r"`capacity` .* must be positive"):
        check_file(bundled_file("validation"), capacity_ah=capacity_ah)


@given(seed=st.integers(0, 2**32 - 1), rows=st.integers(10, 300))
def test_a_rough_record_of_any_shape_is_checked_without_a_crash(tmp_path_factory, seed, rows):
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.integers(-6, 7, 3)
    levels = rng.choice([0.0, 1.0, -1.0, 0.02, rng.normal()], rows // 3 + 1)
    table = pl.DataFrame(
        {
            TIME: np.cumsum(rng.choice([0.0, 1.0, 1.0, 10.0, -5.0], rows)) * scale[0],
            CURRENT: np.repeat(levels, 3)[:rows] * scale[1],
            VOLTAGE: rng.choice([3.7, 4.2, rng.uniform(2, 4)], rows) * scale[2],
            "Step Index / 1": rng.integers(0, 4, rows),
        }
    )
    assert json.dumps(checked(tmp_path_factory.mktemp("rough"), table).to_dict())


def test_rows_of_a_testers_file_are_deleted_in_an_export():
    voltage_v = frame()[VOLTAGE].to_numpy()
    source = source_from_frame(changed(frame(), VOLTAGE, voltage_v[700] + 0.3, 700), "cell.nda")
    remedies = [each.remedy for each in check_file(source).findings]
    assert "export it as CSV, and delete these rows, or correct them" in remedies


# Clocks that run backwards: each kind is told from the others, and seen through.


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
def test_a_slip_of_the_clock_anywhere_is_detected_and_seen_through(
    tmp_path_factory, line, off_s, is_late, run
):
    inputs = frame()[:2000]
    clock = inputs[TIME].to_numpy()
    lines = np.arange(line, line + run)
    wrong = (clock[-1] + off_s if is_late else clock[0] - off_s) + np.arange(run) / 8
    outcome = checked(tmp_path_factory.mktemp("slip"), changed(inputs, TIME, wrong, lines))
    assert finding(outcome, "clock").row == line + 2
    assert outcome.traits.facts["samples"] == 2000 - run
    assert outcome.traits.facts["time [s]"][1] == clock[-1]


@pytest.mark.parametrize("seed", [1, 2])
def test_shuffled_rows_are_sorted_and_the_rest_is_as_it_was(tmp_path, seed):
    outcome = checked(tmp_path, frame().sample(fraction=1, shuffle=True, seed=seed))
    assert counting(outcome) == {"clock": "error"}
    assert outcome.traits == checked(tmp_path, frame()).traits


@pytest.mark.parametrize("gap_s", [60.0, 900.0])
def test_files_in_the_wrong_order_are_sorted_though_the_log_paused_between_them(gap_s):
    whole = frame()[:4000].with_columns(pl.Series(TIME, np.arange(4000.0)))
    pieces = [whole[:2000], whole[2000:].with_columns(pl.col(TIME) + gap_s)]
    outcome = check_file(source_from_frame(pl.concat(pieces[::-1]), "joined"))
    assert finding(outcome, "clock").values["cause"] == "shuffled"
    assert outcome.traits.facts["time [s]"] == (0.0, 3999.0 + gap_s)


@given(lines=st.sets(st.integers(1, 49).map(lambda number: 40 * number), max_size=20))
def test_single_doubled_stamps_are_merged_and_the_first_of_two_kept(lines):
    inputs = frame()[:2000].with_columns(pl.Series(CURRENT, np.sin(np.arange(2000.0))))
    places = np.array(sorted(lines), int)
    record = record_from_frame(changed(inputs, TIME, inputs[TIME].to_numpy()[places - 1], places))
    kept = np.setdiff1d(np.arange(2000), places)
    np.testing.assert_array_equal(record.row, kept + 2)
    assert (np.diff(record.time_s) > 0).all()


def test_one_stamp_of_three_values_is_mended_with_a_warning_that_names_it(tmp_path):
    table = changed(frame(), CURRENT, [0.1, 0.2], [101, 102])
    outcome = checked(tmp_path, changed(table, TIME, table[TIME][100], [101, 102]))
    assert counting(outcome) == {"repeats": "warning"}
    assert finding(outcome, "repeats").row == 103
    record = read_record(tmp_path / "cell.csv")
    assert record.samples == frame().height - 2
    assert "repeats.differ" in {each.code for each in record.warnings}

"""What is read, under which name, and what the checks have against it."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from barnax import FileCheck, InputError, Job, Notice, Window, check_file, identify
from barnax.bundled import BUNDLED
from barnax.checks.roles import are_unfit
from barnax.inputs import input_warnings, read_inputs, windows_of
from barnax.records import source_from_frame
from helpers.records import logged


def read(records, ocv=BUNDLED.ocv, validate=(), window=None, capacity=None, **reading):
    given = {"ocv": list(ocv), "validate": list(validate), "ocv_fit": "polynomial"}
    return read_inputs(Job(records, **given, capacity=capacity, window=window, **reading))


def test_a_record_without_an_ocv_test_is_refused_by_its_name():
    with pytest.raises(InputError, match=r"^identification.parquet: circuits are compared with"):
        read(BUNDLED.record, ocv=())
    with pytest.raises(InputError, match=r"^data frame: circuits are compared with"):
        read(pl.read_parquet(BUNDLED.record), ocv=())


def test_each_record_has_the_window_of_its_name_or_the_common_one():
    inputs = read(BUNDLED.record, validate=[BUNDLED.validation])
    own = Window(initial_soc=0.9, capacity_ah=1.9)
    windows = windows_of(inputs, {"validation.parquet": own, "": Window(score_to_s=9.0)}, 2.1)
    assert windows == {
        "identification.parquet": Window(score_to_s=9.0, capacity_ah=2.1),
        "validation.parquet": own,
    }
    assert windows_of(inputs, Window(score_to_s=9.0), None)["validation.parquet"] == (
        Window(score_to_s=9.0)
    )


@pytest.fixture
def notices(tmp_path):
    """What is warned of for a file of these columns, as the record to identify on."""

    def warnings(time_s, current_a, voltage_v, role="identification"):
        path = tmp_path / "drive.csv"
        logged(time_s, current_a, voltage_v).write_csv(path)
        return input_warnings(check_file(path), role)

    return warnings


def test_a_current_without_a_sign_is_a_finding_with_the_name_of_the_file(notices, bundled_record):
    measured = bundled_record
    actual = notices(measured.time_s, np.abs(measured.current_a), measured.voltage_v)
    assert actual
    assert {each.subject for each in actual} == {"drive.csv"}


@pytest.mark.parametrize(
    ("capacity_ah", "steps", "is_unfit", "by_steps"),
    [(None, 600, False, False), (500.0, 600, True, False), (None, 5, True, True)],
)
def test_a_record_that_is_small_beside_its_capacity_has_not_too_few_steps(
    tmp_path, bundled_record, capacity_ah, steps, is_unfit, by_steps
):
    """The capacity may be that of the OCV test of another cell."""
    measured, path = bundled_record, tmp_path / "drive.csv"
    current_a = np.where(np.arange(4000) < 10 * steps, -measured.current_a[:4000], -1.0)
    logged(measured.time_s[:4000], current_a, measured.voltage_v[:4000]).write_csv(path)
    actual = input_warnings(check_file(path, capacity_ah=capacity_ah), "identification")
    names = {"drive.csv"}
    assert are_unfit(names, actual) == is_unfit
    assert are_unfit(names, actual, by_steps=True) == by_steps
    assert not are_unfit({*names, "other.csv"}, actual)
    assert not are_unfit(set(), actual)


def test_what_makes_r0_wrong_says_nothing_against_an_ocv_test():
    ohm = {"first_ohm": 0.02, "second_ohm": 0.01, "third_ohm": 0.005}
    steps = {**ohm, "interval_s": 1.0, "missing_share": 0.5, "back_ohm": 0.01}
    gap = {"gaps": 1, "longest_s": 60.0, "longest_row": 3, "charge": "steady", "held_ah": 0.02}
    given = {"late-voltage.step": steps, "smoothed-current.back": steps, "gaps.missing": gap}
    actual = tuple(Notice(code, values) for code, values in given.items())
    checked = FileCheck("ocv.csv", actual, ())
    of_test, of_record = (
        [each.code for each in input_warnings(checked, role)]
        for role in ("OCV test", "identification")
    )
    assert of_record == [each.code for each in actual]
    assert of_test == ["gaps.missing"]


def refusal(record, **options):
    with pytest.raises(InputError) as caught:
        identify(record, ocv=BUNDLED.ocv, seeds=1, trust="none", **options)
    return str(caught.value).splitlines()[0]


@pytest.mark.slow
def test_a_fast_record_too_short_for_three_pairs_is_identified_with_two(tmp_path):
    frame = pl.read_parquet(BUNDLED.validation)[:60]
    frame.with_columns(pl.col("Test Time / s") / 10).write_csv(tmp_path / "short.csv")
    quick = {"seeds": 0, "trust": "none", "folds": 0, "max_boxes": 0}
    actual = identify(tmp_path / "short.csv", ocv=BUNDLED.ocv, **quick)
    assert "3rc" not in {each.model for each in actual.candidates}


def test_a_record_without_changes_of_load_is_refused_with_what_to_give(tmp_path):
    for current_a, hours, what in ((1.0, 1.5, "only charges"), (0.1, 19.0, "is a slow sweep")):
        time_s = np.linspace(0, 3600 * hours, 2000)
        voltage_v = np.interp(time_s / time_s[-1], [0, 0.1, 0.9, 1], [3.0, 3.5, 4.0, 4.2])
        current = np.where(time_s > 0, current_a, 0.0)
        logged(time_s, current, voltage_v).write_csv(tmp_path / "charge.csv")
        told = refusal(tmp_path / "charge.csv", window=Window(initial_soc=0.03))
        assert told.startswith(f"charge.csv: {what}")
        assert "give a record under a changing load" in told


def test_data_frames_and_records_of_one_name_are_numbered():
    frame = pl.read_parquet(BUNDLED.record)
    actual = read([frame[:9000], frame[9000:]])
    assert [each.name for each in actual.records] == ["data frame", "data frame 2"]
    again = [replace(each, name="log") for each in actual.records]
    actual = read(again)
    assert [each.name for each in actual.records] == ["log", "log 2"]


@pytest.mark.parametrize("given", [["a=0.25", "b=-0.5"], {"a": 0.25, "b": -0.5}])
def test_a_lag_is_given_for_one_record_by_its_name(given):
    frame = pl.read_parquet(BUNDLED.record)
    sources = [
        source_from_frame(part, name) for part, name in ((frame[:9000], "a"), (frame[9000:], "b"))
    ]
    actual = read(sources, voltage_lag=given)
    assert [record.voltage_lag_s for record in actual.records] == [0.25, -0.5]
    assert {record.voltage_lag_s for record in actual.ocv} == {0.0}

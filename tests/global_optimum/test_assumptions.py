"""What was assumed about a record, tried the other way."""

from dataclasses import replace

import pytest

from barnax.bundled import BUNDLED
from barnax.cell import characterize
from barnax.global_optimum import find_global_optimum, try_other_hold
from barnax.model.problem import make_problem
from barnax.model.window import Window
from barnax.records import read_record


@pytest.fixture(scope="module")
def cell():
    return characterize([read_record(path) for path in BUNDLED.ocv], ocv_fit="interpolated")


def problem_of(cell, hold, circuit="so-rc", **window):
    record = read_record(BUNDLED.record, current_hold=hold)
    return make_problem(record, cell, circuit, window=Window(score_to_s=3000.0, **window))


def test_the_other_hold_is_what_reading_the_file_with_it_gives(cell):
    found = try_other_hold(problem_of(cell, "auto"))
    assert found is not None
    assert found.value == "backward"
    read = find_global_optimum(problem_of(cell, "backward"), prove=False)
    assert found.rmse_v == read.rmse_v
    assert found.parameters == read.parameters


def test_a_hold_that_is_known_is_not_tried(cell):
    assert try_other_hold(problem_of(cell, "forward")) is None


def test_the_other_hold_starts_in_the_direction_that_was_settled(cell):
    problem = problem_of(cell, "auto", "iso-rc")
    (own,) = problem.prepared_records
    direction = -own.start.direction
    start = replace(own.start, direction=direction, direction_source="better fit")
    settled = replace(problem, prepared_records=(replace(own, start=start),))
    read = problem_of(cell, "backward", "iso-rc", initial_direction=direction)
    found, unsettled = try_other_hold(settled), try_other_hold(problem)
    assert found is not None
    assert unsettled is not None
    assert found.rmse_v == find_global_optimum(read, prove=False).rmse_v != unsettled.rmse_v

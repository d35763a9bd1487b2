"""A small comparison on the bundled cell: its rows, its differences and its file."""

import itertools
import json
from contextlib import contextmanager

import pytest
from scipy.optimize import differential_evolution

from barnax.baselines import Budget
from barnax.bundled import BUNDLED
from barnax.comparison import ComparisonResult, compare
from barnax.comparison.statistics import errors_by_soc
from barnax.errors import InputError
from barnax.model.window import Window
from barnax.records import read_record
from barnax.search.answers import SAME_RMSE
from barnax.search.evaluate import validate

WINDOW = Window(score_to_s=1500.5)
ROWS = (("1rc", "ls"), ("so-rc", "varpro"), ("so-rc", "pso"), ("iso-rc", "pso"), ("esc", "rls"))
BUDGET = Budget(population=8, iterations=20, seeds=4, key=3)


@pytest.fixture(scope="module")
def validation():
    return read_record(BUNDLED.validation)


@pytest.fixture(scope="module")
def watched():
    """What a comparison tells while it works: titles, and seeds finished under each."""
    return {}


@pytest.fixture(scope="module")
def comparison(bundled_record, bundled_cell, validation, watched):
    @contextmanager
    def watch(title):
        watched[title] = 0

        def advance(gained):
            watched[title] += gained

        yield advance

    return compare(
        bundled_record,
        bundled_cell,
        ROWS,
        validation=[validation],
        window=WINDOW,
        budget=BUDGET,
        watch=watch,
    )


def row_of(comparison, name):
    return next(row for row in comparison.rows if row.name == name)


def test_the_rows_stand_in_the_order_asked_for(comparison):
    assert [(row.model, row.method) for row in comparison.rows] == list(ROWS)


def test_a_row_is_its_median_seeds_answer_on_every_record(comparison, validation, bundled_cell):
    row = row_of(comparison, "pso iso-rc")
    errors_v = sorted(row.errors_v)
    assert len(errors_v) == BUDGET.seeds
    assert row.median.rmse_v == errors_v[1]
    assert row.evaluations[0].metrics.rmse_v == pytest.approx(errors_v[1], rel=1e-9)
    own = row.evaluations[0]
    bands = errors_by_soc(own.error_v, own.prepared.soc, own.prepared.scored)
    assert row.errors[0].bands == bands
    again = validate(validation, bundled_cell, "iso-rc", row.median.parameters, WINDOW)
    assert row.evaluations[1].metrics == again.metrics


def test_a_method_that_cannot_answer_is_a_row_that_says_why(comparison):
    row = row_of(comparison, "rls esc")
    assert "dynamic hysteresis" in row.failure
    assert (row.answers, row.evaluations, row.refined) == ((), (), None)
    assert row not in comparison.answered


def test_refinement_stands_beside_the_answer_and_is_never_worse(comparison):
    exact = row_of(comparison, "varpro so-rc")
    for row in comparison.answered:
        if row.method != "ls":  # which may leave the box
            assert row.refined.rmse_v <= row.median.rmse_v * (1 + 1e-9)
    assert row_of(comparison, "pso so-rc").refined.rmse_v >= exact.median.rmse_v * (1 - SAME_RMSE)


def test_every_pair_of_answered_rows_is_compared_on_every_record(comparison):
    names = [row.name for row in comparison.answered]
    expected = {
        (*pair, place) for pair in itertools.combinations(names, 2) for place in (False, True)
    }
    found = [(each.first, each.second, each.is_validation) for each in comparison.differences]
    assert set(found) == expected
    assert len(found) == len(expected)


def test_a_difference_is_that_of_the_rows_errors(comparison):
    for each in comparison.differences:
        first, second = (
            row_of(comparison, name).evaluations[each.is_validation].metrics.rmse_v
            for name in (each.first, each.second)
        )
        assert each.over_time.difference_v == pytest.approx(first - second, abs=1e-15)


def test_seeds_are_paired_where_a_row_has_them_and_on_the_identification_record(comparison):
    paired = {
        (each.first, each.second)
        for each in comparison.differences
        if each.over_seeds is not None and not each.is_validation
    }
    assert ("ls 1rc", "varpro so-rc") not in paired
    assert len(paired) == 5
    assert all(each.over_seeds is None for each in comparison.differences if each.is_validation)


@pytest.mark.slow
def test_bounds_go_to_the_models_that_have_the_parameter(bundled_record, bundled_cell):
    compared = compare(
        bundled_record,
        bundled_cell,
        [("so-rc", "varpro"), ("3rc", "ls")],
        window=WINDOW,
        bounds={"R3 [Ohm]": (0.001, 0.002)},
        fixed={"R0 [Ohm]": 0.06},
    )
    assert compared.rows[0].median.parameters.r0 == pytest.approx(0.06)
    assert compared.rows[1].problem.bounds.ranges["R3 [Ohm]"] == (0.001, 0.002)


def test_the_file_gives_back_the_result_exactly(comparison, tmp_path):
    path = tmp_path / "comparison.json"
    path.write_text(comparison.to_json())
    assert ComparisonResult.from_json(path) == comparison


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda stored: stored["rows"][0].update(answers=[]), "lacks answers"),
        (lambda stored: stored["rows"][0].update(errors=[]), "errors on some record"),
        (lambda stored: stored.update(models={}), "no box of"),
    ],
)
def test_a_file_that_is_not_whole_is_refused(comparison, tmp_path, change, reason):
    stored = json.loads(comparison.to_json())
    change(stored)
    path = tmp_path / "comparison.json"
    path.write_text(json.dumps(stored))
    with pytest.raises(InputError, match=reason):
        ComparisonResult.from_json(path)


def test_a_comparison_repeats_to_the_same_bytes(bundled_record, bundled_cell):
    def text():
        compared = compare(bundled_record, bundled_cell, ROWS[2:4], window=WINDOW, budget=BUDGET)
        return compared.to_json()

    assert text() == text()


@pytest.mark.slow
def test_seeds_that_stop_after_different_generations_are_stored(
    bundled_record, bundled_cell, monkeypatch, tmp_path
):
    """Differential evolution ends where its whole population has come to one error, at last."""
    turns = itertools.count()

    def sooner(*given, maxiter, **more):
        return differential_evolution(*given, maxiter=maxiter - 10 * next(turns), **more)

    monkeypatch.setattr("barnax.baselines.searches.differential_evolution", sooner)
    compared = compare(
        bundled_record,
        bundled_cell,
        [("1rc", "de")],
        window=WINDOW,
        fixed={"R1 [Ohm]": 0.02, "tau1 [s]": 20.0},
        budget=Budget(population=5, iterations=60, seeds=3),
    )
    path = tmp_path / "comparison.json"
    path.write_text(compared.to_json())
    result = ComparisonResult.from_json(path)
    assert len({seed.evaluations for seed in result.rows[0].answers}) > 1

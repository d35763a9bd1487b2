"""A small comparison on the bundled cell: its rows, its differences and its file."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import differential_evolution

from barnax import Budget, ComparisonJob, ComparisonResult, InputError, Window, compare, validate
from barnax.search.answers import SAME_RMSE

WINDOW = Window(score_to_s=1500.5)
ROWS = (("1rc", "ls"), ("so-rc", "varpro"), ("so-rc", "pso"), ("iso-rc", "pso"), ("esc", "rls"))
BUDGET = Budget(population=8, iterations=20, seeds=4, key=3)


@pytest.fixture(scope="module")
def comparison(bundled_record, bundled_cell, bundled_validation):
    job = ComparisonJob(rows=ROWS, window=WINDOW, **vars(BUDGET))
    return compare(bundled_record, bundled_cell, job, [bundled_validation])


def row_of(comparison, name):
    return next(row for row in comparison.rows if row.name == name)


def test_a_row_is_its_median_seeds_answer_on_every_record(
    comparison, bundled_validation, bundled_cell
):
    row = row_of(comparison, "pso iso-rc")
    errors_v = sorted(row.errors_v)
    assert len(errors_v) == BUDGET.seeds
    assert row.median.rmse_v == errors_v[1]
    assert replace(row, answers=row.answers[:3]).median.rmse_v == np.median(row.errors_v[:3])
    assert row.evaluations[0].metrics.rmse_v == pytest.approx(errors_v[1], rel=1e-9)
    first = row.evaluations[0]
    here = first.prepared.scored & (first.prepared.soc >= 0.2)
    assert row.errors[0].bands[-1].rmse_v == pytest.approx(
        np.sqrt(np.mean(first.error_v[here] ** 2))
    )
    again = validate(bundled_validation, bundled_cell, "iso-rc", row.median.parameters, WINDOW)
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


def test_every_pair_of_answered_rows_is_compared_by_its_errors_on_every_record(comparison):
    assert [(row.model, row.method) for row in comparison.rows] == list(ROWS)
    pairs = itertools.combinations([row.name for row in comparison.answered], 2)
    compared = [(each.first, each.second, each.is_validation) for each in comparison.differences]
    expected = itertools.product(pairs, (False, True))
    assert sorted(compared) == sorted((*pair, is_validation) for pair, is_validation in expected)
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
    rows = [("so-rc", "varpro"), ("3rc", "ls")]
    box = {"bounds": {"R3 [Ohm]": (0.001, 0.002)}, "fix": {"R0 [Ohm]": 0.06}}
    job = ComparisonJob(rows=rows, window=WINDOW, **box)
    compared = compare(bundled_record, bundled_cell, job)
    assert compared.rows[0].median.parameters.r0 == pytest.approx(0.06)
    assert compared.rows[1].problem.bounds.ranges["R3 [Ohm]"] == (0.001, 0.002)


def test_the_file_gives_back_the_result_exactly(comparison, tmp_path):
    path = tmp_path / "comparison.json"
    path.write_text(comparison.to_json())
    assert ComparisonResult.from_json(path) == comparison
    # One that is not whole is refused.
    stored = json.loads(comparison.to_json())
    first, *others = stored["rows"]
    for change, reason in (
        ({"rows": [first | {"answers": []}, *others]}, "lacks answers"),
        ({"rows": [first | {"errors": []}, *others]}, "errors on some record"),
        ({"models": {}}, "no box of"),
    ):
        path.write_text(json.dumps(stored | change))
        with pytest.raises(InputError, match=reason):
            ComparisonResult.from_json(path)


def test_a_comparison_repeats_to_the_same_bytes(bundled_record, bundled_cell):
    job = ComparisonJob(rows=ROWS[2:4], window=WINDOW, **vars(BUDGET))
    first, again = (compare(bundled_record, bundled_cell, job) for _ in range(2))
    assert first.to_json() == again.to_json()


@pytest.mark.slow
def test_seeds_that_stop_after_different_generations_are_stored(
    bundled_record, bundled_cell, monkeypatch, tmp_path
):
    """Differential evolution ends where its whole population has come to one error, at last."""
    turns = itertools.count()

    def sooner(*given, maxiter, **more):
        return differential_evolution(*given, maxiter=maxiter - 10 * next(turns), **more)

    monkeypatch.setattr("barnax.baselines.searches.differential_evolution", sooner)
    given = {"fix": {"R1 [Ohm]": 0.02, "tau1 [s]": 20.0}, "window": WINDOW}
    given |= {"population": 5, "iterations": 60, "seeds": 3}
    job = ComparisonJob(rows=[("1rc", "de")], **given)
    compared = compare(bundled_record, bundled_cell, job)
    path = tmp_path / "comparison.json"
    path.write_text(compared.to_json())
    result = ComparisonResult.from_json(path)
    assert len({seed.evaluations for seed in result.rows[0].answers}) > 1

"""The comparison of optimizers: its statistics against slow formulas, its counts and functions."""

import itertools
from pathlib import Path

import numpy as np
import pytest
import scipy.stats
from benchmarks.optimizers import statistics

runs = pytest.importorskip("benchmarks.optimizers.runs", exc_type=ImportError)


def test_mean_ranks_and_the_critical_difference_are_those_of_demsar():
    """Demsar (2006), Table 6 and section 3.2.2: four classifiers on 14 data sets."""
    means = np.random.default_rng(0).normal(size=(14, 4))
    ranking = statistics.rank_methods(means)
    ranks = [[1 + sum(other < mean for other in row) for mean in row] for row in means]
    np.testing.assert_allclose(ranking.mean_ranks, np.mean(ranks, axis=0))
    assert ranking.critical_difference == pytest.approx(2.569 * np.sqrt(4 * 5 / (6 * 14)), abs=1e-3)
    squares = sum((rank - 2.5) ** 2 for rank in np.mean(ranks, axis=0))
    friedman = 12 * 14 / (4 * 5) * squares
    assert ranking.p_value == pytest.approx(scipy.stats.chi2.sf(friedman, 3))


def test_holm_adjusts_as_the_steps_say():
    np.testing.assert_allclose(statistics.holm([0.01, 0.04, 0.03, 0.005]), [0.03, 0.06, 0.06, 0.02])
    np.testing.assert_allclose(statistics.holm([0.9, 0.8]), [1, 1])


def test_equal_pairs_do_not_differ():
    assert statistics.signed_rank_p(np.arange(5.0), np.arange(5.0)) == 1
    assert statistics.signed_rank_p(np.arange(9.0), np.arange(9.0) + 1) < 0.01


def test_a12_counts_pairs():
    first, second = np.array([0.0, 1.0, 2.0]), np.array([1.0, 3.0])
    pairs = [(x < y) + (x == y) / 2 for x, y in itertools.product(first, second)]
    assert statistics.a12(first, second) == pytest.approx(np.mean(pairs))


def test_expected_evaluations_count_failed_runs():
    hits = np.array([100.0, 300.0, np.inf])
    assert statistics.expected_evaluations(hits, 1000) == (100 + 300 + 1000) / 2
    assert statistics.expected_evaluations(np.array([np.inf]), 1000) == np.inf
    assert statistics.reached(hits, 300) == pytest.approx(2 / 3)


class Descent:
    """A function whose losses are the first coordinates."""

    f_opt = 5.0

    def __call__(self, rows):
        return [row[0] for row in rows]


def test_a_record_counts_one_by_one_and_forgets_what_is_beyond_the_budget():
    losses = 5 + 10 ** np.random.default_rng(1).uniform(-6, 3, (2, 9, 3))
    record = runs.Record(Descent(), 20, 2)
    for block in np.split(losses, 3, axis=1):
        record.evaluate(block)
    assert record.evaluations == 9
    for run, target in itertools.product(range(2), range(len(runs.TARGETS))):
        below = [
            n for n, loss in enumerate(losses[run, :, 0] - 5, 1) if loss <= runs.TARGETS[target]
        ]
        assert record.hits[run, target] == (below[0] if below else np.inf)
    for _ in range(2):
        record.evaluate(losses)
    record.evaluate(np.full((2, 9, 3), 5.0))
    assert record.evaluations == 20
    np.testing.assert_allclose(record.best, losses[:, :, 0].min(axis=1) - 5)


FILES = Path(runs.minionpy.__file__).parent / "cec_input_data" / "input_data_2022"


@pytest.mark.parametrize("number", range(1, 13))
def test_every_function_of_cec_2022_has_its_optimum_at_its_shift(number):
    function = runs.Suite(2022, 10, (), 0, 0).function(number, [0])
    shift = np.loadtxt(FILES / f"shift_data_{number}.txt").ravel()[:10]
    assert function([shift])[0] == pytest.approx(function.f_opt, abs=1e-9)
    nearby = shift + np.random.default_rng(0).normal(0, 1e-2, (50, 10))
    assert min(function(nearby)) > function.f_opt


@pytest.mark.parametrize("number", [1, 8, 24])
def test_every_run_of_bbob_has_an_instance_whose_optimum_is_zero(number):
    cocoex = pytest.importorskip("cocoex")
    function = runs.Suite(runs.BBOB, 5, (), 0, 0).function(number, [0, 3])
    assert [one.instance for one in function.instances] == [1, 4]
    rows = np.random.default_rng(number).uniform(-100, 100, (6, 5))
    losses = function(rows)
    for run, instance in enumerate((1, 4)):
        alone = cocoex.BareProblem("bbob", number, 5, instance)
        expected = [alone(row / 20) - alone.best_value() for row in rows[3 * run : 3 * run + 3]]
        np.testing.assert_allclose(losses[3 * run : 3 * run + 3], expected)
        at_best = np.tile(20 * np.array(alone.best_parameter()), (2, 1))
        assert function(at_best)[run] == pytest.approx(0, abs=1e-8)

"""Methods that search the time constants with the tables solved inside."""

import numpy as np
import pytest
from scipy.optimize import approx_fprime

from barnax.baselines import Budget
from barnax.over_soc import TableSettings
from barnax.over_soc.by_method import SEARCHES, capped, search_by
from barnax.over_soc.fit import reduced_objective
from barnax.over_soc.search import find_best

from .conftest import NODES, SMALL

BUDGET = capped(Budget(seeds=2, iterations=100))


@pytest.fixture(scope="module")
def objective(prepared):
    return reduced_objective([prepared], SMALL)


@pytest.mark.parametrize("method", ["ibmo-centered", "lm", "de"])
def test_every_kind_of_method_finds_the_optimum(objective, method):
    best = find_best(objective)
    for found, evaluations in search_by(objective, method, BUDGET):
        assert best.root * (1 - 1e-9) <= found.root <= best.root * 1.001
        assert list(found.place) == sorted(found.place)
        assert 0 < evaluations <= 1000


def test_slopes_are_those_of_the_least_objective(objective):
    place = np.log([8.0, 90.0])
    expected = approx_fprime(place, lambda at: objective.solve(tuple(at)).squared, 1e-5)
    assert objective.slope(objective.solve(tuple(place))) == pytest.approx(expected, rel=1e-3)


def test_the_budget_is_a_small_one_and_never_more_than_was_given():
    assert (BUDGET.population, BUDGET.iterations, BUDGET.seeds) == (10, 30, 2)
    small = capped(Budget(population=4, iterations=3, seeds=1))
    assert (small.population, small.iterations, small.seeds) == (4, 3, 1)


@pytest.mark.parametrize("method", ["lm", "de"])
def test_held_time_constants_stay(prepared, method):
    held = {"tau1 [s]": 10.0, "tau2 [s]": 60.0}
    objective = reduced_objective([prepared], TableSettings(nodes=NODES, fixed=held, folds=0))
    found, _ = search_by(objective, method, capped(Budget(seeds=1, iterations=3)))[0]
    assert np.exp(found.place) == pytest.approx([10.0, 60.0])


def test_all_searches_are_methods_of_a_comparison():
    from barnax.baselines import METHODS

    assert set(SEARCHES) < set(METHODS)

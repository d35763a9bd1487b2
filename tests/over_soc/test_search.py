"""Least squares in a box against SciPy, and every method that searches the time constants."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from barnax.baselines import Budget
from barnax.over_soc import TableSettings
from barnax.over_soc.by_method import SEARCHES, capped, search_by
from barnax.over_soc.fit import reduced_objective
from barnax.over_soc.search import find_best, least_in_box, least_squares_in_box

from .conftest import NODES, SMALL


def made(seed, rows=60, unknowns=24):
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(rows, unknowns)) * np.geomspace(1, 1e-3, unknowns)
    # Neighbors that hardly differ, as those of two time constants.
    matrix[:, 1::2] = matrix[:, ::2] + 1e-3 * matrix[:, 1::2]
    low = np.where(rng.random(unknowns) < 0.3, -np.inf, 0.0)
    high = np.where(rng.random(unknowns) < 0.3, 0.5, np.inf)
    return matrix, rng.normal(size=rows), low, high


@pytest.mark.parametrize("seed", range(8))
def test_scipy_finds_the_same_minimum(seed):
    matrix, base, low, high = made(seed)
    x, sides = least_squares_in_box(matrix, base, low, high)
    other = lsq_linear(matrix, -base, (low, high), method="bvls", tol=1e-14)
    assert np.sum((base + matrix @ x) ** 2) == pytest.approx(2 * other.cost, rel=1e-10)
    assert np.all((x >= low) & (x <= high))
    assert np.all(x[sides < 0] == low[sides < 0])


def test_any_guess_of_the_sides_ends_at_the_same_answer():
    matrix, base, low, high = made(1)
    normal, gradient = matrix.T @ matrix, matrix.T @ base
    expected, sides = least_in_box(normal, gradient, low, high)
    for guess in (sides, -np.ones_like(sides) * np.isfinite(low)):
        found, _ = least_in_box(normal, gradient, low, high, guess.astype(int))
        assert found == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_held_unknowns_keep_their_values():
    matrix, base, low, high = made(2)
    low[3] = high[3] = 0.25
    assert least_squares_in_box(matrix, base, low, high)[0][3] == 0.25


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

"""The proof: no tables in a cell are below its bound."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from barnax.over_soc.certificate import _Relaxation, _remainders, certify
from barnax.over_soc.search import find_best

from .conftest import SMALL
from .test_reduced import objective_of

CASES = ["prepared", "with_hysteresis"]


@pytest.fixture(scope="module", params=CASES)
def objective(request):
    prepared = request.getfixturevalue(request.param)
    gamma_range = (10.0, 30.0) if request.param == "with_hysteresis" else None
    return objective_of(prepared, gamma_range=gamma_range)


def test_no_tables_of_a_cell_are_below_its_bound(objective):
    relaxation = _Relaxation(objective, _remainders(objective))
    best = find_best(objective)
    rng = np.random.default_rng(0)
    bounded = 0
    for _ in range(12):
        width = rng.uniform(0.02, 0.3)
        cell = []
        for axis in objective.axes:
            low = rng.uniform(axis.low, axis.high - width)
            cell.append((low, low + width))
        # With the limits of some bound on J, what is below that bound is above the cell's.
        limit = 4 * best.squared
        bound, _ = relaxation.bound(tuple(cell), limit, np.inf)
        assert bound == 0.0
        bound, middle = relaxation.bound(tuple(cell), limit, 0.98 * best.squared)
        bounded += bound > 0
        corners = list(itertools.product(*cell))
        inside = [tuple(rng.uniform(*ends) for ends in cell) for _ in range(6)]
        lowest = min(objective.solve(place).squared for place in (*corners, *inside))
        assert bound <= lowest * (1 + 1e-9)
        assert middle.squared >= best.squared * (1 - 1e-9)
    assert bounded


def test_a_proof_comes_close_to_the_best(objective):
    best = find_best(objective)
    objective = replace(objective, settings=replace(SMALL, proved_share=0.01, most_cells=4000))
    proof = certify(objective, best)
    assert 0.99 * best.root <= proof.lower_bound_v <= best.root
    assert proof.best.squared == best.squared


def test_a_proof_finds_what_the_search_missed(objective):
    objective = replace(objective, settings=replace(SMALL, proved_share=0.01, most_cells=4000))
    poor = objective.solve(tuple(axis.high for axis in objective.axes))
    proof = certify(objective, poor)
    assert 0.99 * proof.best.root <= find_best(objective).root <= proof.best.root * (1 + 1e-9)

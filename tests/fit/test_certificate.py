"""The proof: no tables in a box are below its bound."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from barnax.fit.certificate import _Relaxation, certify
from barnax.fit.table_problem import find_best

from .conftest import SMALL
from .test_reduced import objective_of

CASES = ["prepared", "with_hysteresis"]


@pytest.fixture(scope="module", params=CASES)
def objective(request):
    prepared = request.getfixturevalue(request.param)
    gamma_range = (10.0, 30.0) if request.param == "with_hysteresis" else None
    return objective_of(prepared, gamma_range=gamma_range)


def test_no_tables_of_a_box_are_below_its_bound(objective):
    relaxation = _Relaxation(objective)
    best = find_best(objective)
    rng = np.random.default_rng(0)
    bounded = 0
    for _ in range(12):
        width = rng.uniform(0.02, 0.3)
        box = []
        for axis in objective.axes:
            low = rng.uniform(axis.low, axis.high - width)
            box.append((low, low + width))
        # With the limits of some bound on J, what is below that bound is above the box's.
        limit = 4 * best.objective_v2
        middle = objective.solve(tuple(np.mean(box, axis=1).tolist()))
        assert relaxation.bound(box, middle, limit, np.inf) == 0.0
        bound = relaxation.bound(box, middle, limit, 0.98 * best.objective_v2)
        bounded += bound > 0
        corners = list(itertools.product(*box))
        inside = [tuple(rng.uniform(*ends) for ends in box) for _ in range(6)]
        lowest = min(objective.solve(place).objective_v2 for place in (*corners, *inside))
        assert bound <= lowest * (1 + 1e-9)
        assert middle.objective_v2 >= best.objective_v2 * (1 - 1e-9)
    assert bounded


def test_a_proof_comes_close_to_the_best(objective):
    best = find_best(objective)
    objective = replace(objective, settings=replace(SMALL, proved_share=0.01, max_boxes=4000))
    proof = certify(objective, best)
    assert 0.99 * best.rms_v <= proof.lower_bound_v <= best.rms_v
    assert proof.best.objective_v2 == best.objective_v2


def test_a_proof_finds_what_the_search_missed(objective):
    objective = replace(objective, settings=replace(SMALL, proved_share=0.01, max_boxes=4000))
    poor = objective.solve(tuple(axis.high for axis in objective.axes))
    proof = certify(objective, poor)
    assert 0.99 * proof.best.rms_v <= find_best(objective).rms_v <= proof.best.rms_v * (1 + 1e-9)

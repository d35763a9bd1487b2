"""What is tried first lowers the error most, on records whose fault is known."""

from dataclasses import replace

import numpy as np
import pytest

from barnax.cell import CircuitParameters
from barnax.model.problem import make_problem
from barnax.uncertainty.suggestions import in_words, suggestions

from .made import TRUTH, cross_check, made_problem

NOISE_V = 0.5e-3


def white(seed=3):
    return np.random.default_rng(seed).normal(0, NOISE_V, 1501)


@pytest.fixture(scope="module")
def shifted(short_problem):
    """Suggestions for a known circuit whose initial SOC is given 3 % too low."""
    problem = made_problem(short_problem, white())
    start = problem.prepared.initial_soc
    window = replace(problem.window, initial_soc=start - 0.03)
    wrong = make_problem(problem.prepared.record, problem.cell, "so-rc", window=window)
    checked = cross_check(wrong)
    return start, checked, suggestions(checked)


def test_a_wrong_initial_soc_is_found(shifted):
    start, _, found = shifted
    by_name = {each.name: each for each in found}
    best = by_name["initial SOC"]
    assert best.rmse_v == pytest.approx(NOISE_V, rel=0.1)
    assert float(best.text.split()[2]) == pytest.approx(start, abs=0.002)


def test_suggestions_are_ranked_and_none_makes_it_worse(shifted):
    _, checked, found = shifted
    errors_v = [each.rmse_v for each in found]
    assert errors_v == sorted(errors_v)
    assert errors_v[-1] <= checked.rmse_v * (1 + 1e-6)
    assert {each.name for each in found} >= {
        "initial SOC",
        "one more pair",
        "dynamic hysteresis",
        "resistance over SOC",
        "OCV over SOC",
    }
    words = in_words(found, checked.rmse_v)
    assert words.startswith(f"RMSE {1e3 * checked.rmse_v:.4g} mV would fall to ")
    assert found[0].to_dict()["rmse [V]"] == errors_v[0]


def test_a_third_pair_is_found_where_there_is_one(short_problem):
    truth = CircuitParameters(0.05, (0.02, 0.03, 0.04), (4 / 0.02, 40 / 0.03, 400 / 0.04))
    checked = cross_check(made_problem(short_problem, white(), truth), TRUTH)
    (pair,) = [each for each in suggestions(checked) if each.name == "one more pair"]
    assert checked.rmse_v > 1.5 * NOISE_V
    assert pair.rmse_v == pytest.approx(NOISE_V, rel=0.1)
    assert pair.text.startswith("third RC pair")

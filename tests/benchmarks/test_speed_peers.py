"""The peers of the speed page find what they are said to find."""

import jax
import numpy as np
import pytest
from benchmarks.speed.filtered import Filtered
from benchmarks.speed.work import rmse_of

import barnax
from helpers.reference import drop_v, looped_response


@pytest.fixture(scope="module")
def filtered(short_problem):
    with jax.enable_x64(True):
        return Filtered(short_problem)


def test_their_errors_are_those_of_a_plain_loop(filtered, short_problem):
    prepared, circuit = short_problem.prepared, (0.05, (0.01, 0.02), (5.0, 80.0))
    drop = drop_v(looped_response, prepared.time_s, prepared.current_a, circuit)
    error_v = prepared.voltage_v - (prepared.source_v - drop)
    np.testing.assert_allclose(
        filtered.errors(np.log([0.05, 0.01, 5.0, 0.02, 80.0])), error_v, atol=1e-12
    )


def test_variable_projection_finds_the_proved_optimum(filtered, short_problem):
    optimum = barnax.find_global_optimum(short_problem)
    assert rmse_of(filtered.project()) == pytest.approx(optimum.rmse_v, rel=1e-3)


def test_a_descent_from_many_starts_is_never_below_the_proved_optimum(filtered, short_problem):
    optimum = barnax.find_global_optimum(short_problem)
    points = np.random.default_rng(0).uniform(size=(2, len(filtered.lower)))
    found = filtered.descend(filtered.lower + points * (filtered.upper - filtered.lower))
    assert min(map(rmse_of, found)) >= optimum.rmse_v * (1 - 1e-9)


def test_an_adapted_search_stays_in_the_box(filtered):
    pytest.importorskip("cmaes")
    found = filtered.adapt()
    assert np.all((filtered.lower <= found.x) & (found.x <= filtered.upper))
    assert found.fun == pytest.approx(filtered.rmse(found.x), rel=1e-12)

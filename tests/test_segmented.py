"""Stretches side by side compute what one scan after another computes."""

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.random as jr
import numpy as np
import pytest

from barnax.identification import identify
from barnax.optimizers import make_optimizer
from barnax.precision import in_float64
from barnax.problem import make_problem, residuals, rmse
from barnax.segmented import Segmented
from barnax.simulate import Drive
from barnax.window import Window
from reference import make_record

SAMPLES = 311
CURRENT_A = np.repeat(np.random.default_rng(5).choice([0.0, 2.0, -1.0, 3.0], 32), 10)[:SAMPLES]


@pytest.fixture(scope="module", params=["even", "uneven"])
def clock(request):
    if request.param == "even":
        return np.arange(SAMPLES) * 1.0
    rng = np.random.default_rng(6)
    steps = rng.choice([0.5, 1.0, 30.0], SAMPLES) + rng.normal(0, 1e-5, SAMPLES)
    return np.cumsum(steps)


@pytest.fixture(scope="module", params=["so-rc", "esc"])
def problem(request, clock, bundled_cell):
    record = make_record(clock, CURRENT_A, 3.7 - 0.05 * CURRENT_A + 1e-3 * np.sin(clock))
    window = Window(initial_soc=0.8, initial_direction=-1, score_from_s=float(clock[20]) - 0.1)
    return make_problem(record, bundled_cell, request.param, window=window)


@eqx.filter_jit
def computed(evaluator, coordinates, points):
    """Squared error and errors at every point."""

    def one(point):
        circuit = coordinates.decode(point)
        return evaluator.squared_error(circuit), evaluator.errors(circuit)

    return jax.vmap(one)(points)


# Of 45 samples, of 13, and of one: whole blocks of the loop, some left over, and none.
@pytest.mark.parametrize("stretches", [7, 25, SAMPLES])
@in_float64
def test_any_number_of_stretches_gives_the_errors_of_one_scan(problem, stretches):
    box, (drive,) = problem.coordinates, problem.drives
    fraction = np.random.default_rng(7).uniform(size=(50, len(box.lower)))
    points = box.lower + fraction * (box.upper - box.lower)
    total, errors_v = computed(Segmented.of(drive, stretches), box, points)
    expected_total, expected_v = computed(drive, box, points)
    np.testing.assert_allclose(total, expected_total, rtol=1e-10)
    np.testing.assert_allclose(errors_v, expected_v, rtol=1e-10, atol=1e-13)


@in_float64
def test_slopes_are_those_of_one_scan(problem):
    box, objective = problem.coordinates, problem.objective
    folded = eqx.tree_at(lambda given: given.evaluator, objective, Segmented.of(*problem.drives))
    point = 0.7 * box.lower + 0.3 * box.upper
    slope = eqx.filter_jit(jax.jacfwd(residuals))
    slopes = [slope(point, each) for each in (folded, objective)]
    scale = np.abs(slopes[1]).max(axis=0)
    np.testing.assert_allclose(slopes[0] / scale, slopes[1] / scale, atol=1e-10)


@in_float64
def test_the_steps_in_a_row_are_the_fewest(problem):
    (drive,) = problem.drives

    def steps(stretches):
        folded = jax.eval_shape(lambda: Segmented.of(drive, stretches)).drive.current_a
        return folded.shape[0] + 2 * folded.shape[1]

    # Two runs over a stretch and one over all their ends.
    assert steps(None) <= 1.05 * min(steps(stretches) for stretches in (4, 10, 20, 25, 30, 50, 150))


def test_where_there_is_no_cpu_a_search_runs_in_stretches(bundled_cell, monkeypatch):
    time_s = np.arange(SAMPLES) * 1.0
    record = make_record(time_s, CURRENT_A, 3.7 - 0.05 * CURRENT_A + 1e-3 * np.sin(time_s))
    window = Window(initial_soc=0.8, initial_direction=-1)
    problem = make_problem(record, bundled_cell, window=window)
    optimizer = make_optimizer("pso", 8, 10)
    expected = identify(problem, optimizer, key=jr.key(0), seeds=1)
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    elsewhere = make_problem(record, bundled_cell, window=window)
    assert isinstance(elsewhere.scan, Segmented)
    assert isinstance(problem.scan, Drive)
    with jax.enable_x64(True):
        middle = 0.5 * (problem.coordinates.lower + problem.coordinates.upper)
        error = eqx.filter_jit(rmse)
        np.testing.assert_allclose(
            error(middle, elsewhere.objective), error(middle, problem.objective), rtol=1e-10
        )
    found = identify(elsewhere, optimizer, key=jr.key(0), seeds=1)
    # A search is chaotic, so only its first generation can be the same to rounding.
    first, expected_first = found.seeds[0].history_v[0], expected.seeds[0].history_v[0]
    np.testing.assert_allclose(first, expected_first, rtol=1e-10)
    assert jnp.isfinite(found.best.rmse_v)

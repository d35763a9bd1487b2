"""Least squares and its recursive form on records whose circuit is known."""

from dataclasses import replace

import numpy as np
import pytest

from barnax import Window, evaluate, make_problem
from barnax.baselines import METHODS, Budget, MethodFailure
from barnax.baselines.online import middle_of
from barnax.baselines.regression import circuit_values, even_samples, regression, state_matrix
from barnax.model.prepared import prepare_record
from helpers.reference import banded_response, drop_v, make_record

TWO_PAIRS = (0.05, (0.02, 0.03), (8.0, 90.0))
CIRCUITS = {
    "1rc": (0.05, (0.03,), (20.0,)),
    "so-rc": TWO_PAIRS,
    "3rc": (0.05, (0.01, 0.02, 0.03), (2.0, 20.0, 200.0)),
}


def answer_of(method, problem):
    (answer,) = METHODS[method].run(problem, Budget(), lambda gained: None)
    return answer


def values_of(answer):
    actual = answer.parameters
    return np.array([actual.r0, *actual.r, *actual.tau_s])


def values(circuit):
    r0, r, tau_s = circuit
    return np.array([r0, *r, *tau_s])


@pytest.mark.parametrize("hold", ["forward", "backward"])
@pytest.mark.parametrize("model", CIRCUITS)
@pytest.mark.parametrize(("method", "rel"), [("ls", 1e-6), ("n4sid", 1e-5)])
def test_least_squares_and_subspaces_find_a_circuit_without_noise_exactly(
    method, rel, model, hold, filtered_problem
):
    answer = answer_of(method, filtered_problem(CIRCUITS[model], model, hold=hold))
    assert values_of(answer) == pytest.approx(values(CIRCUITS[model]), rel=rel)
    assert answer.rmse_v < 1e-8


# Its first guess of zero is forgotten with e^-4 of its weight left after 4,000 samples.
@pytest.mark.parametrize("hold", ["forward", "backward"])
def test_recursive_least_squares_ends_at_a_circuit_without_noise(hold, filtered_problem):
    answer = answer_of("rls", filtered_problem(TWO_PAIRS, hold=hold))
    assert values_of(answer) == pytest.approx(values(TWO_PAIRS), rel=1e-3)


def test_weighted_least_squares_is_a_loop_with_a_factor_a_coefficient(filtered_problem):
    problem = filtered_problem(TWO_PAIRS, noise_v=1e-5)
    samples, columns, target = regression(problem)
    factors = np.array([0.9999, 0.9999, 0.999, 0.999, 0.999])
    scale = np.sqrt(np.mean(columns**2, axis=0))
    theta, variance, thetas = np.zeros(5), 1e6 * np.eye(5), []
    for row, value in zip(columns / scale, target, strict=True):
        variance = variance / np.sqrt(np.outer(factors, factors))
        gain = variance @ row / (1 + row @ variance @ row)
        theta = theta + gain * (value - row @ theta)
        variance = (np.eye(5) - np.outer(gain, row)) @ variance
        thetas.append(theta)
    r0, r, tau_s = circuit_values(np.array(thetas) / scale, samples, 2)
    rows = np.column_stack([r0, r, tau_s])
    # From where it has forgotten its first guess, and all are circuits.
    assert np.all(rows[1000:] > 0)
    expected = np.median(rows[1000:], axis=0)
    assert values_of(answer_of("wrls", problem)) == pytest.approx(expected, rel=1e-5)


# The filter starts in the middle of the box and has to let go of it.
def test_least_squares_beside_a_filter_ends_at_a_circuit_without_noise(filtered_problem):
    answer = answer_of("rls-ekf", filtered_problem(TWO_PAIRS))
    assert values_of(answer) == pytest.approx(values(TWO_PAIRS), rel=0.02)


# It looks one interval ahead, where R0 and the start of a fast pair look alike.
def test_a_dual_filter_comes_from_the_middle_of_the_box_to_the_resistance_of_now(filtered_problem):
    problem = filtered_problem(TWO_PAIRS)
    answer = answer_of("dual-ukf", problem)
    assert 0.05 < answer.parameters.r0 < 0.05 + 0.02
    middle, _ = middle_of(problem)
    assert answer.rmse_v < 0.5 * evaluate(problem.prepared, middle).metrics.rmse_v


@pytest.mark.slow
def test_a_dual_filter_keeps_the_rate_of_a_dynamic_hysteresis_in_the_middle_of_its_box(
    filtered_problem,
):
    problem = filtered_problem(TWO_PAIRS, "esc")
    answer = answer_of("dual-ukf", problem)
    low, high = problem.bounds.ranges["gamma"]
    assert answer.parameters.gamma == pytest.approx(np.sqrt(low * high))
    assert np.isfinite(answer.rmse_v)


@pytest.mark.parametrize(
    ("current_a", "says"),
    [(np.ones(600), "current never changes"), (np.arange(170) % 7, "there are 111")],
)
def test_subspaces_refuse_a_record_without_turns_and_a_short_one(bundled_cell, current_a, says):
    count = len(current_a)
    voltage_v = 3.7 + 0.01 * np.random.default_rng(0).normal(size=count)
    record = make_record(np.arange(count), current_a, voltage_v)
    problem = make_problem(record, bundled_cell, "so-rc", window=Window(initial_soc=0.9))
    with pytest.raises(MethodFailure, match=says):
        answer_of("n4sid", problem)


def test_subspaces_need_no_first_state():
    """A loop from a state that is not zero; poles as they are."""
    matrix, drive = np.diag([0.9, 0.5]), np.random.default_rng(0).normal(size=500)
    state, output = np.array([3.0, -2.0]), []
    for each in drive:
        output.append(state.sum() + 0.3 * each)
        state = matrix @ state + np.array([0.2, 0.1]) * each
    is_row = np.arange(500) >= 19
    actual = np.linalg.eigvals(state_matrix(drive, np.array(output), is_row, 10, 2))
    np.testing.assert_allclose(np.sort(actual), [0.5, 0.9], rtol=1e-9)


def test_least_squares_equals_the_regression_in_lagged_samples(filtered_problem):
    problem = filtered_problem(CIRCUITS["1rc"], "1rc", noise_v=2e-4)
    prepared = problem.prepared
    drop, current = prepared.source_v - prepared.voltage_v, prepared.current_a
    columns = np.stack([drop[:-1], current[1:], current[:-1]], axis=1)
    pole, b0, b1 = np.linalg.lstsq(columns, drop[1:])[0]
    expected = [b0, (b1 + b0 * pole) / (1 - pole), -1 / np.log(pole)]
    assert values_of(answer_of("ls", problem)) == pytest.approx(expected, rel=1e-6)


def test_samples_beside_a_gap_are_left_out_and_the_rest_is_exact(filtered_problem, bundled_cell):
    made = filtered_problem(TWO_PAIRS).prepared
    time_s = made.time_s + 60.0 * (np.arange(len(made.time_s)) > 1000)
    drop = drop_v(banded_response, time_s, made.current_a, TWO_PAIRS)
    window = Window(initial_soc=1.0)
    flat = make_record(time_s, made.current_a)
    source_v = prepare_record(flat, bundled_cell, "so-rc", window).source_v
    record = make_record(time_s, made.current_a, source_v - drop)
    answer = answer_of("ls", make_problem(record, bundled_cell, "so-rc", window=window))
    assert values_of(answer) == pytest.approx(values(TWO_PAIRS), rel=1e-6)
    assert answer.notes == ("fitted to the 3996 of 4000 scored samples that are evenly spaced",)


def test_rows_need_every_interval_even_and_every_sample_scored(filtered_problem):
    prepared = filtered_problem(TWO_PAIRS).prepared
    scored = prepared.scored.copy()
    scored[2000:2010] = False
    time_s = prepared.time_s + 0.2 * (np.arange(len(scored)) > 1000)
    uneven = replace(prepared, scored=scored, record=replace(prepared.record, time_s=time_s))
    left_out = {0, 1, 1001, 1002, *range(2000, 2012)}
    assert set(np.flatnonzero(~even_samples(uneven, 2).is_row)) == left_out


# White noise alone has no pole between zero and one, and none that is a circuit's.
@pytest.mark.parametrize("method", ["ls", "rls"])
def test_a_linear_method_refuses_what_it_cannot_hold(method, filtered_problem):
    held = filtered_problem(TWO_PAIRS, fixed={"R0 [Ohm]": 0.08})
    with pytest.raises(MethodFailure, match=r"cannot hold R0 \[Ohm\] = 0.08"):
        answer_of(method, held)

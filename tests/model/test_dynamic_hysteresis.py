"""The one-state hysteresis of `esc` against Plett's recursion, written as a plain loop."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from barnax import CircuitParameters, Window
from barnax.execution import in_float64
from barnax.model.prepared import prepare_record
from barnax.model.problem import make_problem, residuals
from helpers.reference import drop_v, looped_response, make_record
from helpers.scan import rc_parameters, terminal_voltage

CIRCUIT = CircuitParameters.constant(0.05, (0.01, 0.02), (500.0, 4000.0), gamma=300.0)
# Beside rests without any current, one with a tester's offset and noise.
CURRENT_A = np.tile(np.repeat([0.0, 2.0, 0.0, -1.0, 3.0], 40), 4)
CURRENT_A[200:240] = np.random.default_rng(8).normal(1e-3, 2e-3, 40)
simulate = in_float64(eqx.filter_jit(terminal_voltage))


def simulated(prepared, circuit):
    inputs = prepared.simulation_input(0.5, 1e4)
    return simulate(rc_parameters(circuit), inputs, prepared.source_v)


def plett_state(prepared, capacity_ah, gamma) -> np.ndarray:
    """h at every sample, by Plett (2004): charge moves it toward the sign of the current.

    Below the rest current nothing moves it, as the direction of the switched hysteresis.
    """
    state = prepared.start.direction
    states = [state]
    for sample in range(len(prepared.soc) - 1):
        flowing_a = prepared.held_a[sample]
        passed = 0.0
        if abs(flowing_a) >= prepared.rest_current_a:
            passed = abs(flowing_a) * (prepared.time_s[sample + 1] - prepared.time_s[sample])
        decay = np.exp(-gamma * passed / 3600 / capacity_ah)
        state = decay * state - (1 - decay) * np.sign(flowing_a)
        states.append(state)
    return np.array(states)


TIME_S = np.cumsum(np.random.default_rng(3).uniform(0.5, 1.5, len(CURRENT_A)))


def prepared_of(cell, current_a, hold, direction, circuit="esc"):
    record = make_record(TIME_S, current_a, 3.7 + 0.01 * np.sin(TIME_S), hold=hold)
    window = Window(initial_soc=0.8, initial_direction=direction)
    return prepare_record(record, cell, circuit, window)


# From rest by either hold, and under a discharge after either direction.
@pytest.fixture(
    scope="module",
    params=[(0, "forward", -1), (0, "backward", -1), (40, "forward", 1), (40, "forward", -1)],
)
def prepared(request, bundled_cell):
    first, hold, direction = request.param
    prepared = prepared_of(bundled_cell, np.roll(CURRENT_A, -first), hold, direction)
    assert prepared.start.direction == direction
    return prepared


def expected_v(prepared, cell, circuit):
    state = plett_state(prepared, cell.capacity_ah, circuit.gamma)
    values = (circuit.r0, circuit.r, circuit.tau_s)
    hold = prepared.record.hold.value
    return (
        cell.average_ocv_v(prepared.soc)
        + state * cell.hysteresis_v(prepared.soc) / 2
        - drop_v(looped_response, prepared.time_s, prepared.current_a, values, hold)
    )


@pytest.mark.parametrize("gamma", [1.0, 300.0, 1e4])
def test_the_voltage_agrees_with_a_plain_loop(bundled_cell, prepared, gamma):
    circuit = CircuitParameters.constant(CIRCUIT.r0, CIRCUIT.r, CIRCUIT.c, gamma)
    with jax.enable_x64(True):
        simulated_v = simulated(prepared, circuit)
    expected = expected_v(prepared, bundled_cell, circuit)
    np.testing.assert_allclose(simulated_v, expected, rtol=1e-12)


def test_ten_hours_of_noise_at_rest_turn_nothing(bundled_cell):
    current_a = np.random.default_rng(2).normal(0, 2e-3, 36_000)
    current_a[:60] = 2.0
    record = make_record(np.arange(36_000.0), current_a)
    window = Window(initial_soc=0.8, initial_direction=-1)
    prepared = prepare_record(record, bundled_cell, "esc", window)
    assert np.abs(current_a[60:]).max() < prepared.rest_current_a
    circuit = CircuitParameters.constant(1e-9, (1e-9, 1e-9), (1e9, 1e9), gamma=54.0)
    with jax.enable_x64(True):
        moved_v = np.asarray(simulated(prepared, circuit))
    state = (moved_v - bundled_cell.average_ocv_v(prepared.soc)) / (
        bundled_cell.hysteresis_v(prepared.soc) / 2
    )
    np.testing.assert_allclose(state, -1.0, atol=1e-4)


def test_the_slope_in_the_rate_is_that_of_the_errors(bundled_cell):
    record = make_record(TIME_S, CURRENT_A, 3.7 + 0.01 * np.sin(TIME_S))
    problem = make_problem(record, bundled_cell, "esc", window=Window(initial_soc=0.8))
    with jax.enable_x64(True):
        objective = replace(problem, scale="log").objective
        point, step = jnp.asarray(objective.coordinates.encode(rc_parameters(CIRCUIT))), 1e-5
        errors = eqx.filter_jit(residuals)
        slope = eqx.filter_jit(jax.jacfwd(residuals))(point, objective)[:, -1]
        raised, lowered = (
            np.asarray(errors(point.at[-1].add(by), objective)) for by in (step, -step)
        )
    np.testing.assert_allclose(slope, (raised - lowered) / (2 * step), rtol=1e-5, atol=1e-12)

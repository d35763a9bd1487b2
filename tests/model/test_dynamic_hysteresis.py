"""The one-state hysteresis of `esc` against Plett's recursion, written as a plain loop."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from barnax.cell import CircuitParameters, get_circuit
from barnax.execution import in_float64
from barnax.model.inputs import Window, prepare_record
from barnax.model.problem import make_problem, rc_parameters, residuals, rmse
from barnax.model.simulate import squared_error, terminal_voltage
from reference import drop_v, looped_response, make_record

CIRCUIT = CircuitParameters(0.05, (0.01, 0.02), (500.0, 4000.0), gamma=300.0)
# Beside rests without any current, one with a tester's offset and noise.
CURRENT_A = np.tile(np.repeat([0.0, 2.0, 0.0, -1.0, 3.0], 40), 4)
CURRENT_A[200:240] = np.random.default_rng(8).normal(1e-3, 2e-3, 40)
simulate = in_float64(eqx.filter_jit(terminal_voltage))


def plett_state(prepared, capacity_ah, gamma) -> np.ndarray:
    """h at every sample, by Plett (2004): charge moves it toward the sign of the current.

    Below the rest current nothing moves it, as the direction of the switched hysteresis.
    """
    state = prepared.direction[0]
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


@pytest.fixture(scope="module", params=["forward", "backward"])
def prepared(request, bundled_cell):
    time_s = np.cumsum(np.random.default_rng(3).uniform(0.5, 1.5, len(CURRENT_A)))
    record = make_record(time_s, CURRENT_A, 3.7 + 0.01 * np.sin(time_s), hold=request.param)
    return prepare_record(
        record, bundled_cell, "esc", Window(initial_soc=0.8, initial_direction=-1)
    )


@pytest.mark.parametrize("gamma", [1.0, 300.0, 1e4])
def test_the_voltage_agrees_with_a_plain_loop(bundled_cell, prepared, gamma):
    circuit = CircuitParameters(CIRCUIT.r0, CIRCUIT.r, CIRCUIT.c, gamma)
    with jax.enable_x64(True):
        simulated_v = simulate(rc_parameters(circuit), prepared.simulation_input(0.5, 1e4))
    state = plett_state(prepared, bundled_cell.capacity_ah, gamma)
    values = (circuit.r0, circuit.r, circuit.tau_s)
    hold = prepared.record.hold.value
    expected_v = (
        bundled_cell.average_ocv_v(prepared.soc)
        + state * bundled_cell.hysteresis_v(prepared.soc) / 2
        - drop_v(looped_response, prepared.time_s, prepared.current_a, values, hold)
    )
    np.testing.assert_allclose(simulated_v, expected_v, rtol=1e-12)


@pytest.mark.parametrize("hold", ["forward", "backward"])
def test_ten_hours_of_noise_at_rest_turn_nothing(bundled_cell, hold):
    current_a = np.random.default_rng(2).normal(0, 2e-3, 36_000)
    current_a[:60] = 2.0
    record = make_record(np.arange(36_000.0), current_a, hold=hold)
    window = Window(initial_soc=0.8, initial_direction=-1)
    prepared = prepare_record(record, bundled_cell, "esc", window)
    assert np.abs(current_a[60:]).max() < prepared.rest_current_a
    circuit = CircuitParameters(1e-9, (1e-9, 1e-9), (1e9, 1e9), gamma=54.0)
    with jax.enable_x64(True):
        moved_v = np.asarray(simulate(rc_parameters(circuit), prepared.simulation_input(0.5, 1e4)))
    state = (moved_v - bundled_cell.average_ocv_v(prepared.soc)) / (
        bundled_cell.hysteresis_v(prepared.soc) / 2
    )
    np.testing.assert_allclose(state, -1.0, atol=1e-4)


def test_the_summed_error_is_that_of_the_voltages(prepared):
    with jax.enable_x64(True):
        inputs, rc = prepared.simulation_input(0.5, 1e4), rc_parameters(CIRCUIT)
        error_v = prepared.voltage_v - np.asarray(simulate(rc, inputs))
        total = eqx.filter_jit(squared_error)(rc, inputs)
    assert float(total) == pytest.approx(float(error_v @ error_v), rel=1e-12)


@settings(max_examples=20, deadline=None)
@given(gamma=st.floats(1.0, 1e4))
def test_the_state_stays_between_its_ends(bundled_cell, prepared, gamma):
    circuit = CircuitParameters(1e-9, (1e-9, 1e-9), (1e9, 1e9), gamma)
    with jax.enable_x64(True):
        moved_v = simulate(rc_parameters(circuit), prepared.simulation_input(0.5, 1e4))
    half_v = bundled_cell.hysteresis_v(prepared.soc) / 2
    away_v = np.asarray(moved_v) - bundled_cell.average_ocv_v(prepared.soc)
    assert np.all(np.abs(away_v) <= np.abs(half_v) + 1e-7)


def test_a_very_fast_hysteresis_is_the_switched_one(bundled_cell):
    record = make_record(np.arange(len(CURRENT_A)), CURRENT_A)
    window = Window(initial_soc=0.8)
    moving = prepare_record(record, bundled_cell, "esc", window)
    switched = prepare_record(record, bundled_cell, "iso-rc", window)
    fast = CircuitParameters(CIRCUIT.r0, CIRCUIT.r, CIRCUIT.c, gamma=1e9)
    plain = CircuitParameters(CIRCUIT.r0, CIRCUIT.r, CIRCUIT.c)
    with jax.enable_x64(True):
        moved_v = simulate(rc_parameters(fast), moving.simulation_input(0.5, 1e9))
        switched_v = simulate(rc_parameters(plain), switched.simulation_input(0.5))
    # The state turns while the current flows, so it follows the switch by one sample.
    settled = np.diff(moving.direction, prepend=moving.direction[0]) == 0
    np.testing.assert_allclose(moved_v[settled], switched_v[settled], rtol=1e-9)
    assert 0 < np.count_nonzero(~settled) < 20


def test_the_residuals_and_their_slope_agree_with_the_summed_error(bundled_record, bundled_cell):
    problem = make_problem(bundled_record, bundled_cell, "esc", window=Window(score_to_s=600.0))
    with jax.enable_x64(True):
        objective = problem.objective_in("log")
        point = objective.coordinates.encode(rc_parameters(CIRCUIT))
        errors = eqx.filter_jit(residuals)(point, objective)
        assert float(jnp.linalg.norm(errors)) == pytest.approx(float(rmse(point, objective)))
        slope = eqx.filter_jit(jax.jacfwd(residuals))(point, objective)[:, -1]
        step = 1e-5
        raised, lowered = (
            np.asarray(eqx.filter_jit(residuals)(point.at[-1].add(change), objective))
            for change in (step, -step)
        )
    np.testing.assert_allclose(slope, (raised - lowered) / (2 * step), rtol=1e-5, atol=1e-12)


def test_only_a_circuit_with_dynamic_hysteresis_has_a_rate():
    assert get_circuit("esc").parameter_names[-1] == "gamma"
    assert "gamma" not in get_circuit("iso-rc").parameter_names

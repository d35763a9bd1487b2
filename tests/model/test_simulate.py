"""The simulation against a digital filter, a plain loop and closed forms, in float64."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from barnax.model.sampling_intervals import Intervals
from barnax.model.simulate import (
    LANES,
    HysteresisInput,
    RCParameters,
    SimulationInput,
    overpotential,
    unit_response,
)
from helpers.reference import drop_v, looped_response
from helpers.scan import terminal_voltage

CIRCUIT = (0.05, (0.01, 0.02), (3.0, 80.0))
SHORTEST_TAU_S = 0.5
# No multiple of the samples that one turn of the loop takes.
SAMPLES = 403
RNG = np.random.default_rng(1)
CURRENT_A = np.repeat(RNG.choice([0.0, 4.0, 1.0, -2.0], SAMPLES // 8 + 1), 8)[:SAMPLES]
SOURCE_V = 3.7 + 0.1 * np.sin(np.arange(SAMPLES) / 40)
MEASURED_V = SOURCE_V - 0.05 * CURRENT_A + RNG.normal(0, 1e-3, SAMPLES)
WEIGHT = (np.arange(SAMPLES) % 3 > 0) * 1.0

terminal_voltage_jit = eqx.filter_jit(terminal_voltage)


def squared_error(rc, inputs):
    return inputs.squared_error(rc)


squared_error_jit = eqx.filter_jit(squared_error)
responses_jit = eqx.filter_jit(jax.vmap(unit_response, in_axes=(0, None, None)))
errors_jit = eqx.filter_jit(SimulationInput.errors)


def measured_clock(samples: int, seed: int = 2) -> np.ndarray:
    """A tester's clock: two alternating intervals with jitter, gaps, and bursts."""
    rng = np.random.default_rng(seed)
    interval_s = np.where(np.arange(samples - 1) % 2, 1.0, 1.0155)
    interval_s = interval_s + rng.normal(0, 2e-5, samples - 1)
    interval_s[rng.random(samples - 1) < 0.1] = 10.0
    interval_s[50:54], interval_s[200], interval_s[300] = 0.002, 3600.0, 61.7
    return 12345.678 + np.concatenate([[0.0], np.cumsum(interval_s)])


CLOCKS = {
    "even": np.arange(SAMPLES) * 1.0,
    "minutes": np.arange(SAMPLES) * 60.0,
    "tenths": 7.3 + np.arange(SAMPLES) * 0.1,
    "measured": measured_clock(SAMPLES),
}


pytestmark = pytest.mark.usefixtures("double_precision")


def drive_of(
    time_s, hold="forward", current_a=CURRENT_A, shortest_tau_s=SHORTEST_TAU_S
) -> SimulationInput:
    held_a = current_a[:-1] if hold == "forward" else current_a[1:]
    samples = len(time_s)
    return SimulationInput(
        current_a=jnp.asarray(current_a),
        held_a=jnp.asarray(np.append(held_a, 0.0)),
        base_error_v=jnp.asarray((MEASURED_V - SOURCE_V)[:samples]),
        weight=jnp.asarray(WEIGHT[:samples]),
        scored=jnp.asarray(WEIGHT[:samples].sum()),
        intervals=Intervals.measure(time_s, shortest_tau_s),
    )


def rc_parameters(circuit) -> RCParameters:
    return jax.tree.map(jnp.asarray, RCParameters(*circuit))


@pytest.mark.parametrize("hold", ["forward", "backward"])
@pytest.mark.parametrize("clock", CLOCKS)
def test_any_clock_agrees_with_a_plain_loop(clock, hold):
    time_s = CLOCKS[clock]
    simulated_v = terminal_voltage_jit(rc_parameters(CIRCUIT), drive_of(time_s, hold), SOURCE_V)
    expected_v = SOURCE_V - drop_v(looped_response, time_s, CURRENT_A, CIRCUIT, hold)
    np.testing.assert_allclose(simulated_v, expected_v, rtol=1e-12)


@given(
    interval_s=st.lists(
        st.one_of(st.sampled_from([1.0, 1.0155]), st.floats(1e-3, 100.0)), min_size=39, max_size=39
    ),
    fractions=st.lists(st.floats(0, 1), min_size=4, max_size=4),
)
def test_any_time_constants_on_any_intervals_agree_with_a_plain_loop(interval_s, fractions):
    time_s = np.concatenate([[0.0], np.cumsum(interval_s)])
    taus = SHORTEST_TAU_S * (1e5 / SHORTEST_TAU_S) ** np.array(fractions)
    inputs = drive_of(time_s, current_a=CURRENT_A[:40])
    # Of one size, so that a program or two serve all examples.
    missing = len(time_s) - len(inputs.intervals.node_s)
    intervals = eqx.tree_at(
        lambda each: each.node_s,
        inputs.intervals,
        replace_fn=lambda node_s: jnp.pad(node_s, (0, missing), mode="edge"),
    )
    responses = responses_jit(jnp.asarray(taus), inputs.held_a, intervals)
    expected = looped_response(time_s, CURRENT_A, taus).T
    # Responses reach 4 A; a hundredth of an ohm on 3 V makes this 1e-14 of the terminal voltage.
    np.testing.assert_allclose(responses, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("clock", ["even", "measured"])
def test_populations_give_what_each_candidate_gives_alone(clock):
    # More than fit side by side, and a resistance that they share.
    inputs, own = drive_of(CLOCKS[clock]), rc_parameters(CIRCUIT)
    factors = jnp.linspace(0.5, 3.0, 2 * (LANES // 2 + 3)).reshape(2, -1)

    def squared_error_at(factor):
        r, tau = jax.tree.map(lambda leaf: leaf * factor, (own.r, own.tau))
        return inputs.squared_error(RCParameters(own.r0, r, tau))

    together = jax.jit(jax.vmap(jax.vmap(squared_error_at)))(factors)
    one = jax.jit(squared_error_at)
    alone = [[one(factor) for factor in row[::40]] for row in factors]
    np.testing.assert_array_equal(together[:, ::40], alone)


@pytest.mark.parametrize("clock", ["even", "measured"])
def test_derivatives_are_exact(clock):
    # A complex step through the plain loop has no truncation error.
    time_s, step = CLOCKS[clock], 1e-40
    jacobian = eqx.filter_jit(jax.jacfwd(overpotential))(rc_parameters(CIRCUIT), drive_of(time_s))
    np.testing.assert_allclose(jacobian.r0, CURRENT_A, rtol=1e-12)
    for pair, (r, tau) in enumerate(zip(*CIRCUIT[1:], strict=True)):
        response = looped_response(time_s, CURRENT_A, tau)
        slope = looped_response(time_s, CURRENT_A, complex(tau, step)).imag / step
        np.testing.assert_allclose(jacobian.r[pair], response, atol=1e-11)
        np.testing.assert_allclose(jacobian.tau[pair], r * slope, atol=1e-12)


@pytest.mark.parametrize(
    ("start_s", "samples"), [(7.3, SAMPLES), (7.3, 100_000), (1.7e9, SAMPLES), (-1.7e9, SAMPLES)]
)
def test_an_even_clock_needs_one_exponential(start_s, samples):
    # However long it runs and far from zero: the rounding of its times is no jitter.
    intervals = Intervals.measure(start_s + np.arange(samples) * 0.1, SHORTEST_TAU_S)
    assert intervals.is_even
    assert not intervals.has_offsets


def test_no_state_moves_where_no_time_passes():
    intervals = Intervals.gather(np.zeros(5), SHORTEST_TAU_S, 1e-12)
    np.testing.assert_array_equal(responses_jit(jnp.ones(1), jnp.arange(5.0), intervals), 0.0)


def test_a_single_odd_interval_of_a_long_record_keeps_its_offset():
    time_s = np.arange(300_000.0)
    time_s[150_000:] -= 1e-5
    intervals = Intervals.measure(time_s, SHORTEST_TAU_S)
    assert intervals.is_even
    assert intervals.has_offsets


def test_nodes_and_offsets_are_the_measured_intervals():
    intervals = Intervals.measure(CLOCKS["measured"], SHORTEST_TAU_S)
    rebuilt_s = intervals.node_s[intervals.node] + intervals.offset_s
    interval_s = np.diff(CLOCKS["measured"])
    np.testing.assert_allclose(rebuilt_s[:-1], interval_s, rtol=1e-15, atol=1e-15)
    # The last leads nowhere and is the one before again.
    assert rebuilt_s[-1] == rebuilt_s[-2]


def moved_drive() -> SimulationInput:
    """With a dynamic hysteresis, whose clock counts SOC."""
    inputs = drive_of(CLOCKS["measured"])
    soc = np.cumsum(np.append(0.0, 1e-4 * (1 + np.abs(CURRENT_A[:-1]))))
    moved = HysteresisInput(
        amplitude_v=jnp.asarray(0.02 + 0.01 * np.sin(np.arange(SAMPLES) / 60)),
        hysteresis_input=jnp.asarray(np.sign(CURRENT_A)),
        intervals=Intervals.measure(soc, 1e-3),
    )
    return eqx.tree_at(
        lambda each: each.hysteresis, inputs, moved, is_leaf=lambda leaf: leaf is None
    )


def unweighted(inputs: SimulationInput) -> SimulationInput:
    return eqx.tree_at(lambda each: each.weight, inputs, None)


MOVED = eqx.tree_at(
    lambda each: each.gamma, RCParameters(*CIRCUIT), 40.0, is_leaf=lambda leaf: leaf is None
)


def test_errors_are_measured_minus_simulated_where_samples_count():
    inputs, rc = moved_drive(), jax.tree.map(jnp.asarray, MOVED)
    expected_v = MEASURED_V - np.asarray(terminal_voltage_jit(rc, inputs, SOURCE_V))
    np.testing.assert_allclose(errors_jit(unweighted(inputs), rc), expected_v, atol=1e-14)
    found_v = errors_jit(inputs, rc)
    np.testing.assert_allclose(found_v, np.where(WEIGHT > 0, expected_v, 0), atol=1e-14)
    np.testing.assert_allclose(squared_error_jit(rc, inputs), np.sum(found_v**2), rtol=1e-12)

"""Records of many lengths through one compiled scan: one program, and the bits of each alone."""

from contextlib import contextmanager
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from barnax import CircuitParameters, Window, evaluate
from barnax.execution import in_float64
from barnax.model.problem import FACTOR_STEP, make_problem, rmse_by_scan
from barnax.model.simulate import SimulationInput
from barnax.uncertainty.covariance import linearize
from helpers.problems import drive_a
from helpers.reference import make_record
from helpers.scan import rc_parameters

KNOWN_SOC = Window(initial_soc=0.8, initial_direction=-1)


def problem_of(cell, circuit, clocks):
    """A problem on records of these clocks, all with their own current and voltage."""
    records = []
    for seed, time_s in enumerate(clocks):
        current_a = drive_a(len(time_s), seed)
        noise_v = np.random.default_rng(seed).normal(0, 1e-3, len(time_s))
        records.append(make_record(time_s, current_a, 3.7 - 0.05 * current_a + noise_v))
    return make_problem(records, cell, circuit, window=KNOWN_SOC)


def uneven(samples, seed):
    steps = np.random.default_rng(seed).choice([0.5, 1.0, 7.0 + seed], samples)
    return np.cumsum(steps)


@contextmanager
def counted_compilations():
    """The durations of what is compiled inside."""
    compiled = []

    def note(event, duration_s, **_):
        if event == "/jax/core/compile/backend_compile_duration":
            compiled.append(duration_s)

    jax.monitoring.register_event_duration_secs_listener(note)
    try:
        yield compiled
    finally:
        jax.monitoring.unregister_event_duration_listener(note)


@pytest.mark.parametrize("circuit", ["so-rc", pytest.param("esc", marks=pytest.mark.slow)])
def test_a_new_length_in_a_compiled_size_compiles_nothing(bundled_cell, circuit):
    gamma = 100.0 if circuit == "esc" else None
    at = CircuitParameters.constant(0.05, (0.01, 0.02), (500.0, 4000.0), gamma)

    def run(samples):
        problem = problem_of(bundled_cell, circuit, [uneven(samples, 1)])
        rmse_by_scan(problem, [at])
        linearize(problem, at)
        evaluate(problem.prepared, at)
        return problem.padded_compressed

    known = run(300)
    with counted_compilations() as compiled:
        new = run(341)
    assert compiled == []
    # The descent's program depends on nothing else.
    assert eqx.tree_equal(*(jax.tree.map(jnp.shape, each) for each in (known, new)))


@in_float64
def test_a_compressed_record_of_a_common_size_has_the_same_errors(bundled_cell):
    problem = problem_of(bundled_cell, "esc", [uneven(221, 2)])
    short, common = problem.compressed, problem.padded_compressed
    assert common.factor.shape[0] % FACTOR_STEP == 0
    assert (common.factor.shape[1] - 2) % FACTOR_STEP == 0
    for share in (0.2, 0.5, 0.9):
        box = problem.coordinates
        point = jnp.asarray(box.lower * (1 - share) + box.upper * share)
        circuit = problem.coordinates.decode(point)
        expected_v = short.errors(circuit)
        errors_v = common.errors(circuit)
        np.testing.assert_allclose(errors_v[: len(expected_v)], expected_v, rtol=1e-12, atol=1e-15)
        assert not np.any(errors_v[len(expected_v) :])


@pytest.mark.parametrize("is_whole", [True, False])
@in_float64
def test_a_record_of_more_samples_has_the_same_errors_bit_for_bit(bundled_cell, is_whole):
    prepared = problem_of(bundled_cell, "esc", [uneven(261, 2)]).prepared
    scored = np.full(261, True) if is_whole else np.arange(261) % 3 > 0
    prepared = replace(prepared, scored=scored)
    circuit = rc_parameters(CircuitParameters.constant(0.05, (0.01, 0.02), (500.0, 4000.0), 100.0))
    plain, longer = (prepared.simulation_input(0.5, 1e4, size) for size in (None, 302))
    assert longer.weight is not None
    np.testing.assert_array_equal(longer.weight, np.append(scored, np.zeros(41)))
    errors, squares = eqx.filter_jit(SimulationInput.errors), SimulationInput.squared_error
    expected_v = np.append(errors(plain, circuit), np.zeros(41))
    np.testing.assert_array_equal(errors(longer, circuit), expected_v)
    assert eqx.filter_jit(squares)(longer, circuit) == eqx.filter_jit(squares)(plain, circuit)

"""One circuit on one record: what was simulated, and the errors where they count."""

from dataclasses import replace

import numpy as np
import pytest

from barnax import CircuitParameters, Window
from barnax.model.prepared import prepare_record
from barnax.model.reference import simulate_circuit
from barnax.search.evaluate import evaluate, step_warnings, validate
from helpers.reference import drop_v, filtered_response, make_record

CIRCUIT = CircuitParameters.constant(r0=0.05, r=(0.01, 0.02), c=(500.0, 4000.0))
WINDOW = Window(score_from_s=99.5, score_to_s=1500.5)


@pytest.fixture(scope="module")
def evaluation(bundled_validation, bundled_cell):
    return validate(bundled_validation, bundled_cell, "iso-rc", CIRCUIT, WINDOW)


def test_the_simulated_voltage_is_that_of_a_digital_filter(evaluation):
    prepared = evaluation.prepared
    circuit = (0.05, (0.01, 0.02), (5.0, 80.0))
    expected_v = prepared.source_v - drop_v(filtered_response, 1.0, prepared.current_a, circuit)
    np.testing.assert_allclose(evaluation.simulated_v, expected_v, rtol=1e-12)
    # Only scored samples count.
    scored_v = (prepared.voltage_v - evaluation.simulated_v)[prepared.scored]
    assert evaluation.metrics.samples == len(scored_v) == 1401
    assert evaluation.metrics.rmse_v == pytest.approx(np.sqrt(np.mean(scored_v**2)), rel=1e-12)
    assert evaluation.metrics.max_v == np.abs(scored_v).max()


@pytest.mark.parametrize("hold", ["forward", "backward", "centered"])
def test_an_r0_above_what_the_steps_show_is_warned_of_with_both(bundled_cell, hold):
    """Levels of a minute at 1 s: the record's answer to their steps is of the closed form."""
    time_s = np.arange(3000.0)
    current_a = np.repeat(np.random.default_rng(3).uniform(-1, 2, 50), 60)
    record = make_record(time_s, current_a, 3.6, hold=hold)
    window = Window(initial_soc=0.8)
    simulated_v = simulate_circuit(prepare_record(record, bundled_cell, "so-rc", window), CIRCUIT)
    noise_v = np.random.default_rng(4).normal(0, 1e-3, 3000)
    record = replace(record, voltage_v=simulated_v + noise_v)
    prepared = prepare_record(record, bundled_cell, "so-rc", window)
    assert not [*step_warnings(evaluate(prepared, CIRCUIT), CIRCUIT)]
    # As where slow pairs are missing, R0 takes what a pair does not.
    high = CircuitParameters.constant(r0=0.065, r=(0.001, 0.02), c=(5000.0, 4000.0))
    (notice,) = step_warnings(evaluate(prepared, high), high)
    assert notice.values["shown_ohm"] == pytest.approx(0.0535, rel=0.04)
    assert notice.values["own_ohm"] == pytest.approx(0.0655, rel=0.04)
    # By less than a tenth too: the scatter over all steps decides.
    a_little = CircuitParameters.constant(r0=0.055, r=(0.001, 0.02), c=(5000.0, 4000.0))
    assert [*step_warnings(evaluate(prepared, a_little), a_little)]
    # Where the interval of R0 reaches down to what the steps show, that says it.
    assert [*step_warnings(evaluate(prepared, high), high, 0.9)]
    assert not [*step_warnings(evaluate(prepared, high), high, 0.75)]
    low = CircuitParameters.constant(r0=0.045, r=(0.01, 0.02), c=(500.0, 4000.0))
    assert not [*step_warnings(evaluate(prepared, low), low)]

"""What the search minimises: records, box and circuit in one objective."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from barnax import CircuitParameters, InputError, Window
from barnax.model.coordinates import Coordinates
from barnax.model.problem import make_problem, residuals, rmse, rmse_by_scan
from helpers.reference import drop_v, looped_response
from helpers.scan import rc_parameters

CIRCUIT = CircuitParameters.constant(r0=0.05, r=(0.01, 0.02), c=(500.0, 4000.0))
LOGARITHMS = np.log([0.05, 0.01, 5.0, 0.02, 80.0])


SHORT = Window(score_to_s=60.0, initial_soc=1.0)
rmse_jit, residuals_jit = eqx.filter_jit(rmse), eqx.filter_jit(residuals)


def looped_error_v(problem, logarithms):
    prepared = problem.prepared
    r0, r1, tau1, r2, tau2 = np.exp(logarithms)
    circuit = (r0, (r1, r2), (tau1, tau2))
    drop = drop_v(looped_response, prepared.time_s, prepared.current_a, circuit)
    return prepared.voltage_v - (prepared.source_v - drop)


def test_the_objective_is_the_rmse_of_a_plain_loop(short_problem):
    with jax.enable_x64(True):
        objective = replace(short_problem, scale="log").objective
        loss = float(rmse_jit(jnp.asarray(LOGARITHMS), objective))
        errors = np.asarray(residuals_jit(jnp.asarray(LOGARITHMS), objective))
    expected = np.sqrt(np.mean(looped_error_v(short_problem, LOGARITHMS) ** 2))
    assert loss == pytest.approx(expected, rel=1e-11)
    # The residuals square to the mean square error.
    assert np.sum(errors**2) == pytest.approx(loss**2, rel=1e-12)


def test_unscored_samples_have_no_residual(bundled_record, bundled_cell):
    window = Window(score_to_s=60.0, score_from_s=30.0, initial_soc=1.0)
    problem = make_problem(bundled_record, bundled_cell, window=window)
    with jax.enable_x64(True):
        errors = residuals_jit(jnp.asarray(LOGARITHMS), replace(problem, scale="log").objective)
    np.testing.assert_array_equal(np.asarray(errors) != 0, problem.prepared.scored)


def test_a_problem_is_in_double_precision_and_leaves_the_setting(bundled_record, bundled_cell):
    # Other packages that were loaded before, PyBaMM is one, may have turned it on for good.
    with jax.enable_x64(False):
        problem = make_problem(bundled_record, bundled_cell, window=Window(score_to_s=60.0))
        assert problem.objective.evaluator.base_error_v.dtype == jnp.float64
        assert problem.objective.coordinates.lower.dtype == jnp.float64
        assert not jax.config.jax_enable_x64


@pytest.mark.parametrize("scale", ["rc", "log"])
def test_circuits_are_given_with_the_faster_pair_first(short_problem, scale):
    swapped = CircuitParameters.constant(r0=0.05, r=(0.02, 0.01), c=(4000.0, 500.0))
    with jax.enable_x64(True):
        coordinates = replace(short_problem, scale=scale).coordinates
        point = np.asarray(coordinates.encode(rc_parameters(swapped)))
        (circuit,) = short_problem.parameters_at([point], coordinates)
    assert circuit.to_dict() == pytest.approx(CIRCUIT.to_dict(), rel=1e-12)


def test_pairs_with_boxes_of_their_own_keep_their_labels(short_problem):
    bounds = short_problem.bounds.with_changes({"R1 [Ohm]": (0.015, 0.1)}, {}, "")
    problem = replace(short_problem, bounds=bounds)
    slow_first = CircuitParameters.constant(r0=0.05, r=(0.02, 0.01), c=(4000.0, 500.0))
    with jax.enable_x64(True):
        coordinates = Coordinates.of(bounds, "log")
        point = np.asarray(coordinates.encode(rc_parameters(slow_first)))
        (circuit,) = problem.parameters_at([point], coordinates)
    assert circuit.to_dict() == pytest.approx(slow_first.to_dict(), rel=1e-12)


def test_a_flat_voltage_is_refused_by_name(bundled_record, bundled_cell):
    flat = replace(bundled_record, voltage_v=np.full(bundled_record.samples, 4.1))
    with pytest.raises(InputError, match=r"identification\.parquet: the voltage is 4.1 V at every"):
        make_problem(flat, bundled_cell, window=SHORT)


def changed_records(problem):
    """What differs from the problem's record in one number that its errors are computed from."""
    prepared, record = problem.prepared, problem.prepared.record
    voltage_v = record.voltage_v.copy()
    voltage_v[prepared.first + 700] += 0.1
    scored = prepared.scored.copy()
    scored[700] = False
    start = replace(prepared.start, direction=-prepared.start.direction)
    return {
        "voltage": (replace(prepared, record=replace(record, voltage_v=voltage_v)),),
        "source": (replace(prepared, source_v=prepared.source_v + 1e-3),),
        "scored": (replace(prepared, scored=scored),),
        "resting": (replace(prepared, rest_current_a=2 * prepared.rest_current_a),),
        "start": (replace(prepared, start=start),),
        "factor": (replace(prepared, resistance_factor=np.ones(len(prepared.soc))),),
        "shorter": (prepared.part(slice(0, 700)),),
        "two": (prepared, prepared),
    }


def test_nothing_computed_for_other_records_is_kept(short_problem):
    _ = short_problem.compressed, short_problem.all_inputs, short_problem.padded_compressed
    cached = {"compressed", "padded_compressed", "padded_scan", "all_inputs"}
    for name, records in changed_records(short_problem).items():
        changed = short_problem.keeping_computed(prepared_records=records)
        assert not cached & set(vars(changed)), name


def test_another_record_has_errors_of_its_own(short_problem):
    (higher,) = changed_records(short_problem)["voltage"]
    _ = rmse_by_scan(short_problem, [CIRCUIT]), short_problem.compressed
    problem = short_problem.keeping_computed(prepared_records=(higher,), kind="compressed")
    errors_v = looped_error_v(problem, LOGARITHMS)
    expected = np.sqrt(np.mean(errors_v**2))
    assert rmse_by_scan(problem, [CIRCUIT])[0] == pytest.approx(expected, rel=1e-11)
    with jax.enable_x64(True):
        loss = rmse_jit(jnp.asarray(LOGARITHMS), replace(problem, scale="log").objective)
    assert float(loss) == pytest.approx(expected, rel=1e-9)


def test_another_box_is_computed_anew(short_problem):
    _ = short_problem.compressed, short_problem.coordinates
    bounds = short_problem.bounds.with_changes({"tau2 [s]": (20.0, 400.0)}, {}, "")
    for changes in ({"bounds": bounds}, {"scale": "log"}):
        changed = short_problem.keeping_computed(**changes)
        assert not {"compressed", "coordinates"} & set(vars(changed))

"""The state-space model says what a simulation says."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from barnax import InputError, Window, evaluate
from barnax.cell import CircuitParameters, Dependence
from barnax.execution import in_float64
from barnax.filters import Drive, ErrorModel, make_model
from barnax.model.prepared import prepare_record
from barnax.model.reference import simulate_circuit
from barnax.result_filter import model_of
from helpers.results import PAIRS, PAIRS_OF, make_cell, make_record, make_result, with_constant

NODES = (0.0, 0.2, 0.5, 1.0)
# Between two points of the grid the OCV of this cell bends by less.
GRID_V = 3e-5


@in_float64
def open_loop(model, prepared):
    """The voltage along a record without any correction."""
    slow = jnp.zeros(0)

    def step(state, drive):
        state = model.advance(state, slow, drive)
        return state, model.voltage(state, slow, drive)

    start, _ = model.start(prepared.start.soc, 0.1, float(prepared.start.direction), 0.0)
    return np.asarray(jax.lax.scan(step, start, Drive.of(prepared))[1])


@pytest.mark.parametrize("circuit", PAIRS_OF)
def test_without_corrections_it_simulates_the_circuit(circuit):
    r, c = zip(*PAIRS[: PAIRS_OF[circuit]], strict=True)
    parameters = CircuitParameters.constant(0.05, r, c, 60.0 if circuit == "esc" else None)
    prepared = prepare_record(make_record(600), make_cell(), circuit, Window(initial_soc=0.9))
    model = in_float64(make_model)(make_cell(), circuit, parameters, ErrorModel(1e-3))
    expected_v = evaluate(prepared, parameters).simulated_v
    assert np.abs(open_loop(model, prepared) - expected_v).max() < GRID_V


HEATED = Dependence(
    kappa_per_a2=0.05, heating_tau_s=200.0, reference_a2=1.0, onset_a=1.5, charge_ratio=1.2
)


@pytest.mark.parametrize(
    ("circuit", "followed"), [("so-rc", None), ("iso-rc", None), ("esc", None), ("so-rc", HEATED)]
)
def test_without_corrections_it_simulates_tables_and_what_they_follow(circuit, followed):
    gamma = 60.0 if circuit == "esc" else None
    tables = CircuitParameters.over_soc(
        NODES, (20.0, 300.0), (0.09, 0.06, 0.05, 0.05),
        ((0.03, 0.02, 0.01, 0.01), (0.05, 0.02, 0.02, 0.03)),
        ocv_correction_v=(0.01, -0.01, 0.0, 0.02),
        half_hysteresis_v=None if gamma is None else (0.02, 0.01, 0.01, 0.0),
        gamma=gamma, visited=(True,) * 4, dependence=followed,
    )  # fmt: skip
    prepared = prepare_record(make_record(600), make_cell(), circuit, Window(initial_soc=0.9))
    model = in_float64(make_model)(make_cell(), circuit, tables, ErrorModel(1e-3))
    expected_v = simulate_circuit(prepared, tables)
    if followed is not None:
        assert np.abs(open_loop(model, prepared) - expected_v).max() > 1e-3
        prepared = prepared.with_dependence(followed)
    assert np.abs(open_loop(model, prepared) - expected_v).max() < GRID_V


def test_a_result_without_an_assessment_is_refused():
    result = with_constant(make_result("so-rc"), assessment=None)
    with pytest.raises(InputError, match="identify again with `trust` 'basic'"):
        model_of(result)

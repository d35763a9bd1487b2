"""The scan with tables against closed forms and SciPy's filters."""

import equinox as eqx
import numpy as np
import pytest
from scipy.signal import lfilter

from barnax import CircuitParameters, InputError
from barnax.cell.parameters import OCV_CORRECTION
from barnax.cell.tables import hats
from barnax.execution import in_float64
from barnax.model.reference import simulate_circuit
from helpers.scan import rc_parameters, terminal_voltage

from .conftest import NODES

TABLES = CircuitParameters.over_soc(
    nodes=NODES,
    tau_s=(8.0, 90.0),
    r0_ohm=(0.09, 0.05, 0.06, 0.04, 0.07),
    r_ohm=((0.01, 0.02, 0.0, 0.015, 0.01), (0.03, 0.01, 0.02, 0.025, 0.005)),
    ocv_correction_v=(0.01, -0.01, 0.0, 0.02, -0.02),
)


def filtered_drop_v(prepared, tables):
    """The drop of every node's column by SciPy, on an even clock."""
    (interval_s,) = np.unique(np.round(np.diff(prepared.time_s), 9))
    columns = hats(prepared.soc, tables.nodes)
    drop_v = columns @ tables.ohm[0] * prepared.current_a
    for tau_s, r_ohm in zip(tables.tau_s, tables.ohm[1:], strict=True):
        a = np.exp(-interval_s / tau_s)
        held = columns * prepared.held_a[:, None]
        drop_v += lfilter([0.0, 1 - a], [1.0, -a], held, axis=0) @ np.array(r_ohm)
    return drop_v - columns @ np.array(tables.tables[OCV_CORRECTION])


def test_scipy_filters_node_by_node_give_the_same_voltage(prepared):
    simulated_v = simulate_circuit(prepared, TABLES)
    expected_v = prepared.source_v - filtered_drop_v(prepared, TABLES)
    assert simulated_v == pytest.approx(expected_v, abs=1e-12)


@pytest.mark.parametrize("name", ["prepared", "with_hysteresis"])
def test_level_tables_are_the_constant_circuit(name, request):
    prepared = request.getfixturevalue(name)
    gamma = 30.0 if name == "with_hysteresis" else None
    circuit = CircuitParameters.constant(0.05, (0.02, 0.03), (500.0, 3000.0), gamma)
    level = [(value,) * len(NODES) for value in (0.05, 0.02, 0.03)]
    tables = CircuitParameters.over_soc(
        NODES, circuit.tau_s, level[0], tuple(level[1:]), gamma=gamma
    )
    inputs = prepared.simulation_input(min(circuit.tau_s), gamma)
    by_population = in_float64(eqx.filter_jit(terminal_voltage))
    expected_v = np.asarray(by_population(rc_parameters(circuit), inputs, prepared.source_v))
    assert simulate_circuit(prepared, circuit) == pytest.approx(expected_v, abs=1e-12)
    assert simulate_circuit(prepared, tables) == pytest.approx(expected_v, abs=1e-12)
    one = CircuitParameters.over_soc(
        (0.5,), circuit.tau_s, (0.05,), ((0.02,), (0.03,)), gamma=gamma
    )
    assert simulate_circuit(prepared, one) == pytest.approx(expected_v, abs=1e-12)


def test_a_table_of_the_measured_amplitude_is_the_measured_hysteresis(with_hysteresis):
    level = (0.05,) * len(NODES)
    measured = CircuitParameters.over_soc(NODES, (10.0,), level, (level,), gamma=30.0)
    soc = with_hysteresis.soc
    # Linear between so many nodes, the amplitude is met where they lie.
    nodes = tuple(np.linspace(soc.min(), soc.max(), 400).tolist())
    amplitude_v = np.interp(nodes, soc[::-1], with_hysteresis.hysteresis_amplitude_v[::-1])
    level = (0.05,) * len(nodes)
    tabled = CircuitParameters.over_soc(
        nodes, (10.0,), level, (level,), half_hysteresis_v=tuple(amplitude_v.tolist()), gamma=30.0
    )
    simulated_v = simulate_circuit(with_hysteresis, tabled)
    assert simulated_v == pytest.approx(simulate_circuit(with_hysteresis, measured), abs=2e-4)


@pytest.mark.parametrize(
    "changed",
    [
        {"nodes": (0.5, 0.3)},
        {"r0_ohm": (0.1,)},
        {"tau_s": (1.0,)},
        {"ocv_correction_v": (0.0, 0.0)},
    ],
)
def test_tables_that_do_not_fit_together_are_refused(changed):
    given = {"nodes": (0.0, 1.0, 2.0), "r0_ohm": (0.1,) * 3, "tau_s": (1.0, 2.0)}
    given |= {"r_ohm": ((0.1,) * 3, (0.1,) * 3)} | changed
    with pytest.raises(InputError):
        CircuitParameters.over_soc(**given)

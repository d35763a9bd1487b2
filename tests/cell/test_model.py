import json

import numpy as np
import pytest

from barnax.cell import CIRCUITS, CellModel, characterize, get_circuit
from barnax.errors import InputError

from .pulse_rest import average_v, both_ways, branch_v, discharge_only, hysteresis_v

GRID = np.linspace(0.0, 1.0, 21)


@pytest.fixture(scope="module")
def cell() -> CellModel:
    return characterize([both_ways()], ocv_fit="interpolated")


@pytest.mark.parametrize("ocv_fit", ["polynomial", "interpolated"])
@pytest.mark.parametrize("hysteresis_fit", ["continuous", "independent"])
@pytest.mark.parametrize("make", [both_ways, discharge_only])
def test_a_cell_survives_json_bit_for_bit(make, ocv_fit, hysteresis_fit):
    cell = characterize([make()], ocv_fit=ocv_fit, hysteresis_fit=hysteresis_fit)
    assert CellModel.from_dict(json.loads(json.dumps(cell.to_dict()))) == cell


def test_a_stored_cell_without_capacity_is_refused(cell):
    stored = cell.to_dict()
    del stored["capacity [A.h]"]
    with pytest.raises(InputError, match=r"capacity \[A.h\]"):
        CellModel.from_dict(stored)


def test_a_stored_cell_without_points_is_refused(cell):
    stored = cell.to_dict() | {"charge points": [], "discharge points": []}
    with pytest.raises(InputError, match="no OCV points"):
        CellModel.from_dict(stored)


def test_the_average_coefficients_are_the_average_inside_both_branches():
    cell = characterize([both_ways()])
    coefficients = cell.to_dict()["average coefficients [V]"]
    expected = np.polynomial.polynomial.polyval(GRID, coefficients)
    np.testing.assert_allclose(cell.average_ocv_v(GRID), expected, atol=1e-9)


@pytest.mark.parametrize("soc", [0.0, 0.03, 0.42, 0.77, 1.0])
def test_a_rested_voltage_tells_the_state_of_charge(cell, soc):
    voltage_v = float(cell.average_ocv_v(np.array(soc)))
    assert cell.soc_from_rest_voltage(voltage_v) == pytest.approx(soc, abs=1e-5)


@pytest.mark.parametrize("direction", [-1, 1])
def test_a_rested_voltage_can_be_read_on_one_branch(cell, direction):
    voltage_v = float(branch_v(np.array(0.55), direction))
    assert cell.soc_from_rest_voltage(voltage_v, direction) == pytest.approx(0.55, abs=1e-5)


def test_a_rested_voltage_just_outside_is_the_nearest_end(cell):
    assert cell.soc_from_rest_voltage(float(average_v(np.array(1.0))) + 0.01) == 1.0


def test_a_rested_voltage_far_outside_asks_for_the_state_of_charge(cell):
    with pytest.raises(InputError, match="--initial-soc"):
        cell.soc_from_rest_voltage(4.6)


@pytest.mark.parametrize("direction", [-1.0, 1.0])
def test_the_second_order_circuit_ignores_the_direction(cell, direction):
    source_v = get_circuit("so-rc").source_voltage(cell, GRID, np.full(21, direction))
    np.testing.assert_allclose(source_v, average_v(GRID), atol=1e-9)


@pytest.mark.parametrize("direction", [-1.0, 1.0])
def test_the_improved_circuit_follows_the_branch_of_the_direction(cell, direction):
    source_v = get_circuit("iso-rc").source_voltage(cell, GRID, np.full(21, direction))
    expected_v = average_v(GRID) + direction * hysteresis_v(GRID) / 2
    np.testing.assert_allclose(source_v, expected_v, atol=1e-6)


@pytest.mark.parametrize("name", CIRCUITS)
def test_every_circuit_gives_one_finite_voltage_a_sample(cell, name):
    source_v = CIRCUITS[name].source_voltage(cell, GRID, np.ones(21))
    assert source_v.shape == GRID.shape
    assert np.isfinite(source_v).all()


@pytest.mark.parametrize("name", CIRCUITS)
def test_every_circuit_is_registered_under_its_own_name(name):
    assert get_circuit(name).name == name


def test_an_unknown_circuit_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match="iso-rc, so-rc"):
        get_circuit("rint")

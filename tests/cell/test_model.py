import json
from dataclasses import replace

import numpy as np
import pytest

from barnax.cell import CIRCUITS, CellModel, FitError, PolynomialCurve, characterize, get_circuit
from barnax.cell.model import fit_error
from barnax.errors import InputError
from helpers.ocv_tests import average_v, both_ways, branch_v, discharge_only, hysteresis_v

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
    with pytest.raises(InputError, match=r"stored cell has no 'capacity \[A.h\]'"):
        CellModel.from_dict(stored)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"capacity [A.h]": 0.0}, "capacity of 0 Ah"),
        ({"capacity [A.h]": -2.0}, "capacity of -2 Ah"),
        ({"capacity [A.h]": 1e13}, r"capacity of 1e\+13 Ah"),
        ({"fit errors": []}, "fit errors"),
        ({"charge points": {}}, "OCV points"),
    ],
)
def test_a_stored_cell_that_was_tampered_with_is_refused(cell, change, message):
    with pytest.raises(InputError, match=message):
        CellModel.from_dict(cell.to_dict() | change)


def test_a_stored_cell_without_points_is_refused(cell):
    stored = cell.to_dict() | {"charge points": [], "discharge points": []}
    with pytest.raises(InputError, match="no OCV points"):
        CellModel.from_dict(stored)


def test_the_average_coefficients_are_the_average_inside_both_branches():
    cell = characterize([both_ways()])
    coefficients = cell.to_dict()["average coefficients [V]"]
    expected = np.polynomial.polynomial.polyval(GRID, coefficients)
    np.testing.assert_allclose(cell.average_ocv_v(GRID), expected, atol=1e-9)


def test_branches_of_different_kinds_have_no_average_coefficients(cell):
    mixed = replace(cell, charge=PolynomialCurve.fit(cell.charge.soc, cell.charge.voltage_v))
    assert "average coefficients [V]" not in mixed.to_dict()
    assert CellModel.from_dict(mixed.to_dict()) == mixed


@pytest.mark.parametrize("soc", [0.0, 0.03, 0.42, 0.77, 1.0])
def test_a_rested_voltage_tells_the_state_of_charge(cell, soc):
    voltage_v = float(cell.average_ocv_v(np.array(soc)))
    assert cell.soc_from_rest_voltage(voltage_v) == pytest.approx(soc, abs=1e-5)


@pytest.mark.parametrize("direction", [-1, 1])
def test_a_rested_voltage_can_be_read_on_one_branch(cell, direction):
    voltage_v = float(branch_v(np.array(0.55), direction))
    assert cell.soc_from_rest_voltage(voltage_v, direction) == pytest.approx(0.55, abs=1e-5)


@pytest.mark.parametrize(("end", "outward"), [(0.0, -1), (1.0, 1)])
def test_a_rested_voltage_is_the_nearest_end_up_to_50_mv_outside(cell, end, outward):
    end_v = float(average_v(np.array(end)))
    assert cell.soc_from_rest_voltage(end_v + outward * 49.9e-3) == end
    with pytest.raises(InputError, match="`initial_soc`"):
        cell.soc_from_rest_voltage(end_v + outward * 50.1e-3)


def test_a_rested_voltage_where_a_branch_is_constant_is_its_lowest_soc():
    cell = characterize([both_ways(returned=0.98)], ocv_fit="interpolated")
    assert cell.soc_range[1] == 1.0
    highest_v = float(cell.charge.voltage_v[-1])
    assert cell.soc_from_rest_voltage(highest_v, +1) == pytest.approx(0.98, abs=1e-3)


def test_the_fit_error_is_root_mean_square_and_largest_of_either_sign():
    assert fit_error(np.array([3e-3, -4e-3])) == FitError(pytest.approx(12.5e-6**0.5), 4e-3)


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

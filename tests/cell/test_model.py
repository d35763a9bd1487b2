import numpy as np
import pytest

from barnax.cell import CellModel, characterize, get_circuit
from barnax.cell.circuits import loops
from barnax.errors import InputError
from helpers.ocv_tests import average_v, both_ways, branch_v

GRID = np.linspace(0.0, 1.0, 21)


@pytest.fixture(scope="module")
def cell() -> CellModel:
    return characterize([both_ways()], ocv_fit="interpolated")


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
    with pytest.raises(InputError, match=r"the OCV test is of this cell .*`initial_soc`"):
        cell.soc_from_rest_voltage(end_v + outward * 50.1e-3)


def test_a_rested_voltage_where_a_branch_is_constant_is_its_lowest_soc():
    cell = characterize([both_ways(returned=0.98)], ocv_fit="interpolated")
    assert cell.soc_range[1] == 1.0
    highest_v = float(cell.charge.voltage_v[-1])
    assert cell.soc_from_rest_voltage(highest_v, +1) == pytest.approx(0.98, abs=1e-3)


def test_a_loop_turns_along_a_tangent_and_a_minor_one_begins_where_it_had_come():
    """Charged to 0.5, discharged by 0.03, charged by 0.04, at rest."""
    soc = np.array([0.49, 0.5, 0.48, 0.47, 0.49, 0.51, 0.51])
    turned = loops(soc, np.array([1.0, -1, -1, 1, 1, 1, 1]))
    width = 0.1 / np.arctanh(0.95)
    bottom = 1 - 2 * np.tanh(0.03 / width)
    along = [bottom + (1 - bottom) * np.tanh(passed / width) for passed in (0.0, 0.02, 0.04)]
    expected = [1, 1, 1 - 2 * np.tanh(0.02 / width), *along, along[-1]]
    np.testing.assert_allclose(turned, expected, atol=1e-12)


@pytest.mark.parametrize("direction", [1, -1])
def test_a_loop_without_a_turn_is_the_branch(cell, direction):
    takacs, directions = get_circuit("takacs"), np.full(21, float(direction))
    state = takacs.hysteresis.state(GRID, directions)
    source_v = takacs.ocv_v(cell, GRID) + state * takacs.hysteresis.half_v(cell, GRID)
    branch_v = cell.average_ocv_v(GRID) + direction * cell.branch_gap_v(GRID) / 2
    np.testing.assert_allclose(source_v, branch_v, rtol=0, atol=1e-12)

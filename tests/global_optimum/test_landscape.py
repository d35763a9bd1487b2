"""The landscape over time constants, against SciPy's bounded least squares on simulations."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from barnax.cell import CircuitParameters
from barnax.global_optimum import Landscape
from barnax.global_optimum.objective import ConstantObjective
from barnax.global_optimum.search import landscape_of
from barnax.model.problem import make_problem
from barnax.model.window import Window
from barnax.search.evaluate import evaluate
from barnax.uncertainty.covariance import named_values
from helpers.problems import drive_record

KNOWN_SOC = Window(initial_soc=0.6)
R_BOX = (1e-4, 0.2)
CASES = {
    "one pair": ("1rc", {}, {}),
    "two pairs": ("so-rc", {}, {}),
    "three pairs": ("3rc", {}, {}),
    "four pairs": ("4rc", {}, {}),
    "dynamic hysteresis": ("esc", {}, {}),
    "a fixed rate": ("esc", {}, {"gamma": 50.0}),
    "a fixed resistance": ("so-rc", {}, {"R1 [Ohm]": 0.02}),
    "a fixed time constant": ("so-rc", {}, {"tau1 [s]": 10.0}),
    "two boxes": ("so-rc", {"tau1 [s]": (1.0, 50.0)}, {}),
    "narrow resistances": ("iso-rc", {"R0 [Ohm]": (0.05, 0.06), "R2 [Ohm]": (1e-3, 2e-3)}, {}),
    "a bounded capacitance": ("so-rc", {"C2 [F]": (1000.0, 9000.0)}, {}),
    "a fixed capacitance": ("so-rc", {}, {"C1 [F]": 800.0}),
}


@pytest.fixture(scope="module")
def problem_of(bundled_cell):
    """The problem of a case, on one record."""
    made = {}

    def make(case):
        if case not in made:
            circuit, bounds, fixed = CASES[case]
            given = {"window": KNOWN_SOC, "bounds": bounds, "fixed": fixed}
            made[case] = make_problem(drive_record("gaps", 400, 0), bundled_cell, circuit, **given)
        return made[case]

    return make


@pytest.fixture(scope="module")
def landscape_in(problem_of):
    made = {}

    def make(case) -> Landscape:
        if case not in made:
            made[case] = landscape_of(ConstantObjective.of(problem_of(case)))
        return made[case]

    return make


def errors_of(problem, resistances, taus, gamma):
    """The error at every scored sample of every record, by simulation."""
    r0, *r = (float(each) for each in resistances)
    circuit = CircuitParameters.constant(r0, tuple(r), tuple(np.divide(taus, r).tolist()), gamma)
    return np.concatenate(
        [
            (each.voltage_v - evaluate(each, circuit).simulated_v)[each.scored]
            for each in problem.prepared_records
        ]
    )


def least_rmse(problem, low, high, taus, gamma):
    """The least RMSE that resistances from low to high reach, by SciPy."""
    reference = np.full(len(low), 0.03)
    base = errors_of(problem, reference, taus, gamma)
    moved = [errors_of(problem, reference + 0.03 * unit, taus, gamma) for unit in np.eye(len(low))]
    columns = (np.array(moved) - base).T / 0.03
    base = base - columns @ reference
    free = high > low
    target = -(base + columns[:, ~free] @ low[~free])
    found = lsq_linear(columns[:, free], target, (low[free], high[free]), method="bvls", tol=1e-14)
    return np.sqrt(2 * found.cost / len(base))


def some_points(landscape, count, seed=0):
    """The lowest point and some others."""
    known = np.argwhere(np.isfinite(landscape.rmse_v))
    picked = np.random.default_rng(seed).integers(0, len(known), count)
    lowest = np.argwhere(landscape.rmse_v == np.nanmin(landscape.rmse_v))[:1]
    return [tuple(point) for point in np.concatenate([lowest, known[picked]]).tolist()]


def resistance_limits(bounds, tau_s):
    """Least and greatest resistances at some time constants, capacitances' bounds included."""
    names = [f"R{index} [Ohm]" for index in range(bounds.pairs + 1)]
    names += [f"C{pair + 1} [F]" for pair in range(bounds.pairs)]
    ends = [
        (bounds.fixed[name],) * 2 if name in bounds.fixed else bounds.ranges.get(name)
        for name in names
    ]
    low, high = np.transpose(ends[: bounds.pairs + 1])
    for pair, (tau, c) in enumerate(zip(tau_s, ends[bounds.pairs + 1 :], strict=True), 1):
        if c is not None:
            low[pair] = max(low[pair], tau / c[1])
            high[pair] = max(low[pair], min(high[pair], tau / c[0]))
    return low, high


@pytest.mark.parametrize("case", CASES)
def test_every_point_is_the_circuit_with_the_least_error_of_all_resistances_in_the_box(
    problem_of, landscape_in, case
):
    problem, landscape = problem_of(case), landscape_in(case)
    for point in some_points(landscape, 5):
        circuit = landscape.circuit(point)
        expected = least_rmse(
            problem, *resistance_limits(problem.bounds, circuit.tau_s), circuit.tau_s, circuit.gamma
        )
        assert landscape.rmse_v[point] == pytest.approx(expected, rel=1e-8)
        errors_v = errors_of(problem, (circuit.r0, *circuit.r), circuit.tau_s, circuit.gamma)
        own_v = np.sqrt(np.mean(errors_v**2))
        assert landscape.rmse_v[point] == pytest.approx(own_v, rel=1e-9)
        values = named_values(circuit)
        for name, (low, high) in problem.bounds.ranges.items():
            assert low * (1 - 1e-12) <= values[name] <= high * (1 + 1e-12)
        for name, value in problem.bounds.fixed.items():
            assert values[name] == pytest.approx(value, rel=1e-12)


def test_pairs_of_one_box_have_values_only_where_they_are_in_order(landscape_in):
    tau_s, rmse_v = landscape_in("two pairs").tau_s, landscape_in("two pairs").rmse_v
    in_order = tau_s[0][:, None] <= tau_s[1]
    np.testing.assert_array_equal(np.isfinite(rmse_v), in_order)


def test_pairs_with_boxes_of_their_own_have_values_everywhere(landscape_in):
    landscape = landscape_in("two boxes")
    assert np.all(np.isfinite(landscape.rmse_v))
    assert landscape.tau_s[0][-1] == pytest.approx(50.0)


def test_a_fixed_value_is_one_point_of_its_axis(landscape_in):
    assert landscape_in("a fixed rate").gamma == pytest.approx([50.0])
    assert landscape_in("a fixed time constant").tau_s[0] == pytest.approx([10.0])


def test_minima_are_lower_than_all_around_them_and_the_best_comes_first():
    valleys = np.array([3.0, 1.0, 1.0, 2.0, 5.0, 1.2, 4.0, 9.0, 8.0])
    taus = np.geomspace(1, 100, len(valleys))
    landscape = Landscape((taus,), None, valleys, np.ones((2, len(valleys))))
    assert landscape.minima(1.5) == [(1,), (5,)]
    assert landscape.minima(10) == [(1,), (5,), (8,)]


def test_records_together_have_the_landscape_of_their_joint_error(bundled_cell):
    records = [drive_record("gaps", 300, 1), drive_record("gaps", 200, 2, "backward")]
    problem = make_problem(records, bundled_cell, "so-rc", window=KNOWN_SOC)
    landscape = landscape_of(ConstantObjective.of(problem))
    low, high = np.full(3, R_BOX[0]), np.full(3, R_BOX[1])
    scale = 2 / bundled_cell.capacity_ah
    for point in some_points(landscape, 4):
        taus = landscape.circuit(point).tau_s
        expected = least_rmse(problem, low * scale, high * scale, taus, None)
        assert landscape.rmse_v[point] == pytest.approx(expected, rel=1e-8)

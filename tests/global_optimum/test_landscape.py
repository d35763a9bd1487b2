"""The least errors at time constants, against SciPy's bounded least squares on simulations."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from barnax.cell import CircuitParameters
from barnax.global_optimum.objective import ConstantObjective
from barnax.model.descent import GridSizes, lowest_scales, minima_of
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


def errors_of(problem, resistances, taus, gamma):
    """The error at every scored sample of every record, by simulation."""
    r0, *r = (float(each) for each in resistances)
    circuit = CircuitParameters.constant(r0, tuple(r), tuple(np.divide(taus, r).tolist()), gamma)
    evaluations = [evaluate(each, circuit) for each in problem.prepared_records]
    return np.concatenate([each.error_v[each.prepared.scored] for each in evaluations])


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


def some_scales(objective, count, seed=0):
    """Scales in the box, those of interchangeable pairs in order."""
    low, high = np.transpose([[axis.low, axis.high] for axis in objective.axes])
    found = np.random.default_rng(seed).uniform(low, high, (count, len(low)))
    found[:, : objective.interchangeable].sort(axis=1)
    return found


def resistance_limits(bounds, tau_s):
    """Least and greatest resistances at some time constants, capacitances' bounds included."""
    names = [f"R{index} [Ohm]" for index in range(bounds.pairs + 1)]
    names += [f"C{pair + 1} [F]" for pair in range(bounds.pairs)]
    given = bounds.ranges | {name: (value, value) for name, value in bounds.fixed.items()}
    ends = [given.get(name) for name in names]
    low, high = np.transpose(ends[: bounds.pairs + 1])
    for pair, (tau, c) in enumerate(zip(tau_s, ends[bounds.pairs + 1 :], strict=True), 1):
        if c is not None:
            low[pair] = max(low[pair], tau / c[1])
            high[pair] = max(low[pair], min(high[pair], tau / c[0]))
    return low, high


@pytest.mark.parametrize("case", CASES)
def test_everywhere_it_is_the_circuit_with_the_least_error_of_all_resistances_in_the_box(
    problem_of, case
):
    problem = problem_of(case)
    objective = ConstantObjective.of(problem)
    scales = some_scales(objective, 5)
    for log_scales, least_v2 in zip(scales, objective.least_v2(scales.T), strict=True):
        circuit = objective.circuit(objective.solve(tuple(log_scales), exact=True))
        expected = least_rmse(
            problem, *resistance_limits(problem.bounds, circuit.tau_s), circuit.tau_s, circuit.gamma
        )
        assert np.sqrt(least_v2) == pytest.approx(expected, rel=1e-8)
        errors_v = errors_of(problem, (circuit.r0, *circuit.r), circuit.tau_s, circuit.gamma)
        own_v = np.sqrt(np.mean(errors_v**2))
        assert np.sqrt(least_v2) == pytest.approx(own_v, rel=1e-8)
        values = named_values(circuit)
        for name, (low, high) in problem.bounds.ranges.items():
            assert low * (1 - 1e-12) <= values[name] <= high * (1 + 1e-12)
        for name, value in problem.bounds.fixed.items():
            assert values[name] == pytest.approx(value, rel=1e-12)


def test_minima_of_the_grid_are_in_order_and_the_best_comes_first(problem_of):
    objective = ConstantObjective.of(problem_of("two pairs"))
    starts = lowest_scales(objective, GridSizes({2: 48}, {}, 1), apart=False)
    least_v2 = objective.least_v2(np.transpose(starts))
    assert all(fast <= slow for fast, slow in starts)
    assert np.all(np.diff(least_v2) >= 0)
    assert least_v2[0] <= np.min(objective.least_v2(some_scales(objective, 400).T)) * 1.05


@pytest.mark.parametrize(
    ("case", "axis", "value"), [("a fixed rate", 2, 50.0), ("a fixed time constant", 0, 10.0)]
)
def test_a_fixed_value_is_one_point_of_its_axis(problem_of, case, axis, value):
    objective = ConstantObjective.of(problem_of(case))
    found = lowest_scales(objective, GridSizes({2: 8}, {2: 8}, 8), apart=False)
    assert [scales[axis] for scales in found] == pytest.approx([np.log(value)] * len(found))


def test_minima_are_lower_than_all_around_them_and_the_best_comes_first():
    valleys = np.array([3.0, 1.0, 1.0, 2.0, 5.0, 1.2, 4.0, 9.0, 8.0])
    assert minima_of(valleys, 1.5) == [(1,), (5,)]
    assert minima_of(valleys, 10) == [(1,), (5,), (8,)]


def test_records_together_have_their_joint_error(bundled_cell):
    records = [drive_record("gaps", 300, 1), drive_record("gaps", 200, 2, "backward")]
    problem = make_problem(records, bundled_cell, "so-rc", window=KNOWN_SOC)
    objective = ConstantObjective.of(problem)
    low, high = np.full(3, R_BOX[0]), np.full(3, R_BOX[1])
    scale = 2 / bundled_cell.capacity_ah
    scales = some_scales(objective, 4)
    for log_scales, least_v2 in zip(scales, objective.least_v2(scales.T), strict=True):
        expected = least_rmse(problem, low * scale, high * scale, np.exp(log_scales), None)
        assert np.sqrt(least_v2) == pytest.approx(expected, rel=1e-8)

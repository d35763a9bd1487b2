"""The proved bound: never above what any circuit reaches, and as close as it claims."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import lsq_linear

from barnax import CircuitParameters, Window, evaluate
from barnax.global_optimum.certificate import CERTIFIED_GAP, certify
from barnax.global_optimum.objective import ConstantObjective
from barnax.global_optimum.proof import THIRD_DERIVATIVE, lowest_of_parabola
from barnax.global_optimum.search import GRID
from barnax.model.descent import GridSizes, lowest_scales, minima_of
from barnax.model.problem import make_problem, rmse_by_scan
from barnax.model.search_space import Bounds
from barnax.uncertainty.covariance import named_values
from helpers.problems import drive_record
from helpers.reference import banded_response, make_record

KNOWN_SOC = Window(initial_soc=0.6)
MANY = 20_000


def made_record(seed, noise_v=1e-3, samples=300):
    """Steps and rests on an uneven clock; two relaxations, noise, and a drift that none can fit."""
    rng = np.random.default_rng(seed)
    time_s = np.append(
        0.0, np.cumsum(rng.choice([1.0, 1.016, 25.0], samples - 1, p=[0.6, 0.38, 0.02]))
    )
    current_a = np.repeat(rng.choice([0.0, 0.5, 3.0, -1.5], samples // 10 + 1), 10)[:samples]
    r, tau = rng.uniform(0.002, 0.05, 3), np.exp(rng.uniform(0.0, 6.5, 2))
    drop_v = r[0] * current_a
    for each, tau_s in zip(r[1:], tau, strict=True):
        drop_v = drop_v + each * banded_response(time_s, current_a, tau_s)
    drift_v = noise_v * (np.sin(time_s / rng.uniform(30, 300)) + rng.standard_normal(samples))
    return make_record(time_s, current_a, 3.7 - drop_v + drift_v)


def made_problem(cell, seed=0, circuit="so-rc", noise_v=1e-3, window=KNOWN_SOC, **given):
    return make_problem(made_record(seed, noise_v), cell, circuit, window=window, **given)


def reduced_problem(*given, **more) -> ConstantObjective:
    return ConstantObjective.of(made_problem(*given, **more))


def least_error(reduced, place):
    """The least RMSE at some time constants, by SciPy."""
    columns = [
        axis.columns(np.array([at]))[0, :, 0] for axis, at in zip(reduced.axes, place, strict=True)
    ]
    matrix = np.column_stack([reduced.current, *columns])
    low, high = (end[:, 0] for end in reduced.coefficient_box(np.array(place)[:, None]))
    free = high > low
    base = reduced.base + matrix[:, ~free] @ low[~free]
    actual = lsq_linear(matrix[:, free], -base, (low[free], high[free]), method="bvls", tol=1e-14)
    return np.sqrt(2 * actual.cost)


def lowest_on_grid(reduced):
    """The scales of the lowest point of the search's grid, and its RMSE in V."""
    (lowest, *_) = lowest_scales(reduced, GRID, apart=False)
    return lowest, float(np.sqrt(reduced.least_v2(np.array([lowest]).T)[0]))


def random_scales(reduced, count, seed):
    """Places in the box, half of them near the lowest point of a grid."""
    rng = np.random.default_rng(seed)
    low, high = np.array([[axis.low, axis.high] for axis in reduced.axes]).T
    anywhere = rng.uniform(low, high, (count, len(low)))
    near = lowest_on_grid(reduced)[0] + 0.3 * rng.standard_normal((count, len(low)))
    return np.concatenate([anywhere, np.clip(near, low, high)])


def proved(reduced, rmse_v, max_boxes=MANY):
    """What is proved from that error on; a better circuit counts with its own."""

    def polish(log_scales):
        circuit = reduced.circuit(reduced.solve(log_scales))
        return SimpleNamespace(rmse_v=least_error(reduced, np.array(log_scales)), circuit=circuit)

    return certify(reduced, SimpleNamespace(rmse_v=rmse_v, circuit=None), polish, max_boxes)


def test_the_third_derivative_of_a_pairs_kernel_is_bounded():
    # In z = s / tau the kernel is z exp(-z), and a derivative in log(tau) is -z d/dz.
    def integrand(z):
        return abs(1 - 7 * z + 6 * z**2 - z**3) * np.exp(-z)

    exact = sum(quad(integrand, a, b)[0] for a, b in [(0, 0.2), (0.2, 1.5), (1.5, 5), (5, 80)])
    assert exact == pytest.approx(THIRD_DERIVATIVE, rel=1e-5)
    assert exact < THIRD_DERIVATIVE


@pytest.mark.parametrize("tau", [0.7, 3.0, 20.0, 150.0, 900.0])
def test_no_response_s_third_derivative_exceeds_its_bound(bundled_cell, tau):
    problem = made_problem(bundled_cell, 3, "1rc")
    record, step = problem.prepared.record, 1e-2
    responses = [
        banded_response(record.time_s, record.current_a, tau * np.exp(k * step))
        for k in (-2, -1, 1, 2)
    ]
    third = (responses[3] - 2 * responses[2] + 2 * responses[1] - responses[0]) / (2 * step**3)
    bound = ConstantObjective.of(problem).remainders[0][0, 0]
    assert np.sqrt(np.mean(third**2)) < bound


def test_the_current_some_time_before_the_scored_samples_never_exceeds_its_bound(bundled_cell):
    window = replace(KNOWN_SOC, score_from_s=40.0, score_to_s=200.0)
    problem = made_problem(bundled_cell, 5, "1rc", window=window)
    prepared = problem.prepared
    bound = ConstantObjective.of(problem).remainders[0][0, 0] / THIRD_DERIVATIVE
    scored_s = prepared.time_s[prepared.scored]
    for lag_s in np.random.default_rng(0).uniform(0, 200, 400):
        interval = np.searchsorted(prepared.time_s, scored_s - lag_s, side="right") - 1
        earlier_a = np.where(interval >= 0, prepared.held_a[interval], 0.0)
        assert np.sqrt(np.mean(earlier_a**2)) <= bound


@given(
    wave=st.floats(0.1, 8.0),
    phase=st.floats(0.0, 6.3),
    wrong=st.floats(0.0, 0.3),
    boxes=st.integers(0, 40),
)
def test_what_a_response_does_between_the_three_scales_is_allowed_for(wave, phase, wrong, boxes):
    # One number that is 2 + r sin(wave u + phase), computed up to `wrong`; no circuit's response is
    # as wild, so the boxes are wide for it.
    def columns(log_scales):
        return np.sin(wave * log_scales + phase)[:, None, None] + wrong

    axis = SimpleNamespace(low=0.0, high=8.0, columns=columns)
    resistances = {"R0 [Ohm]": (0.1, 0.2), "R1 [Ohm]": (0.5, 1.0), "tau1 [s]": (1.0, np.exp(8.0))}
    box = Bounds(resistances, resistances["tau1 [s]"], elements=("rc",))
    reduced = ConstantObjective(np.array([2.0]), np.array([0.0]), (axis,), box, (), 0)
    vars(reduced)["remainders"] = [np.array([[wave**3], [wrong]])]
    places = np.linspace(0.0, 8.0, 20_001)
    sine = np.min(np.sin(wave * places + phase))
    lowest = 2 + min(0.5 * sine, sine)
    assert proved(reduced, 0.9 * lowest, boxes).lower_bound_v <= lowest


@settings(max_examples=12, suppress_health_check=[HealthCheck.too_slow])
@given(
    seed=st.integers(0, 10_000),
    noise_v=st.sampled_from([1e-2, 1e-3, 1e-5]),
    max_boxes=st.sampled_from([0, 100, MANY]),
    changes=st.sampled_from(
        [
            {},
            {"circuit": "1rc"},
            {"bounds": {"R1 [Ohm]": (1e-4, 3e-3), "R0 [Ohm]": (0.03, 0.2)}},
            {"bounds": {"tau1 [s]": (2.0, 9.0), "tau2 [s]": (1.0, 400.0)}},
            {"bounds": {"C1 [F]": (100.0, 900.0)}},
            {"fixed": {"C2 [F]": 4000.0}},
            {"fixed": {"tau2 [s]": 60.0, "R0 [Ohm]": 0.02}},
        ]
    ),
)
def test_no_circuit_beats_the_bound(bundled_cell, seed, noise_v, max_boxes, changes):
    reduced = reduced_problem(bundled_cell, seed, noise_v=noise_v, **changes)
    lowest_v = lowest_on_grid(reduced)[1]
    proof = proved(reduced, lowest_v, max_boxes)
    bound_v = proof.lower_bound_v
    for log_scales in random_scales(reduced, 15, seed):
        assert least_error(reduced, log_scales) >= bound_v
    if max_boxes == MANY:
        assert proof.boxes < MANY
        assert bound_v >= proof.best.rmse_v * (1 - 1.01 * CERTIFIED_GAP)
        again = proved(reduced, lowest_v, max_boxes)
        assert (again.lower_bound_v, again.boxes) == (bound_v, proof.boxes)


@pytest.mark.parametrize("circuit", ["3rc", "esc"])
def test_three_pairs_and_dynamic_hysteresis_are_proved_too(bundled_cell, circuit):
    reduced = reduced_problem(bundled_cell, 1, circuit)
    lowest_v = lowest_on_grid(reduced)[1]
    proof = proved(reduced, lowest_v)
    least_v = proof.best.rmse_v * (1 - 1.01 * CERTIFIED_GAP)
    assert least_v <= proof.lower_bound_v <= lowest_v


def test_a_better_basin_is_met_and_is_really_better(bundled_cell):
    problem = made_problem(bundled_cell)
    reduced = ConstantObjective.of(problem)
    worse_v = 1.2 * lowest_on_grid(reduced)[1]
    proof = proved(reduced, worse_v)
    (better_v,) = rmse_by_scan(problem, [proof.best.circuit])
    assert proof.lower_bound_v <= better_v < worse_v


def test_a_straight_line_is_lowest_at_an_end_however_large_the_current():
    """Of a cell of hundreds of ampere-hours; a warning of NumPy fails the test."""
    below, middle, above = np.array([[-300.0, 3e150], [0.0, 2e150], [300.0, 1e150]])
    assert lowest_of_parabola(below, middle, above).tolist() == [-300.0, 1e150]


# The least errors at time constants, against SciPy's bounded least squares on simulations.


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
    actual = lsq_linear(columns[:, free], target, (low[free], high[free]), method="bvls", tol=1e-14)
    return np.sqrt(2 * actual.cost / len(base))


def some_scales(objective, count, seed=0):
    """Scales in the box, those of interchangeable pairs in order."""
    low, high = np.transpose([[axis.low, axis.high] for axis in objective.axes])
    points = np.random.default_rng(seed).uniform(low, high, (count, len(low)))
    points[:, : objective.interchangeable].sort(axis=1)
    return points


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
    actual = lowest_scales(objective, GridSizes({2: 8}, {2: 8}, 8), apart=False)
    assert [scales[axis] for scales in actual] == pytest.approx([np.log(value)] * len(actual))


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

"""The bound of a box of time constants against its formula, one resistance at a time."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from barnax import Window, make_problem
from barnax.global_optimum.certificate import _bound
from barnax.global_optimum.objective import ConstantObjective
from barnax.global_optimum.proof import THIRD_DERIVATIVE, beyond_parabola
from helpers.problems import drive_record

BOXES = [[(1.0, 1.3), (4.0, 4.5)], [(0.2, 0.9), (2.0, 3.0)], [(2.0, 2.1), (5.5, 5.6)]]


BOUNDS = {
    "free": {},
    "bounded": {"R1 [Ohm]": (1e-3, 8e-3), "R0 [Ohm]": (0.001, 0.02)},
    "by capacitance": {"C1 [F]": (100.0, 900.0)},
}


@pytest.fixture(scope="module", params=BOUNDS)
def objective(request, bundled_cell):
    given = {"window": Window(initial_soc=0.6), "bounds": BOUNDS[request.param]}
    record = drive_record("uneven", 300, seed=4)
    return ConstantObjective.of(make_problem(record, bundled_cell, "so-rc", **given))


def best_error(objective, matrix, box, tilt=0.0):
    """The error of the best resistances at the middle of a box, less a linear reward for each."""
    low, high = box
    root = np.linalg.cholesky(matrix.T @ matrix).T
    target = -np.linalg.solve(root.T, matrix.T @ objective.base - tilt)
    ohm = lsq_linear(root, target, (low, high), method="bvls", tol=1e-15).x
    return objective.base + matrix @ ohm


def bound_by_hand(objective, error, places, allowed):
    """y.base with the least of r y.phi over every resistance and every scale of the box, and what
    y.phi loses over that: phi is a parabola of the scale, but for its remainder."""
    unit = error / np.linalg.norm(error)
    value, lost = unit @ objective.base, [0.0]
    slope = unit @ objective.current
    value += min(allowed[0][0] * slope, allowed[1][0] * slope)
    for number, (axis, (low, high)) in enumerate(zip(objective.axes, places, strict=True), 1):
        three = [
            unit @ axis.columns(np.array([at]))[0, :, 0] for at in (low, (low + high) / 2, high)
        ]
        third, rounding = objective.remainders[number - 1][:, 0]
        curve = np.polynomial.Polynomial.fit([-1, 0, 1], three, 2, domain=[-1, 1])
        turns = [np.real(at) for at in curve.deriv().roots() if np.isreal(at) and abs(at) < 1]
        least = min(curve(at) for at in [-1.0, 1.0, *turns])
        least -= third * ((high - low) / 2) ** 3 / (9 * np.sqrt(3)) + 1.25 * rounding
        value += min(allowed[0][number] * least, allowed[1][number] * least)
        lost.append(three[1] - least)
    return value, np.array(lost)


@pytest.mark.parametrize("places", BOXES)
def test_the_bound_of_a_box_is_the_better_of_two_directions(objective, places):
    ends = np.array(places)
    low, middle, high = ends[:, 0], ends.mean(axis=1), ends[:, 1]
    at_low, box, at_high = (
        [limit[:, 0] for limit in objective.coefficient_box(at[:, None])]
        for at in (low, middle, high)
    )
    allowed = at_low[0], at_high[1]
    axes = zip(objective.axes, middle, strict=True)
    answers = [axis.columns(np.array([at]))[0, :, 0] for axis, at in axes]
    matrix = np.column_stack([objective.current, *answers])
    error = best_error(objective, matrix, box)
    plain_v, lost = bound_by_hand(objective, error, places, allowed)
    # With so much slope in the error that the box cannot take it.
    error = best_error(objective, matrix, box, 1.05 * np.linalg.norm(error) * lost)
    tilted_v, _ = bound_by_hand(objective, error, places, allowed)
    bounds_v, _, _ = _bound(objective, ends[None], 0.0)
    assert bounds_v[0] == pytest.approx(max(plain_v, tilted_v), rel=1e-6, abs=1e-9)


def test_the_remainder_is_that_of_the_current_before_every_sample(objective):
    (prepared,) = objective.prepared_records
    held_a, time_s = prepared.held_a, prepared.time_s
    # Lengths are rounded up to eighths of an octave.
    runs_s = 2 ** (np.ceil(8 * np.log2(np.diff(time_s))) / 8)
    most = {
        run_s: max(np.sum((time_s >= start) & (time_s < start + run_s)) for start in time_s)
        for run_s in set(runs_s.tolist())
    }
    total = sum(
        most[run_s] * each**2 for run_s, each in zip(runs_s.tolist(), held_a[:-1], strict=True)
    )
    largest_a = np.max(np.abs(held_a))
    rms_a = min(largest_a, np.sqrt(total / len(time_s)))
    for axis, bounds in zip(objective.axes, objective.remainders, strict=True):
        third, rounding = bounds[:, 0]
        assert third == pytest.approx(THIRD_DERIVATIVE * rms_a, rel=1e-12)
        assert rounding == pytest.approx(axis.span.error * largest_a, rel=1e-12)


def test_between_three_points_a_parabola_is_off_by_its_remainder_and_their_errors():
    at = np.linspace(-1, 1, 200_001)
    # A cubic and the parabola through it differ by a sixth of its third derivative times these.
    beyond = np.max(np.abs((at + 1) * at * (at - 1))) / 6
    shares = at * (at - 1) / 2, 1 - at**2, at * (at + 1) / 2
    adding_up = np.max(sum(map(np.abs, shares)))
    bounds = beyond_parabola(np.array([[2.0], [0.3]]), np.array([0.5]))
    assert bounds[0] == pytest.approx(2.0 * 0.5**3 * beyond + 0.3 * adding_up, rel=1e-8)

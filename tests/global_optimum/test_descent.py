"""The descent from the landscape's minima: its slopes, and where pairs are one."""

import numpy as np
import pytest

from barnax import Window, make_problem
from barnax.global_optimum.objective import ConstantObjective
from barnax.model.descent import polish

IN_FARAD = {"R0 [Ohm]": (1e-3, 0.03), "C1 [F]": (100.0, 300.0), "C2 [F]": (2000.0, 9000.0)}


@pytest.mark.parametrize("bounds", [{}, IN_FARAD])
@pytest.mark.parametrize("model", ["so-rc", "esc"])
def test_slopes_are_those_of_differences(bundled_record, bundled_cell, model, bounds):
    window = Window(score_to_s=3000.0)
    problem = make_problem(bundled_record, bundled_cell, model, window=window, bounds=bounds)
    objective = ConstantObjective.of(problem)
    at = np.array([axis.low + 0.4 * (axis.high - axis.low) for axis in objective.axes])
    at[1] += 0.5
    actual = objective.solve(tuple(at))
    assert actual.active_set.any() or not bounds
    for index, slope in enumerate(objective.slope(actual)):
        moved = 1e-5 * np.eye(len(at))[index]
        up, down = (
            objective.solve(tuple(at + sign * moved), actual.active_set) for sign in (1, -1)
        )
        expected = (up.objective_v2 - down.objective_v2) / 2e-5
        assert slope == pytest.approx(expected, rel=1e-4, abs=1e-10)


def test_pairs_with_one_time_constant_are_one_pair(bundled_record, bundled_cell):
    window = Window(score_to_s=3000.0)
    two, one = (
        ConstantObjective.of(make_problem(bundled_record, bundled_cell, model, window=window))
        for model in ("so-rc", "1rc")
    )
    start, alone = two.solve((3.0, 3.0)), one.solve((3.0,))
    assert start.objective_v2 == pytest.approx(alone.objective_v2, rel=1e-9)
    assert start.unknowns[1:].sum() == pytest.approx(alone.unknowns[1], rel=1e-6)
    assert polish(two, start).objective_v2 < alone.objective_v2

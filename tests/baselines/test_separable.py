"""Variable projection against SciPy on the whole problem."""

from dataclasses import replace

import numpy as np
import pytest

from barnax import METHODS, Budget, CircuitParameters, evaluate, make_problem
from helpers.reference import drop_v, filtered_response, fit_circuit

NOISY = (0.05, (0.02, 0.03), (8.0, 90.0))


def varpro(problem):
    (answer,) = METHODS["varpro"].run(problem, Budget(), lambda gained: None)
    return answer


def test_it_meets_scipys_optimum_of_the_whole_problem(filtered_problem):
    problem = filtered_problem(NOISY, noise_v=2e-3)
    prepared, ranges = problem.prepared, problem.bounds.ranges
    names = ("R0 [Ohm]", "R1 [Ohm]", "R2 [Ohm]", "tau1 [s]", "tau2 [s]")
    lower, upper = np.transpose([ranges[name] for name in names])

    def drop_of(r0, r, tau_s):
        return drop_v(filtered_response, 1.0, prepared.current_a, (r0, r, tau_s))

    base_v = prepared.source_v - prepared.voltage_v
    rmse_v, (r0, r1, r2, tau1, tau2) = fit_circuit(
        drop_of, base_v, prepared.scored, lower, upper, starts=4
    )
    answer = varpro(problem)
    assert answer.rmse_v == pytest.approx(rmse_v, rel=1e-9)
    actual = answer.parameters
    assert [actual.r0, *actual.r, *actual.tau_s] == pytest.approx(
        [r0, r1, r2, tau1, tau2], rel=1e-4
    )


def test_it_finds_the_rate_of_a_dynamic_hysteresis(short_problem, bundled_record, bundled_cell):
    made = CircuitParameters.constant(0.05, (0.02, 0.03), (400.0, 3000.0), 120.0)
    window = short_problem.prepared.window
    problem = make_problem(bundled_record, bundled_cell, "esc", window=window)
    simulated_v = bundled_record.voltage_v.copy()
    simulated_v[problem.prepared.span] = evaluate(problem.prepared, made).simulated_v
    record = replace(bundled_record, voltage_v=simulated_v)
    window = replace(window, initial_soc=problem.prepared.start.soc)
    answer = varpro(make_problem(record, bundled_cell, "esc", window=window))
    assert answer.parameters.to_dict() == pytest.approx(made.to_dict(), rel=1e-3)


@pytest.mark.parametrize(
    ("bounds", "fixed"),
    [
        pytest.param({"R1 [Ohm]": (0.001, 0.01)}, {}, marks=pytest.mark.slow),
        ({"C1 [F]": (100.0, 300.0)}, {}),
        pytest.param({}, {"C2 [F]": 2000.0}, marks=pytest.mark.slow),
        ({}, {"tau1 [s]": 5.0, "R2 [Ohm]": 0.02}),
    ],
)
def test_bounds_and_fixed_values_hold_exactly(bounds, fixed, filtered_problem):
    problem = filtered_problem(NOISY, noise_v=1e-3, bounds=bounds, fixed=fixed)
    answer = varpro(problem)
    values = answer.parameters.to_dict() | answer.parameters.named_tau_s
    for name, (low, high) in problem.bounds.ranges.items():
        assert low * (1 - 1e-9) <= values[name] <= high * (1 + 1e-9)
    for name, value in fixed.items():
        assert values[name] == pytest.approx(value, rel=1e-9)

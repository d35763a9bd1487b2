"""Refits against the scan, and profiles against SciPy's refits."""

from dataclasses import replace

import numpy as np
import pytest

from barnax.cell import CircuitParameters
from barnax.errors import InputError
from barnax.model.problem import make_problem, rmse_by_scan
from barnax.model.window import Window
from barnax.uncertainty import Refit, profile
from helpers.noisy_fits import TRUTH, fit, made_problem, white_noise


@pytest.fixture(scope="module")
def jointly(short_problem):
    """One circuit under two voltages of the same current."""
    first, second = (made_problem(short_problem, white_noise(seed)) for seed in (0, 1))
    return replace(first, prepared_records=(*first.prepared_records, *second.prepared_records))


@pytest.fixture(scope="module")
def turning(short_problem):
    """A problem with dynamic hysteresis."""
    prepared = short_problem.prepared
    window = Window(initial_soc=prepared.start.soc, score_from_s=200.0, score_to_s=1500.5)
    return make_problem(prepared.record, short_problem.cell, "esc", window=window)


@pytest.mark.parametrize("kind", ["jointly", pytest.param("turning", marks=pytest.mark.slow)])
def test_the_error_of_a_held_circuit_is_the_scan_s(kind, request):
    problem = request.getfixturevalue(kind)
    gamma = 30.0 if problem.bounds.has_rate else None
    circuit = CircuitParameters.constant(TRUTH.r0, TRUTH.r, TRUTH.c, gamma)
    refit = Refit(problem)
    point = refit.encode(circuit)
    ends = refit(point[None], matrix=np.zeros((len(point), len(point))), shift=point[None])
    assert ends.points[0] == pytest.approx(point)
    assert ends.rmse_v[0] == pytest.approx(rmse_by_scan(problem, [circuit])[0], rel=1e-7)


def test_another_voltage_is_fitted_as_if_it_were_the_record_s(short_problem):
    problem = made_problem(short_problem, white_noise(0))
    changed = made_problem(short_problem, white_noise(1))
    refit, own = Refit(problem), Refit(changed)
    start = refit.encode(TRUTH)[None]
    foreign = refit(start, base_v=refit.voltages.project(own.voltages.own_v[None]))
    np.testing.assert_allclose(foreign.points, own(start).points, rtol=1e-5)
    np.testing.assert_allclose(foreign.rmse_v, own(start).rmse_v, rtol=1e-8)


def test_how_many_fits_run_at_a_time_changes_no_bit(short_problem):
    problem = made_problem(short_problem, white_noise(0))
    refit = Refit(problem)
    starts = refit.encode(TRUTH) + 0.1 * np.random.default_rng(2).normal(size=(11, 5))
    together = refit(starts)
    alone = refit(starts[9:10])
    assert np.array_equal(together.points[9], alone.points[0])
    assert together.rmse_v[9] == alone.rmse_v[0]


def test_an_end_that_the_data_leave_open_is_not_made_up(short_problem):
    # Under 300 mV of noise a slower pair of the same capacitance fits as well.
    loose = fit(made_problem(short_problem, white_noise(2, 0.3)))
    assert loose.assessment.uncertainty["tau2 [s]"].held == "at upper bound"
    found = profile(loose.problem, loose.parameters, "tau2 [s]")
    assert found.high is None
    assert max(found.values) <= 1500


def test_a_parameter_the_circuit_does_not_have_is_refused(white):
    with pytest.raises(InputError, match=r"'R7 \[Ohm\]' is not a parameter"):
        profile(white.problem, white.parameters, "R7 [Ohm]", **white.known)


def test_a_held_parameter_has_no_profile(short_problem):
    problem = made_problem(short_problem, white_noise(5), fixed={"tau2 [s]": 120.0})
    with pytest.raises(InputError, match="held: fixed"):
        profile(problem, TRUTH, "tau2 [s]")

"""An examination: what it holds, and its profiles against SciPy's refits."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from barnax.errors import InputError
from barnax.uncertainty import Examination, examine, profile
from helpers.noisy_fits import TRUTH, fit, made_problem, white_noise
from helpers.reference import drop_v, filtered_response


@pytest.fixture(scope="module")
def examination(white) -> Examination:
    return examine(white.problem, white.parameters, white.assessment)


def test_where_little_is_unknown_the_profile_gives_the_linear_interval(white, examination):
    estimates = white.assessment.uncertainty.estimates
    with_errors = [each.name for each in estimates if each.relative_error]
    assert [each.name for each in examination.profiles] == with_errors
    assert len(with_errors) == 7
    assert examination.rmse_v == white.rmse_v
    for actual in examination.profiles:
        linear = white.assessment.uncertainty[actual.name]
        width = np.log(linear.high / linear.low)
        assert np.log(actual.low / linear.low) == pytest.approx(0, abs=0.05 * width)
        assert np.log(actual.high / linear.high) == pytest.approx(0, abs=0.05 * width)
        best = actual.values[np.argmin(actual.rmse_v)]
        assert best == actual.value == pytest.approx(linear.value, rel=1e-9)


@pytest.mark.parametrize("slot", [1, 4])
def test_scipy_refits_the_others_to_the_same_error(slot, white, examination):
    prepared = white.problem.prepared
    name = ["R0 [Ohm]", "R1 [Ohm]", "R2 [Ohm]", "tau1 [s]", "tau2 [s]"][slot]
    (actual,) = [each for each in examination.profiles if each.name == name]
    start = np.log([TRUTH.r0, *TRUTH.r, *TRUTH.tau_s])

    def errors_mv(others, value):
        r0, r1, r2, tau1, tau2 = np.exp(np.insert(others, slot, np.log(value)))
        drop = drop_v(filtered_response, 1.0, prepared.current_a, (r0, (r1, r2), (tau1, tau2)))
        return 1e3 * (prepared.voltage_v - prepared.source_v + drop)

    for place in (1, -2):
        others, value = np.delete(start, slot), actual.values[place]
        fitted = least_squares(errors_mv, others, args=(value,), xtol=1e-14)
        expected_v = 1e-3 * np.sqrt(np.mean(fitted.fun**2))
        assert actual.rmse_v[place] == pytest.approx(expected_v, rel=1e-6)


def test_an_end_that_the_data_leave_open_is_not_made_up(short_problem):
    # Under 300 mV of noise a slower pair of the same capacitance fits as well.
    loose = fit(made_problem(short_problem, white_noise(2, 0.3)))
    assert loose.assessment.uncertainty["tau2 [s]"].held == "at upper bound"
    actual = profile(loose.problem, loose.parameters, "tau2 [s]")
    assert actual.high is None
    assert max(actual.values) <= 1500


def test_a_parameter_that_is_held_or_not_there_has_no_profile(white, short_problem):
    with pytest.raises(InputError, match=r"'R7 \[Ohm\]' is not a parameter"):
        profile(white.problem, white.parameters, "R7 [Ohm]")
    problem = made_problem(short_problem, white_noise(5), fixed={"tau2 [s]": 120.0})
    with pytest.raises(InputError, match="held: fixed"):
        profile(problem, TRUTH, "tau2 [s]")

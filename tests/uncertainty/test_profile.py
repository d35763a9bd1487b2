"""Profiles against SciPy's own refits and, where all is linear, against the linear interval."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from barnax.errors import InputError
from barnax.uncertainty.assessment import assess
from barnax.uncertainty.profile import profile
from barnax.uncertainty.refit import Refit
from reference import drop_v, filtered_response

from .made import TRUTH, cross_check, made_problem


@pytest.fixture(scope="module")
def noisy(short_problem):
    """A known circuit under 1 mV of white noise: its cross-check, assessment and refits."""
    noise_v = np.random.default_rng(5).normal(0, 1e-3, 1501)
    checked = cross_check(made_problem(short_problem, noise_v))
    return checked, assess(checked), Refit(checked.search.problem)


@pytest.mark.parametrize("name", ["R0 [Ohm]", "R1 [Ohm]", "C1 [F]", "tau1 [s]", "C2 [F]"])
def test_where_little_is_unsure_the_profile_gives_the_linear_interval(name, noisy):
    checked, assessment, refit = noisy
    found = profile(checked, name, assessment=assessment, refit=refit)
    linear = assessment.uncertainty[name]
    width = np.log(linear.high / linear.low)
    assert found.low is not None
    assert found.high is not None
    assert np.log(found.low / linear.low) == pytest.approx(0, abs=0.05 * width)
    assert np.log(found.high / linear.high) == pytest.approx(0, abs=0.05 * width)
    assert found.values[np.argmin(found.rmse_v)] == pytest.approx(linear.value, rel=1e-9)


@pytest.mark.parametrize("slot", [1, 4])
def test_scipy_refits_the_others_to_the_same_error(slot, noisy):
    checked, assessment, refit = noisy
    prepared = checked.search.problem.prepared
    name = ["R0 [Ohm]", "R1 [Ohm]", "R2 [Ohm]", "tau1 [s]", "tau2 [s]"][slot]
    found = profile(checked, name, assessment=assessment, refit=refit)
    start = np.log([TRUTH.r0, *TRUTH.r, *TRUTH.tau_s])

    def errors_mv(others, value):
        r0, r1, r2, tau1, tau2 = np.exp(np.insert(others, slot, np.log(value)))
        drop = drop_v(filtered_response, 1.0, prepared.current_a, (r0, (r1, r2), (tau1, tau2)))
        return 1e3 * (prepared.voltage_v - prepared.source_v + drop)

    for value, rmse_v in zip(found.values[[1, -2]], found.rmse_v[[1, -2]], strict=True):
        fit = least_squares(errors_mv, np.delete(start, slot), args=(value,), xtol=1e-14)
        assert rmse_v == pytest.approx(1e-3 * np.sqrt(np.mean(fit.fun**2)), rel=1e-6)


def test_an_end_that_the_data_leave_open_is_not_made_up(short_problem):
    # Under 300 mV of noise a slower pair of the same capacitance fits as well.
    noise_v = np.random.default_rng(2).normal(0, 0.3, 1501)
    checked = cross_check(made_problem(short_problem, noise_v))
    assert checked.at_bound == ("tau2 [s] at its upper bound",)
    found = profile(checked, "tau2 [s]")
    assert found.high is None
    assert found.values.max() <= 1500
    assert "known" in found.words or "no value" in found.words


def test_a_parameter_the_circuit_does_not_have_is_refused(noisy):
    with pytest.raises(InputError, match=r"'R7 \[Ohm\]' is no parameter"):
        profile(noisy[0], "R7 [Ohm]", assessment=noisy[1], refit=noisy[2])


def test_a_held_parameter_has_no_profile(short_problem):
    problem = made_problem(short_problem, np.zeros(1501), fixed={"tau2 [s]": 120.0})
    with pytest.raises(InputError, match="held: fixed"):
        profile(cross_check(problem), "tau2 [s]")


def test_the_stored_profile_is_plain(noisy):
    stored = profile(noisy[0], "R0 [Ohm]", assessment=noisy[1], refit=noisy[2]).to_dict()
    assert len(stored["values"]) == len(stored["rmse [V]"])
    assert stored["low"] < stored["value"] < stored["high"]

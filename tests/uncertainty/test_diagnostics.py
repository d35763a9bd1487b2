"""Bands and correlations of residuals against plain NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from barnax.uncertainty.assessment import assess
from barnax.uncertainty.diagnostics import diagnostics

from .made import colored_noise, cross_check, made_problem


@pytest.fixture(scope="module")
def colored(short_problem):
    """A known circuit under noise that remembers 12 s, and its assessment."""
    noise_v = colored_noise(np.random.default_rng(8), 1501, 12.0, 1e-3)[0]
    checked = cross_check(made_problem(short_problem, noise_v))
    return checked, assess(checked)


@pytest.mark.parametrize("bands", ["by_soc", "by_current"])
def test_bands_share_out_all_samples_and_all_squared_error(bands, colored):
    found = getattr(colored[1].diagnostics, bands)
    assert sum(band.samples for band in found) == 1501
    assert sum(band.share for band in found) == pytest.approx(1.0)
    squares = sum(band.samples * band.rmse_v**2 for band in found)
    assert np.sqrt(squares / 1501) == pytest.approx(colored[0].rmse_v)


def test_a_band_holds_the_errors_of_its_samples(colored):
    checked, assessment = colored
    prepared = checked.search.problem.prepared
    error_v = assessment.linearization.error_v
    (rest,) = [band for band in assessment.diagnostics.by_current if band.label == "rest"]
    inside = np.abs(prepared.current_a) < prepared.rest_current_a
    assert rest.samples == np.count_nonzero(inside)
    assert rest.mean_v == pytest.approx(np.mean(error_v[inside]))
    (top,) = [b for b in assessment.diagnostics.by_soc if b.label == "90 to 100 %"]
    assert top.samples == np.count_nonzero(prepared.soc >= 0.9)


def test_the_autocorrelation_is_the_residuals_own(colored):
    found = colored[1].diagnostics
    error_v = colored[1].linearization.error_v
    at_one = np.mean(error_v[1:] * error_v[:-1]) / np.mean(error_v**2)
    assert found.lags_s[:2].tolist() == [0.0, 1.0]
    assert found.autocorrelation[:2] == pytest.approx([1.0, at_one])


def test_the_integrated_time_is_about_twice_the_correlation_time(colored):
    found = colored[1].diagnostics
    assert found.integrated_time_s == pytest.approx(2 * 12.0, rel=0.6)
    assert found.effective_samples == pytest.approx(1501 / found.integrated_time_s, rel=1e-6)


def test_temperature_bands_appear_where_it_was_measured(colored):
    checked, assessment = colored
    assert assessment.diagnostics.by_temperature is None
    problem = checked.search.problem
    prepared = problem.prepared
    degrees = np.linspace(20.0, 26.0, prepared.record.samples)
    record = replace(prepared.record, temperature_degc=degrees)
    warm = replace(problem, prepared_records=(replace(prepared, record=record),))
    again = replace(checked, found=replace(checked.search, problem=warm))
    found = diagnostics(
        again, assessment.linearization, assessment.uncertainty.noise
    ).by_temperature
    assert found is not None
    assert sum(band.samples for band in found) == 1501
    assert found[0].label == "20 to 21 degC"


def test_a_band_that_holds_most_of_the_error_is_worth_a_sentence(short_problem):
    noise_v = np.random.default_rng(0).normal(0, 1e-3, 1501)
    current_a = short_problem.prepared.current_a
    # Large errors at large currents alone.
    noise_v[current_a > 2.0] *= 30
    found = assess(cross_check(made_problem(short_problem, noise_v))).diagnostics
    assert "of the squared error lies at discharge" in found.words

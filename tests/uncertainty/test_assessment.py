"""What an assessment and an examination hold; bands and correlations of residuals by NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from barnax import CircuitParameters, InputError
from barnax.uncertainty import assess, covariance
from barnax.uncertainty.assessment import diagnostics
from helpers.noisy_fits import SAMPLES, fit, made_problem, white_noise


@pytest.mark.parametrize("seed", [1, 3])
def test_where_two_pairs_are_one_every_parameter_has_an_error(short_problem, seed):
    # Rounding then leaves variances below zero where the data determine most.
    same = CircuitParameters.constant(0.05, (0.02, 0.03), (40 / 0.02, 40 / 0.03))
    actual = fit(made_problem(short_problem, white_noise(seed), same), same).assessment
    for estimate in actual.uncertainty.estimates:
        assert estimate.relative_error is not None
    assert actual.uncertainty["R1 [Ohm]"].low is None
    assert actual.uncertainty["R0 [Ohm]"].low is not None


def test_a_time_constant_too_short_to_be_seen_has_no_interval(short_problem):
    problem = made_problem(short_problem, white_noise(0), bounds={"tau1 [s]": (1e-6, 1e-4)})
    fast = CircuitParameters.constant(0.05, (0.02, 0.03), (5e-4, 4000))
    uncertainty = assess(problem, fast).uncertainty
    assert uncertainty["tau1 [s]"].held == "unseen"
    assert uncertainty["R2 [Ohm]"].low is not None


def test_errors_too_large_to_be_squared_are_refused_in_one_message(white, monkeypatch):
    monkeypatch.setattr(covariance, "LARGEST_NUMBER", 0.5 * white.rmse_v)
    with pytest.raises(InputError, match="narrow the bounds"):
        assess(white.problem, white.parameters)


@pytest.mark.parametrize("bands", ["by_soc", "by_current"])
def test_bands_share_out_all_samples_and_all_squared_error(bands, colored):
    actual = getattr(colored.assessment.diagnostics, bands)
    assert sum(band.samples for band in actual) == SAMPLES
    assert sum(band.share for band in actual) == pytest.approx(1.0)
    squares = sum(band.samples * band.rmse_v**2 for band in actual)
    assert np.sqrt(squares / SAMPLES) == pytest.approx(colored.rmse_v)


def test_a_band_holds_the_errors_of_its_samples(colored):
    prepared, actual = colored.problem.prepared, colored.assessment.diagnostics
    error_v = colored.assessment.covariance.linearization.error_v
    rest_c = prepared.rest_current_a / colored.problem.cell.capacity_ah
    (rest,) = [band for band in actual.by_current if band.low == -rest_c and band.high == rest_c]
    inside = np.abs(prepared.current_a) < prepared.rest_current_a
    assert rest.samples == np.count_nonzero(inside)
    assert rest.mean_v == pytest.approx(np.mean(error_v[inside]))
    (top,) = [band for band in actual.by_soc if band.high == 1.0]
    assert top.samples == np.count_nonzero(prepared.soc >= 0.9)
    # Rates are of the capacity that the record was simulated with.
    aged = replace(prepared, capacity_ah=prepared.capacity_ah / 4)
    problem = replace(colored.problem, prepared_records=(aged,))
    rate = 4 * prepared.current_a / prepared.capacity_ah
    for band in diagnostics(problem, colored.assessment.covariance).by_current:
        low, high = band.low or -np.inf, band.high or np.inf
        assert band.samples == np.count_nonzero((rate >= low) & (rate < high))
    informed_v = error_v[colored.assessment.covariance.linearization.is_informative]
    at_one = np.mean(informed_v[1:] * informed_v[:-1]) / np.mean(informed_v**2)
    assert actual.lags_s[:2] == (0.0, 1.0)
    assert actual.autocorrelation[:2] == pytest.approx([1.0, at_one])


def test_temperature_bands_appear_where_it_was_measured(colored):
    assert colored.assessment.diagnostics.by_temperature is None
    prepared = colored.problem.prepared

    def bands_of(degrees):
        record = replace(prepared.record, temperature_degc=degrees)
        warm = replace(colored.problem, prepared_records=(replace(prepared, record=record),))
        return diagnostics(warm, colored.assessment.covariance).by_temperature

    actual = bands_of(np.linspace(20.0, 26.0, prepared.record.samples))
    assert actual
    assert sum(band.samples for band in actual) == SAMPLES
    assert (actual[0].low, actual[0].high) == (20.0, 21.0)
    assert bands_of(np.full(prepared.record.samples, np.nan)) is None

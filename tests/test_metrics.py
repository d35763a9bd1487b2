"""The figures of merit, against their definitions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from barnax.metrics import measure
from shape_checks import unchecked

MEASURED = np.array([3.0, 3.5, 4.0])
SIMULATED = np.array([3.1, 3.5, 3.8])
VOLTAGES = arrays(float, 20, elements=st.floats(2.5, 4.2))


def test_the_rmse_is_the_root_of_the_mean_square():
    assert measure(MEASURED, SIMULATED).rmse_v == pytest.approx(np.sqrt(0.05 / 3), rel=1e-12)


def test_r2_compares_with_the_mean_of_the_measurement():
    assert measure(MEASURED, SIMULATED).r2 == pytest.approx(1 - 0.05 / 0.5, rel=1e-12)


def test_the_papers_r2_compares_with_the_mean_of_the_simulation():
    # Eq. 24 as printed: deviations 3.0, 3.5, 4.0 from 10.4 / 3.
    spread = (9 - 10.4) ** 2 / 9 + (10.5 - 10.4) ** 2 / 9 + (12 - 10.4) ** 2 / 9
    assert measure(MEASURED, SIMULATED).r2_paper == pytest.approx(1 - 0.05 / spread, rel=1e-12)


def test_mape_is_relative_to_the_measurement_in_percent():
    expected = 100 * (0.1 / 3 + 0.2 / 4) / 3
    assert measure(MEASURED, SIMULATED).mape_percent == pytest.approx(expected, rel=1e-12)


def test_the_cumulative_error_adds_all_magnitudes():
    assert measure(MEASURED, SIMULATED).ce_v == pytest.approx(0.3, rel=1e-12)


def test_the_maximum_error_is_a_magnitude():
    assert measure(SIMULATED, MEASURED).max_v == pytest.approx(0.2, rel=1e-12)


def test_samples_are_counted():
    assert measure(MEASURED, SIMULATED).samples == 3


def test_a_perfect_simulation_has_no_error():
    metrics = measure(MEASURED, MEASURED)
    assert (metrics.rmse_v, metrics.ce_v, metrics.max_v, metrics.mape_percent) == (0, 0, 0, 0)
    assert metrics.r2 == metrics.r2_paper == 1


@given(VOLTAGES, VOLTAGES)
def test_the_papers_denominator_is_larger_by_the_squared_bias(measured_v, simulated_v):
    # Variance plus bias^2, so the printed R2 is never the smaller of the two.
    metrics = measure(measured_v, simulated_v)
    squares = metrics.rmse_v**2 * 20
    spread = 20 * np.var(measured_v)
    biased = spread + 20 * np.mean(measured_v - simulated_v) ** 2
    if spread > 1e-6 and squares > 0:
        assert metrics.r2 == pytest.approx(1 - squares / spread, rel=1e-6, abs=1e-9)
        assert metrics.r2_paper == pytest.approx(1 - squares / biased, rel=1e-6, abs=1e-9)
        assert metrics.r2_paper >= metrics.r2 - 1e-12


@given(VOLTAGES, VOLTAGES)
def test_no_mean_exceeds_the_maximum(measured_v, simulated_v):
    metrics = measure(measured_v, simulated_v)
    assert metrics.ce_v / 20 <= metrics.rmse_v * (1 + 1e-9) + 1e-15
    assert metrics.rmse_v <= metrics.max_v * (1 + 1e-9)


def test_a_flat_record_that_is_missed_has_no_r2():
    assert measure(np.full(3, 3.7), np.full(3, 3.6)).r2 == -np.inf


def test_a_flat_record_that_is_met_is_explained():
    assert measure(np.full(3, 3.7), np.full(3, 3.7)).r2 == 1.0


def test_different_lengths_are_refused_with_both_shapes():
    with (
        unchecked(),
        pytest.raises(ValueError, match=r"equally many .* got shapes \(3,\) and \(2,\)"),
    ):
        measure(MEASURED, SIMULATED[:2])


def test_no_samples_are_refused():
    with pytest.raises(ValueError, match="at least one"):
        measure(np.array([]), np.array([]))

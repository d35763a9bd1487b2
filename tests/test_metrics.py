"""The figures of merit, against their definitions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from barnax.metrics import measure
from helpers.shape_checks import unchecked

MEASURED = np.array([3.0, 3.5, 4.0])
SIMULATED = np.array([3.1, 3.5, 3.8])
VOLTAGES = arrays(float, 20, elements=st.floats(2.5, 4.2))


def test_every_metric_is_that_of_its_definition():
    found = measure(MEASURED, SIMULATED)
    # Of the paper's R2, Eq. 24 as printed: deviations 3.0, 3.5, 4.0 from 10.4 / 3.
    spread = (9 - 10.4) ** 2 / 9 + (10.5 - 10.4) ** 2 / 9 + (12 - 10.4) ** 2 / 9
    assert vars(found) == pytest.approx(
        {
            "rmse_v": np.sqrt(0.05 / 3),
            "r2": 1 - 0.05 / 0.5,
            "r2_paper": 1 - 0.05 / spread,
            "mape_percent": 100 * (0.1 / 3 + 0.2 / 4) / 3,
            "ce_v": 0.3,
            "max_v": 0.2,
            "samples": 3,
        },
        rel=1e-12,
    )


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


def test_different_lengths_are_refused_with_both_shapes():
    with (
        unchecked(),
        pytest.raises(ValueError, match=r"equally many .* got shapes \(3,\) and \(2,\)"),
    ):
        measure(MEASURED, SIMULATED[:2])

"""The figures of merit, against their definitions."""

import json

import numpy as np
import pytest

from barnax.metrics import measure
from barnax.result_parts import MetricsBlock
from helpers.shape_checks import unchecked

MEASURED = np.array([3.0, 3.5, 4.0])
SIMULATED = np.array([3.1, 3.5, 3.8])


def test_every_metric_is_that_of_its_definition():
    actual = measure(MEASURED, SIMULATED, record="a.csv")
    # Of the paper's R2, Eq. 24 as printed: deviations 3.0, 3.5, 4.0 from 10.4 / 3.
    spread = (9 - 10.4) ** 2 / 9 + (10.5 - 10.4) ** 2 / 9 + (12 - 10.4) ** 2 / 9
    assert actual.record == "a.csv"
    numbers = {
        name: value for name, value in vars(actual).items() if isinstance(value, float | int)
    }
    assert numbers == pytest.approx(
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


def test_different_lengths_are_refused_with_both_shapes():
    with (
        unchecked(),
        pytest.raises(ValueError, match=r"equally many .* got shapes \(3,\) and \(2,\)"),
    ):
        measure(MEASURED, SIMULATED[:2])


def test_the_metrics_of_a_voltage_that_stays_the_same_are_read_as_they_were_stored():
    metrics = measure(np.full(3, 3.3), np.full(3, 3.2), record="rest")
    block = MetricsBlock(identification=metrics, validation=())
    text = block.model_dump_json(by_alias=True)
    assert json.loads(text)["identification"]["r2"] is None
    assert MetricsBlock.model_validate_json(text) == block
    assert metrics.r2 == -np.inf

"""OCV tests as testers wrote them; the expected figures come from tables made elsewhere."""

from pathlib import Path

import numpy as np
import pytest

from barnax import characterize, read_record
from barnax.bundled import BUNDLED

INCREMENTAL = "calce-inr18650-20r/ocv-incremental_25degC_SP20-3.parquet"
TENTHS = np.arange(1, 10) / 10


def test_the_samsung_cell_has_the_published_rested_voltages_gap_and_capacity(real_data: Path):
    samsung = characterize([read_record(real_data / INCREMENTAL)], ocv_fit="interpolated")
    # SP20-3 after 2 h of rest, SOC by 1.996 Ah. The table interpolates linearly.
    points = samsung.discharge_points
    linear_v = np.interp(TENTHS, [p.soc for p in points], [p.voltage_v for p in points])
    published_v = [3.4731, 3.5628, 3.6017, 3.6292, 3.6719, 3.7599, 3.8477, 3.9480, 4.0583]
    np.testing.assert_allclose(linear_v, published_v, atol=1.1e-3)
    gap_mv = 1e3 * (samsung.charge(TENTHS) - samsung.discharge(TENTHS))
    published_mv = [14.0, 17.8, 10.4, 10.6, 7.8, 11.3, 12.5, 11.8, 10.4]
    np.testing.assert_allclose(gap_mv, published_mv, atol=1.0)
    assert samsung.capacity_ah == pytest.approx(1.9960, abs=5e-4)
    assert samsung.capacity_origin.startswith("measured")
    assert samsung.warnings == ()


def test_the_lfp_cell_has_the_published_gap_at_c_30(real_data: Path):
    folder = real_data / "plett-a123-26650"
    records = [read_record(folder / f"ocv-{name}_25degC.parquet") for name in ("s3", "s1")]
    cell = characterize(records, ocv_fit="interpolated")
    soc = np.array([0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95])
    gap_mv = 1e3 * (cell.charge(soc) - cell.discharge(soc))
    published_mv = [48.7, 41.8, 46.5, 58.1, 37.3, 33.4, 38.6, 39.6, 27.3, 23.6, 25.4]
    np.testing.assert_allclose(gap_mv, published_mv, atol=1.0)
    assert cell.capacity_ah == pytest.approx(2.060, abs=2e-3)
    assert cell.warnings == ()


def test_the_virtual_cell_has_the_gap_that_was_put_into_its_graphite():
    # 12 mV between lithiation and delithiation at every stoichiometry of the graphite.
    cell = characterize([read_record(path) for path in BUNDLED.ocv], ocv_fit="interpolated")
    assert cell.capacity_ah == pytest.approx(2.0, abs=0.01)
    assert cell.hysteresis.parameters["P"] == pytest.approx(0.012, abs=0.002)
    assert cell.soc_range == pytest.approx((0.0, 1.0), abs=1e-3)

"""Measured cells are read as they are, with the sign and hold their own README states."""

import numpy as np
import polars as pl
import pytest

from barnax.records import read_record
from helpers.records import parquet, read

CALCE, PLETT, LEAF = "calce-inr18650-20r", "plett-a123-26650", "nissan-leaf-lmo-33ah"
# Ampere-hours in and out by the README's integration, where every sample ends its interval.
# checks/measured.txt has the files in this order.
FILES = {
    f"{CALCE}/dst_25degC_80soc_SP20-2.parquet": (12561, 0.6845, 2.2622),
    f"{CALCE}/dst_25degC_50soc_SP20-2.parquet": (9501, 2.1444, 2.1688),
    f"{CALCE}/dst_0degC_80soc_SP20-2.parquet": (10311, 0.2817, 2.0214),
    f"{CALCE}/dst_45degC_80soc_SP20-2.parquet": (13621, 2.3635, 2.3645),
    f"{CALCE}/us06_25degC_80soc_SP20-2.parquet": (11898, 2.1922, 2.2518),
    f"{CALCE}/us06_25degC_50soc_SP20-2.parquet": (8321, 2.1667, 2.1825),
    f"{CALCE}/us06_0degC_80soc_SP20-2.parquet": (11445, 2.0582, 2.0056),
    f"{CALCE}/us06_45degC_80soc_SP20-2.parquet": (12786, 2.3218, 2.2851),
    f"{CALCE}/ocv-low-current_25degC_SP20-1.parquet": (169407, 1.9307, 2.1569),
    f"{CALCE}/ocv-incremental_25degC_SP20-3.parquet": (164928, 1.9718, 1.9960),
    f"{CALCE}/ocv-incremental-part3_25degC_SP20-1.parquet": (14141, 0.2768, 0.0),
    f"{PLETT}/dyn-s1_25degC.parquet": (36880, 3.3832, 5.3619),
    f"{PLETT}/dyn-s2_25degC.parquet": (18963, 0.0056, 0.0330),
    f"{PLETT}/dyn-s3_25degC.parquet": (21990, 2.1753, 0.1099),
    f"{PLETT}/ocv-s1_25degC.parquet": (9788, 0.0, 2.0602),
    f"{PLETT}/ocv-s2_25degC.parquet": (11873, 0.0050, 0.0182),
    f"{PLETT}/ocv-s3_25degC.parquet": (9807, 2.0630, 0.0),
    f"{PLETT}/ocv-s4_25degC.parquet": (11825, 0.1432, 0.1223),
    f"{LEAF}/hppc_25degC.parquet": (13248, 30.7755, 31.1767),
    f"{LEAF}/discharge-1c.parquet": (2287, 151.1143, 121.2840),
    f"{LEAF}/discharge-3c.parquet": (2684, 142.2400, 142.7835),
}
RAW = {
    "11_05_2015_SP20-2_DST_80SOC.xls": "dst_25degC_80soc_SP20-2",
    "11_05_2015_SP20-2_DST_50SOC.with-extra-sheets.xls": "dst_25degC_50soc_SP20-2",
    "12_2_2015_Incremental OCV test_SP20-13.csv": "ocv-incremental-part3_25degC_SP20-1",
    "A123_DYN_50_P25_s2.csv": "dyn-s2_25degC",
    "leaf-cell-discharge-bitrode-1c.csv": "discharge-1c",
}


@pytest.mark.parametrize("file", FILES)
def test_a_measured_record_has_its_samples_sign_hold_and_ampere_hours(real_data, file):
    samples, charged_ah, discharged_ah = FILES[file]
    record = read_record(real_data / file)
    sign = "discharge-positive" if "/dyn-" in file else "charge-positive"
    assert (record.samples, record.sign.value, record.sign.strength) == (samples, sign, "strong")
    if "dst" in file or "us06" in file:
        assert (record.hold.value, record.hold.strength) == ("backward", "strong")
    moved = record.current_a[1:] * record.interval_s / 3600
    assert np.sum(np.maximum(moved, 0)) == pytest.approx(discharged_ah, abs=1e-4)
    assert np.sum(np.maximum(-moved, 0)) == pytest.approx(charged_ah, abs=1e-4)


@pytest.mark.parametrize(
    "raw", [pytest.param(each, marks=[pytest.mark.slow] if "50SOC" in each else []) for each in RAW]
)
def test_an_original_file_gives_the_record_made_from_it(real_data, raw):
    original = read_record(real_data / "raw" / raw)
    (made,) = real_data.glob(f"*/{RAW[raw]}.parquet")
    record = read_record(made)
    np.testing.assert_allclose(original.time_s, record.time_s, rtol=1e-9)
    np.testing.assert_allclose(original.current_a, record.current_a, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(original.voltage_v, record.voltage_v, rtol=1e-6)
    np.testing.assert_array_equal(original.step, record.step)
    assert original.sign.value == record.sign.value


@pytest.mark.slow
@pytest.mark.parametrize("start", range(0, 9000, 600))
@pytest.mark.parametrize("sweep", ["ocv-s1", "ocv-s3"])
def test_a_piece_of_a_slow_sweep_is_never_strongly_wrong(real_data, tmp_path, sweep, start):
    piece = pl.read_parquet(real_data / f"{PLETT}/{sweep}_25degC.parquet")[start : start + 600, :3]
    assert read(tmp_path, piece).sign.value == "charge-positive"


@pytest.mark.slow
@pytest.mark.parametrize("samples", [60, 300])
def test_a_piece_of_a_drive_cycle_never_proves_an_arbin_record_forward(
    real_data, tmp_path, samples
):
    whole = pl.read_parquet(real_data / f"{CALCE}/us06_25degC_50soc_SP20-2.parquet")
    for start in range(1400, 8000, 200):
        hold = read(tmp_path, parquet(whole[start : start + samples]), "piece.parquet").hold
        assert (hold.value, hold.strength) != ("forward", "strong")

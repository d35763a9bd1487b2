"""The bundled virtual cell is what its provenance page says it is."""

import hashlib
import re
import runpy
import shutil
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from scipy.interpolate import PchipInterpolator

from barnax import bundled
from barnax.bundled import BUNDLED, BUNDLED_NAMES, HPPC_NAMES, LFP_NAMES, bundled_file
from barnax.errors import InputError

SOURCE = Path(__file__).parents[1] / "data" / "virtual_cell"
COLUMNS = ["Test Time / s", "Current / A", "Voltage / V"]
TEMPERATURE = "Surface Temperature / degC"
CAPACITY_AH = 2.0004
LFP_CAPACITY_AH = 2.2276
CURRENT_NOISE_A = 2e-3
VOLTAGE_NOISE_V = 1e-3
REST_BELOW_A = 0.02


def columns_of(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    time_s, current_a, voltage_v = pl.read_parquet(bundled_file(name), columns=COLUMNS).to_numpy().T
    return time_s, current_a, voltage_v


def charge_passed_ah(time_s: np.ndarray, current_a: np.ndarray) -> np.ndarray:
    """Ampere-hours by the trapezoidal rule, with the noise of the rests cut away."""
    without_rests = np.where(np.abs(current_a) < REST_BELOW_A, 0.0, current_a)
    means = (without_rests[1:] + without_rests[:-1]) / 2
    return np.concatenate([[0.0], np.cumsum(means * np.diff(time_s))]) / 3600


def rest_ends(current_a: np.ndarray) -> np.ndarray:
    at_rest = np.abs(current_a) < REST_BELOW_A
    return np.flatnonzero(at_rest & np.append(~at_rest[1:], True))


def rested_points(name: str, capacity_ah: float = CAPACITY_AH) -> tuple[np.ndarray, np.ndarray]:
    """SOC, rising, and the mean voltage of each rest's last ten samples (4.5 min)."""
    time_s, current_a, voltage_v = columns_of(name)
    passed = charge_passed_ah(time_s, current_a) / capacity_ah
    ends = rest_ends(current_a)
    soc = passed[ends] + (0.0 if passed[-1] > 0 else 1.0)
    rested_v = np.array([voltage_v[max(end - 9, 0) : end + 1].mean() for end in ends])
    order = np.argsort(soc)
    return soc[order], rested_v[order]


@pytest.mark.parametrize("name", [*BUNDLED_NAMES, *HPPC_NAMES, *LFP_NAMES])
def test_the_hash_equals_the_one_in_the_provenance_page(name: str):
    page = (bundled_file(name).parent / "README.md").read_text(encoding="utf-8")
    stated = dict(re.findall(r"^\| `(\w+)\.parquet` .* `([0-9a-f]{64})` \|$", page, re.MULTILINE))
    assert stated[name] == hashlib.sha256(bundled_file(name).read_bytes()).hexdigest()


@pytest.mark.parametrize("name", [*BUNDLED_NAMES, *HPPC_NAMES, *LFP_NAMES])
def test_the_columns_are_those_of_the_battery_data_format(name: str):
    table = pl.read_parquet(bundled_file(name))
    time_s, current_a, voltage_v = table.select(COLUMNS).to_numpy().T
    assert table.columns == COLUMNS + ([TEMPERATURE] if name in HPPC_NAMES else [])
    assert np.isfinite(table.to_numpy()).all()
    assert time_s[0] == 0.0
    assert (np.diff(time_s) > 0).all()
    # A charging current is positive, and voltages stay within the cutoffs but for noise.
    steps_a, steps_v = np.diff(current_a), np.diff(voltage_v)
    at_steps = np.abs(steps_a) > 0.5
    assert (steps_v[at_steps] / steps_a[at_steps] > 0).mean() > 0.99
    assert 2.5 - 6 * VOLTAGE_NOISE_V < voltage_v.min() < voltage_v.max()
    assert voltage_v.max() < 4.2 + 6 * VOLTAGE_NOISE_V


@pytest.mark.parametrize(("name", "sign"), [("ocv_charge", 1), ("ocv_discharge", -1)])
def test_each_ocv_test_passes_the_whole_capacity_one_way(name: str, sign: int):
    time_s, current_a, _ = columns_of(name)
    assert charge_passed_ah(time_s, current_a)[-1] == pytest.approx(sign * CAPACITY_AH, rel=2e-3)
    assert (sign * current_a > -6 * CURRENT_NOISE_A).all()


@pytest.mark.parametrize("name", ["ocv_charge", "ocv_discharge"])
def test_every_rest_between_pulses_lasts_two_hours(name: str):
    time_s, current_a, _ = columns_of(name)
    ends = rest_ends(current_a)
    last_pulse_sample = [
        np.flatnonzero(np.abs(current_a[:end]) > REST_BELOW_A)[-1] for end in ends[1:]
    ]
    np.testing.assert_allclose(time_s[ends[1:]] - time_s[last_pulse_sample], 7200, atol=1e-3)


def test_the_ocv_after_charge_lies_about_12_mv_above_the_one_after_discharge():
    charge = PchipInterpolator(*rested_points("ocv_charge"))
    discharge = PchipInterpolator(*rested_points("ocv_discharge"))
    soc = np.linspace(0.35, 0.85, 11)
    gap_v = charge(soc) - discharge(soc)
    assert gap_v.mean() == pytest.approx(0.012, abs=1e-3)
    assert gap_v.min() > 0.009
    assert gap_v.max() < 0.015


def test_the_phosphate_cell_has_nearly_its_whole_hysteresis_on_a_flat_curve():
    charge = PchipInterpolator(*rested_points("lfp_ocv_charge", LFP_CAPACITY_AH))
    discharge = PchipInterpolator(*rested_points("lfp_ocv_discharge", LFP_CAPACITY_AH))
    soc = np.linspace(0.35, 0.70, 8)
    gap_v = charge(soc) - discharge(soc)
    # The generator sets 24 mV between the branches of the phosphate.
    assert ((gap_v > 0.020) & (gap_v < 0.024)).all()
    assert discharge(0.70) - discharge(0.35) < 0.04


def test_both_ocv_tests_meet_at_full_and_at_empty():
    _, charge_v = rested_points("ocv_charge")
    _, discharge_v = rested_points("ocv_discharge")
    assert charge_v[[0, -1]] == pytest.approx(discharge_v[[0, -1]], abs=2e-3)


@pytest.mark.parametrize(("name", "net_ah"), [("identification", -1.883), ("validation", -1.544)])
def test_a_drive_is_the_generators_profile_and_noise_at_one_sample_a_second(name, net_ah):
    profiles = runpy.run_path(str(SOURCE / "profiles.py"))
    time_s, current_a, _ = columns_of(name)
    np.testing.assert_allclose(time_s, np.arange(time_s.size), atol=1e-6)
    assert np.trapezoid(current_a, time_s) / 3600 == pytest.approx(net_ah, abs=2e-3)
    noise_a = current_a + profiles[f"{name}_current"](2.0)
    assert noise_a.std() == pytest.approx(CURRENT_NOISE_A, rel=0.03)
    assert np.abs(noise_a).max() < 6 * CURRENT_NOISE_A


@pytest.mark.parametrize("name", HPPC_NAMES)
def test_an_hppc_test_runs_from_full_to_empty_at_its_temperature(name: str):
    time_s, current_a, voltage_v = columns_of(name)
    degc = pl.read_parquet(bundled_file(name))[TEMPERATURE].to_numpy()
    ambient_degc = float(name.removeprefix("hppc_").removesuffix("degC"))
    # The cell comes from 25 degC and warms in its pulses.
    at_rest = (np.abs(current_a) < REST_BELOW_A) & (time_s > 2 * 3600)
    at_rest &= np.diff(time_s, prepend=0) > 20
    assert np.median(degc[at_rest]) == pytest.approx(ambient_degc, abs=0.11)
    assert np.abs(degc[time_s > 2 * 3600] - ambient_degc).max() < 3
    assert charge_passed_ah(time_s, current_a)[-1] == pytest.approx(-1.985, abs=0.01)
    assert voltage_v[time_s < 3 * 3600].min() > 4.17


def test_the_roles_name_every_file():
    paths = [BUNDLED.record, BUNDLED.validation, *BUNDLED.ocv, *BUNDLED.hppc]
    assert [path.stem for path in paths] == [*BUNDLED_NAMES, *HPPC_NAMES]


def test_an_unknown_name_is_refused_with_the_names_there_are():
    with pytest.raises(
        InputError, match="identification, validation, ocv_charge, ocv_discharge, hppc_10"
    ):
        bundled_file("ocv")


def test_a_missing_file_is_named_with_the_remedy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(bundled, "__file__", str(tmp_path / "lib" / "barnax" / "bundled.py"))
    with pytest.raises(InputError, match=r"validation\.parquet is missing.*reinstall barnax"):
        bundled_file("validation")


def test_an_installed_wheel_finds_the_files_beside_the_module(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    package = tmp_path / "lib" / "barnax"
    shutil.copytree(BUNDLED.record.parent, package / "data" / "virtual_cell")
    monkeypatch.setattr(bundled, "__file__", str(package / "bundled.py"))
    assert bundled_file("validation").parent == (package / "data" / "virtual_cell").resolve()

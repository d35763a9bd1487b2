"""The bundled virtual cell is what its provenance page says it is."""

import hashlib
import re
import shutil
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from barnax import bundled
from barnax.bundled import BUNDLED, BUNDLED_NAMES, HPPC_NAMES, LFP_NAMES, bundled_file
from barnax.errors import InputError

COLUMNS = ["Test Time / s", "Current / A", "Voltage / V"]
TEMPERATURE = "Surface Temperature / degC"
VOLTAGE_NOISE_V = 1e-3


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

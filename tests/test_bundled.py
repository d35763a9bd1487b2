"""The bundled virtual cell is what its provenance page says it is."""

import hashlib
import re
import shutil

import numpy as np
import polars as pl
import pytest

from barnax import InputError, bundled
from barnax.bundled import BUNDLED, BUNDLED_NAMES, HPPC_NAMES, LFP_NAMES, bundled_file

COLUMNS = ["Test Time / s", "Current / A", "Voltage / V"]
TEMPERATURE = "Surface Temperature / degC"
VOLTAGE_NOISE_V = 1e-3


@pytest.mark.parametrize("name", [*BUNDLED_NAMES, *HPPC_NAMES, *LFP_NAMES])
def test_a_file_has_the_hash_of_its_page_and_columns_of_the_battery_data_format(name: str):
    page = (bundled_file(name).parent / "README.md").read_text(encoding="utf-8")
    stated = dict(re.findall(r"^\| `(\w+)\.parquet` .* `([0-9a-f]{64})` \|$", page, re.MULTILINE))
    assert stated[name] == hashlib.sha256(bundled_file(name).read_bytes()).hexdigest()

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


def test_an_installed_wheel_has_the_files_beside_the_module_or_says_so(tmp_path, monkeypatch):
    package, bundled_folder = tmp_path / "lib" / "barnax", BUNDLED.record.parent
    monkeypatch.setattr(bundled, "__file__", str(package / "bundled.py"))
    with pytest.raises(InputError, match="identification, validation, ocv_charge, ocv_discharge,"):
        bundled_file("ocv")
    with pytest.raises(InputError, match=r"validation\.parquet is missing.*reinstall barnax"):
        bundled_file("validation")
    folder = package / "data" / "virtual_cell"
    shutil.copytree(bundled_folder, folder)
    assert bundled_file("validation").parent == folder.resolve()

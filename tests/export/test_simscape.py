"""The MATLAB file, read back by SciPy."""

import io

import numpy as np
import pytest
from scipy.io import loadmat

from barnax.export import EXPORTERS
from barnax.export.tables import TOLERANCE_V
from helpers.results import CIRCUITS, PAIRS, PAIRS_OF, make_cell, make_result

every_circuit = pytest.mark.parametrize("circuit", CIRCUITS)


def load(circuit: str) -> dict:
    return loadmat(io.BytesIO(EXPORTERS["simscape"].write(make_result(circuit)).content))


@every_circuit
def test_the_file_has_the_blocks_names_and_no_others(circuit):
    pairs = range(1, PAIRS_OF[circuit] + 1)
    names = {"SOC_vec", "V0_vec", "V_range", "AH", "R0_vec", "prm_dyn", "stateOfCharge"}
    names |= {f"R{k}_vec" for k in pairs} | {f"tau{k}_vec" for k in pairs}
    stored = {name for name in load(circuit) if not name.startswith("__")}
    assert stored == names | {"barnax_notes"}


@every_circuit
def test_the_values_come_back_as_they_were_identified(circuit):
    stored = load(circuit)
    assert stored["AH"] == 2.0
    assert stored["stateOfCharge"] == 0.9
    assert np.all(stored["R0_vec"] == 0.0511)
    for k, (r, c) in enumerate(PAIRS[: PAIRS_OF[circuit]], start=1):
        assert np.all(stored[f"R{k}_vec"] == r)
        assert np.all(stored[f"tau{k}_vec"] == r * c)
    assert stored["prm_dyn"] == [f"simscape.enum.tablebattery.prm_dyn.rc{PAIRS_OF[circuit]}"]


def test_every_table_is_a_row_over_the_same_soc():
    stored = load("so-rc")
    shape = stored["SOC_vec"].shape
    assert shape[0] == 1
    assert shape[1] > 20
    for name in ("V0_vec", "R0_vec", "R1_vec", "tau1_vec", "R2_vec", "tau2_vec"):
        assert stored[name].shape == shape


def test_the_ocv_read_linearly_is_the_cells():
    stored, soc = load("so-rc"), np.linspace(0, 1, 2001)
    found_v = np.interp(soc, stored["SOC_vec"][0], stored["V0_vec"][0])
    assert np.abs(found_v - make_cell().average_ocv_v(soc)).max() < 1.1 * TOLERANCE_V


@every_circuit
def test_the_notes_say_every_caveat(circuit):
    caveats = EXPORTERS["simscape"].write(make_result(circuit)).caveats
    notes = " ".join(str(load(circuit)["barnax_notes"][0]).split())
    assert all(caveat in notes for caveat in caveats)

"""The plain files, read back: a C header by a program, CSV by line, MATLAB by SciPy."""

import csv
import io
import re
import shutil
import subprocess

import numpy as np
import pytest
from scipy.io import loadmat

from barnax.export import EXPORTERS
from barnax.export.tables import TOLERANCE_V, tables_of
from helpers.results import CIRCUITS, GAMMA, PAIRS, PAIRS_OF, make_cell, make_result

every_circuit = pytest.mark.parametrize("circuit", CIRCUITS)
COMPILER = shutil.which("cc")
PROGRAM = r"""
#include <stdio.h>
#include "barnax_cell.h"
#include "barnax_cell.h"

static void show(const double *values, int count)
{
    int k;
    for (k = 0; k < count; k++)
        printf("%.17g ", values[k]);
    printf("\n");
}

int main(void)
{
    show(&barnax_capacity_ah, 1);
    show(&barnax_initial_soc, 1);
    show(&barnax_initial_direction, 1);
    show(&barnax_rest_current_a, 1);
    show(&barnax_r0_ohm, 1);
    show(barnax_r_ohm, BARNAX_RC_PAIRS);
    show(barnax_c_f, BARNAX_RC_PAIRS);
    show(barnax_tau_s, BARNAX_RC_PAIRS);
    show(barnax_ocv_soc, BARNAX_OCV_POINTS);
    show(barnax_ocv_v, BARNAX_OCV_POINTS);
#if BARNAX_HYSTERESIS
    show(barnax_hysteresis_soc, BARNAX_HYSTERESIS_POINTS);
    show(barnax_hysteresis_v, BARNAX_HYSTERESIS_POINTS);
#endif
#if BARNAX_HYSTERESIS == 2
    show(&barnax_gamma, 1);
#endif
    return 0;
}
"""


@pytest.mark.skipif(COMPILER is None, reason="no C compiler here")
@every_circuit
def test_a_program_prints_every_number_of_the_result(tmp_path, circuit):
    result = make_result(circuit, initial_direction=-1)
    (tmp_path / "barnax_cell.h").write_bytes(EXPORTERS["c-header"].write(result).content)
    (tmp_path / "main.c").write_text(PROGRAM)
    strict = ["-std=c89", "-pedantic", "-Wall", "-Wextra", "-Werror"]
    subprocess.run([COMPILER, *strict, "main.c", "-o", "main"], cwd=tmp_path, check=True)
    ran = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True)
    found = [[float(word) for word in line.split()] for line in ran.stdout.splitlines()]

    tables = tables_of(result)
    r, c = np.array(PAIRS[: PAIRS_OF[circuit]]).T
    expected = [[2.0], [0.9], [-1.0], [0.035], [0.0511], r, c, r * c]
    expected += [tables.ocv.soc, tables.ocv.voltage_v]
    if tables.hysteresis is not None:
        expected += [tables.hysteresis.soc, tables.hysteresis.voltage_v]
    if circuit == "esc":
        expected += [[GAMMA]]
    assert len(found) == len(expected)
    for numbers, values in zip(found, expected, strict=True):
        np.testing.assert_array_equal(numbers, values)


@pytest.mark.parametrize(("circuit", "code"), [("so-rc", 0), ("iso-rc", 1), ("esc", 2)])
def test_the_kind_of_hysteresis_can_be_asked_of_the_preprocessor(circuit, code):
    text = EXPORTERS["c-header"].write(make_result(circuit)).content.decode()
    assert f"#define BARNAX_HYSTERESIS {code}\n" in text


def rows(circuit: str) -> list[dict[str, str]]:
    content = EXPORTERS["csv"].write(make_result(circuit)).content.decode()
    return list(csv.DictReader(content.splitlines()))


@every_circuit
def test_every_value_is_a_number_with_a_unit_under_a_name_of_its_own(circuit):
    found = rows(circuit)
    assert all(np.isfinite(float(row["value"])) for row in found)
    assert {row["unit"] for row in found} == {"Ohm", "F", "s", "A", "A.h", "V", "1"}
    assert len({row["name"] for row in found}) == len(found)


@every_circuit
def test_the_circuit_comes_back_as_it_was_identified(circuit):
    found = {row["name"]: (float(row["value"]), row["unit"]) for row in rows(circuit)}
    assert found["R0"] == (0.0511, "Ohm")
    for k, (r, c) in enumerate(PAIRS[: PAIRS_OF[circuit]], start=1):
        assert found[f"R{k}"] == (r, "Ohm")
        assert found[f"C{k}"] == (c, "F")
        assert found[f"tau{k}"] == (r * c, "s")
    assert found["capacity"] == (2.0, "A.h")
    assert found["initial SOC"] == (0.9, "1")
    assert found["rest current"] == (0.035, "A")
    assert found.get("gamma") == ((GAMMA, "1") if circuit == "esc" else None)


@pytest.mark.parametrize("name", ["OCV", "W"])
def test_a_curve_comes_back_point_by_point(name):
    matches = [(re.fullmatch(rf"{name}\((.+)\)", row["name"]), row) for row in rows("esc")]
    points = [(float(match[1]), float(row["value"])) for match, row in matches if match]
    tables = tables_of(make_result("esc"))
    table = tables.ocv if name == "OCV" else tables.hysteresis
    np.testing.assert_array_equal(np.array(points), np.stack([table.soc, table.voltage_v], axis=1))


def load(circuit: str) -> dict:
    return loadmat(io.BytesIO(EXPORTERS["simscape"].write(make_result(circuit)).content))


@every_circuit
def test_the_file_has_the_blocks_names_and_no_others(circuit):
    pairs = range(1, PAIRS_OF[circuit] + 1)
    names = {"SOC_vec", "V0_vec", "V_range", "AH", "R0_vec", "prm_dyn", "stateOfCharge"}
    names |= {f"R{k}_vec" for k in pairs} | {f"tau{k}_vec" for k in pairs}
    stored = {name for name in load(circuit) if not name.startswith("__")}
    assert stored == names | {"BatteryEquivalentCircuit", "barnax_notes"}


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


def test_the_ocv_read_linearly_is_the_cells():
    stored, soc = load("so-rc"), np.linspace(0, 1, 2001)
    found_v = np.interp(soc, stored["SOC_vec"][0], stored["V0_vec"][0])
    assert np.abs(found_v - make_cell().average_ocv_v(soc)).max() < 1.1 * TOLERANCE_V


@every_circuit
def test_the_notes_say_every_caveat(circuit):
    caveats = EXPORTERS["simscape"].write(make_result(circuit)).caveats
    notes = " ".join(str(load(circuit)["barnax_notes"][0]).split())
    assert all(caveat in notes for caveat in caveats)

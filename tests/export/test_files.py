"""The plain files, read back: a C header by programs, CSV by line, JSON, MATLAB by SciPy."""

import csv
import io
import json
import re
import subprocess

import fastexcel
import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.io import loadmat

from barnax.export import EXPORTERS, pulse_profile
from barnax.export.tables import TOLERANCE_V, tables_of
from barnax.export.verification import simulate_here
from helpers.results import (
    GAMMA,
    NODES,
    PAIRS,
    PAIRS_OF,
    TABLE_OHM,
    TABLE_TAU_S,
    WITH_GAMMA,
    make_result,
    make_table_result,
)

from .conftest import compiled, every_circuit, needs_a_compiler, r0_ohm

SOC = np.linspace(0, 1, 401)
TWICE = '#include "barnax_cell.h"\n#include "barnax_cell.h"\nint main(void) { return 0; }\n'


@needs_a_compiler
@every_circuit
def test_a_header_has_every_number_of_the_result_and_may_be_included_twice(tmp_path, circuit):
    result = make_result(circuit, initial_direction=-1)
    compiled(tmp_path, EXPORTERS["c-header"], result, TWICE, "-std=c89", "-Wno-unused-variable")
    text = re.sub(r"/\*.*?\*/", "", (tmp_path / "barnax_cell.h").read_text(), flags=re.S)
    defined = re.findall(r"static const double barnax_(\w+)(?:\[\w+\])? = \{?([^;{}]+)\}?;", text)
    numbers = {name: np.array(re.findall(r"[^\s,]+", row), float) for name, row in defined}

    tables = tables_of(result)
    r, c = np.array(PAIRS[: PAIRS_OF[circuit]]).T
    expected = {"capacity_ah": 2.0, "initial_soc": 0.9, "initial_direction": -1.0}
    expected |= {"rest_current_a": 0.035, "r0_ohm": 0.0511, "r_ohm": r, "c_f": c, "tau_s": r * c}
    expected |= {"ocv_soc": tables.ocv.soc, "ocv_v": tables.ocv.voltage_v}
    if tables.hysteresis is not None:
        expected["hysteresis_soc"] = tables.hysteresis.soc
        expected["hysteresis_v"] = tables.hysteresis.voltage_v
    if circuit in WITH_GAMMA:
        expected["gamma"] = GAMMA
    assert numbers.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(numbers[name], np.atleast_1d(values), name)


SIMULATION = r"""
#include <math.h>
#include <stdio.h>
#define BARNAX_LOOK_UP
#include "barnax_cell.h"

int main(void)
{
    double u1 = 0, u2 = 0, soc = barnax_initial_soc, i, dt = 0.05, d1, d2;
    int k, step, steps;
    d1 = exp(-dt / barnax_tau_s[0]);
    d2 = exp(-dt / barnax_tau_s[1]);
    while (scanf("%lf %d", &i, &steps) == 2) {
        printf("%.17g\n", barnax_look_up(barnax_ocv_soc, barnax_ocv_v, BARNAX_OCV_POINTS, soc)
            - i * barnax_look_up(barnax_nodes_soc, barnax_r0_ohm, BARNAX_NODES, soc) - u1 - u2);
        for (k = 0, step = 0; step < steps; step++, k++) {
            u1 = d1 * u1 + (1 - d1) * i
                * barnax_look_up(barnax_nodes_soc, barnax_r1_ohm, BARNAX_NODES, soc);
            u2 = d2 * u2 + (1 - d2) * i
                * barnax_look_up(barnax_nodes_soc, barnax_r2_ohm, BARNAX_NODES, soc);
            soc -= i * dt / 3600 / barnax_capacity_ah;
        }
    }
    return 0;
}
"""


@needs_a_compiler
def test_a_c_program_with_the_headers_look_up_simulates_what_barnax_does(tmp_path):
    result = make_table_result()
    profile = pulse_profile(result)
    program = compiled(tmp_path, EXPORTERS["c-header"], result, SIMULATION, "-std=c89")
    steps = np.round(np.diff(profile.time_s, append=profile.time_s[-1]) / 0.05).astype(int)
    text = "\n".join(f"{a!r} {n}" for a, n in zip(profile.current_a.tolist(), steps, strict=True))
    ran = subprocess.run([program], input=text, capture_output=True, text=True, check=True)
    there_v = np.array([float(line) for line in ran.stdout.split()])
    assert np.abs(there_v - simulate_here(result, profile)).max() < 1e-4


LOOK_UP = r"""
#include <stdio.h>
#define BARNAX_LOOK_UP
#include "barnax_cell.h"

int main(void)
{
    printf("%.12g %.12g\n",
        barnax_look_up_degc(barnax_nodes_soc, &barnax_r0_ohm[0][0], BARNAX_NODES, 0.4, 45.0),
        barnax_look_up_degc(barnax_ocv_soc, &barnax_ocv_v[0][0], BARNAX_OCV_POINTS, 0.4, -9.0));
    return 0;
}
"""


@needs_a_compiler
def test_the_header_looks_up_over_soc_and_temperature(over_temperature, tmp_path):
    program = compiled(tmp_path, EXPORTERS["c-header"], over_temperature, LOOK_UP, "-std=c89")
    ran = subprocess.run([program], capture_output=True, text=True, check=True)
    r0, ocv_v = map(float, ran.stdout.split())
    assert r0 == pytest.approx(r0_ohm(45.0, 0.4))
    assert ocv_v == pytest.approx(ocv_at(over_temperature, 0.0, 0.4), abs=1e-6)


def ocv_at(over_temperature, degc, soc):
    return tables_of(over_temperature.at_temperature(degc)).ocv(np.asarray(soc))


def rows_of(result) -> dict[str, tuple[float, str]]:
    """Value and unit by name."""
    text = EXPORTERS["csv"].write(result).content.decode()
    rows = list(csv.DictReader(text.splitlines()))
    assert len({row["name"] for row in rows}) == len(rows)
    return {row["name"]: (float(row["value"]), row["unit"]) for row in rows}


@every_circuit
def test_csv_gives_the_circuit_back_as_it_was_identified(circuit):
    rows = rows_of(make_result(circuit))
    assert np.isfinite([value for value, _ in rows.values()]).all()
    assert {unit for _, unit in rows.values()} == {"Ohm", "F", "s", "A", "A.h", "V", "1"}
    expected = {"R0": (0.0511, "Ohm"), "capacity": (2.0, "A.h"), "initial SOC": (0.9, "1")}
    expected |= {"rest current": (0.035, "A")} | (
        {"gamma": (GAMMA, "1")} if circuit in WITH_GAMMA else {}
    )
    for k, (r, c) in enumerate(PAIRS[: PAIRS_OF[circuit]], start=1):
        expected |= {f"R{k}": (r, "Ohm"), f"C{k}": (c, "F"), f"tau{k}": (r * c, "s")}
    assert expected.items() <= rows.items()
    assert ("gamma" in rows) == (circuit in WITH_GAMMA)


@pytest.mark.parametrize("circuit", ["so-rc", "esc"])
def test_a_workbook_has_the_parameters_and_both_branches_of_the_ocv(circuit):
    result = make_result(circuit)
    workbook = fastexcel.read_excel(EXPORTERS["xlsx"].write(result).content)
    rows = workbook.load_sheet("parameters").to_polars()
    lines = list(csv.DictReader(EXPORTERS["csv"].write(result).content.decode().splitlines()))
    assert rows["name"].to_list() == [line["name"] for line in lines]
    assert rows["value"].to_list() == pytest.approx([float(line["value"]) for line in lines])
    ocv, tables = workbook.load_sheet("OCV").to_polars(), tables_of(result)
    between_v = (ocv["after charging [V]"] - ocv["after discharging [V]"]).to_numpy()
    expected_v = 0 if tables.hysteresis is None else tables.hysteresis(tables.ocv.soc)
    assert np.abs(between_v - expected_v).max() < 1e-12
    assert ("R0(" in " ".join(rows["name"])) == (tables.nodes is not None)


@pytest.mark.parametrize("circuit", ["so-rc", "esc"])
def test_json_and_csv_hold_every_value_of_tables(circuit):
    result = make_table_result(circuit)
    (record,) = result.inputs
    warm = record.model_copy(update={"temperature_degc": 31.0})
    result = result.model_copy(update={"inputs": (warm,)})
    actual, rows = json.loads(EXPORTERS["json"].write(result).content), rows_of(result)
    assert actual["resistances"]["SOC"] == list(NODES)
    for number, values in enumerate(TABLE_OHM):
        assert actual["resistances"][f"R{number} [Ohm]"] == list(values)
    assert actual["tau [s]"] == list(TABLE_TAU_S)
    assert actual["gamma"] == (GAMMA if circuit in WITH_GAMMA else None)
    assert actual["temperature [degC]"] == 31.0
    assert (actual["W"] is None) == (circuit == "so-rc")
    assert rows["R0(0.1)"] == (TABLE_OHM[0][2], "Ohm")
    assert rows["R2(-0.05)"] == (TABLE_OHM[2][0], "Ohm")
    assert ("gamma" in rows) == (circuit in WITH_GAMMA)
    assert "R0" not in rows


def test_csv_and_json_have_every_temperature(over_temperature):
    rows = rows_of(over_temperature)
    content = json.loads(EXPORTERS["json"].write(over_temperature).content)
    at = content["temperature [degC]"].index(45.0)
    for index, soc in enumerate(NODES):
        value, _ = rows[f"R0({soc!r}, 45.0)"]
        assert value == pytest.approx(0.5 * TABLE_OHM[0][index])
        assert content["resistances"]["R0 [Ohm]"][at][index] == value
    own = np.interp(0.5, content["OCV"]["SOC"], content["OCV"]["voltage [V]"][at])
    assert own == pytest.approx(ocv_at(over_temperature, 45.0, 0.5), abs=1e-6)


def test_the_capacity_is_that_of_the_record_nearest_to_25_degc(over_temperature):
    (record,) = over_temperature.inputs
    inputs = tuple(
        record.model_copy(update={"temperature_degc": degc, "capacity_ah": own_ah})
        for degc, own_ah in ((1.0, 1.7), (24.0, 1.6), (24.5, 1.5))
    )
    own = over_temperature.model_copy(update={"inputs": inputs})
    exported = EXPORTERS["json"].write(own)
    assert json.loads(exported.content)["capacity [A.h]"] == 1.6
    assert "at 0, 25, 45 degC it was 1.7, 1.6, 2.1 Ah" in " ".join(exported.caveats)
    assert b"barnax_filter_capacity_ah = BARNAX_N(1.6);" in EXPORTERS["c-filter"].write(own).content


def load(result) -> dict:
    return loadmat(io.BytesIO(EXPORTERS["simscape"].write(result).content), squeeze_me=True)


@every_circuit
def test_simscape_gets_the_values_under_the_blocks_names_and_no_others(circuit):
    stored, pairs = load(make_result(circuit)), PAIRS[: PAIRS_OF[circuit]]
    ocv = tables_of(make_result(circuit)).ocv
    np.testing.assert_array_equal(np.interp(SOC, stored["SOC_vec"], stored["V0_vec"]), ocv(SOC))
    assert stored["AH"] == 2.0
    assert stored["stateOfCharge"] == 0.9
    assert np.all(stored["R0_vec"] == 0.0511)
    for k, (r, c) in enumerate(pairs, start=1):
        assert np.all(stored[f"R{k}_vec"] == r)
        assert np.all(stored[f"tau{k}_vec"] == r * c)
    assert stored["prm_dyn"] == f"simscape.enum.tablebattery.prm_dyn.rc{len(pairs)}"
    names = {"SOC_vec", "V0_vec", "V_range", "AH", "R0_vec", "prm_dyn", "stateOfCharge"}
    names |= {f"{name}{k + 1}_vec" for k in range(len(pairs)) for name in ("R", "tau")}
    names |= {"BatteryEquivalentCircuit", "barnax_notes"}
    assert {name for name in stored if not name.startswith("__")} == names
    caveats = EXPORTERS["simscape"].write(make_result(circuit)).caveats
    notes = " ".join(str(stored["barnax_notes"]).split())
    assert all(caveat in notes for caveat in caveats)


def test_simscape_gets_tables_for_both_blocks():
    result = make_table_result()
    stored, ocv = load(result), tables_of(result).ocv
    soc, block = stored["SOC_vec"], stored["BatteryEquivalentCircuit"]
    assert (soc[0], soc[-1]) == (0.0, 1.0)
    for number, values in enumerate(TABLE_OHM):
        np.testing.assert_allclose(stored[f"R{number}_vec"], np.interp(soc, NODES, values))
    np.testing.assert_allclose(stored["tau1_vec"], TABLE_TAU_S[0])
    np.testing.assert_allclose(stored["V0_vec"], ocv(soc), atol=1.1 * TOLERANCE_V)
    np.testing.assert_allclose(block["ResistanceSOCBreakpoints"].item(), NODES[1:])
    np.testing.assert_allclose(block["R1"].item(), TABLE_OHM[1][1:])
    np.testing.assert_allclose(block["Tau2"].item(), TABLE_TAU_S[1])
    np.testing.assert_allclose(block["OpenCircuitVoltage"].item(), stored["V0_vec"])
    assert any("0 to 1" in caveat for caveat in EXPORTERS["simscape"].write(result).caveats)


@pytest.mark.parametrize("kept", [slice(2, 6), slice(4, 5)], ids=["0.1 to 0.8", "0.5 alone"])
def test_a_table_that_is_read_on_straight_is_constant_beyond_its_nodes(kept):
    result = make_table_result("esc", kept)
    expected_ohm = np.interp(SOC, NODES[kept], TABLE_OHM[0][kept])
    actual = json.loads(EXPORTERS["json"].write(result).content)["resistances"]
    block = load(result)["BatteryEquivalentCircuit"]
    for nodes, values in (
        (actual["SOC"], actual["R0 [Ohm]"]),
        (block["ResistanceSOCBreakpoints"].item(), block["R0"].item()),
    ):
        straight = make_interp_spline(nodes, values, k=1)
        np.testing.assert_allclose(straight(SOC), expected_ohm, rtol=1e-12)


def test_simscape_has_a_column_for_each_temperature(over_temperature):
    content = load(over_temperature)
    kelvin, soc = content["T_vec"], content["SOC_vec"]
    at = int(np.argmin(np.abs(kelvin - 273.15)))
    assert content["R0_mat"].shape == content["tau2_mat"].shape == (len(soc), len(kelvin))
    np.testing.assert_allclose(content["R0_mat"][:, at], r0_ohm(0.0, soc), rtol=1e-9)
    expected_v = ocv_at(over_temperature, 0.0, soc)
    np.testing.assert_allclose(content["V0_mat"][:, at], expected_v, atol=1e-6)
    assert np.all(content["tau2_mat"] == TABLE_TAU_S[1])
    block = content["BatteryEquivalentCircuit"]
    nodes = block["ResistanceSOCBreakpoints"].item()
    assert block["R0Thermal"].item().shape == (len(nodes), len(kelvin))
    assert block["OpenCircuitVoltageThermal"].item().shape == (len(soc), len(kelvin))
    np.testing.assert_array_equal(block["ResistanceTemperatureBreakpoints"].item(), kelvin)

"""Circuits with tables over SOC in every export: read back, simulated, and what is left out."""

import csv
import io
import json
import math
import shutil
import subprocess
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.io import loadmat

from barnax.export import EXPORTERS, pulse_profile
from barnax.export.tables import TOLERANCE_V, tables_of
from barnax.export.verification import simulate_here
from helpers.results import (
    CAPACITY_AH,
    CORRECTION_V,
    GAMMA,
    NODES,
    TABLE_OHM,
    TABLE_TAU_S,
    make_table_result,
)

every_exporter = pytest.mark.parametrize("exporter", EXPORTERS.values(), ids=lambda each: each.name)
COMPILER = shutil.which("cc")
SOC = np.linspace(0, 1, 401)
R0_OHM = np.interp(SOC, NODES, TABLE_OHM[0])


def corrected_ocv_v(soc):
    result = make_table_result()
    return result.cell_model.average_ocv_v(soc) + np.interp(soc, NODES, CORRECTION_V)


def content_of(name: str, circuit: str = "so-rc", **given) -> bytes:
    return EXPORTERS[name].write(make_table_result(circuit, **given)).content


def run_module(name: str, circuit: str = "so-rc", **given) -> dict:
    module: dict = {}
    exec(content_of(name, circuit, **given), module)
    return module


def plain_voltage_v(soc_start, profile, r0, r, ocv, tau_s=TABLE_TAU_S):
    """The circuit's equations in a plain loop of small steps, with functions of SOC."""
    soc, u, found = soc_start, np.zeros(len(tau_s)), []
    decay = np.exp(-0.05 / np.array(tau_s))
    for current_a, interval_s in zip(
        profile.current_a, np.diff(profile.time_s, append=profile.time_s[-1]), strict=True
    ):
        found.append(ocv(soc) - r0(soc) * current_a - u.sum())
        for _ in range(round(interval_s / 0.05)):
            u = decay * u + (1 - decay) * np.array([each(soc) for each in r]) * current_a
            soc -= 0.05 * current_a / 3600 / CAPACITY_AH
    return np.array(found)


def short_profile(result):
    profile = pulse_profile(result)
    return type(profile)(profile.time_s[:400], profile.current_a[:400])


def test_the_ocv_holds_the_correction_exactly():
    table = tables_of(make_table_result()).ocv
    assert np.abs(table(SOC) - corrected_ocv_v(SOC)).max() < 1.1 * TOLERANCE_V
    assert table.soc[0] == NODES[0]


@pytest.mark.parametrize("kept", [slice(2, 6), slice(4, 5)], ids=["0.1 to 0.8", "0.5 alone"])
def test_a_table_that_is_read_on_straight_is_constant_beyond_its_nodes(kept):
    result = make_table_result("esc", kept)
    expected_ohm = np.interp(SOC, NODES[kept], TABLE_OHM[0][kept])
    found = json.loads(EXPORTERS["json"].write(result).content)["resistances"]
    stored = loadmat(io.BytesIO(EXPORTERS["simscape"].write(result).content), squeeze_me=True)
    block = stored["BatteryEquivalentCircuit"]
    for nodes, values in (
        (found["SOC"], found["R0 [Ohm]"]),
        (block["ResistanceSOCBreakpoints"].item(), block["R0"].item()),
    ):
        straight = make_interp_spline(nodes, values, k=1)
        np.testing.assert_allclose(straight(SOC), expected_ohm, rtol=1e-12)


@every_exporter
def test_nodes_near_no_sample_are_named(exporter):
    caveats = exporter.write(make_table_result()).caveats
    assert caveats[0].startswith("No sample is near the nodes at SOC -0.05, 0:")


@every_exporter
def test_equal_tables_give_equal_bytes_and_others_give_others(exporter):
    result = make_table_result()
    assert exporter.write(result) == exporter.write(make_table_result())
    without = result.model_copy(update={"tables": None})
    assert exporter.write(result).content != exporter.write(without).content


def test_thevenins_functions_of_soc_simulate_what_barnax_does():
    result = make_table_result()
    profile, module = short_profile(result), run_module("thevenin")
    params = module["get_params"]()
    at = {name: params[name] for name in ("R0", "R1", "R2", "C1", "C2")}
    tau_s = [at["R1"](0.3, 298.15) * at["C1"](0.3, 298.15), TABLE_TAU_S[1]]
    assert tau_s == pytest.approx(TABLE_TAU_S)
    there_v = plain_voltage_v(
        params["soc0"],
        profile,
        lambda soc: at["R0"](soc, 298.15),
        [lambda soc: at["R1"](soc, 298.15), lambda soc: at["R2"](soc, 298.15)],
        params["ocv"],
    )
    assert np.abs(there_v - simulate_here(result, profile)).max() < 1e-4


def test_pybamm_gets_interpolants_of_the_tables(monkeypatch):
    fake = ModuleType("pybamm")

    def interpolant(x, y, at, name=""):
        return np.interp(at, x, y)

    fake.__dict__.update(
        Interpolant=interpolant,
        equivalent_circuit=SimpleNamespace(Thevenin=lambda options: options),
    )
    monkeypatch.setitem(__import__("sys").modules, "pybamm", fake)
    values = run_module("pybamm")["get_parameter_values"]()
    np.testing.assert_allclose(values["R0 [Ohm]"](25.0, 1.0, SOC), R0_OHM)
    tau_s = values["R2 [Ohm]"](25.0, 1.0, SOC) * values["C2 [F]"](25.0, 1.0, SOC)
    np.testing.assert_allclose(tau_s, TABLE_TAU_S[1])
    # A resistance of zero leaves a time constant that no solver divides by.
    assert np.isfinite(values["C1 [F]"](25.0, 1.0, SOC)).all()
    found_v = values["Open-circuit voltage [V]"](SOC)
    assert np.abs(found_v - corrected_ocv_v(SOC)).max() < 1.1 * TOLERANCE_V


def test_simscape_gets_tables_for_both_blocks():
    stored = loadmat(io.BytesIO(content_of("simscape")), squeeze_me=True)
    soc = stored["SOC_vec"]
    assert (soc[0], soc[-1]) == (0.0, 1.0)
    for number, values in enumerate(TABLE_OHM):
        np.testing.assert_allclose(stored[f"R{number}_vec"], np.interp(soc, NODES, values))
    np.testing.assert_allclose(stored["tau1_vec"], TABLE_TAU_S[0])
    np.testing.assert_allclose(stored["V0_vec"], corrected_ocv_v(soc), atol=1.1 * TOLERANCE_V)
    block = stored["BatteryEquivalentCircuit"]
    np.testing.assert_allclose(block["ResistanceSOCBreakpoints"].item(), NODES[1:])
    np.testing.assert_allclose(block["R1"].item(), TABLE_OHM[1][1:])
    np.testing.assert_allclose(block["Tau2"].item(), TABLE_TAU_S[1])
    np.testing.assert_allclose(block["OpenCircuitVoltage"].item(), stored["V0_vec"])
    assert any("0 to 1" in caveat for caveat in EXPORTERS["simscape"].write(make_table_result())[1])


@pytest.mark.parametrize("circuit", ["so-rc", "esc"])
def test_json_and_csv_hold_every_value(circuit):
    found = json.loads(content_of("json", circuit))
    assert found["resistances"]["SOC"] == list(NODES)
    for number, values in enumerate(TABLE_OHM):
        assert found["resistances"][f"R{number} [Ohm]"] == list(values)
    assert found["tau [s]"] == list(TABLE_TAU_S)
    assert found["gamma"] == (GAMMA if circuit == "esc" else None)
    assert (found["W"] is None) == (circuit == "so-rc")
    rows = {
        row["name"]: row for row in csv.DictReader(content_of("csv", circuit).decode().split("\n"))
    }
    assert float(rows["R0(0.1)"]["value"]) == TABLE_OHM[0][2]
    assert float(rows["R2(-0.05)"]["value"]) == TABLE_OHM[2][0]
    assert rows["R2(-0.05)"]["unit"] == "Ohm"
    assert ("gamma" in rows) == (circuit == "esc")
    assert "R0" not in rows


PROGRAM = r"""
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


@pytest.mark.skipif(COMPILER is None, reason="no C compiler here")
def test_a_c_program_with_the_headers_look_up_simulates_what_barnax_does(tmp_path):
    result = make_table_result()
    profile = pulse_profile(result)
    (tmp_path / "barnax_cell.h").write_bytes(content_of("c-header"))
    (tmp_path / "main.c").write_text(PROGRAM)
    strict = ["-std=c89", "-pedantic", "-Wall", "-Wextra", "-Werror"]
    subprocess.run([COMPILER, *strict, "main.c", "-o", "main", "-lm"], cwd=tmp_path, check=True)
    steps = np.round(np.diff(profile.time_s, append=profile.time_s[-1]) / 0.05).astype(int)
    text = "\n".join(f"{a!r} {n}" for a, n in zip(profile.current_a.tolist(), steps, strict=True))
    ran = subprocess.run(
        [tmp_path / "main"], input=text, capture_output=True, text=True, check=True
    )
    there_v = np.array([float(line) for line in ran.stdout.split()])
    assert np.abs(there_v - simulate_here(result, profile)).max() < 1e-4


def test_barnax_own_side_is_the_tables():
    result = make_table_result()
    profile = short_profile(result)
    expected_v = plain_voltage_v(
        0.9,
        profile,
        lambda soc: np.interp(soc, NODES, TABLE_OHM[0]),
        [lambda soc, table=table: np.interp(soc, NODES, table) for table in TABLE_OHM[1:]],
        lambda soc: float(corrected_ocv_v(np.array(soc))),
    )
    assert np.abs(simulate_here(result, profile) - expected_v).max() < 5e-5
    assert math.isfinite(expected_v.sum())

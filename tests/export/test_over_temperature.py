"""Tables over SOC and temperature in every export, read back."""

import csv
import io
import json
import shutil
import subprocess
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
from scipy.io import loadmat

from barnax.cell import InterpolatedCurve
from barnax.export import EXPORTERS
from barnax.export.tables import tables_of
from barnax.over_soc import OverTemperature
from helpers.results import NODES, TABLE_OHM, TABLE_TAU_S, make_table_result

DEGC = (0.0, 25.0, 45.0)
FACTORS = (2.0, 1.0, 0.5)
COMPILER = shutil.which("cc")


@pytest.fixture(scope="module")
def result():
    found = make_table_result()
    fit, fits = found.tables.fit, []
    for factor in FACTORS:
        r0, *r = (tuple(factor * np.array(each)) for each in TABLE_OHM)
        correction_v = tuple(factor * np.array(fit.tables.ocv_correction_v))
        tables = replace(fit.tables, r0_ohm=r0, r_ohm=tuple(r), ocv_correction_v=correction_v)
        fits.append(replace(fit, tables=tables))
    over = OverTemperature(DEGC, 1e-3, 1e-3, 1e-3, (), ())
    part = found.tables.model_copy(update={"fits": tuple(fits), "over_temperature": over})
    return found.model_copy(update={"tables": part, "cell": with_own_ocv(found.cell)})


def with_own_ocv(cell):
    """The cell, its OCV 4 mV lower and higher at the outer temperatures, of other capacities."""

    def moved(degc, lift_v, capacity_ah):
        branches = {
            name: InterpolatedCurve.fit(branch.soc, branch.voltage_v + lift_v)
            for name, branch in (("charge", cell.charge), ("discharge", cell.discharge))
        }
        return replace(cell, **branches, temperature_degc=degc, capacity_ah=capacity_ah)

    others = moved(0.0, -4e-3, 1.9), moved(45.0, 4e-3, 2.1)
    return replace(cell, temperature_degc=25.0, capacity_ah=2.0, elsewhere=others)


def test_every_temperature_has_its_own_ocv(result):
    tables, soc = tables_of(result), np.array([0.33])
    for degc, row in zip(tables.degc, tables.ocv_v, strict=True):
        correction_v = result.tables.found.tables.at(degc).at("OCV correction [V]", soc)
        lift_v = np.interp(degc, DEGC, (-4e-3, 0.0, 4e-3))
        ocv_v = result.cell.average_ocv_v(soc) + lift_v + correction_v
        assert np.interp(soc, tables.ocv.soc, row) == pytest.approx(ocv_v, abs=6e-5)


def test_the_capacity_is_that_of_the_record_nearest_to_25_degc(result):
    (record,) = result.inputs
    inputs = tuple(
        record.model_copy(update={"temperature_degc": degc, "capacity_ah": own_ah})
        for degc, own_ah in ((1.0, 1.7), (24.0, 1.6), (24.5, 1.5))
    )
    own = result.model_copy(update={"inputs": inputs})
    exported = EXPORTERS["json"].write(own)
    assert json.loads(exported.content)["capacity [A.h]"] == 1.6
    assert "at 0, 25, 45 degC it was 1.7, 1.6, 2.1 Ah" in " ".join(exported.caveats)
    header = EXPORTERS["c-filter"].write(own).content
    assert b"barnax_capacity_ah = 1.6;" in header


def ocv_v(result, degc, soc):
    return tables_of(result.at_temperature(degc)).ocv(np.asarray(soc))


def r0_ohm(degc, soc):
    """The logarithm is linear in 1/T between the measured temperatures."""
    inverse = 1 / (273.15 + np.array(DEGC))
    power = np.interp(-1 / (273.15 + degc), -inverse, np.log(FACTORS))
    return np.exp(power) * np.interp(soc, NODES, TABLE_OHM[0])


def test_a_linear_look_up_follows_what_lies_between(result):
    tables = tables_of(result)
    assert set(DEGC) <= set(tables.degc)
    for degc in (7.3, 33.0):
        rows = [np.interp(0.5, NODES, row) for row in tables.resistances["R0"]]
        assert np.interp(degc, tables.degc, rows) == pytest.approx(r0_ohm(degc, 0.5), rel=5e-3)


@pytest.mark.parametrize("exporter", EXPORTERS.values(), ids=lambda each: each.name)
def test_every_export_names_the_measured_temperatures(exporter, result):
    told = " ".join(exporter.write(result).caveats)
    if exporter.name == "c-filter":
        assert "all of it is for 25 degC, and nothing identified at 0, 45" in told
        one = result.at_temperature(25.0)
        assert exporter.write(one).content.count(b"\n") < exporter.write(result).content.count(
            b"\n"
        )
        return
    assert "Identified at 0, 25, 45 degC" in told
    assert "at 0, 25, 45 degC it was 1.9, 2, 2.1 Ah" in told


def test_csv_and_json_have_every_temperature(result):
    text = EXPORTERS["csv"].write(result).content.decode()
    rows = {row["name"]: float(row["value"]) for row in csv.DictReader(io.StringIO(text))}
    content = json.loads(EXPORTERS["json"].write(result).content)
    at = content["temperature [degC]"].index(45.0)
    for place, soc in enumerate(NODES):
        assert rows[f"R0({soc!r}, 45.0)"] == pytest.approx(0.5 * TABLE_OHM[0][place])
        assert content["resistances"]["R0 [Ohm]"][at][place] == rows[f"R0({soc!r}, 45.0)"]
    own = np.interp(0.5, content["OCV"]["SOC"], content["OCV"]["voltage [V]"][at])
    assert own == pytest.approx(ocv_v(result, 45.0, 0.5), abs=1e-6)


def test_simscape_has_a_column_for_each_temperature(result):
    content = loadmat(io.BytesIO(EXPORTERS["simscape"].write(result).content), squeeze_me=True)
    kelvin = content["T_vec"]
    at = int(np.argmin(np.abs(kelvin - 273.15)))
    soc = content["SOC_vec"]
    assert content["R0_mat"].shape == content["tau2_mat"].shape == (len(soc), len(kelvin))
    np.testing.assert_allclose(content["R0_mat"][:, at], r0_ohm(0.0, soc), rtol=1e-9)
    np.testing.assert_allclose(content["V0_mat"][:, at], ocv_v(result, 0.0, soc), atol=1e-6)
    assert np.all(content["tau2_mat"] == TABLE_TAU_S[1])
    block = content["BatteryEquivalentCircuit"]
    nodes = block["ResistanceSOCBreakpoints"].item()
    assert block["R0Thermal"].item().shape == (len(nodes), len(kelvin))
    assert block["OpenCircuitVoltageThermal"].item().shape == (len(soc), len(kelvin))
    np.testing.assert_array_equal(block["ResistanceTemperatureBreakpoints"].item(), kelvin)


def test_thevenin_has_functions_of_soc_and_temperature(result):
    module: dict = {}
    exec(EXPORTERS["thevenin"].write(result).content, module)
    for degc in (*DEGC, 33.0, -20.0, 60.0):
        params = module["get_params"](degc)
        inside = min(max(degc, DEGC[0]), DEGC[-1])
        assert params["T_inf"] == pytest.approx(273.15 + degc)
        assert params["R0"](0.4, 273.15 + degc) == pytest.approx(r0_ohm(inside, 0.4), rel=5e-3)
        r1, c1 = (params[name](0.4, 273.15 + degc) for name in ("R1", "C1"))
        assert r1 * c1 == pytest.approx(TABLE_TAU_S[0])
        assert params["ocv"](0.4) == pytest.approx(ocv_v(result, inside, 0.4), abs=1e-6)
    # thevenin tries arrays first, and goes one by one after a TypeError.
    with pytest.raises(TypeError):
        params["R0"](np.array([0.4, 0.5]), np.array([298.0, 299.0]))


def test_pybamm_interpolates_over_both(result, monkeypatch):
    asked = []

    class Stub(ModuleType):
        maximum, minimum = staticmethod(max), staticmethod(min)

        @staticmethod
        def Interpolant(points, values, at, name=""):
            asked.append((points, np.asarray(values), at))
            if name:
                return float(np.interp(at, points, values))
            return float(
                np.interp(at[0], points[0], [np.interp(at[1], points[1], v) for v in values])
            )

    monkeypatch.setitem(__import__("sys").modules, "pybamm", Stub("pybamm"))
    module: dict = {}
    exec(EXPORTERS["pybamm"].write(result).content, module)
    values = module["get_parameter_values"](45.0)
    assert values["Ambient temperature [K]"] == pytest.approx(318.15)
    assert values["R0 [Ohm]"](45.0, 1.0, 0.4) == pytest.approx(r0_ohm(45.0, 0.4))
    assert values["R0 [Ohm]"](99.0, 1.0, 0.4) == pytest.approx(r0_ohm(45.0, 0.4))
    product = values["R2 [Ohm]"](10.0, 1.0, 0.4) * values["C2 [F]"](10.0, 1.0, 0.4)
    assert product == pytest.approx(TABLE_TAU_S[1])
    assert values["Open-circuit voltage [V]"](0.4) == pytest.approx(
        float(ocv_v(result, 45.0, 0.4)), abs=1e-6
    )


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
def test_the_header_looks_up_over_both(result, tmp_path):
    (tmp_path / "barnax_cell.h").write_bytes(EXPORTERS["c-header"].write(result).content)
    source = tmp_path / "look.c"
    source.write_text(
        '#include <stdio.h>\n#define BARNAX_LOOK_UP\n#include "barnax_cell.h"\n'
        'int main(void) { printf("%.12g %.12g\\n", barnax_look_up_degc(barnax_nodes_soc, '
        "&barnax_r0_ohm[0][0], BARNAX_NODES, 0.4, 45.0), barnax_look_up_degc(barnax_ocv_soc, "
        "&barnax_ocv_v[0][0], BARNAX_OCV_POINTS, 0.4, -9.0)); return 0; }\n"
    )
    program = tmp_path / "look"
    subprocess.run([COMPILER, "-std=c89", "-o", program, source], check=True)
    ran = subprocess.run([program], capture_output=True, text=True, check=True)
    r0, ocv = map(float, ran.stdout.split())
    assert r0 == pytest.approx(r0_ohm(45.0, 0.4))
    assert ocv == pytest.approx(float(ocv_v(result, 0.0, 0.4)), abs=1e-6)

"""A pulse test of a made cell gives the cell back, and what the command writes of it."""

import csv
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from barnax import Result, hppc
from barnax.cli.app import app
from barnax.export import EXPORTERS
from helpers.pulse_tests import CAPACITY_AH, R1_OHM, R2_OHM, TAU_S, made_record, r0_ohm


@pytest.fixture(scope="module")
def result() -> Result:
    nodes = (0.0, 0.25, 0.5, 0.75, 1.0)
    return hppc(made_record(), capacity=CAPACITY_AH, nodes=nodes, folds=0, trust="none", seeds=0)


def test_resistances_and_time_constants_are_those_of_the_cell(result):
    tables = result.fit.tables
    assert tables.tau_s == pytest.approx(TAU_S, rel=0.02)
    for soc in (0.25, 0.5, 0.75):
        at = np.array([soc])
        assert tables.at("R0 [Ohm]", at)[0] == pytest.approx(r0_ohm(soc), rel=0.01)
        assert tables.at("R1 [Ohm]", at)[0] == pytest.approx(R1_OHM, rel=0.05)
        assert tables.at("R2 [Ohm]", at)[0] == pytest.approx(R2_OHM, rel=0.05)
    assert result.metrics.identification.rmse_v < 2e-4


def test_pulse_resistances_are_those_of_the_closed_form(result):
    first = result.pulses[0]
    # Held forward at 0.5 s, the last sample of a pulse of 10 s shows it after 9.5 s.
    expected = r0_ohm(1.0) + sum(
        r * (1 - np.exp(-9.5 / tau_s)) for r, tau_s in zip((R1_OHM, R2_OHM), TAU_S, strict=True)
    )
    assert Result.model_validate_json(result.to_json()).pulses == result.pulses
    # The charge of the pulse moves the OCV by 0.9 V over the whole of SOC, and R0 hardly.
    expected += 0.9 * 9.5 / 3600 / CAPACITY_AH
    assert first.resistance_ohm[0] == pytest.approx(r0_ohm(1.0), rel=1e-6)
    assert first.resistance_ohm[2] == pytest.approx(expected, rel=5e-4)


@pytest.mark.slow
def test_the_command_writes_tables_pulses_and_figures_and_exports_take_them(tmp_path):
    folder = tmp_path / "out"
    runner = CliRunner()
    ran = runner.invoke(app, ["hppc", "--seeds=0", "--out", str(folder)])
    assert ran.exit_code == 0, ran.output
    assert "discharge at 1C (2 A)" in ran.output
    figures = {path.stem for path in (folder / "figures").iterdir()}
    assert {"tables", "identification-pulses"} <= figures
    rows = list(csv.DictReader((folder / "pulses.csv").read_text().splitlines()))
    assert len(rows) == len(json.loads((folder / "result.json").read_text())["pulses"]) == 37
    for name, exporter in EXPORTERS.items():
        place = tmp_path / exporter.file_name
        ran = runner.invoke(app, ["export", str(folder), "--to", name, "--out", str(place)])
        assert ran.exit_code == 0, ran.output
        assert place.stat().st_size > 500

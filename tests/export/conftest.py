"""What exports are tested with: results of each kind, packages that are not there, C programs."""

import shutil
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from barnax.cell import InterpolatedCurve
from barnax.export import EXPORTERS
from barnax.fit.temperature_fits import OverTemperature
from helpers.results import CIRCUITS, NODES, TABLE_OHM, make_table_result

every_exporter = pytest.mark.parametrize("exporter", EXPORTERS.values(), ids=lambda each: each.name)
every_circuit = pytest.mark.parametrize("circuit", CIRCUITS)

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
needs_a_compiler = pytest.mark.skipif(COMPILER is None, reason="this system has no C compiler")
STRICT = (
    *("-pedantic", "-Wall", "-Wextra", "-Wdouble-promotion", "-Wfloat-conversion", "-Werror"),
    "-O2",
)

# Temperatures of tables over both, and the factors of their resistances and OCV corrections.
DEGC, FACTORS = (0.0, 25.0, 45.0), (2.0, 1.0, 0.5)


def compiled(folder, exporter, result, source, *options):
    """A program around an exported header."""
    (folder / exporter.file_name).write_bytes(exporter.write(result).content)
    (folder / "main.c").write_text(source)
    program = folder / "-".join(["main", *options])
    command = [COMPILER, *STRICT, *options, folder / "main.c", "-o", program, "-lm"]
    subprocess.run(command, check=True)
    return program


def run_module(exporter, result) -> dict[str, Any]:
    """What an exported Python module defines."""
    module: dict[str, Any] = {}
    exec(exporter.write(result).content, module)
    return module


@pytest.fixture
def fake_pybamm(monkeypatch):
    """As much of PyBaMM as the module names, so that it loads where PyBaMM is not installed."""

    def interpolant(points, values, at, name=""):
        if not isinstance(at, list):
            return np.interp(at, points, values)
        return np.interp(at[0], points[0], [np.interp(at[1], points[1], row) for row in values])

    circuits = SimpleNamespace(Thevenin=lambda options: options)
    fake = SimpleNamespace(
        Interpolant=interpolant, equivalent_circuit=circuits, maximum=max, minimum=min
    )
    monkeypatch.setitem(sys.modules, "pybamm", fake)


@pytest.fixture(scope="session")
def over_temperature():
    """Tables over SOC and temperature, and the cell of each temperature: its OCV 4 mV lower and
    higher at the outer ones, its capacity another."""
    actual = make_table_result()
    fit, fits = actual.fit, []
    for factor in FACTORS:
        tables = fit.tables.with_tables(
            {name: factor * np.array(row) for name, row in fit.tables.tables.items()}
        )
        fits.append(replace(fit, tables=tables))
    over = OverTemperature(DEGC, 1e-3, 1e-3, 1e-3, (), ())
    part = replace(actual.tables, fits=tuple(fits), over_temperature=over)

    def moved(degc, lift_v, capacity_ah):
        branches = {
            name: InterpolatedCurve.fit(branch.soc, branch.voltage_v + lift_v)
            for name, branch in (
                ("charge", actual.cell.charge),
                ("discharge", actual.cell.discharge),
            )
        }
        return replace(actual.cell, **branches, temperature_degc=degc, capacity_ah=capacity_ah)

    others = moved(0.0, -4e-3, 1.9), moved(45.0, 4e-3, 2.1)
    cell = replace(actual.cell, temperature_degc=25.0, capacity_ah=2.0, elsewhere=others)
    return actual.model_copy(update={"tables": part, "cell": cell})


def r0_ohm(degc, soc):
    """The logarithm is linear in 1/T between the measured temperatures, constant beyond."""
    inverse = 1 / (273.15 + np.array(DEGC))
    power = np.interp(-1 / (273.15 + degc), -inverse, np.log(FACTORS))
    return np.exp(power) * np.interp(soc, NODES, TABLE_OHM[0])

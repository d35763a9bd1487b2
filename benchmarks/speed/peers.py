"""PyBaMM and PyBOP at the same job, in an environment of their own that this command makes."""

import json
import os
import subprocess
import tempfile
import venv
from pathlib import Path

import numpy as np

import barnax
from barnax.search.evaluate import evaluate

from .case import bundled_cell, bundled_record
from .sizes import POPULATION, Sizes

REQUIREMENTS = ("pybop==26.3",)
WORKER = Path(__file__).parent / "peers_worker.py"
CIRCUIT = barnax.CircuitParameters.constant(0.06, (0.03, 0.02), (1000.0, 50_000.0))
# Where the bounded fit starts, as a share of the circuit whose simulation was timed.
START = 1.2


def run_peers(sizes: Sizes) -> tuple[dict, str]:
    """What the worker measured, and why it could not where it could not (then the first is {})."""
    try:
        python = _environment()
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "case.npz"
            _write_case(path)
            command = [python, WORKER, str(sizes.evaluations_of_peers), path]
            done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=300)
        return json.loads(done.stdout.splitlines()[-1]), ""
    except (subprocess.SubprocessError, OSError, ValueError) as error:
        detail = getattr(error, "stderr", None) or str(error)
        return {}, str(detail).strip().splitlines()[-1]


def whole_fit_s(measured: dict, name: str, sizes: Sizes) -> float:
    """A fit of as many evaluations as ours, from what one evaluation or the bounded fit took."""
    each = measured[name].get("fit_s", measured[name]["simulation_s"])
    return each / measured[name].get("evaluations", 1) * POPULATION * sizes.generations


def _environment() -> Path:
    folder = Path(tempfile.gettempdir()) / "barnax-benchmark-pybop"
    python = folder / ("Scripts" if os.name == "nt" else "bin") / "python"
    if not python.exists():
        venv.create(folder, with_pip=True)
        command = [python, "-m", "pip", "install", "--quiet", *REQUIREMENTS]
        subprocess.run(command, check=True, capture_output=True, text=True, timeout=600)
    return python


def _write_case(path: Path) -> None:
    """The bundled record and the OCV without hysteresis, for which PyBaMM has no counterpart."""
    problem = barnax.make_problem(bundled_record(), bundled_cell(), "so-rc")
    prepared = problem.prepared
    soc = np.linspace(0, 1, 201)
    ranges = [problem.bounds.ranges[name] for name in ("R0 [Ohm]", "R1 [Ohm]", "R2 [Ohm]")]
    (low0, high0), (low1, high1), (low2, high2) = ranges
    shortest_s, longest_s = problem.bounds.tau_limits_s
    (r1, r2), (c1, c2) = CIRCUIT.r, CIRCUIT.c
    circuit = np.array([CIRCUIT.r0, r1, c1, r2, c2])
    np.savez(
        path,
        time_s=prepared.time_s - prepared.time_s[0],
        current_a=prepared.current_a,
        voltage_v=prepared.voltage_v,
        simulated_v=evaluate(prepared, CIRCUIT).simulated_v,
        soc=soc,
        ocv_v=bundled_cell().average_ocv_v(soc),
        initial_soc=min(prepared.start.soc, 1 - 1e-6),
        capacity_ah=bundled_cell().capacity_ah,
        circuit=circuit,
        start=START * circuit,
        lower=np.array([low0, low1, shortest_s / high1, low2, shortest_s / high2]),
        upper=np.array([high0, high1, longest_s / low1, high2, longest_s / low2]),
    )

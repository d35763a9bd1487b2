"""One simulation and a bounded fit by PyBaMM and PyBOP, in their own environment.

Called with the number of evaluations and an `.npz` of the case; prints JSON.
"""

import importlib.metadata
import json
import statistics
import sys
import time
from pathlib import Path

import numpy as np
import pybamm
import pybop


def parameter_values(case) -> pybamm.ParameterValues:
    """The circuit under PyBaMM's names, with thermal parameters that hold the cell at 25 degC."""
    soc, ocv_v = case["soc"], case["ocv_v"]

    def open_circuit_voltage(at):
        return pybamm.Interpolant(soc, ocv_v, at, name="open-circuit voltage")

    capacity_ah = float(case["capacity_ah"])
    r0, r1, c1, r2, c2 = case["circuit"].tolist()
    return pybamm.ParameterValues(
        {
            "chemistry": "ecm",
            "Initial SoC": float(case["initial_soc"]),
            "Cell capacity [A.h]": capacity_ah,
            "Nominal cell capacity [A.h]": capacity_ah,
            "Current function [A]": pybamm.Interpolant(
                case["time_s"], case["current_a"], pybamm.t, interpolator="linear"
            ),
            "R0 [Ohm]": r0,
            "R1 [Ohm]": r1,
            "C1 [F]": c1,
            "R2 [Ohm]": r2,
            "C2 [F]": c2,
            "Element-1 initial overpotential [V]": 0.0,
            "Element-2 initial overpotential [V]": 0.0,
            "Open-circuit voltage [V]": open_circuit_voltage,
            "Upper voltage cut-off [V]": float(ocv_v.max()) + 1.0,
            "Lower voltage cut-off [V]": float(ocv_v.min()) - 1.0,
            "Entropic change [V/K]": 0.0,
            "Initial temperature [K]": 298.15,
            "Ambient temperature [K]": 298.15,
            "Cell thermal mass [J/K]": 1e9,
            "Cell-jig heat transfer coefficient [W/K]": 1.0,
            "Jig thermal mass [J/K]": 1e9,
            "Jig-air heat transfer coefficient [W/K]": 1.0,
        }
    )


def thevenin() -> pybamm.BaseModel:
    return pybamm.equivalent_circuit.Thevenin(options={"number of rc elements": 2})


def median_seconds(call, repeats: int) -> float:
    """The median of some calls after one that builds what there is to build."""
    call()
    seconds = []
    for _ in range(repeats):
        begin = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - begin)
    return statistics.median(seconds)


def simulate(case, repeats: int) -> dict:
    """PyBaMM's Thevenin model, its fastest solver, the voltage at every sample."""
    simulation = pybamm.Simulation(
        thevenin(), parameter_values=parameter_values(case), solver=pybamm.IDAKLUSolver()
    )
    time_s = case["time_s"]
    ends = [time_s[0], time_s[-1]]
    found = {}

    def call():
        solution = simulation.solve(t_eval=ends, t_interp=time_s)
        found["voltage_v"] = solution["Voltage [V]"].entries

    seconds = median_seconds(call, repeats)
    voltage_v = found["voltage_v"]
    error_v = voltage_v - case["simulated_v"][: len(voltage_v)]
    return {"simulation_s": seconds, "difference_v": float(np.sqrt(np.mean(error_v**2)))}


def fit(case, repeats: int, evaluations: int) -> dict:
    """PyBOP's problem with its recommended solver, under a simplex that stops after few steps."""
    values, names = parameter_values(case), ("R0 [Ohm]", "R1 [Ohm]", "C1 [F]", "R2 [Ohm]", "C2 [F]")
    for name, start, low, high in zip(
        names, case["start"].tolist(), case["lower"].tolist(), case["upper"].tolist(), strict=True
    ):
        values[name] = pybop.Parameter(bounds=(low, high), initial_value=start)
    dataset = pybop.Dataset(
        {
            "Time [s]": case["time_s"],
            "Current [A]": case["current_a"],
            "Voltage [V]": case["voltage_v"],
        }
    )
    simulator = pybop.pybamm.Simulator(thevenin(), parameter_values=values, protocol=dataset)
    problem = pybop.Problem(simulator, pybop.RootMeanSquaredError(dataset))
    truth = dict(zip(names, case["circuit"].tolist(), strict=True))
    evaluation_s = median_seconds(lambda: problem(truth), repeats)
    options = pybop.SciPyMinimizeOptions(
        method="Nelder-Mead", jac=False, solver_options={"maxfev": evaluations}
    )
    optimizer = pybop.SciPyMinimize(problem, options=options)
    begin = time.perf_counter()
    found = optimizer.run()
    return {
        "simulation_s": evaluation_s,
        "fit_s": time.perf_counter() - begin,
        "evaluations": int(found.scipy_result.nfev),
    }


def main() -> None:
    evaluations, path = int(sys.argv[1]), Path(sys.argv[2])
    repeats = 3 if evaluations > 5 else 1
    with np.load(path) as loaded:
        case = dict(loaded)
    answer = {
        "PyBaMM": simulate(case, repeats),
        "PyBOP": fit(case, repeats, evaluations),
        "versions": {name: importlib.metadata.version(name) for name in ("pybop", "pybamm")},
    }
    print(json.dumps(answer))


if __name__ == "__main__":
    main()

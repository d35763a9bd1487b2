"""Exports that are Python modules: for PyBaMM's Thevenin model, and for NREL's thevenin.

A simulation of both verifies that the exported circuit is the identified one.

PyBaMM: names and signatures are those of its own set `ECM_Example` and of `pybamm.EcmParameters`
(PyBaMM 26.10). The sign of current is ours.

thevenin: keys and signatures are those of `thevenin.Simulation` and `thevenin.Prediction` (thevenin
0.2). The package relaxes the hysteresis voltage itself toward M_hyst(soc), Plett (2004), while
barnax relaxes the share of it: they differ by about the slope of M_hyst over gamma.
"""

import importlib.metadata
import importlib.util
from typing import Any

import numpy as np
from jaxtyping import Float

from ..cell.model import REFERENCE_DEGC
from ..results import Result
from .exporter import INSTANT_RATE, Export, HeldLoad, caveats_of, from_template
from .tables import Tables, tables_of

# A result has no cut-off voltages; these do not stop any simulation of the cell.
CUTOFF_MARGIN_V = 1.0
# PyBaMM refuses to start if one of its events is already met.
NEAREST_TO_LIMIT = 1e-6
# Duration of a current jump between two samples, far below any time constant.
JUMP_S = 1e-6
# Tools with a capacitance as input divide by the resistance; this value counts as zero.
LEAST_OHM = 1e-9


def _module(package: str, getter: str, tables: Tables, **values: Any) -> Export:
    """The module for a package, whose function `getter` returns the parameters."""
    is_over_temperature = tables.degc is not None
    return from_template(
        f"barnax_{package}.py.jinja",
        tables.heading,
        tables.caveats + caveats_of(package, tables, getter),
        tables=tables,
        argument=f"temperature_degc={REFERENCE_DEGC}" if is_over_temperature else "",
        kelvin="273.15 + temperature_degc" if is_over_temperature else 298.15,
        resistances={name: np.maximum(r, LEAST_OHM) for name, r in tables.resistances.items()},
        **values,
    )


def _loaded(content: bytes, getter: str, profile: HeldLoad) -> tuple[dict, dict]:
    """An exported module, and its parameters at the profile's temperature."""
    module: dict = {}
    exec(compile(content, "the exported module", "exec"), module)
    degc = [profile.temperature_degc] if "DEGC" in module else []
    return module, module[getter](*degc)


def write_pybamm(result: Result) -> Export:
    """The source of a module for PyBaMM."""
    tables = tables_of(result)
    return _module(
        "pybamm", "get_parameter_values", tables,
        initial_soc=min(max(result.initial_soc, NEAREST_TO_LIMIT), 1 - NEAREST_TO_LIMIT),
        cutoff_margin_v=CUTOFF_MARGIN_V,
    )  # fmt: skip


def simulate_pybamm(content: bytes, profile: HeldLoad) -> Float[np.ndarray, "samples"]:
    """PyBaMM's terminal voltage in V, from an exported module."""
    pybamm = importlib.import_module("pybamm")
    module, values = _loaded(content, "get_parameter_values", profile)
    # PyBaMM interpolates a current linearly; two points at every jump make it a step, and its
    # solver restarts at each of them.
    before_s = profile.time_s[1:] - JUMP_S
    time_s = np.insert(profile.time_s, np.arange(1, len(profile.time_s)), before_s)
    current_a = np.repeat(profile.current_a, 2)[:-1]
    values["Current function [A]"] = lambda t: pybamm.Interpolant(time_s, current_a, t)
    simulation = pybamm.Simulation(
        module["get_model"](),
        parameter_values=pybamm.ParameterValues(values),
        solver=pybamm.IDAKLUSolver(rtol=1e-8, atol=1e-9),
    )
    solution = simulation.solve(t_eval=time_s, t_interp=profile.time_s)
    return np.asarray(solution["Voltage [V]"](profile.time_s))


def write_thevenin(result: Result) -> Export:
    """The source of a module for thevenin."""
    tables = tables_of(result)
    none = np.zeros(2)
    return _module(
        "thevenin", "get_params", tables,
        gamma=INSTANT_RATE if tables.kind == "instant" else tables.gamma or 0.0,
        hysteresis_soc=tables.hysteresis.soc if tables.hysteresis else np.array([0.0, 1.0]),
        half_hysteresis_v=tables.hysteresis.voltage_v / 2 if tables.hysteresis else none,
    )  # fmt: skip


def simulate_thevenin(content: bytes, profile: HeldLoad) -> Float[np.ndarray, "samples"]:
    """thevenin's terminal voltage in V, from an exported module, stepped with its Prediction."""
    thevenin = importlib.import_module("thevenin")
    module, params = _loaded(content, "get_params", profile)
    model = thevenin.Prediction(params)
    model.set_options(rtol=1e-8, atol=1e-10)
    state = thevenin.TransientState(
        soc=params["soc0"],
        T_cell=params["T_inf"],
        hyst=module["INITIAL_HYSTERESIS_V"],
        eta_j=np.zeros(params["num_RC_pairs"]),
    )

    def voltage_v(current_a: float) -> float:
        ohmic_v = current_a * model.R0(state.soc, state.T_cell)
        return float(model.ocv(state.soc) + state.hyst - np.sum(state.eta_j) - ohmic_v)

    current_a = profile.current_a.tolist()
    voltages_v = [voltage_v(current_a[0])]
    for sample, interval_s in enumerate(np.diff(profile.time_s).tolist()):
        state = model.take_step(state, current_a[sample], interval_s)
        # The voltage of a step is that before the current jumps.
        voltages_v.append(voltage_v(current_a[sample + 1]))
    return np.array(voltages_v)

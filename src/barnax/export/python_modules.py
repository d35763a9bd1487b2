"""Exports that are Python modules: for PyBaMM's Thevenin model, and for NREL's thevenin.

PyBaMM: names and signatures are those of its own set `ECM_Example` and of `pybamm.EcmParameters`
(PyBaMM 26.10). The sign of current is ours.

thevenin: keys and signatures are those of `thevenin.Simulation` and `thevenin.Prediction` (thevenin
0.2). The package relaxes the hysteresis voltage itself toward M_hyst(soc), Plett (2004), where
barnax relaxes the share of it: they differ by about the slope of M_hyst over gamma.
"""

import importlib
from typing import Any

import numpy as np
from jaxtyping import Float

from ..cell.model import REFERENCE_DEGC
from ..results import Result
from .exporter import Export, Profile, from_template, hysteresis_is_left_out
from .tables import Tables, tables_of

# A result has no cut-off voltages; these stop no simulation of the cell.
CUTOFF_MARGIN_V = 1.0
# PyBaMM refuses to start where one of its events is already met.
NEAREST_TO_LIMIT = 1e-6
# The time a current takes to jump between two samples, far below any time constant.
JUMP_S = 1e-6
# The rate, per unit of SOC, that turns the hysteresis within 1e-5 of the capacity: nearly at once.
# A higher one turns with a tester's noise at rest: measured on the bundled trips, 1e5 has the
# lowest rms difference from a hysteresis that turns at once.
INSTANT_RATE = 1e5
# Tools that ask for a capacitance divide by the resistance; this much is none.
LEAST_OHM = 1e-9


def _module(
    package: str, getter: str, tables: Tables, caveats: tuple[str, ...], **values: Any
) -> Export:
    """The module for a package, whose function `getter` gives the parameters."""
    is_over_temperature = tables.degc is not None
    if is_over_temperature:
        caveats += (
            f"{package}'s open-circuit voltage does not depend on temperature: it is that at the "
            f"temperature given to {getter}, which is also the cell's; get another set if it "
            "changes.",
        )
    return from_template(
        f"barnax_{package.lower()}.py.jinja",
        tables,
        (*tables.caveats, *caveats),
        argument=f"temperature_degc={REFERENCE_DEGC}" if is_over_temperature else "",
        kelvin="273.15 + temperature_degc" if is_over_temperature else 298.15,
        resistances={name: np.maximum(r, LEAST_OHM) for name, r in tables.resistances.items()},
        **values,
    )


def _loaded(content: bytes, getter: str, profile: Profile) -> tuple[dict, dict]:
    """An exported module, and its parameters at the profile's temperature."""
    module: dict = {}
    exec(compile(content, "the exported module", "exec"), module)
    degc = [profile.temperature_degc] if "DEGC" in module else []
    return module, module[getter](*degc)


def write_pybamm(result: Result) -> Export:
    """The source of a module for PyBaMM."""
    tables = tables_of(result)
    where = "25 degC" if tables.degc is None else "the given temperature"
    caveats = (
        *hysteresis_is_left_out("PyBaMM's Thevenin model", tables),
        "PyBaMM stops a simulation when the SOC leaves 0 to 1; barnax continues with the end "
        "values of the OCV.",
        "A result has no cut-off voltages: they are set 1 V outside the OCV, where they have no "
        "effect. Set those of your cell.",
        "A result has no thermal parameters and no entropic change: the placeholders keep the "
        f"cell at {where}.",
    )
    return _module(
        "PyBaMM", "get_parameter_values", tables, caveats,
        initial_soc=min(max(tables.initial_soc, NEAREST_TO_LIMIT), 1 - NEAREST_TO_LIMIT),
        cutoff_margin_v=CUTOFF_MARGIN_V,
    )  # fmt: skip


def simulate_pybamm(content: bytes, profile: Profile) -> Float[np.ndarray, "samples"]:
    """PyBaMM's terminal voltage in V, from an exported module."""
    pybamm = importlib.import_module("pybamm")
    module, values = _loaded(content, "get_parameter_values", profile)
    # PyBaMM interpolates a current linearly; two points at every jump make it hold instead, and
    # its solver restarts at each of them.
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
    caveats = (
        *_hysteresis_caveats(tables),
        "A result has no thermal parameters: mass, Cp, h_therm and A_therm are placeholders, and "
        "the model is isothermal.",
    )
    none = np.zeros(2)
    return _module(
        "thevenin", "get_params", tables, caveats,
        gamma=INSTANT_RATE if tables.kind == "instant" else tables.gamma or 0.0,
        hysteresis_soc=tables.hysteresis.soc if tables.hysteresis else np.array([0.0, 1.0]),
        half_hysteresis_v=tables.hysteresis.voltage_v / 2 if tables.hysteresis else none,
    )  # fmt: skip


def _hysteresis_caveats(tables: Tables) -> tuple[str, ...]:
    if tables.kind == "none":
        return ()
    relaxing = (
        "thevenin relaxes the hysteresis voltage, barnax its fraction of W(soc)/2: they differ by "
        "about the slope of W(soc)/2 over gamma. In thevenin it changes at any current, however "
        "small, while barnax holds it below the rest current."
    )
    switching = (
        f"{tables.model} switches its hysteresis immediately; here it follows the charge with "
        f"gamma = {INSTANT_RATE:g} per unit of SOC, and at any current, however small, while "
        "barnax holds it below the rest current."
    )
    return (
        switching if tables.kind == "instant" else relaxing,
        "thevenin.Simulation starts without hysteresis voltage, barnax with "
        f"{1e3 * tables.initial_hysteresis_v:.3g} mV; thevenin.Prediction takes it as its state.",
    )


def simulate_thevenin(content: bytes, profile: Profile) -> Float[np.ndarray, "samples"]:
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
    found = [voltage_v(current_a[0])]
    for sample, interval_s in enumerate(np.diff(profile.time_s).tolist()):
        state = model.take_step(state, current_a[sample], interval_s)
        # A step's own voltage is that before the current jumps.
        found.append(voltage_v(current_a[sample + 1]))
    return np.array(found)

"""PyBaMM: a Python module with the parameters of `pybamm.equivalent_circuit.Thevenin`.

Names and signatures are those of PyBaMM's own set `ECM_Example` and of `pybamm.EcmParameters`
(PyBaMM 26.10). The sign of current is ours.
"""

import importlib

import numpy as np
from jaxtyping import Float

from ..cell.model import REFERENCE_DEGC
from ..results import Result
from .exporter import (
    Export,
    Exporter,
    Profile,
    hysteresis_is_left_out,
    note_lines,
    numbers,
    python_array,
    python_tables,
)
from .tables import Tables, table_caveats, tables_of

# A result has no cut-off voltages; these stop no simulation of the cell.
CUTOFF_MARGIN_V = 1.0
# PyBaMM refuses to start where one of its events is already met.
NEAREST_TO_LIMIT = 1e-6
# The time a current takes to jump between two samples, far below any time constant.
JUMP_S = 1e-6

TEMPLATE = '''\
{notes}
#
# import pybamm
# from barnax_pybamm import get_model, get_parameter_values
# values = pybamm.ParameterValues(get_parameter_values())
# solution = pybamm.Simulation(get_model(), parameter_values=values).solve([0, 600])

import numpy as np
import pybamm

RC_ELEMENTS = {pairs}

SOC = np.array([
{soc}
])
OCV_V = {ocv}
{circuit_tables}


{functions}def get_model():
    """The Thevenin model with as many RC elements as these parameters have."""
    return pybamm.equivalent_circuit.Thevenin(options={{"number of rc elements": RC_ELEMENTS}})


def get_parameter_values({argument}):
    """The parameters under PyBaMM's names."""
    return {{
        "chemistry": "ecm",
{values}
        "Open-circuit voltage [V]": {ocv_function},
    }}
'''


OCV = """\
def open_circuit_voltage(soc):
    return pybamm.Interpolant(SOC, OCV_V, soc, name="open-circuit voltage")


"""
CAPACITANCE = """\
def capacitance(values, tau):
    resistance = table(values)

    def over_soc(T_cell, current, soc):
        return tau / resistance(T_cell, current, soc)

    return over_soc


"""
FUNCTIONS = f"""\
def table(values):
    def over_soc(T_cell, current, soc):
        return pybamm.Interpolant(NODES, values, soc)

    return over_soc


{CAPACITANCE}"""


# The model's OCV knows no temperature: it is that of the temperature the parameters are asked for.
OVER_TEMPERATURE = f"""\
def within(T_cell):
    return pybamm.minimum(pybamm.maximum(T_cell, DEGC[0]), DEGC[-1])


def table(values):
    def over_soc(T_cell, current, soc):
        return pybamm.Interpolant([DEGC, NODES], values, [within(T_cell), soc])

    return over_soc


{CAPACITANCE}def ocv_at(temperature_degc):
    ocv_v = [np.interp(temperature_degc, DEGC, column) for column in OCV_V.T]

    def over_soc(soc):
        return pybamm.Interpolant(SOC, np.array(ocv_v), soc, name="open-circuit voltage")

    return over_soc


"""
ONE_OCV = (
    "PyBaMM's open-circuit voltage does not depend on temperature: it is that at the temperature "
    "given to get_parameter_values, which is also the cell's; get another set if it changes."
)


def write_pybamm(result: Result) -> Export:
    """The module's source."""
    tables = tables_of(result)
    axis = tables.over_temperature
    caveats = (
        *table_caveats(tables),
        *hysteresis_is_left_out("PyBaMM's Thevenin model", tables),
        "PyBaMM stops a simulation when the SOC leaves 0 to 1; barnax continues with the end "
        "values of the OCV.",
        "A result has no cut-off voltages: they are set 1 V outside the OCV, where they have no "
        "effect. Set those of your cell.",
        "A result has no thermal parameters and no entropic change: the placeholders keep the "
        f"cell at {'the given temperature' if axis else '25 degC'}.",
        *([ONE_OCV] if axis else []),
    )
    functions = OCV + ("" if tables.over_soc is None else FUNCTIONS)
    content = TEMPLATE.format(
        notes=note_lines(tables.heading, caveats, "# "),
        pairs=tables.pairs,
        soc=numbers(tables.ocv.soc),
        ocv=python_array(tables.ocv.voltage_v if axis is None else axis.ocv_v),
        circuit_tables=python_tables(tables),
        functions=functions if axis is None else OVER_TEMPERATURE,
        argument="" if axis is None else f"temperature_degc={REFERENCE_DEGC}",
        ocv_function="open_circuit_voltage" if axis is None else "ocv_at(temperature_degc)",
        values="\n".join(
            f'        "{name}": {value},'
            for name, value in (_circuit(tables) | _values(tables)).items()
        ),
    )
    return Export(content.encode(), caveats)


def _circuit(tables: Tables) -> dict[str, str]:
    """R0 and every pair's R and C: numbers, or calls that make functions of SOC."""
    if tables.over_soc is None:
        constants = tables.parameters.to_dict()
        return {name: repr(value) for name, value in constants.items() if name != "gamma"}
    named = {"R0 [Ohm]": "table(R0)"}
    for pair, tau_s in enumerate(tables.tau_s, start=1):
        named[f"R{pair} [Ohm]"] = f"table(R{pair})"
        named[f"C{pair} [F]"] = f"capacitance(R{pair}, {tau_s!r})"
    return named


def _values(tables: Tables) -> dict[str, float | str]:
    """What the parameter set has under every name, but for the circuit."""
    overpotentials = {
        f"Element-{pair} initial overpotential [V]": 0.0 for pair in range(1, tables.pairs + 1)
    }
    kelvin = 298.15 if tables.over_temperature is None else "273.15 + temperature_degc"
    initial_soc = min(max(tables.initial_soc, NEAREST_TO_LIMIT), 1 - NEAREST_TO_LIMIT)
    return {
        "Initial SoC": initial_soc,
        "Cell capacity [A.h]": tables.capacity_ah,
        "Nominal cell capacity [A.h]": tables.capacity_ah,
        "Current function [A]": tables.capacity_ah,
        **overpotentials,
        "Upper voltage cut-off [V]": float(tables.ocv.voltage_v.max()) + CUTOFF_MARGIN_V,
        "Lower voltage cut-off [V]": float(tables.ocv.voltage_v.min()) - CUTOFF_MARGIN_V,
        "Entropic change [V/K]": 0.0,
        "Initial temperature [K]": kelvin,
        "Ambient temperature [K]": kelvin,
        "Cell thermal mass [J/K]": 1e9,
        "Cell-jig heat transfer coefficient [W/K]": 1.0,
        "Jig thermal mass [J/K]": 1e9,
        "Jig-air heat transfer coefficient [W/K]": 1.0,
    }


def simulate_pybamm(content: bytes, profile: Profile) -> Float[np.ndarray, "samples"]:
    """PyBaMM's terminal voltage in V, from an exported module."""
    pybamm = importlib.import_module("pybamm")
    module: dict = {}
    exec(compile(content, PYBAMM.file_name, "exec"), module)
    # PyBaMM interpolates a current linearly; two points at every jump make it hold instead, and
    # its solver restarts at each of them.
    before_s = profile.time_s[1:] - JUMP_S
    time_s = np.insert(profile.time_s, np.arange(1, len(profile.time_s)), before_s)
    current_a = np.repeat(profile.current_a, 2)[:-1]
    degc = [profile.temperature_degc] if "DEGC" in module else []
    values = module["get_parameter_values"](*degc)
    values["Current function [A]"] = lambda t: pybamm.Interpolant(time_s, current_a, t)
    simulation = pybamm.Simulation(
        module["get_model"](),
        parameter_values=pybamm.ParameterValues(values),
        solver=pybamm.IDAKLUSolver(rtol=1e-8, atol=1e-9),
    )
    solution = simulation.solve(t_eval=time_s, t_interp=profile.time_s)
    return np.asarray(solution["Voltage [V]"](profile.time_s))


PYBAMM = Exporter(
    name="pybamm",
    description="Python module: parameter values of PyBaMM's Thevenin model",
    file_name="barnax_pybamm.py",
    write=write_pybamm,
    package="pybamm",
    simulate=simulate_pybamm,
)

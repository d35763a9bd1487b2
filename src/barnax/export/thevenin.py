"""NREL's thevenin: a Python module with the parameter dictionary of its models.

Keys and signatures are those of `thevenin.Simulation` and `thevenin.Prediction` (thevenin 0.2).
The package relaxes the hysteresis voltage itself toward M_hyst(soc), Plett (2004), where barnax
relaxes the share of it: they differ by about the slope of M_hyst over gamma.
"""

import importlib
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from ..cell.model import REFERENCE_DEGC
from ..results import Result
from .exporter import Export, Exporter, Profile, note_lines, numbers, python_array, python_tables
from .tables import Tables, table_caveats, tables_of

# The rate, per unit of SOC, that turns the hysteresis within 1e-5 of the capacity: nearly at once.
# A higher one turns with a tester's noise at rest: measured on the bundled trips, 1e5 has the
# lowest rms difference from a hysteresis that turns at once.
INSTANT_RATE = 1e5

TEMPLATE = '''\
{notes}
#
# import thevenin
# from barnax_thevenin import INITIAL_HYSTERESIS_V, get_params
# simulation = thevenin.Simulation(get_params())
# prediction = thevenin.Prediction(get_params())

import numpy as np

SOC = np.array([
{soc}
])
OCV_V = {ocv}
HYSTERESIS_SOC = np.array([
{hysteresis_soc}
])
HALF_HYSTERESIS_V = np.array([
{half_hysteresis}
])
# To start as barnax does: thevenin.TransientState(..., hyst=INITIAL_HYSTERESIS_V, ...).
INITIAL_HYSTERESIS_V = {initial_hysteresis!r}
{circuit_tables}


{ocv_function}def half_hysteresis(soc):
    return np.interp(soc, HYSTERESIS_SOC, HALF_HYSTERESIS_V)


def constant(value):
    return lambda soc, T_cell: value


{functions}def get_params({argument}):
    """The parameters under thevenin's names."""
    return {{
        "num_RC_pairs": {pairs},
        "soc0": {soc0!r},
        "capacity": {capacity!r},
        "ce": 1.0,
        "gamma": {gamma!r},
        "mass": 1.0,
        "isothermal": True,
        "Cp": 1000.0,
        "T_inf": {kelvin},
        "h_therm": 0.0,
        "A_therm": 0.0,
        "ocv": {ocv_name},
        "M_hyst": half_hysteresis,
{circuit}
    }}
'''


OCV = """\
def ocv(soc):
    return np.interp(soc, SOC, OCV_V)


"""
FUNCTIONS = """\
def table(values):
    return lambda soc, T_cell: np.interp(soc, NODES, values)


def capacitance(values, tau):
    return lambda soc, T_cell: tau / np.interp(soc, NODES, values)


"""
# The package's OCV knows no temperature: it is that of the temperature asked for.
OCV_AT = """\
def ocv_at(temperature_degc):
    ocv_v = [np.interp(temperature_degc, DEGC, column) for column in OCV_V.T]
    return lambda soc: np.interp(soc, SOC, ocv_v)


"""
OVER_TEMPERATURE = """\
def table(values):
    def over_soc(soc, T_cell):
        degc = min(max(float(T_cell) - 273.15, DEGC[0]), DEGC[-1])
        above = min(max(int(np.searchsorted(DEGC, degc)), 1), len(DEGC) - 1)
        share = (degc - DEGC[above - 1]) / (DEGC[above] - DEGC[above - 1])
        return np.interp(soc, NODES, (1 - share) * values[above - 1] + share * values[above])

    return over_soc


def capacitance(values, tau):
    resistance = table(values)
    return lambda soc, T_cell: tau / resistance(soc, T_cell)


"""
ONE_OCV = (
    "thevenin's open-circuit voltage does not depend on temperature: it is that at the temperature "
    "given to get_params, which is also the cell's; get another set if it changes."
)


def write_thevenin(result: Result) -> Export:
    """The module's source."""
    tables = tables_of(result)
    axis = tables.over_temperature
    caveats = (
        *table_caveats(tables),
        *_hysteresis_caveats(tables),
        "A result has no thermal parameters: mass, Cp, h_therm and A_therm are placeholders, and "
        "the model is isothermal.",
        *([ONE_OCV] if axis else []),
    )
    hysteresis_soc, half_hysteresis_v = np.array([0.0, 1.0]), np.zeros(2)
    if tables.hysteresis is not None:
        hysteresis_soc = tables.hysteresis.soc
        half_hysteresis_v = tables.hysteresis.voltage_v / 2
    content = TEMPLATE.format(
        notes=note_lines(tables.heading, caveats, "# "),
        soc=numbers(tables.ocv.soc),
        ocv=python_array(tables.ocv.voltage_v if axis is None else axis.ocv_v),
        ocv_function=OCV if axis is None else OCV_AT,
        ocv_name="ocv" if axis is None else "ocv_at(temperature_degc)",
        functions=FUNCTIONS if axis is None else OVER_TEMPERATURE,
        argument="" if axis is None else f"temperature_degc={REFERENCE_DEGC}",
        kelvin=298.15 if axis is None else "273.15 + temperature_degc",
        hysteresis_soc=numbers(hysteresis_soc),
        half_hysteresis=numbers(half_hysteresis_v),
        initial_hysteresis=tables.initial_hysteresis_v,
        pairs=tables.pairs,
        soc0=tables.initial_soc,
        capacity=tables.capacity_ah,
        gamma=_rate(tables),
        circuit_tables=python_tables(tables),
        circuit="\n".join(f"        {line}," for line in _circuit(tables)),
    )
    return Export(content.encode(), caveats)


def _circuit(tables: Tables) -> Iterator[str]:
    """The entries of R0 and of every pair."""
    if tables.over_soc is None:
        for name, value in tables.parameters.to_dict().items():
            if name != "gamma":
                yield f'"{name.split(" ")[0]}": constant({value!r})'
        return
    yield '"R0": table(R0)'
    for pair, tau_s in enumerate(tables.tau_s, start=1):
        yield f'"R{pair}": table(R{pair})'
        yield f'"C{pair}": capacitance(R{pair}, {tau_s!r})'


def _rate(tables: Tables) -> float:
    if tables.kind == "instant":
        return INSTANT_RATE
    return tables.gamma or 0.0


def _hysteresis_caveats(tables: Tables) -> tuple[str, ...]:
    if tables.kind == "none":
        return ()
    start = (
        "thevenin.Simulation starts without hysteresis voltage, barnax with "
        f"{1e3 * tables.initial_hysteresis_v:.3g} mV; thevenin.Prediction takes it as its state."
    )
    if tables.kind == "instant":
        return (
            f"{tables.model} switches its hysteresis immediately; here it follows the charge with "
            f"gamma = {INSTANT_RATE:g} per unit of SOC, and at any current, however small, while "
            "barnax holds it below the rest current.",
            start,
        )
    return (
        "thevenin relaxes the hysteresis voltage, barnax its fraction of W(soc)/2: they differ by "
        "about the slope of W(soc)/2 over gamma. In thevenin it changes at any current, however "
        "small, while barnax holds it below the rest current.",
        start,
    )


def simulate_thevenin(content: bytes, profile: Profile) -> Float[np.ndarray, "samples"]:
    """thevenin's terminal voltage in V, from an exported module, stepped with its Prediction."""
    thevenin = importlib.import_module("thevenin")
    module: dict = {}
    exec(compile(content, THEVENIN.file_name, "exec"), module)
    degc = [profile.temperature_degc] if "DEGC" in module else []
    params = module["get_params"](*degc)
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


THEVENIN = Exporter(
    name="thevenin",
    description="Python module: parameter dictionary of NREL's thevenin",
    file_name="barnax_thevenin.py",
    write=write_thevenin,
    package="thevenin",
    simulate=simulate_thevenin,
)

"""The physics of the two virtual cells: PyBaMM's DFN with open-circuit hysteresis.

`README.md` beside this file says what departs from the published parameter sets, and why.
"""

import os
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

os.environ.setdefault("PYBAMM_DISABLE_TELEMETRY", "true")

import pybamm

# PyBaMM reminds every user of a definition that changed in 25.10; the rates below follow the new.
warnings.filterwarnings("ignore", message="The definition of the hysteresis decay rate")

NOMINAL_CAPACITY_AH = 2.0
UPPER_CUTOFF_V = 4.2
LOWER_CUTOFF_V = 2.5
KELVIN_AT_0_DEGC = 273.15
GRAPHITE_HALF_GAP_V = 0.006
PHOSPHATE_HALF_GAP_V = 0.012

MODEL_OPTIONS: dict[str, Any] = {
    "particle phases": ("2", "1"),
    "open-circuit potential": (("one-state hysteresis", "one-state hysteresis"), "single"),
    "contact resistance": "true",
    "thermal": "lumped",
}

GEOMETRY = {
    "Electrode height [m]": 0.065,
    "Electrode width [m]": 0.7739,
    "Negative electrode thickness [m]": 6.6e-5,
    "Positive electrode thickness [m]": 5.6e-5,
    "Cell volume [m3]": 1.65e-5,
    "Cell cooling surface area [m2]": 4.2e-3,
    "Nominal cell capacity [A.h]": NOMINAL_CAPACITY_AH,
    "Current function [A]": NOMINAL_CAPACITY_AH,
}

MATERIALS = {
    "Primary: Negative electrode active material volume fraction": 0.742,
    "Secondary: Negative electrode active material volume fraction": 0.008,
    "Positive particle diffusivity [m2.s-1]": 1.2e-14,
    "Contact resistance [Ohm]": 0.012,
    "Total heat transfer coefficient [W.m-2.K-1]": 15.0,
    # The lumped thermal model asks for this name; the set has it for each phase only.
    "Negative electrode density [kg.m-3]": 1677.0,
}

# A state of -1 is the branch that a charge leads to (lithiation); the parameter set starts full.
HYSTERESIS = {
    "Primary: Negative particle lithiation hysteresis decay rate": 30.0,
    "Primary: Negative particle delithiation hysteresis decay rate": 30.0,
    "Primary: Initial hysteresis state in negative electrode": -1.0,
    "Secondary: Negative particle lithiation hysteresis decay rate": 10.0,
    "Secondary: Negative particle delithiation hysteresis decay rate": 10.0,
    "Secondary: Initial hysteresis state in negative electrode": -1.0,
}

PHOSPHATE_OPTIONS: dict[str, Any] = {
    "open-circuit potential": ("single", "one-state hysteresis"),
    "contact resistance": "true",
}

# Positive electrodes take up lithium in discharge: +1 is the branch that a charge leads to.
PHOSPHATE = {
    "Positive particle lithiation hysteresis decay rate": 20.0,
    "Positive particle delithiation hysteresis decay rate": 20.0,
    "Initial hysteresis state in positive electrode": 1.0,
    "Contact resistance [Ohm]": 0.006,
}

EXCHANGE_CURRENTS = (
    "Primary: Negative electrode exchange-current density [A.m-2]",
    "Positive electrode exchange-current density [A.m-2]",
)


def parameter_values(ambient_degc: float) -> pybamm.ParameterValues:
    """Chen2020_composite, changed into a 2 Ah 18650 whose graphite has a hysteresis too."""
    values = pybamm.ParameterValues("Chen2020_composite")
    graphite_ocp = values["Primary: Negative electrode OCP [V]"]
    values.update(
        GEOMETRY
        | MATERIALS
        | HYSTERESIS
        | {"Ambient temperature [K]": KELVIN_AT_0_DEGC + ambient_degc}
        | {name: _doubled(values[name]) for name in EXCHANGE_CURRENTS}
        | {
            "Primary: Negative electrode lithiation OCP [V]": lambda stoichiometry: (
                graphite_ocp(stoichiometry) - GRAPHITE_HALF_GAP_V
            ),
            "Primary: Negative electrode delithiation OCP [V]": lambda stoichiometry: (
                graphite_ocp(stoichiometry) + GRAPHITE_HALF_GAP_V
            ),
        },
        check_already_exists=False,
    )
    return values


def phosphate_values(ambient_degc: float) -> pybamm.ParameterValues:
    """Prada2013, a 2.3 Ah cell of lithium iron phosphate, with hysteresis and a contact."""
    values = pybamm.ParameterValues("Prada2013")
    phosphate_ocp = values["Positive electrode OCP [V]"]
    values.update(
        PHOSPHATE
        | {"Ambient temperature [K]": KELVIN_AT_0_DEGC + ambient_degc}
        | {
            "Positive electrode lithiation OCP [V]": lambda stoichiometry: (
                phosphate_ocp(stoichiometry) - PHOSPHATE_HALF_GAP_V
            ),
            "Positive electrode delithiation OCP [V]": lambda stoichiometry: (
                phosphate_ocp(stoichiometry) + PHOSPHATE_HALF_GAP_V
            ),
        },
        check_already_exists=False,
    )
    return values


@dataclass(frozen=True)
class VirtualCell:
    """A cell that can be put on a tester: its limits and its physics."""

    capacity_ah: float
    upper_v: float
    lower_v: float
    options: dict[str, Any]
    values: Callable[[float], pybamm.ParameterValues]

    def simulation(self, steps: Sequence[Any], ambient_degc: float = 25.0) -> pybamm.Simulation:
        """One cycle of PyBaMM experiment steps, in air of that temperature."""
        return pybamm.Simulation(
            pybamm.lithium_ion.DFN(self.options),
            parameter_values=self.values(ambient_degc),
            experiment=pybamm.Experiment([tuple(steps)]),
            solver=pybamm.IDAKLUSolver(rtol=1e-6, atol=1e-6),
        )


NICKEL_CELL = VirtualCell(
    NOMINAL_CAPACITY_AH, UPPER_CUTOFF_V, LOWER_CUTOFF_V, MODEL_OPTIONS, parameter_values
)
PHOSPHATE_CELL = VirtualCell(2.3, 3.6, 2.5, PHOSPHATE_OPTIONS, phosphate_values)


def _doubled(exchange_current_density: Any) -> Any:
    def doubled(c_e: Any, c_s_surf: Any, c_s_max: Any, temperature: Any) -> Any:
        return 2.0 * exchange_current_density(c_e, c_s_surf, c_s_max, temperature)

    return doubled

"""A circuit by the scan, as searches run it."""

import jax
from jaxtyping import Array, Float

from barnax.cell import CircuitParameters
from barnax.cell.elements import alike
from barnax.execution import as_input
from barnax.model.simulate import RCParameters, SimulationInput, overpotential


def rc_parameters(parameters: CircuitParameters) -> RCParameters:
    """A circuit's values as the scan takes them. Call inside float64."""
    given = parameters.r0, parameters.r, parameters.tau_s, parameters.gamma
    are_pairs = alike(parameters.elements) == parameters.pairs
    elements = () if are_pairs else parameters.elements
    r0, r, tau_s, gamma = jax.tree.map(as_input, given)
    return RCParameters(r0, r, tau_s, gamma, elements)


def terminal_voltage(
    rc: RCParameters, inputs: SimulationInput, source_v: Float[Array, "samples"]
) -> Float[Array, "samples"]:
    """Simulated terminal voltage at every sample, in V (Li et al., 2023, Eq. 1 and 5)."""
    return source_v - overpotential(rc, inputs)

"""A circuit on a record, sample by sample: the reference of every reported number.

v = U(s) + D(s) + g(s) h - R0(s) i - sum u_p, with U the source voltage, D the OCV correction, h a
dynamic hysteresis of amplitude g, and u_p the voltages of the RC pairs. In every interval a pair
covers the share 1 - exp(-dt / tau_p) of the way to R_p(s) i, with s the SOC at its start.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Scalar

from ..cell import CircuitParameters
from ..cell.parameters import HALF_HYSTERESIS, OCV_CORRECTION
from ..execution import as_input, compile_for, in_float64
from .prepared import BLOCK, PreparedRecord
from .simulate import SimulationInput, respond


@in_float64
def simulate_circuit(
    prepared: PreparedRecord, parameters: CircuitParameters
) -> Float[np.ndarray, "simulated"]:
    """The terminal voltage at every simulated sample of a record, in V."""
    return prepared.voltage_v - errors_along(prepared, parameters)


def errors_along(
    prepared: PreparedRecord, parameters: CircuitParameters
) -> Float[np.ndarray, "simulated"]:
    """Measured minus simulated voltage in V at every simulated sample. Call inside float64."""
    return np.concatenate([error_v for _, error_v in error_blocks(prepared, parameters)])


def error_blocks(
    prepared: PreparedRecord, parameters: CircuitParameters
) -> Iterator[tuple[slice, Float[np.ndarray, "samples"]]]:
    """The same block after block. Call inside float64."""
    circuit = parameters.laddered()
    prepared, tau_s = _as_tabulated(prepared, circuit), circuit.tau_s
    gamma = None if prepared.hysteresis_amplitude_v is None else circuit.gamma
    states = np.zeros(len(tau_s) + (gamma is not None))
    scales = as_input(tau_s), None if gamma is None else as_input(gamma)
    for here, inputs in prepared.input_blocks(BLOCK, min(tau_s), gamma):
        size = here.stop - here.start
        soc = np.pad(prepared.soc[here], (0, BLOCK - size), mode="edge")
        ohm = np.array([circuit.at(name, soc) for name in circuit.resistances])
        advance = compile_for(_advance, *scales, ohm, inputs, states)
        states, error_v = advance(*scales, ohm, inputs, states)
        yield here, np.asarray(error_v)[:size]


def _as_tabulated(prepared: PreparedRecord, circuit: CircuitParameters) -> PreparedRecord:
    """The record with what the circuit has of its own beside resistances: OCV, hysteresis, and what
    its resistances follow."""
    prepared = prepared.following(circuit.dependence)
    source_v, amplitude_v = prepared.source_v, prepared.hysteresis_amplitude_v
    if OCV_CORRECTION in circuit.tables:
        source_v = source_v + circuit.at(OCV_CORRECTION, prepared.soc)
    if HALF_HYSTERESIS in circuit.tables and amplitude_v is not None:
        own_v = circuit.at(HALF_HYSTERESIS, prepared.soc)
        source_v = source_v + prepared.start.direction * (own_v - amplitude_v)
        amplitude_v = own_v
    return replace(prepared, source_v=source_v, hysteresis_amplitude_v=amplitude_v)


def _advance(
    tau_s: Float[Array, "pairs"],
    gamma: Scalar | None,
    ohm: Float[Array, "resistances samples"],
    inputs: SimulationInput,
    states: Float[Array, "states"],
) -> tuple[Float[Array, "states"], Float[Array, "samples"]]:
    """The states of every pair, then of a dynamic hysteresis, after the last sample, and the error
    at every one."""
    pairs, hysteresis = len(tau_s), inputs.hysteresis
    respond_all = jax.vmap(partial(respond, intervals=inputs.intervals))
    ends_v, drops_v = respond_all(tau_s, states[:pairs], ohm[1:] * inputs.held_a)
    error_v = inputs.base_error_v + ohm[0] * inputs.current_a + jnp.sum(drops_v, axis=0)
    if hysteresis is None or gamma is None:
        return ends_v, error_v
    clock, turning = hysteresis.intervals, hysteresis.hysteresis_input
    turned, state = respond(1 / gamma, states[pairs], turning, clock)
    return jnp.append(ends_v, turned), error_v - hysteresis.amplitude_v * state

"""A circuit on a record, sample by sample: the reference for every reported number.

v = U(s) + D(s) + g(s) h - R0(s) i - sum u_p, with U the source voltage, D the OCV correction, h a
dynamic hysteresis of amplitude g, and u_p the voltages of the RC pairs. In every interval a pair
covers the share 1 - exp(-dt / tau_p) of the way to R_p(s) i, with s the SOC at its start.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from ..cell import CircuitParameters
from ..cell.parameters import HALF_HYSTERESIS, OCV_CORRECTION
from ..execution import in_float64
from .prepared import BLOCK, PreparedRecord
from .reduced import response_block


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
    """The errors of a circuit on a record, block after block. Call inside float64."""
    for here, errors_v in error_blocks_of([prepared], [parameters]):
        yield here, errors_v[0]


def error_blocks_of(
    alike: Sequence[PreparedRecord], parameters: Sequence[CircuitParameters]
) -> Iterator[tuple[slice, Float[np.ndarray, "circuits samples"]]]:
    """The errors of several circuits that differ only in their tables, each on the record with its
    own OCV, at once."""
    from .sampling_intervals import sized

    circuits = [one.laddered() for one in parameters]
    pairs = zip(alike, circuits, strict=True)
    records = [_as_tabulated(prepared, circuit) for prepared, circuit in pairs]
    first, gamma, taus_s = records[0], circuits[0].gamma, np.array(circuits[0].tau_s)
    gamma = None if first.hysteresis_amplitude_v is None else gamma
    states, turned = np.zeros((len(taus_s), 1, len(circuits))), np.zeros((1, 1))
    for here, inputs in first.input_blocks(BLOCK, float(taus_s.min()), gamma):
        soc, size = sized(first.soc[here], BLOCK), here.stop - here.start
        rows = [[circuit.at(name, soc) for name in circuit.resistances] for circuit in circuits]
        r0_ohm, *r_ohm = np.stack(rows, axis=-1)
        bases_v = [sized(each.voltage_v[here] - each.source_v[here], BLOCK) for each in records]
        error_v = np.stack(bases_v, axis=1) + r0_ohm * np.asarray(inputs.current_a)[:, None]
        drops_v = np.zeros_like(error_v)
        for pair, ohm in enumerate(r_ohm):
            held_v, tau_s = ohm * np.asarray(inputs.held_a)[:, None], taus_s[pair : pair + 1]
            states[pair], drop_v = response_block(tau_s, states[pair], held_v, inputs.intervals)
            drops_v += drop_v[:, 0]
        error_v = (error_v + drops_v)[:size]
        if inputs.hysteresis is not None and gamma is not None:
            turning = np.asarray(inputs.hysteresis.hysteresis_input)[:, None]
            clock, tau = inputs.hysteresis.intervals, np.array([1 / gamma])
            turned, state = response_block(tau, turned, turning, clock)
            amplitudes_v = [np.asarray(each.hysteresis_amplitude_v)[here] for each in records]
            error_v -= state[:size, 0] * np.stack(amplitudes_v, axis=1)
        yield here, error_v.T


def _as_tabulated(prepared: PreparedRecord, circuit: CircuitParameters) -> PreparedRecord:
    """The record with the circuit's properties other than resistances: OCV, hysteresis, and
    resistance law."""
    prepared = prepared.with_dependence(circuit.dependence)
    source_v, amplitude_v = prepared.source_v, prepared.hysteresis_amplitude_v
    if OCV_CORRECTION in circuit.tables:
        source_v = source_v + circuit.at(OCV_CORRECTION, prepared.soc)
    if HALF_HYSTERESIS in circuit.tables and amplitude_v is not None:
        half_v = circuit.at(HALF_HYSTERESIS, prepared.soc)
        source_v = source_v + prepared.start.direction * (half_v - amplitude_v)
        amplitude_v = half_v
    return replace(prepared, source_v=source_v, hysteresis_amplitude_v=amplitude_v)

"""A circuit on a record, sample by sample: the reference of every reported number.

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
from ..execution import as_input, compile_for, in_float64
from .prepared import BLOCK, PreparedRecord

# Programs are compiled for so many RC pairs, or a multiple.
PAIRS = 3


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
    for here, errors_v in error_blocks_of([prepared], [parameters]):
        yield here, errors_v[0]


def error_blocks_of(
    alike: Sequence[PreparedRecord], parameters: Sequence[CircuitParameters]
) -> Iterator[tuple[slice, Float[np.ndarray, "circuits samples"]]]:
    """The same of several circuits that differ in their tables alone, each on the one record with
    an OCV of its own, at once."""
    from .intervals import sized
    from .simulate import advance_all

    circuits = [one.laddered() for one in parameters]
    pairs = zip(alike, circuits, strict=True)
    records = [_as_tabulated(prepared, circuit) for prepared, circuit in pairs]
    # Circuits of up to three pairs share a program: pairs without resistance change no bit.
    tau_s = _padded(circuits[0].tau_s)
    first = records[0]
    gamma = None if first.hysteresis_amplitude_v is None else circuits[0].gamma
    states = np.zeros((len(circuits), len(tau_s) + (gamma is not None)))
    scales = as_input(tau_s), None if gamma is None else as_input(gamma)
    for here, inputs in first.input_blocks(BLOCK, min(tau_s), gamma):
        size = here.stop - here.start
        soc = np.pad(first.soc[here], (0, BLOCK - size), mode="edge")
        ohm = np.zeros((len(circuits), 1 + len(tau_s), BLOCK))
        for index, each in enumerate(circuits):
            ohm[index, : 1 + len(each.tau_s)] = [each.at(name, soc) for name in each.resistances]
        base_v = np.stack(
            [sized((each.voltage_v - each.source_v)[here], BLOCK) for each in records]
        )
        amplitude_v = [
            sized(each.hysteresis_amplitude_v[here], BLOCK)
            for each in records
            if each.hysteresis_amplitude_v is not None
        ]
        each = ohm, base_v, np.stack(amplitude_v) if amplitude_v else None
        advance = compile_for(advance_all, *scales, *each, inputs, states)
        states, errors_v = advance(*scales, *each, inputs, states)
        yield here, np.asarray(errors_v)[:, :size]


def _padded(tau_s: Sequence[float]) -> Float[np.ndarray, "pairs"]:
    """Time constants with those of further pairs, up to a multiple of `PAIRS`."""
    more = -len(tau_s) % PAIRS
    return np.append(tau_s, np.full(more, max(tau_s, default=1.0)))


def _as_tabulated(prepared: PreparedRecord, circuit: CircuitParameters) -> PreparedRecord:
    """The record with what the circuit has of its own beside resistances: OCV, hysteresis, and what
    its resistances follow."""
    prepared = prepared.following(circuit.dependence)
    source_v, amplitude_v = prepared.source_v, prepared.hysteresis_amplitude_v
    if OCV_CORRECTION in circuit.tables:
        source_v = source_v + circuit.at(OCV_CORRECTION, prepared.soc)
    if HALF_HYSTERESIS in circuit.tables and amplitude_v is not None:
        half_v = circuit.at(HALF_HYSTERESIS, prepared.soc)
        source_v = source_v + prepared.start.direction * (half_v - amplitude_v)
        amplitude_v = half_v
    return replace(prepared, source_v=source_v, hysteresis_amplitude_v=amplitude_v)

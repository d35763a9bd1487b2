"""Tables over SOC simulated sample by sample in one `lax.scan`: the reference.

Functions are written for one candidate; callers vmap them. What all candidates share, among it
where each sample's SOC lies between the nodes, is in a `TableInput`, made once.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int, Scalar

from ..cell import SocTables
from ..execution import as_input, compile_for, in_float64
from ..metrics import measure
from ..model.compressed import BLOCK
from ..model.prepared import PreparedRecord, require_changing_voltage
from ..model.simulate import Pair, SimulationInput
from ..search.evaluate import Evaluation


class TableInput(eqx.Module):
    """A record's imposed arrays, and each sample's place between the nodes.

    `place` is the node below, `share` how far the SOC is on its way to the next one. `start_h` is
    the state of a dynamic hysteresis at the start; its amplitude is none of `inputs.source_v`.
    """

    inputs: SimulationInput
    place: Int[Array, "samples"]
    share: Float[Array, "samples"]
    start_h: Scalar

    @classmethod
    def of(
        cls,
        prepared: PreparedRecord,
        nodes: Float[np.ndarray, "nodes"],
        shortest_tau_s: float,
        highest_gamma: float | None,
    ) -> "TableInput":
        """Exact for time constants and rates in these limits. Call inside float64."""
        source_v = prepared.source_v
        if prepared.hysteresis_amplitude_v is not None:
            source_v = source_v - prepared.start.direction * prepared.hysteresis_amplitude_v
        without = replace(prepared, source_v=source_v)
        # One node is a constant: its table gets a second, equal one.
        along = np.interp(prepared.soc, nodes, np.arange(len(nodes), dtype=float))
        place = np.clip(along.astype(int), 0, max(len(nodes) - 2, 0))
        return cls(
            inputs=without.simulation_input(shortest_tau_s, highest_gamma),
            place=as_input(place.astype(np.int32)),
            share=as_input(along - place),
            start_h=as_input(float(prepared.start.direction)),
        )

    @classmethod
    def blocks(cls, prepared: PreparedRecord, *given: Any) -> Iterator[tuple[slice, "TableInput"]]:
        """The same block after block, each of `BLOCK` samples: those after the last of a record
        repeat it. A state moved on through a block is that at the start of the next."""
        for number, part in enumerate(prepared.parts(BLOCK)):
            block = cls.of(part, *given)
            place, share = (
                np.pad(np.asarray(each)[:BLOCK], (0, max(0, BLOCK - len(each))), "edge")
                for each in (block.place, block.share)
            )
            here = slice(number * BLOCK, min((number + 1) * BLOCK, len(prepared.soc)))
            inputs = block.inputs.first(BLOCK)
            yield here, cls(inputs, as_input(place), as_input(share), block.start_h)


class TableParameters(eqx.Module):
    """Tables as rows: R0, every pair's R, then where they are fitted the OCV correction and the
    amplitude of a dynamic hysteresis."""

    tables: Float[Array, "tables nodes"]
    tau: Float[Array, "pairs"]
    gamma: Scalar | None
    has_correction: bool = eqx.field(static=True)
    has_amplitude: bool = eqx.field(static=True)

    @classmethod
    def of(cls, tables: SocTables) -> "TableParameters":
        """Call inside float64."""
        return cls(
            tables=jnp.asarray(list(tables.tables.values())),
            tau=jnp.asarray(tables.tau_s),
            gamma=None if tables.gamma is None else jnp.asarray(tables.gamma),
            has_correction=tables.ocv_correction_v is not None,
            has_amplitude=tables.half_hysteresis_v is not None,
        )


def _advanced(
    parameters: TableParameters, given: TableInput, states: Float[Array, "states"]
) -> tuple[Float[Array, "states"], Float[Array, "samples"]]:
    """The states after the last sample, and measured minus simulated voltage in V at every one.

    The states are of every pair, then of a dynamic hysteresis.
    """
    inputs, hysteresis = given.inputs, given.inputs.hysteresis
    pairs = len(parameters.tau)
    below, rise = _lines(parameters.tables)
    one = jnp.ones_like(given.start_h)
    clocks = [Pair(one, tau, inputs.intervals) for tau in parameters.tau]
    turning = amplitude_v = None
    if hysteresis is not None and parameters.gamma is not None:
        charge = hysteresis.intervals
        clocks.append(Pair(one, 1 / parameters.gamma, charge))
        turning = hysteresis.hysteresis_input, charge.node, charge.offset_s
        amplitude_v = hysteresis.amplitude_v

    def step(states, sample):
        place, share, current_a, base_v, held_a, node, offset_s, turning, amplitude_v = sample
        table = below[place] + share * rise[place]
        error_v = base_v + table[0] * current_a + jnp.sum(states[:pairs])
        if parameters.has_correction:
            error_v = error_v - table[pairs + 1]
        flows = [(table[1 + pair] * held_a, node, offset_s) for pair in range(pairs)]
        if turning is not None:
            amplitude_v = table[-1] if parameters.has_amplitude else amplitude_v
            error_v = error_v - amplitude_v * (given.start_h + states[pairs])
            flows.append(turning)
        moves = [
            clock.advance(state, *flow)
            for clock, state, flow in zip(clocks, states, flows, strict=True)
        ]
        return jnp.stack(moves), error_v

    samples = (
        *(given.place, given.share, inputs.current_a, inputs.base_error_v, inputs.held_a),
        *(inputs.intervals.node, inputs.intervals.offset_s, turning, amplitude_v),
    )
    return lax.scan(step, states, samples)


def _lines(tables: Float[Array, "tables nodes"]):
    """All tables' values at the node below and their rise to the next one, a row a place."""
    columns = tables.T if tables.shape[1] > 1 else jnp.repeat(tables.T, 2, axis=0)
    return columns[:-1], jnp.diff(columns, axis=0)


@in_float64
def simulate_tables(prepared: PreparedRecord, tables: SocTables) -> Float[np.ndarray, "simulated"]:
    """The terminal voltage at every simulated sample of a record, in V.

    With U the source voltage, h a dynamic hysteresis and u_p the RC pairs' voltages, v = U + D(s) +
    g(s) h - R0(s) i - sum u_p. In every interval, a pair covers the fraction 1 - exp(-dt / tau_p)
    of the way to R_p(s) i, with s the SOC at the start of the interval.

    Args:
        prepared: The record in its window, such as one of a problem.
        tables: The tables.
    """
    simulated_v = prepared.voltage_v.copy()
    for here, error_v in error_blocks(prepared, tables):
        simulated_v[here] -= error_v
    return simulated_v


def error_blocks(
    prepared: PreparedRecord, tables: SocTables
) -> Iterator[tuple[slice, Float[np.ndarray, "samples"]]]:
    """Measured minus simulated voltage in V, block after block. Call inside float64."""
    tables, prepared = tables.laddered(), prepared.following(tables.dependence)
    parameters, nodes = TableParameters.of(tables), np.array(tables.nodes)
    at_rest = len(tables.tau_s) + (tables.gamma is not None)
    states = jnp.zeros(at_rest, parameters.tables.dtype)
    for here, given in TableInput.blocks(prepared, nodes, min(tables.tau_s), tables.gamma):
        advance = compile_for(_advanced, parameters, given, states)
        states, error_v = advance(parameters, given, states)
        yield here, np.asarray(error_v)[: here.stop - here.start]


def errors_along(prepared: PreparedRecord, tables: SocTables) -> Float[np.ndarray, "simulated"]:
    """Measured minus simulated voltage in V at every simulated sample. Call inside float64."""
    return np.concatenate([error_v for _, error_v in error_blocks(prepared, tables)])


def evaluate_tables(prepared: PreparedRecord, tables: SocTables) -> Evaluation:
    """Tables over SOC simulated on a prepared record, with their errors.

    Args:
        prepared: The record in its window, such as one of a problem.
        tables: The tables.

    Raises `InputError` if the measured voltage is constant.
    """
    require_changing_voltage(prepared)
    simulated_v, scored = simulate_tables(prepared, tables), prepared.scored
    metrics = measure(prepared.voltage_v[scored], simulated_v[scored])
    return Evaluation(prepared, simulated_v, metrics)

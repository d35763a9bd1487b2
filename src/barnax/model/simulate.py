"""One circuit driven by one record: one `lax.scan` over its samples.

Everything that is the same for all candidates (SOC, open-circuit and hysteresis voltage, the
intervals) is in a `SimulationInput`, made once. A candidate's simulation is its RC states and its
ohmic drop. Functions are for one candidate; callers vmap them.
"""

import abc
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from equinox import AbstractVar
from jax import lax
from jax.custom_batching import custom_vmap
from jaxtyping import Array, Float, Int, PyTree, Scalar

from ..cell.elements import rungs_of
from ..execution import in_one_function
from .sampling_intervals import Intervals


class RCParameters(eqx.Module):
    """Ohmic resistance and elements in series; `tau` is each element's R times C, in seconds.

    `gamma` is the rate of a dynamic hysteresis per unit of SOC, None for circuits without.
    `elements` are names of the elements, empty if all are RC pairs.
    """

    r0: Scalar
    r: tuple[Scalar, ...]
    tau: tuple[Scalar, ...]
    gamma: Scalar | None = None
    elements: tuple[str, ...] = eqx.field(static=True, default=())

    @property
    def pairs(self) -> list[tuple[Scalar, Scalar]]:
        """Resistance and time constant of every RC pair, including those that make up elements."""
        elements = list(zip(self.r, self.tau, strict=True))
        if not self.elements:
            return elements
        return [
            (elements[rung.element][0] * rung.share, elements[rung.element][1] * rung.ratio)
            for rung in rungs_of(self.elements)
        ]


class AbstractEvaluator(eqx.Module):
    """One objective, however it is computed. `scored` is the number of scored samples."""

    scored: AbstractVar[Scalar]

    @abc.abstractmethod
    def squared_error(self, rc: RCParameters) -> Scalar:
        """Sum of squared errors over the scored samples, in V^2."""

    @abc.abstractmethod
    def errors(self, rc: RCParameters) -> Float[Array, "errors"]:
        """A vector in V, smooth in the circuit, whose sum of squares is `squared_error`."""


class Joint(AbstractEvaluator):
    """Several records with one circuit: their errors side by side."""

    scored: Scalar
    parts: tuple[AbstractEvaluator, ...]

    @classmethod
    def of(cls, parts: tuple[AbstractEvaluator, ...]) -> AbstractEvaluator:
        """The only part if there is one, otherwise all together."""
        if len(parts) == 1:
            return parts[0]
        return cls(sum((part.scored for part in parts[1:]), parts[0].scored), parts)

    def squared_error(self, rc: RCParameters) -> Scalar:
        return jnp.sum(jnp.stack([part.squared_error(rc) for part in self.parts]))

    def errors(self, rc: RCParameters) -> Float[Array, "errors"]:
        return jnp.concatenate([part.errors(rc) for part in self.parts])


# Samples per turn of the loop, and the most candidates side by side in it: measured on CPU cores
# for 1 to 900 candidates, half or twice as many of either are slower. Candidates are padded to
# whole AVX-512 registers, because the remainder would be computed one by one.
BLOCK = 8
LANES = 256
REGISTER = 8
UNROLL_STACKED = 4


class HysteresisInput(eqx.Module):
    """The input of a dynamic hysteresis state, and its amplitude in V.

    With the state's initial value included in the source, the remainder is the response of an RC
    pair of 1 ohm to `hysteresis_input` on a clock that counts SOC instead of seconds, with the time
    constant 1 / gamma.
    """

    amplitude_v: Float[Array, "samples"]
    hysteresis_input: Float[Array, "samples"]
    intervals: Intervals


class SimulationInput(AbstractEvaluator):
    """The input of one record to every candidate, at the simulated samples.

    `held_a` is the current that flows from a sample to the next, by the record's hold; the last
    entry is unused. `base_error_v` is the measured voltage minus the open-circuit voltage with the
    model's hysteresis term: the error of a circuit without any impedance. `weight` is 1 at scored
    samples, else 0, and None if all are scored; `scored` is their number. Discharge current is
    positive.
    """

    current_a: Float[Array, "samples"]
    held_a: Float[Array, "samples"]
    base_error_v: Float[Array, "samples"]
    weight: Float[Array, "samples"] | None
    scored: Scalar
    intervals: Intervals
    hysteresis: HysteresisInput | None = None

    def squared_error(self, rc: RCParameters) -> Scalar:
        """Sum of squared errors over the scored samples, in V^2."""
        return _squared_errors(jax.tree.map(lambda each: jnp.reshape(each, 1), rc), self)[0]

    def errors(self, rc: RCParameters) -> Float[Array, "samples"]:
        error_v = self.base_error_v + overpotential(rc, self)
        return error_v if self.weight is None else self.weight * error_v


def overpotential(rc: RCParameters, inputs: SimulationInput) -> Float[Array, "samples"]:
    """Source minus terminal voltage at every sample, in V (Li et al., 2023, Eq. 2, 3).

    Ohmic and polarization drop, less the contribution of a dynamic hysteresis. The recursion is
    exact for current held constant between samples. All RC pairs start at rest. Derivatives cost
    one more scan in all, not one per parameter.
    """
    drop_v = rc.r0 * inputs.current_a
    for r, tau in rc.pairs:
        drop_v = drop_v + r * unit_response(tau, inputs.held_a, inputs.intervals)
    hysteresis = inputs.hysteresis
    if hysteresis is not None and rc.gamma is not None:
        state = unit_response(1 / rc.gamma, hysteresis.hysteresis_input, hysteresis.intervals)
        drop_v = drop_v - hysteresis.amplitude_v * state
    return drop_v


@jax.custom_jvp
def unit_response(
    tau: Scalar, held_a: Float[Array, "samples"], intervals: Intervals
) -> Float[Array, "samples"]:
    """Voltage over an RC pair of 1 ohm at every sample: the current, low-passed with `tau`."""
    _, response_a = respond(tau, jnp.zeros_like(tau), held_a, intervals)
    return response_a


def respond(
    tau: Scalar,
    state: Float[Array, "*channels"],
    held: Float[Array, "samples *channels"],
    intervals: Intervals,
) -> tuple[Float[Array, "*channels"], Float[Array, "samples *channels"]]:
    """The response of an RC pair of 1 ohm from any state, and the state after it."""
    pair = Pair(tau, intervals)

    def step(state, sample):
        return pair.advance(state, *sample), state

    scan = in_one_function(lambda state, held: lax.scan(step, state, held, unroll=UNROLL_STACKED))
    after, responses = scan(state / pair.unit, _clocked(held, intervals))
    return pair.unit * after, pair.unit * responses


@unit_response.defjvp
def _unit_response_jvp(primals, tangents):
    # Only tau is ever differentiated. Its slope does not depend on the tangent, so a Jacobian over
    # all parameters computes it once.
    tau, held_a, intervals = primals

    def respond(tau):
        return unit_response.__wrapped__(tau, held_a, intervals)

    response_a, slope = jax.jvp(respond, (tau,), (jnp.ones_like(tau),))
    return response_a, slope * tangents[0]


def _clocked(held: Float[Array, "samples *channels"], intervals: Intervals):
    """The input of a pair, sample by sample."""
    return held, intervals.node, intervals.offset_s


@custom_vmap
def _squared_errors(rc: RCParameters, inputs: SimulationInput) -> Float[Array, "candidates"]:
    """The sum of squared errors of every candidate, by scans of at most `LANES` of them."""
    count = len(rc.r0)
    scans = -(-count // LANES)
    lanes = -(-count // (scans * REGISTER)) * REGISTER
    filled = jax.tree.map(
        lambda each: jnp.pad(each, (0, scans * lanes - count), mode="edge").reshape(scans, lanes),
        rc,
    )

    def squared_errors(rc: RCParameters) -> Float[Array, "lanes"]:
        return _Population(rc, inputs).squared_errors()

    if scans == 1:
        return squared_errors(jax.tree.map(lambda each: each[0], filled))[:count]
    totals = lax.map(squared_errors, filled)
    return totals.reshape(-1)[:count]


@_squared_errors.def_vmap
def _of_populations(size: int, is_batched: PyTree, rc: RCParameters, inputs: SimulationInput):
    """The errors of several populations, as one large population: they share the inputs."""
    del is_batched
    count = rc.r0.shape[-1]
    together = jax.tree.map(lambda each: jnp.broadcast_to(each, (size, count)).reshape(-1), rc)
    return _squared_errors(together, inputs).reshape(size, count), True


class _Population:
    """RC pairs and hysteresis of candidates side by side, and the errors they make."""

    def __init__(self, rc: RCParameters, inputs: SimulationInput):
        clock, hysteresis, amplitude_v = inputs.intervals, inputs.hysteresis, None
        self._r0 = rc.r0
        self._pairs = [Pair(tau, clock) for _, tau in rc.pairs]
        # The contribution of each state to the error, per state or per state and amplitude.
        self._slopes = [r * each.unit for (r, _), each in zip(rc.pairs, self._pairs, strict=True)]
        moving = [_clocked(inputs.held_a, clock)] * len(self._pairs)
        if hysteresis is not None and rc.gamma is not None:
            amplitude_v = hysteresis.amplitude_v
            self._pairs.append(Pair(1 / rc.gamma, hysteresis.intervals))
            self._slopes.append(-self._pairs[-1].unit)
            moving.append(_clocked(hysteresis.hysteresis_input, hysteresis.intervals))
        counting = inputs.current_a, inputs.base_error_v, inputs.weight, amplitude_v
        self._samples = moving, counting

    def squared_errors(self) -> Float[Array, "candidates"]:
        """The sums over all samples.

        The sums are a carry of the scan: stacking the voltages first costs 4 to 40 times more.
        """

        def turn(carry, first):
            block = jax.tree.map(
                lambda array: lax.dynamic_slice_in_dim(array, first, BLOCK), self._samples
            )
            return self._add(carry, block, BLOCK), None

        none = jnp.zeros_like(self._r0)
        carry = (none,) * len(self._pairs), none
        samples = len(self._samples[1][0])
        whole = samples - samples % BLOCK
        if whole:
            scan = in_one_function(lambda carry, firsts: lax.scan(turn, carry, firsts)[0])
            carry = scan(carry, jnp.arange(0, whole, BLOCK))
        rest = jax.tree.map(lambda array: array[whole:], self._samples)
        return self._add(carry, rest, samples - whole)[1]

    def _add(self, carry: PyTree, samples: PyTree, count: int) -> PyTree:
        """The states after `count` more samples, and the totals with their squared errors added."""
        states, total = carry
        for sample in range(count):
            moving, counting = jax.tree.map(lambda array, at=sample: array[at], samples)
            total = total + self._error_v(states, *counting) ** 2
            states = tuple(
                pair.advance(state, *each)
                for pair, state, each in zip(self._pairs, states, moving, strict=True)
            )
        return states, total

    def _error_v(self, states, current_a, base_error_v, weight, amplitude_v):
        added_v = [slope * state for slope, state in zip(self._slopes, states, strict=True)]
        if amplitude_v is not None:
            added_v[-1] = amplitude_v * added_v[-1]
        error_v = sum(added_v, base_error_v + self._r0 * current_a)
        # Weighted before squaring: a weight of one then leaves every bit unchanged.
        return error_v if weight is None else weight * error_v


class Pair:
    """One RC pair of 1 ohm, moved over one interval by the current that flowed in it.

    Its state is counted in `unit`, in V: on even intervals one fused multiply-add moves it.
    """

    def __init__(self, tau: Scalar, intervals: Intervals):
        self._intervals = intervals
        self._rate = 1 / tau
        # expm1 keeps 1 - exp(-interval / tau) exact if tau is far longer than the interval.
        self._gain = -jnp.expm1(-jnp.multiply.outer(intervals.node_s, self._rate))
        self._decay = jnp.exp(-intervals.node_s[0] * self._rate)
        self._is_even = intervals.is_even and not intervals.has_offsets
        self.unit = self._gain[0] if self._is_even else jnp.ones_like(tau)

    def advance(
        self,
        state: Float[Array, "*channels"],
        held_a: Float[Array, "*channels"],
        node: Int[Array, ""],
        offset_s: Scalar,
    ) -> Float[Array, "*channels"]:
        """The state at the next sample: it covers the share 1 - exp(-interval / tau) of its way."""
        if self._is_even:
            return self._decay * state + held_a
        gain = self._gain[node]
        if self._intervals.has_offsets:
            x = offset_s * self._rate
            gain = gain + (1 - gain) * x * (1 - x * (1 / 2 - x / 6))
        return state + gain * (held_a - state)


# Takes arrays only: flattening a module took longer than the program. Compiled by its caller.
def respond_all(tau, state, held, node_s, node, offset_s, is_even: bool, has_offsets: bool):
    intervals = Intervals(node_s, node, offset_s, is_even, has_offsets)
    each = partial(respond, held=held, intervals=intervals)
    return jax.vmap(each, out_axes=(0, 1))(tau, state)

"""One circuit driven by one record: one `lax.scan` over its samples.

Everything that is the same for all candidates (SOC, open-circuit and hysteresis voltage, the
intervals) is in a `SimulationInput`, made once. A candidate's simulation is its RC states and its
ohmic drop. Functions are written for one candidate; callers vmap them.
"""

import abc
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from equinox import AbstractVar
from jax import lax
from jaxtyping import Array, Float, Int, PyTree, Scalar

from ..cell.elements import rungs_of
from ..execution import as_input, in_one_function
from .intervals import Intervals


class RCParameters(eqx.Module):
    """Ohmic resistance and elements in series; `tau` is each one's R times C, in seconds.

    `gamma` is the rate of a dynamic hysteresis per unit of SOC, None for circuits without.
    `elements` are names of the elements, none where all are RC pairs.
    """

    r0: Scalar
    r: tuple[Scalar, ...]
    tau: tuple[Scalar, ...]
    gamma: Scalar | None = None
    elements: tuple[str, ...] = eqx.field(static=True, default=())

    @property
    def pairs(self) -> list[tuple[Scalar, Scalar]]:
        """Resistance and time constant of every RC pair, those that elements consist of too."""
        own = list(zip(self.r, self.tau, strict=True))
        if not self.elements:
            return own
        return [
            (own[rung.element][0] * rung.share, own[rung.element][1] * rung.ratio)
            for rung in rungs_of(self.elements)
        ]


class AbstractEvaluator(eqx.Module):
    """One objective, whichever way it is computed. `scored` is how many samples count."""

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
        """The only part where there is one, else all together."""
        if len(parts) == 1:
            return parts[0]
        return cls(sum((part.scored for part in parts[1:]), parts[0].scored), parts)

    def squared_error(self, rc: RCParameters) -> Scalar:
        return jnp.sum(jnp.stack([part.squared_error(rc) for part in self.parts]))

    def errors(self, rc: RCParameters) -> Float[Array, "errors"]:
        return jnp.concatenate([part.errors(rc) for part in self.parts])


# Samples to a turn of the loop, measured on two CPU cores for 8 to 900 candidates: these are
# fastest or near it, twice as many can be three times slower.
BLOCK = 5
UNROLL_STACKED = 4

# The voltage over every RC pair, and the state of a dynamic hysteresis.
State = tuple[tuple[Scalar, ...], Scalar]


class HysteresisInput(eqx.Module):
    """The input of a dynamic hysteresis state, and its worth in volts.

    With the state's initial value inside the source, the rest of it is the answer of an RC pair
    of 1 ohm to `hysteresis_input` on a clock that counts SOC instead of seconds, with the time
    constant 1 / gamma.
    """

    amplitude_v: Float[Array, "samples"]
    hysteresis_input: Float[Array, "samples"]
    intervals: Intervals


class SimulationInput(AbstractEvaluator):
    """The input of one record to every candidate, at the simulated samples.

    `held_a` is the current that flows from a sample to the next, by the record's hold; the last
    entry leads nowhere. `source_v` is the open-circuit voltage with the model's hysteresis term,
    `base_error_v` the measured voltage minus that: the error of a circuit without any impedance.
    `weight` is 1 at scored samples, else 0, and None where all are; `scored` is how many are.
    Discharge current is positive.
    """

    current_a: Float[Array, "samples"]
    held_a: Float[Array, "samples"]
    source_v: Float[Array, "samples"]
    base_error_v: Float[Array, "samples"]
    weight: Float[Array, "samples"] | None
    scored: Scalar
    intervals: Intervals
    hysteresis: HysteresisInput | None = None

    def padded_to(self, samples: int) -> "SimulationInput":
        """The same in `samples` samples: those added at the end repeat the last and count nothing.

        Errors keep their bits: a weight of one is exact, and nothing but zeros is added.
        """
        missing = samples - len(self.current_a)
        weight = np.ones(len(self.current_a)) if self.weight is None else self.weight
        # In NumPy: JAX would compile a program for every length it meets.
        filled = eqx.tree_at(
            _sampled, self, replace_fn=lambda a: as_input(np.pad(a, (0, missing), mode="edge"))
        )
        weight = np.pad(np.asarray(weight, self.current_a.dtype), (0, missing))
        return replace(filled, weight=as_input(weight))

    def in_common_size(self) -> "SimulationInput":
        """The same in one of few shapes, so that a new record seldom compiles anything: one an
        octave of samples, two of very many, where they cost more than programs; one every two
        octaves of nodes of the clocks."""
        samples = len(self.current_a)
        # The next of 64, 128 and so on to 65,536, then 98,304, 131,072 and so on.
        power = max(6, (samples - 1).bit_length())
        is_between = power > 16 and samples <= 3 << (power - 2)
        padded = self.padded_to(3 << (power - 2) if is_between else 1 << power)
        hysteresis = padded.hysteresis
        if hysteresis is not None:
            clock = hysteresis.intervals.with_common_nodes()
            hysteresis = replace(hysteresis, intervals=clock)
        return replace(
            padded, intervals=padded.intervals.with_common_nodes(), hysteresis=hysteresis
        )

    def squared_error(self, rc: RCParameters) -> Scalar:
        """Sum of squared errors over the scored samples, in V^2.

        The error is summed in the scan's carry: stacking the voltages first costs 4 to 40 times
        more.
        """
        circuit = _Circuit(rc, self)
        samples = circuit.moving, circuit.counting
        blocks, left = divmod(len(self.current_a), BLOCK)
        moving, counting = jax.tree.map(
            lambda array: array[: blocks * BLOCK].reshape(blocks, BLOCK), samples
        )
        # A turn moves the states over the block before its own, then sums its own errors, so that
        # the sum only reads what has already moved and nothing is copied. Before the first is none.
        before = jax.tree.map(
            lambda array: jnp.concatenate([jnp.zeros_like(array[:1]), array[:-1]]), moving
        )

        def turn(carry, block):
            state, total = carry
            before, moving, counting = block
            # Without this the compiler would move them once more where the errors are summed.
            state = lax.optimization_barrier(circuit.advance(state, before, BLOCK))
            return (state, circuit.add_errors(total, state, moving, counting, BLOCK)), None

        total = jnp.zeros_like(rc.r0)
        state = (total,) * len(rc.pairs), total
        if blocks:
            scan = in_one_function(lambda carry, samples: lax.scan(turn, carry, samples)[0])
            state, total = scan((state, total), (before, moving, counting))
            state = circuit.advance(state, jax.tree.map(lambda array: array[-1], moving), BLOCK)
        moving, counting = jax.tree.map(lambda array: array[blocks * BLOCK :], samples)
        return circuit.add_errors(total, state, moving, counting, left)

    def errors(self, rc: RCParameters) -> Float[Array, "samples"]:
        error_v = self.base_error_v + overpotential(rc, self)
        return error_v if self.weight is None else self.weight * error_v


def _sampled(inputs: SimulationInput) -> list[Array]:
    """Every array that has one entry a sample."""
    clocks = [inputs.intervals]
    arrays = [inputs.current_a, inputs.held_a, inputs.source_v, inputs.base_error_v]
    if inputs.weight is not None:
        arrays.append(inputs.weight)
    if inputs.hysteresis is not None:
        arrays += [inputs.hysteresis.amplitude_v, inputs.hysteresis.hysteresis_input]
        clocks.append(inputs.hysteresis.intervals)
    for clock in clocks:
        arrays += [clock.node, clock.offset_s]
    return arrays


def overpotential(rc: RCParameters, inputs: SimulationInput) -> Float[Array, "samples"]:
    """Source minus terminal voltage at every sample, in V (Li et al., 2023, Eq. 2, 3).

    Ohmic and polarization drop, less what a dynamic hysteresis adds. The recursion is exact
    for current held constant between samples. All RC pairs start at rest. Derivatives cost one
    more scan in all, not one a parameter.
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
    """The same from any state on, and the state that a continuation starts from."""
    pair = Pair(jnp.ones_like(tau), tau, intervals)

    def step(state, sample):
        return pair.advance(state, *sample), state

    scan = in_one_function(lambda state, held: lax.scan(step, state, held, unroll=UNROLL_STACKED))
    return scan(state, _clocked(held, intervals))


@unit_response.defjvp
def _unit_response_jvp(primals, tangents):
    # Only tau is ever differentiated. Its slope does not depend on the tangent, so a Jacobian
    # over all parameters computes it once.
    tau, held_a, intervals = primals

    def respond(tau):
        return unit_response.__wrapped__(tau, held_a, intervals)

    response_a, slope = jax.jvp(respond, (tau,), (jnp.ones_like(tau),))
    return response_a, slope * tangents[0]


def _clocked(held: Float[Array, "samples *channels"], intervals: Intervals):
    """The input of a pair, sample by sample."""
    return held, intervals.node, intervals.offset_s


class _Circuit:
    """One candidate's RC pairs and hysteresis, and the error they make at a sample."""

    def __init__(self, rc: RCParameters, inputs: SimulationInput):
        clock, hysteresis = inputs.intervals, inputs.hysteresis
        self._r0 = rc.r0
        self._pairs = [Pair(r, tau, clock) for r, tau in rc.pairs]
        self._hysteresis, turning, amplitude_v = None, None, None
        if hysteresis is not None and rc.gamma is not None:
            one = jnp.ones_like(rc.r0)
            self._hysteresis = Pair(one, 1 / rc.gamma, hysteresis.intervals)
            turning = _clocked(hysteresis.hysteresis_input, hysteresis.intervals)
            amplitude_v = hysteresis.amplitude_v
        # What moves the state from sample to sample, and what an error depends on beside it.
        self.moving = _clocked(inputs.held_a, clock), turning
        self.counting = inputs.current_a, inputs.base_error_v, inputs.weight, amplitude_v

    def advance(self, state: State, moving: PyTree, samples: int) -> State:
        """The state so many samples later."""
        for sample in range(samples):
            state = self._step(state, jax.tree.map(lambda array, at=sample: array[at], moving))
        return state

    def add_errors(
        self, total: Scalar, state: State, moving: PyTree, counting: PyTree, samples: int
    ) -> Scalar:
        """The total with the squared errors of so many samples, the first in this state."""
        for sample in range(samples):
            clocked, (current_a, base_error_v, weight, amplitude_v) = jax.tree.map(
                lambda array, at=sample: array[at], (moving, counting)
            )
            states, hysteresis_state = state
            error_v = base_error_v + self._r0 * current_a + sum(states)
            if amplitude_v is not None:
                error_v = error_v - amplitude_v * hysteresis_state
            # Weighted before it is squared: a weight of one then leaves every bit as it is.
            counted_v = error_v if weight is None else weight * error_v
            total = total + counted_v * counted_v
            if sample + 1 < samples:
                state = self._step(state, clocked)
        return total

    def _step(self, state: State, moving: PyTree) -> State:
        (states, hysteresis_state), (clocked, turning) = state, moving
        states = tuple(
            pair.advance(state_v, *clocked)
            for pair, state_v in zip(self._pairs, states, strict=True)
        )
        if self._hysteresis is not None:
            hysteresis_state = self._hysteresis.advance(hysteresis_state, *turning)
        return states, hysteresis_state


class Pair:
    """One RC pair, moved over one interval by the current that flowed in it."""

    def __init__(self, r: Scalar, tau: Scalar, intervals: Intervals):
        self._r = r
        self._intervals = intervals
        self._rate = 1 / tau
        # expm1 keeps 1 - exp(-interval / tau) exact where tau is far longer than the interval.
        self._gain = -jnp.expm1(-intervals.node_s * self._rate)
        # Even intervals need no look-up: one product and one fused multiply-add a sample.
        self._decay = jnp.exp(-intervals.node_s[0] * self._rate)
        self._push = r * self._gain[0]

    def advance(
        self,
        state_v: Float[Array, "*channels"],
        held_a: Float[Array, "*channels"],
        node: Int[Array, ""],
        offset_s: Scalar,
    ) -> Float[Array, "*channels"]:
        """The state at the next sample: it goes the share 1 - exp(-interval / tau) of its way."""
        if self._intervals.is_even and not self._intervals.has_offsets:
            return self._decay * state_v + self._push * held_a
        gain = self._gain[node]
        if self._intervals.has_offsets:
            x = offset_s * self._rate
            gain = gain + (1 - gain) * x * (1 - x * (1 / 2 - x / 6))
        return state_v + gain * (self._r * held_a - state_v)

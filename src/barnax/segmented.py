"""The same simulation in stretches side by side, for devices where one step after another is slow.

A linear circuit's state at the end of a stretch is what the stretch adds from rest, plus what it
started from, decayed. So all stretches run at once from rest, a short loop over their ends gives
where each really starts, and a second run from there sums the errors: twice the work in a
hundredth of the steps.
"""

import math

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, PyTree, Scalar

from .evaluator import AbstractEvaluator, Impedance
from .intervals import Intervals
from .simulate import Drive, last_state, respond, squared_error


class Clock(eqx.Module):
    """What moves a state in every stretch, and how much time, or SOC, every stretch spans."""

    held: Float[Array, "stretches samples"]
    intervals: Intervals
    span: Float[Array, "stretches"]

    @classmethod
    def of(cls, held: Float[Array, "stretches samples"], intervals: Intervals) -> "Clock":
        interval = intervals.node_s[intervals.node] + intervals.offset_s
        return cls(held, intervals, jnp.sum(interval, axis=1))

    def starts(self, tau: Scalar) -> Float[Array, "stretches"]:
        """The state of an RC pair of 1 ohm at the first sample of every stretch."""
        run = jax.vmap(last_state, (None, 0, _axes(self.intervals)))
        ends = run(tau, self.held, self.intervals)

        def follow(state, stretch):
            decay, end = stretch
            return decay * state + end, state

        _, starts = lax.scan(follow, jnp.zeros_like(tau), (jnp.exp(-self.span / tau), ends))
        return starts

    def states(self, tau: Scalar) -> Float[Array, "stretches samples"]:
        """The same at every sample."""
        run = jax.vmap(respond, (None, 0, 0, _axes(self.intervals)))
        return run(tau, self.starts(tau), self.held, self.intervals)[1]


class Segmented(AbstractEvaluator):
    """A `Drive` whose samples lie in stretches of equal length, the last one filled up.

    It computes what the `Drive` computes, to rounding.
    """

    scored: Scalar
    drive: Drive
    clock: Clock
    turns: Clock | None
    samples: int = eqx.field(static=True)

    @classmethod
    def of(cls, drive: Drive, stretches: int | None = None) -> "Segmented":
        """In at most so many stretches; by default as many as make the fewest steps in a row."""
        samples = len(drive.current_a)
        stretches = stretches or round(math.sqrt(2 * samples))
        length = -(-samples // stretches)
        stretches = -(-samples // length)
        if stretches * length > samples:
            drive = drive.filled_up(stretches * length)
        folded = drive.map_samples(lambda array: array.reshape(stretches, length))
        moved = folded.hysteresis
        return cls(
            scored=drive.scored,
            drive=folded,
            clock=Clock.of(folded.held_a, folded.intervals),
            turns=None if moved is None else Clock.of(moved.push, moved.intervals),
            samples=samples,
        )

    def squared_error(self, impedance: Impedance) -> Scalar:
        pairs = zip(impedance.r, impedance.tau, strict=True)
        states = tuple(r * self.clock.starts(tau) for r, tau in pairs)
        turned = jnp.zeros_like(self.clock.span)
        if self.turns is not None and impedance.gamma is not None:
            turned = self.turns.starts(1 / impedance.gamma)
        run = jax.vmap(squared_error, (None, _axes(self.drive), 0))
        return jnp.sum(run(impedance, self.drive, (states, turned)))

    def errors(self, impedance: Impedance) -> Float[Array, "samples"]:
        error_v = self.drive.base_error_v + impedance.r0 * self.drive.current_a
        for r, tau in zip(impedance.r, impedance.tau, strict=True):
            error_v = error_v + r * self.clock.states(tau)
        moved = self.drive.hysteresis
        if moved is not None and self.turns is not None and impedance.gamma is not None:
            error_v = error_v - moved.amplitude_v * self.turns.states(1 / impedance.gamma)
        if self.drive.weight is not None:
            error_v = self.drive.weight * error_v
        return error_v.ravel()[: self.samples]


def _axes(folded: PyTree) -> PyTree:
    """Over which axis to map: stretches, where there are any."""
    return jax.tree.map(lambda leaf: 0 if leaf.ndim == 2 else None, folded)

"""What a search asks of a record: how far a circuit's voltage is from the measured one."""

import abc

import equinox as eqx
import jax.numpy as jnp
from equinox import AbstractVar
from jaxtyping import Array, Float, Scalar


class Impedance(eqx.Module):
    """Ohmic resistance and RC pairs in series; `tau` is each pair's R times C, in seconds.

    `gamma` is the rate of a dynamic hysteresis per unit of SOC, None for circuits without.
    """

    r0: Scalar
    r: tuple[Scalar, ...]
    tau: tuple[Scalar, ...]
    gamma: Scalar | None = None


class AbstractEvaluator(eqx.Module):
    """One objective, whichever way it is computed. `scored` is how many samples count."""

    scored: AbstractVar[Scalar]

    @abc.abstractmethod
    def squared_error(self, impedance: Impedance) -> Scalar:
        """Sum of squared errors over the scored samples, in V^2."""

    @abc.abstractmethod
    def errors(self, impedance: Impedance) -> Float[Array, "errors"]:
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

    def squared_error(self, impedance: Impedance) -> Scalar:
        return jnp.sum(jnp.stack([part.squared_error(impedance) for part in self.parts]))

    def errors(self, impedance: Impedance) -> Float[Array, "errors"]:
        return jnp.concatenate([part.errors(impedance) for part in self.parts])

"""Search coordinates: the vectors an optimizer moves, and the circuits they stand for."""

from typing import Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .bounds import RESISTANCES, Bounds
from .cell.circuit import RATE
from .errors import InputError
from .evaluator import Impedance

Scale = Literal["rc", "log"]
SCALES: tuple[Scale, ...] = ("rc", "log")


class Coordinates(eqx.Module):
    """A box of free parameters and the map from a point in it to an `Impedance`.

    Parameters stand in the order R0, R1, X1, R2, X2 and so on, with gamma last where there is one.
    In `rc` coordinates X is a capacitance and all are raw, as in the paper. In `log` coordinates
    the point holds logarithms and X is the time constant, or the capacitance where the user bounded
    that. Where R C leaves the limits of tau, C is clipped.
    """

    lower: Float[Array, "free"]
    upper: Float[Array, "free"]
    fixed: Float[Array, "parameters"]
    tau_limits_s: Float[Array, "pairs ends"]
    free: tuple[int, ...] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    holds_tau: tuple[bool, ...] = eqx.field(static=True)
    is_log: bool = eqx.field(static=True)
    gamma_limits: tuple[float, float] | None = eqx.field(static=True)

    @classmethod
    def of(cls, bounds: Bounds, scale: Scale) -> "Coordinates":
        """The coordinates of a box. Raises `InputError` where nothing is free."""
        if scale not in SCALES:
            raise InputError(f"coordinates {scale!r} are not known; there are {', '.join(SCALES)}")
        is_log = scale == "log"
        slots = [_resistance(bounds, 0)]
        tau_limits, holds_tau = [], []
        for pair in range(bounds.pairs):
            resistance = _resistance(bounds, pair + 1)
            name, low, high = _range(bounds, bounds.second_name(pair))
            is_tau = name.startswith("tau")
            is_searched_as_tau = is_tau and (is_log or low == high)
            tau_limits.append((low, high) if is_tau else bounds.tau_limits_s)
            holds_tau.append(is_searched_as_tau)
            if is_tau and not is_searched_as_tau:
                name, low, high = f"C{pair + 1} [F]", low / resistance[2], high / resistance[1]
            slots += [resistance, (name, low, high)]
        if bounds.has_rate:
            slots.append(_range(bounds, RATE))
        free = tuple(index for index, (_, low, high) in enumerate(slots) if low < high)
        if not free:
            raise InputError("every parameter is fixed; leave at least one free")
        ends = np.array([slot[1:] for slot in slots])
        ends = np.log(ends) if is_log else ends
        return cls(
            lower=jnp.asarray(ends[list(free), 0]),
            upper=jnp.asarray(ends[list(free), 1]),
            fixed=jnp.asarray(ends[:, 0]),
            tau_limits_s=jnp.asarray(tau_limits),
            free=free,
            names=tuple(slots[index][0] for index in free),
            holds_tau=tuple(holds_tau),
            is_log=is_log,
            gamma_limits=slots[-1][1:] if bounds.has_rate else None,
        )

    @property
    def shortest_tau_s(self) -> float:
        """The smallest time constant in the box, in s."""
        return float(np.min(np.asarray(self.tau_limits_s)))

    @property
    def longest_tau_s(self) -> float:
        """The largest time constant in the box, in s."""
        return float(np.max(np.asarray(self.tau_limits_s)))

    @property
    def highest_gamma(self) -> float | None:
        """The largest rate in the box, None without dynamic hysteresis."""
        return None if self.gamma_limits is None else self.gamma_limits[1]

    def decode(self, point: Float[Array, "free"]) -> Impedance:
        """The circuit at a point."""
        # Picked one by one: a scatter would cost more than many simulations' steps.
        chosen = [
            point[self.free.index(slot)] if slot in self.free else self.fixed[slot]
            for slot in range(len(self.fixed))
        ]
        r0, *rest = [jnp.exp(value) for value in chosen] if self.is_log else chosen
        gamma = rest.pop() if len(rest) % 2 else None
        resistances, tau = rest[::2], []
        for pair, (r, x) in enumerate(zip(resistances, rest[1::2], strict=True)):
            low, high = self.tau_limits_s[pair]
            tau.append(x if self.holds_tau[pair] else jnp.clip(r * x, low, high))
        return Impedance(r0, tuple(resistances), tuple(tau), gamma)

    def encode(self, impedance: Impedance) -> Float[Array, "free"]:
        """The point of a circuit, moved into the box where it lies outside."""
        values = [impedance.r0]
        for pair, (r, tau) in enumerate(zip(impedance.r, impedance.tau, strict=True)):
            values += [r, tau if self.holds_tau[pair] else tau / r]
        if impedance.gamma is not None:
            values.append(impedance.gamma)
        point = jnp.stack(values)[jnp.array(self.free)]
        point = jnp.log(point) if self.is_log else point
        return jnp.clip(point, self.lower, self.upper)


def _resistance(bounds: Bounds, index: int) -> tuple[str, float, float]:
    return _range(bounds, RESISTANCES[index])


def _range(bounds: Bounds, name: str) -> tuple[str, float, float]:
    low, high = bounds.ranges.get(name) or (bounds.fixed[name], bounds.fixed[name])
    return name, low, high

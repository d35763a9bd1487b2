"""The coordinates in which a compiled search moves."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..cell.elements import alike, get_element
from ..cell.parameters import OHMIC, RATE
from ..errors import InputError, require_choice
from ..execution import as_input
from .search_space import SCALES, Bounds, Range, Scale
from .simulate import RCParameters


class Coordinates(eqx.Module):
    """A box of free parameters and the map from a point in it to an `RCParameters`.

    Parameters are in the order R0, R1, X1, R2, X2 and so on, with gamma last if there is one.
    `elements` are named if not all are RC pairs. In `rc` coordinates X is a capacitance and all are
    raw, as in the paper. In `log` coordinates the point holds logarithms and X is the time
    constant, or the capacitance if the user bounded that. Where R C leaves the limits of tau, C is
    clipped.
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
    elements: tuple[str, ...] = eqx.field(static=True, default=())

    @classmethod
    def of(cls, bounds: Bounds, scale: Scale) -> "Coordinates":
        """The coordinates of a box. Raises `InputError` if nothing is free."""
        require_choice("coordinates", scale, SCALES)
        is_log = scale == "log"
        slots = [(OHMIC, *bounds.range_of(OHMIC))]
        tau_limits, holds_tau = [], []
        for pair, (resistance, tau, capacitance) in enumerate(bounds.element_names):
            r_low, r_high = bounds.range_of(resistance)
            name = bounds.second_name(pair)
            low, high = bounds.range_of(name)
            is_tau = name == tau
            is_searched_as_tau = is_tau and (is_log or low == high or capacitance is None)
            tau_limits.append((low, high) if is_tau else bounds.tau_limits_s)
            holds_tau.append(is_searched_as_tau)
            if is_tau and not is_searched_as_tau:
                name, low, high = str(capacitance), low / r_high, high / r_low
            slots += [(resistance, r_low, r_high), (name, low, high)]
        if bounds.gamma_range is not None:
            slots.append((RATE, *bounds.gamma_range))
        free = tuple(index for index, (_, low, high) in enumerate(slots) if low < high)
        if not free:
            raise InputError("every parameter is fixed; leave at least one free")
        ends = np.array([slot[1:] for slot in slots])
        ends = np.log(ends) if is_log else ends
        return cls(
            lower=as_input(ends[list(free), 0]),
            upper=as_input(ends[list(free), 1]),
            fixed=as_input(ends[:, 0]),
            tau_limits_s=as_input(tau_limits),
            free=free,
            names=tuple(slots[index][0] for index in free),
            holds_tau=tuple(holds_tau),
            is_log=is_log,
            gamma_limits=bounds.gamma_range,
            elements=() if alike(bounds.elements) == bounds.pairs else bounds.elements,
        )

    @property
    def spans(self) -> tuple[Range, Range | None]:
        """The smallest and the largest time constant of an RC pair in the box, in s, and gamma's
        range if there is one."""
        low_s, high_s = np.asarray(self.tau_limits_s).T
        if self.elements:
            ratios = [get_element(name).ratios for name in self.elements]
            low_s = low_s * [each[-1] for each in ratios]
            high_s = high_s * [each[0] for each in ratios]
        return (float(low_s.min()), float(high_s.max())), self.gamma_limits

    def decode(self, point: Float[Array, "free"], xp: Any = jnp) -> RCParameters:
        """The circuit at a point, by JAX; with `numpy` also the circuits at several points, one per
        column."""
        # Picked one by one: a scatter would cost more than many simulation steps.
        chosen = [
            point[self.free.index(slot)] if slot in self.free else self.fixed[slot]
            for slot in range(len(self.fixed))
        ]
        r0, *rest = [xp.exp(value) for value in chosen] if self.is_log else chosen
        gamma = rest.pop() if len(rest) % 2 else None
        resistances, tau = rest[::2], []
        for pair, (r, x) in enumerate(zip(resistances, rest[1::2], strict=True)):
            low, high = self.tau_limits_s[pair]
            tau.append(x if self.holds_tau[pair] else xp.clip(r * x, low, high))
        return RCParameters(r0, tuple(resistances), tuple(tau), gamma, self.elements)

    def encode(self, rc: RCParameters) -> Float[np.ndarray, "*points free"]:
        """The point of a circuit, moved into the box if it lies outside."""
        values = [rc.r0]
        for pair, (r, tau) in enumerate(zip(rc.r, rc.tau, strict=True)):
            values += [r, tau if self.holds_tau[pair] else tau / r]
        if rc.gamma is not None:
            values.append(rc.gamma)
        point = np.stack([*map(np.asarray, values)], axis=-1)[..., list(self.free)]
        point = np.log(point) if self.is_log else point
        return np.clip(point, np.asarray(self.lower), np.asarray(self.upper))

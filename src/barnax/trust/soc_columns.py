"""What a model would add to its voltage if it were tabulated over the state of charge."""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..precision import in_float64
from ..problem import impedance_of
from ..refinement import CrossCheck
from ..simulate import Drive, unit_response

KNOTS = 6
# Over a narrower range of SOC a table has nothing to tell.
NARROWEST = 0.05


@dataclass(frozen=True, eq=False)
class SocColumns:
    """Voltages over the scored samples that the error is linear in, time constants kept.

    The error is `base_error_v` plus columns times their coefficients: `constant` with the
    resistances R0, R1, ..., `resistances` with their values at every knot (R0's first), `offsets`
    with the OCV's errors at the knots.
    """

    base_error_v: Float[np.ndarray, "scored"]
    constant: Float[np.ndarray, "scored resistances"]
    resistances: Float[np.ndarray, "scored tabulated"]
    offsets: Float[np.ndarray, "scored knots"]
    knots: int


@in_float64
def soc_columns(checked: CrossCheck) -> SocColumns | None:
    """The columns for `KNOTS` knots over the scored SOC; None where that hardly changes.

    A resistance between knots is interpolated. In an RC pair it multiplies the current that
    charges it, so the pair's voltage moves to a new resistance with its own time constant.
    """
    problem = checked.found.problem
    courses = problem.courses
    soc = np.concatenate([course.soc[course.scored] for course in courses])
    knots = np.linspace(soc.min(), soc.max(), KNOTS)
    if knots[-1] - knots[0] < NARROWEST:
        return None
    impedance = impedance_of(checked.parameters)
    base, constant, tabulated = [], [], []
    for course, drive in zip(courses, problem.drives, strict=True):
        hats = np.stack([np.interp(course.soc, knots, row) for row in np.eye(KNOTS)])
        responses = np.asarray(_responses(jnp.stack(impedance.tau), jnp.asarray(hats), drive))
        scored = course.scored
        turned = 0.0 if impedance.gamma is None else _turned(impedance.gamma, drive)
        base.append((np.asarray(drive.base_error_v) - turned)[scored])
        constant.append(responses.sum(axis=1)[:, scored].T)
        tabulated.append(responses.reshape(-1, responses.shape[-1])[:, scored].T)
    return SocColumns(
        base_error_v=np.concatenate(base),
        constant=np.concatenate(constant),
        resistances=np.concatenate(tabulated),
        offsets=np.stack([np.interp(soc, knots, row) for row in np.eye(KNOTS)], axis=1),
        knots=KNOTS,
    )


@eqx.filter_jit
def _responses(
    tau: Float[Array, "pairs"], hats: Float[Array, "knots samples"], drive: Drive
) -> Float[Array, "resistances knots samples"]:
    """The voltage over R0 and every pair of 1 ohm for the current around each knot."""

    def one(tau, hat):
        return unit_response(tau, hat * drive.held_a, drive.intervals)

    pairs = jax.vmap(jax.vmap(one, in_axes=(None, 0)), in_axes=(0, None))(tau, hats)
    return jnp.concatenate([(hats * drive.current_a)[None], pairs])


@eqx.filter_jit
def _turned(gamma: Float[Array, ""], drive: Drive) -> Float[Array, "samples"]:
    moved = drive.hysteresis
    if moved is None:
        return jnp.zeros_like(drive.base_error_v)
    return moved.amplitude_v * unit_response(1 / gamma, moved.push, moved.intervals)

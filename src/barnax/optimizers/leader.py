"""The best candidate a swarm has met, for algorithms that follow one."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Scalar

from .swarm import Swarm


class Leader(eqx.Module):
    """A position and its loss, kept though the swarm moves on."""

    position: Float[Array, "dims"]
    loss: Scalar


def best_of(swarm: Swarm) -> Leader:
    """The swarm's best candidate; of equal ones the first."""
    best = jnp.argmin(swarm.losses)
    return Leader(swarm.positions[best], swarm.losses[best])


def better_leader(leader: Leader, swarm: Swarm) -> Leader:
    """The leader, unless the swarm holds a strictly better candidate."""
    challenger = best_of(swarm)
    is_better = challenger.loss < leader.loss
    return Leader(
        jnp.where(is_better, challenger.position, leader.position),
        jnp.where(is_better, challenger.loss, leader.loss),
    )

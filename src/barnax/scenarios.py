"""Wrong beliefs of a battery manager that starts a filter, and the filter's inputs then."""

from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .filters import Drive, FilterModel
from .model.prepared import PreparedRecord


@dataclass(frozen=True)
class Scenario:
    """Errors of a battery manager's knowledge.

    Args:
        name: What it is called in reports.
        soc_error: Error of the SOC at the start, a fraction, positive where it is too high. The
            filter starts at the first sample that leaves room for it between empty and full.
        offset_c: Offset of the current, as a C-rate.
        capacity_factor: The capacity that is believed, relative to the right one.
    """

    name: str
    soc_error: float = 0.0
    offset_c: float = 0.0
    capacity_factor: float = 1.0


SCENARIOS = (
    Scenario("right start"),
    Scenario("start 20 % too low", soc_error=-0.2),
    Scenario("start 20 % too high", soc_error=0.2),
    Scenario("current offset", offset_c=0.01),
    Scenario("capacity 5 % high", capacity_factor=1.05),
)


@dataclass(frozen=True, eq=False)
class Case:
    """A scenario from its first sample on: the model, the start and the drive as the battery
    manager has them."""

    scenario: Scenario
    first: int
    given: tuple[FilterModel, Any, Drive]

    @property
    def counted(self) -> Float[np.ndarray, "samples"]:
        """SOC by counting alone, with what the manager has wrong."""
        believed, (state, _), drive = self.given
        passed_ah = np.cumsum(np.asarray(drive.held_a * drive.interval_s)) / 3600
        return float(state[0]) - passed_ah / float(believed.capacity_ah)


def first_with_room(soc: Float[np.ndarray, "samples"], error: float) -> int | None:
    """The first sample that leaves room for a wrong start, None without one."""
    has_room = (soc + error >= min(0.0, soc[0])) & (soc + error <= max(1.0, soc[0]))
    return int(np.argmax(has_room)) if np.any(has_room) else None


def case_of(
    model: FilterModel, prepared: PreparedRecord, scenario: Scenario, first: int, soc_sd: float
) -> Case:
    drive = Drive.of(prepared)
    direction_sd = 1.0 if prepared.start.direction_source == "assumed" else 0.0
    direction = float(prepared.start.direction)
    soc = prepared.soc[first] + scenario.soc_error
    state, variance = model.start(soc, soc_sd, direction, direction_sd)
    if first:
        # The current was known until then: pairs and hysteresis stand where it has left them.
        right, _ = model.start(prepared.soc[0], soc_sd, direction, direction_sd)
        before = jax.tree.map(lambda array: array[: first + 1], drive)
        reached = _open_loop(model, right, before)
        state = reached.at[0].set(soc)
    # The samples before are put behind the last, where nothing is counted.
    drive = jax.tree.map(
        lambda array: jnp.concatenate([array[first:], jnp.repeat(array[-1:], first)]), drive
    )
    capacity_ah = model.capacity_ah * scenario.capacity_factor
    offset_a = scenario.offset_c * prepared.capacity_ah
    drive = drive._replace(
        interval_s=drive.interval_s.at[0].set(0.0),
        held_a=drive.held_a.at[1:].add(offset_a),
        current_a=drive.current_a + offset_a,
        pairs_a=None if drive.pairs_a is None else drive.pairs_a.at[1:].add(offset_a),
    )
    believed = eqx.tree_at(lambda model: model.capacity_ah, model, capacity_ah)
    return Case(scenario, first, (believed, (state, variance), drive))


@jax.jit
def _open_loop(model: FilterModel, state: Any, drive: Drive) -> Any:
    """The state at the end of a drive."""
    slow = jnp.zeros_like(model.slow_sd)
    return jax.lax.scan(
        lambda state, current_a: (model.advance(state, slow, current_a), None), state, drive
    )[0]


def in_place(
    values: Float[np.ndarray, "samples *_"], first: int
) -> Float[np.ndarray, "samples *_"]:
    """Values that were computed from a sample on, in their place."""
    found = np.full(values.shape, np.nan)
    found[first:] = values[: len(values) - first]
    return found

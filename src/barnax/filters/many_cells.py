"""The extended filter of many cells in one call, written out number by number.

Vmapped, each number is a vector over the cells, and a sample is some hundred sums and products of
them, which run at the machine's SIMD speed; matrices of eight rows, a cell after the other, take
ten times as long. Only slopes that are not zero are there at all. For one cell it is the other way
round, because each of these numbers is a kernel of its own.
"""

from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int, Scalar

from .model import CAPACITY, GRID, OFFSET, STEPS_PER_SOC, WALK_S, Drive, Estimate, FilterModel

# By row, and by row and column; what is not there is zero.
Slopes = Mapping[int, Scalar | float]
Places = tuple[int, int]
SparseMatrix = dict[Places, Scalar | float]
Covariance = dict[Places, Scalar]


def filter_in_scalars(
    model: FilterModel, start: tuple[Float[Array, "states"], Float[Array, "states"]], drive: Drive
) -> Estimate:
    """The extended filter with joint parameters, as `kalman` has it for one cell."""
    mean, variance = start
    variance = jnp.concatenate([variance, model.slow_sd**2])
    count, slow = len(variance), range(model.states, len(variance))
    covariance = {
        (row, column): variance[row] if row == column else 0 * variance[row]
        for row in range(count)
        for column in range(row, count)
    }

    def step(belief, drive: Drive):
        state, covariance = belief
        state, slopes, walk = _advance(model, state, drive)
        voltage_v, toward, noise_v2 = _see(model, state, drive)
        gain, covariance, sd_v = _update(covariance, slopes, walk, toward, noise_v2)
        innovation_v = drive.voltage_v - voltage_v
        weight = innovation_v / sd_v
        state = [each + share * weight for each, share in zip(state, gain, strict=True)]
        variances = [covariance[at, at] for at in (0, *slow)]
        return (state, covariance), (state[0], state[model.states :], variances, innovation_v, sd_v)

    belief = [*mean, *(0 * model.slow_sd)], covariance
    soc, found, variances, innovation_v, sd_v = lax.scan(step, belief, drive)[1]
    soc_sd, *found_sd = [jnp.sqrt(each) for each in variances]
    nothing = jnp.zeros((*soc.shape, 0))
    found, found_sd = (jnp.stack(each, axis=-1) if each else nothing for each in (found, found_sd))
    return Estimate(soc, soc_sd, found, found_sd, innovation_v, sd_v)


def _advance(
    model: FilterModel, state: Sequence[Scalar], drive: Drive
) -> tuple[list[Scalar], SparseMatrix, Slopes]:
    """`FilterModel.advance` with its slopes, and the variances of `FilterModel.walk`."""
    places = {name: model.states + at for at, name in enumerate(model.slow)}

    def factor(name: str) -> Scalar | float:
        return jnp.exp(state[places[name]]) if name in places else 1.0

    interval_s, held_a = drive.interval_s, drive.held_a
    if OFFSET in places:
        held_a = held_a - state[places[OFFSET]]
    capacity_as = 3600 * model.capacity_ah * factor(CAPACITY)
    # A quotient is computed once, a product wherever it is used.
    per_a = interval_s / capacity_as
    moved = list(state)
    slopes: SparseMatrix = {(at, at): 1.0 for at in (0, *places.values())}
    walk = {0: (model.current_sd_a * interval_s / (3600 * model.capacity_ah)) ** 2}
    moved[0] = state[0] - per_a * held_a
    # By the name of a slow parameter, the slope of one row after the other.
    by_slow = {(0, OFFSET): per_a, (0, CAPACITY): per_a * held_a}
    values, rises = _look_up(model, state[0])
    for pair in range(model.pairs):
        row, tau, resistance = 1 + pair, f"tau{pair + 1}", f"R{pair + 1}"
        times = interval_s / (model.tau_s[pair] * factor(tau))
        left, r = jnp.exp(-times), values[4 + pair] * factor(resistance)
        away_v = r * held_a - state[row]
        moved[row] = state[row] + (1 - left) * away_v
        slopes[row, row] = left
        slopes[row, 0] = (1 - left) * rises[4 + pair] * factor(resistance) * held_a
        by_slow[row, OFFSET] = (left - 1) * r
        by_slow[row, resistance] = (1 - left) * r * held_a
        by_slow[row, tau] = -left * times * away_v
    if model.hysteresis == "dynamic":
        row, direction = 1 + model.pairs, -jnp.sign(drive.turning_a)
        passed = model.gamma * jnp.abs(drive.turning_a) * per_a
        left, away = jnp.exp(-passed), state[row] - direction
        moved[row] = direction + left * away
        slopes[row, row], by_slow[row, CAPACITY] = left, left * passed * away
    first = model.states - model.error_s.shape[-1]
    for row in range(first, model.states):
        left = jnp.exp(-interval_s / model.error_s[row - first])
        moved[row], slopes[row, row] = left * state[row], left
        walk[row] = (1 - left**2) * model.error_sd_v[row - first] ** 2
    for at, row in enumerate(places.values()):
        walk[row] = model.slow_sd[at] ** 2 * (interval_s / WALK_S)
    slopes |= {(row, places[name]): each for (row, name), each in by_slow.items() if name in places}
    return moved, slopes, walk


def _see(
    model: FilterModel, state: Sequence[Scalar], drive: Drive
) -> tuple[Scalar, Slopes, Scalar]:
    """`FilterModel.voltage` with its slopes, and `FilterModel.noise_v2`."""
    places = {name: model.states + at for at, name in enumerate(model.slow)}
    (ocv_v, half_v, scale, r0), (ocv_rise, half_rise, scale_rise, r0_rise) = (
        each[:4] for each in _look_up(model, state[0])
    )
    current_a, turned = drive.current_a, 0.0
    if OFFSET in places:
        current_a = current_a - state[places[OFFSET]]
    if "R0" in places:
        factor = jnp.exp(state[places["R0"]])
        r0, r0_rise = r0 * factor, r0_rise * factor
    toward: dict[int, Scalar | float] = dict.fromkeys(range(1, 1 + model.pairs), -1.0)
    if model.hysteresis == "instant":
        turned = drive.direction
    if model.hysteresis == "dynamic":
        turned, toward[1 + model.pairs] = state[1 + model.pairs], half_v
    first = model.states - model.error_s.shape[-1]
    errors_v = sum(state[first : model.states])
    toward |= dict.fromkeys(range(first, model.states), scale)
    toward[0] = ocv_rise + turned * half_rise + scale_rise * errors_v - r0_rise * current_a
    by_slow = {OFFSET: r0, "R0": -r0 * current_a}
    toward |= {places[name]: each for name, each in by_slow.items() if name in places}
    voltage_v = ocv_v + turned * half_v + scale * errors_v - r0 * current_a
    voltage_v = voltage_v - sum(state[1 : 1 + model.pairs])
    return voltage_v, toward, (scale * model.white_sd_v) ** 2


def _update(
    covariance: Covariance, slopes: SparseMatrix, walk: Slopes, toward: Slopes, noise_v2: Scalar
) -> tuple[list[Scalar], Covariance, Scalar]:
    """The gains over the innovation's deviation, the covariance after a sample, that deviation.

    The predicted covariance is nowhere: it would be computed anew wherever it is used.
    """
    count = 1 + max(row for row, _ in covariance)
    rows = [
        [(column, slopes[row, column]) for column in range(count) if (row, column) in slopes]
        for row in range(count)
    ]
    before: dict[int, Scalar | float] = {}
    for (row, column), slope in slopes.items():
        if row in toward:
            before[column] = before.get(column, 0.0) + slope * toward[row]

    def at(row: int, column: int) -> Scalar:
        return covariance[min(row, column), max(row, column)]

    carried = [
        sum(at(row, column) * each for column, each in before.items()) for row in range(count)
    ]
    with_state = [
        sum(slope * carried[column] for column, slope in rows[row])
        + walk.get(row, 0.0) * toward.get(row, 0.0)
        for row in range(count)
    ]
    sd_v = jnp.sqrt(sum(toward[row] * with_state[row] for row in toward) + noise_v2)
    # A quotient, so that it is computed once for all that is made of it.
    gain = [each / sd_v for each in with_state]
    return (
        gain,
        {
            (row, column): sum(
                slope * sum(other * at(left, right) for left, other in rows[row])
                for right, slope in rows[column]
            )
            + (walk.get(row, 0.0) if row == column else 0.0)
            - gain[row] * gain[column]
            for row, column in covariance
        },
        sd_v,
    )


def _look_up(model: FilterModel, soc: Scalar) -> tuple[list[Scalar], list[Scalar]]:
    """The table's row at a SOC, as `FilterModel.at`, and its slope over SOC."""
    along = (soc - GRID[0]) * STEPS_PER_SOC
    place = jnp.clip(along, 0, len(GRID) - 2).astype(jnp.int32)
    columns = model.table.shape[-1]
    found = _rows(model.table, place)
    rises = [above - below for below, above in zip(found[:columns], found[columns:], strict=True)]
    values = [below + (along - place) * rise for below, rise in zip(found, rises, strict=False)]
    return values, [rise * STEPS_PER_SOC for rise in rises]


@jax.custom_batching.custom_vmap
def _rows(table: Float[Array, "points rows"], place: Int[Array, ""]) -> list[Scalar]:
    """Two rows of a table, one number after the other.

    Of many cells' tables they are read by one index into all of them: the one that JAX makes of
    cell and row takes as long as all the rest.
    """
    return _read(table, place * table.shape[1])


@_rows.def_vmap
def _rows_of_cells(axis_size: int, in_batched, table, place):
    if not in_batched[1]:
        place = jnp.broadcast_to(place, axis_size)
    first = place * table.shape[-1]
    if in_batched[0]:
        first = first + jnp.arange(axis_size, dtype=place.dtype) * table[0].size
    found = _read(table, first)
    return found, [True] * len(found)


def _read(table: Array, first: Array) -> list[Array]:
    numbers = table.reshape(-1)
    return [
        numbers.at[first + at].get(mode="promise_in_bounds", wrap_negative_indices=False)
        for at in range(2 * table.shape[-1])
    ]

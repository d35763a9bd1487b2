"""An offset of the current that several records share, such as those of one tester.

An offset o adds dv = o (U'(s) t / C + R) after a time t. In one record this looks like a capacity,
or a slow pair. In records at different rates it shifts their charge by shares that no start and no
capacity explain, and is one more unknown, with an OCV fitted to the records: a measured one need
not extend to where the charge goes without the offset.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ..model.descent import polish
from ..model.prepared import PreparedRecord
from ..model.search_space import Range
from .flat_ocv import with_fitted_ocv, with_flat_ocv
from .nuisances import estimate, of_starts
from .objective import Solution, TableObjective
from .table_problem import held_at, reduced_objective, search_ranges

# Offsets that are tried first, and the prior's standard deviation, in shares of the capacity per
# hour.
TRIED_PER_H, SD_PER_H = (-0.015, -0.01, -0.005, 0.005, 0.01, 0.015), 0.02
# An offset is accepted from this many standard errors and this size on, if the remaining error is
# less than this share. The search ends if the first round's standard error is above the next limit,
# or a later round gives less than the last number of standard errors.
LEAST_ERRORS, LEAST_PER_H, LEAVES = 3.0, 1 / 300, 0.85
OPEN_PER_H, DOUBTED_ERRORS = 0.0075, 1.5
# A current that reads no more than this for at least this long at rest has no offset. Of the
# currents up to `SMALL_PER_H`, those at rest are more than this share, within a quarter of that.
ZERO_PER_H, LEAST_REST_S = LEAST_PER_H / 2, 60.0
SMALL_PER_H, STAYS = 0.02, 0.6
# An offset that testers commonly have: its effect is reported if the records cannot rule it out.
DOUBTED_PER_H = 1 / 200
# The offset moves time constants by no more than this factor.
MOVES = 2.0
# Charge is off by percents, so slopes of the OCV are differences over a similar step. The rounds
# end when the offset moves by less than this share of its error.
STEP_SOC, ROUNDS, SETTLED = 0.02, 6, 0.05


@dataclass(frozen=True)
class OffsetEffect:
    """The relative change of R0, and of the sum of all resistances, caused by an undetected offset
    of the current: medians of their magnitudes over the visited nodes."""

    offset_a: float
    r0: float
    total: float


def _without_offset(
    objective: TableObjective,
    shifts: Float[np.ndarray, "records two"],
    offset_a: float,
    ranges: Mapping[str, Range],
) -> TableObjective | None:
    """The objective with starts and capacities moved, the currents without an offset, and an OCV
    fitted to the records; None if they leave the SOC axis."""
    records = []
    for prepared, soc, share in zip(objective.prepared_records, *shifts.T.tolist(), strict=True):
        record = prepared.record
        record = replace(record, current_a=record.current_a - offset_a)
        start, capacity_ah = prepared.start.soc + soc, prepared.capacity_ah * (1 + share)
        moved = prepared.registered(start, capacity_ah, record=record)
        if moved is None:
            return None
        records.append(moved.with_dependence(prepared.dependence))
    records = with_flat_ocv(records, objective.prepared_records[0])
    return reduced_objective(records, with_fitted_ocv(objective.settings), ranges)


def shared_offset(
    objective: TableObjective,
    best: Solution,
    prior: Float[np.ndarray, "records two"],
    registered_v: float,
) -> tuple[float, float] | None:
    """The offset of the current shared by the records, in A with discharge positive, and its
    standard error; None if they do not determine one, or if the current of one of them reads zero
    at rest.

    Args:
        objective: The objective of the records as given.
        best: Its best tables.
        prior: Standard deviations of the given starts, and of the given capacities as shares.
        registered_v: sqrt(J) with starts and capacities registered, and no offset.
    """
    if any(map(reads_zero_at_rest, objective.prepared_records)):
        return None
    capacity_ah = objective.prepared_records[0].capacity_ah
    box = search_ranges(objective.prepared_records, objective.settings)
    lowest, highest = np.log([*box.values()]).T
    sds = np.append(prior.ravel(), SD_PER_H * capacity_ah)
    as_given, ranges = objective, held_at(objective.ranges, best.log_scales)
    shifts, offset_a, least_v2 = np.zeros(prior.shape), 0.0, np.inf
    for tried_a in (0.0, *(capacity_ah * share for share in TRIED_PER_H)):
        moved = _without_offset(as_given, shifts, tried_a, ranges)
        objective_v2 = moved.solve(best.log_scales).objective_v2 if moved else np.inf
        if objective_v2 < least_v2:
            offset_a, least_v2 = tried_a, objective_v2
    error_a = leaves = np.inf
    log_scales = np.array(best.log_scales)
    for number in range(ROUNDS):
        ranges = box if number == 1 else held_at(box, log_scales.tolist())
        moved = _without_offset(as_given, shifts, offset_a, ranges)
        if moved is None:
            return None
        objective = moved
        best = objective.solve(tuple(log_scales.tolist()))
        # A slow pair may have absorbed the offset so far that no step leads back.
        if number == 1:
            best = polish(objective, best)
            log_scales = np.array(best.log_scales)
        before, before_a = np.append(shifts.ravel(), offset_a), offset_a
        estimated = estimate(objective, best, _of_starts_and_offset, before, [sds])[0]
        log_scales = np.clip(log_scales + estimated.moved_scales, lowest, highest)
        shifts = estimated.values[:-1].reshape(prior.shape)
        # SOC is scaled so that the given values are right on average.
        shifts = shifts - np.average(shifts, axis=0, weights=prior**-2.0)
        offset_a, error_a = float(estimated.values[-1]), float(estimated.errors[-1])
        farthest_a = abs(offset_a) + LEAST_ERRORS * error_a
        is_none = abs(offset_a) < DOUBTED_ERRORS * error_a or farthest_a < LEAST_PER_H * capacity_ah
        if is_none if number else error_a > OPEN_PER_H * capacity_ah:
            return None
        leaves = best.rms_v / registered_v
        if number and abs(offset_a - before_a) < SETTLED * error_a:
            break
    least_a = max(LEAST_ERRORS * error_a, LEAST_PER_H * capacity_ah)
    is_shown = abs(offset_a) > least_a and leaves < LEAVES
    return (offset_a, error_a) if is_shown else None


def reads_zero_at_rest(prepared: PreparedRecord) -> bool:
    """True if rests show that the current has no offset. The remains of a hysteresis look like an
    offset on a flat OCV, so evidence from the voltages does not count against it."""
    per_h = prepared.current_a / prepared.capacity_ah
    small = per_h[np.abs(per_h) < SMALL_PER_H]
    if len(small) * prepared.median_interval_s < LEAST_REST_S:
        return False
    # A load passes through zero too, but does not stay there; a rest with an offset stays near it.
    level = float(np.median(small))
    stays = np.mean(np.abs(small - level) < SMALL_PER_H / 4) > STAYS
    return bool(stays) and abs(level) < ZERO_PER_H


def offset_effect(objective: TableObjective, best: Solution) -> OffsetEffect | None:
    """The effect of an offset of `DOUBTED_PER_H` on tables fitted to one record with its own OCV,
    whose time constants move with it; None if it would leave the SOC axis, or no resistance is
    positive."""
    (prepared,) = objective.prepared_records
    offset_a = DOUBTED_PER_H * prepared.capacity_ah
    # The same SOC range as without the offset, so that the same states are compared.
    full, empty = int(np.argmax(prepared.soc)), int(np.argmin(prepared.soc))
    hours = float(prepared.time_s[empty] - prepared.time_s[full]) / 3600
    share = -DOUBTED_PER_H * hours / float(np.ptp(prepared.soc))
    ranges = {
        name: (max(low, math.exp(scale) / MOVES), min(high, math.exp(scale) * MOVES))
        for (name, (low, high)), scale in zip(
            objective.ranges.items(), best.log_scales, strict=True
        )
    }
    other = _without_offset(objective, np.array([[0.0, share]]), offset_a, ranges)
    if other is None:
        return None
    other = polish(other, other.solve(best.log_scales))
    moved_shares = []
    for tables in (slice(1), slice(1 + objective.pairs)):
        before, after = (np.sum(solution.values[tables], axis=0) for solution in (best, other))
        is_positive = objective.visited & (before > 0)
        if not is_positive.any():
            return None
        moved_shares.append(float(np.median(np.abs(after[is_positive] / before[is_positive] - 1))))
    return OffsetEffect(offset_a, *moved_shares)


def _of_starts_and_offset(
    objective: TableObjective, best: Solution, index: int
) -> Float[np.ndarray, "samples nuisances"]:
    """The columns of starts and capacities, and of an offset of the current shared by all."""
    prepared = objective.prepared_records[index]
    soc, (nodes, ocv_v) = prepared.soc[prepared.scored], objective.ocv_at(best)
    half = STEP_SOC / 2
    middle = np.clip(soc, nodes[0] + half, nodes[-1] - half)
    below_v, above_v = (np.interp(middle + step, nodes, ocv_v) for step in (-half, half))
    slope = (above_v - below_v) / STEP_SOC
    hours = (prepared.time_s - prepared.time_s[0])[prepared.scored] / 3600
    r_ohm = np.sum(best.values[: 1 + objective.pairs], axis=0)
    of_offset = slope * hours / prepared.capacity_ah
    of_offset += np.interp(soc, objective.nodes_of[0], r_ohm)
    return np.column_stack([of_starts(objective, best, index, slope), of_offset])

"""Ageing by one record: capacity, resistances and OCV beside those of before.

With the OCV U that the cell had over its state of charge s, a record's voltage is

    v = U(s) + d + g(s) - R0(s) i - ...,    s = s0 - charge / C,

with its own capacity C, start s0 and shift d of the OCV, which a sensor's offset is too. They are
estimated together with all tables (`nuisances`), with the errors that U may have. There are priors
on s0 and d, and hardly one on C. A capacity with too wide an interval is not determined.

An ageing cell's OCV changes its shape by g, for its electrodes lose lithium and material unequally.
Charges end at one voltage, so that g is zero where the cell is full; below, it is a random walk,
whose standard deviation is found with the rest. Where nothing shows the empty end, a change of
shape is mistaken for a change of capacity: of a capacity that fell by 6.6 % in PyBaMM, the OCV of
before, stretched over the upper 70 %, sees half. A rest near empty, where the OCV is steep, does
tell the capacity.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri

from ..blas import one_blas_thread
from ..cell.ocv_points import CLOCK_SLACK_S, MINIMUM_REST_S
from ..cell.tables import hats
from ..errors import InputError
from ..execution import in_float64
from ..model.prepared import FEWEST_SAMPLES, PreparedRecord
from ..model.search_space import Range
from ..records.record import runs
from ..uncertainty.covariance import CONFIDENCE
from .nuisances import Estimated, Measured, estimate, of_starts
from .objective import Solution, TableObjective
from .problem import box_of, held_at, reduced_objective
from .registration import FULL_SD, REST_SD_V, slope_of, told_within
from .search import find_best
from .settings import TableSettings

Nuisance = Float[np.ndarray, "nuisances"]
CIRCUIT = "so-rc"
CAPACITY, SHIFT, R0, R = "capacity [A.h]", "OCV shift [V]", "R0 [Ohm]", "R [Ohm]"
AGED = (CAPACITY, "start SOC", SHIFT, R0, R)
# Standard deviations of what is believed of a shift of the OCV, and of the logarithm of a capacity.
SHIFT_SD_V, CAPACITY_SD = 0.02, 1.0
# An OCV identified from records ripples between its nodes, which no cell's does. Slopes over so
# wide a step of SOC leave that out: it would tell start and capacity from a shift, wrongly.
SLOPE_SOC = 0.1
# Standard deviations of the OCV of before at its nodes, and of what is held.
OCV_SD_V, OCV_NODES = 1.5e-3, np.linspace(0.0, 1.0, 21)
HELD_SD = 1e-7
# The usual standard deviation of a change of its shape over all of the SOC, which counts as much
# as one step that a record tells: cells in PyBaMM that lost 1 to 17 % of their capacity have 5 to
# 48 mV. What looks like another capacity shows in no step, so that without it too little is found.
SHAPE_SD_V = 0.025
# Below the first SOC circuits do not follow, and only rests count; below the second these tell the
# capacity. A rest's slope is over so much SOC.
EMPTY_SOC, NEAR_EMPTY_SOC, REST_SLOPE_SOC = 0.05, 0.15, 0.01
# Shares of the capacity that are tried first, with time constants in s for which any do.
SHARES, TRIED_S = (1.05, 0.98, 0.9, 0.82, 0.74, 0.66), (10.0, 100.0)
# The descent's end, and its largest step in a share or in V.
SETTLED, LARGEST_STEP, ROUNDS = 1e-4, 0.1, 8
# An interval that reaches further than this share of the value to either side determines nothing.
DETERMINED = {CAPACITY: 0.05, R0: 0.25, R: 0.5}


@dataclass(frozen=True)
class Aged:
    """One aged quantity with its 95 % interval. `by_ocv` is how far the value is
    off where the OCV of before is, by one standard deviation at one of its nodes: what all records
    that are told beside one OCV have in common."""

    value: float
    low: float
    high: float
    by_ocv: tuple[float, ...]


@in_float64
def measure_ageing(
    prepared_records: Sequence[PreparedRecord],
    settings: TableSettings,
    soc: float = 0.5,
    *,
    is_own: bool = False,
) -> dict[str, Aged]:
    """Capacity, start, OCV shift, and R0 and all resistances at a state of charge, by name.

    Args:
        prepared_records: Records of one cell at one age, with the OCV that it had before.
        settings: The bounds and weights of tables.
        soc: Where the resistances are told, on the capacity that is found.
        is_own: Whether the OCV was identified from these very records, of which it then tells R0
            alone, on the capacity that was told.

    What the records do not determine is left out: all of it where no capacity fits them.
    """
    records = [prepared.as_told for prepared in prepared_records]
    records = [_moved(prepared, prepared.start.soc, prepared.capacity_ah) for prepared in records]
    plain = replace(
        settings, folds=0, max_boxes=0, resistances_follow="none", half_hysteresis=False
    )
    # A slower pair than a correction of the OCV leaves imitates a capacity.
    ranges = box_of(records, plain)
    plain = replace(plain, ocv_correction=False)
    told, count = np.array([prepared.start.soc for prepared in records]), len(records)
    # What was called full when the OCV was identified.
    axis_sd = FULL_SD if records[0].cell.is_of_records else HELD_SD
    of_shape = np.full(len(OCV_NODES) - 1, SHAPE_SD_V / np.sqrt(len(OCV_NODES) - 1))
    shape = slice(-len(of_shape), None)
    own = [CAPACITY_SD, SHIFT_SD_V, axis_sd, *[OCV_SD_V] * len(OCV_NODES), *of_shape]
    prior = np.array([*map(_start_sd, records), *own])
    prior = np.full_like(prior, HELD_SD) if is_own else prior

    def objective_at(now: Nuisance, box: Mapping[str, Range]) -> TableObjective:
        share, ocv_v = float(np.exp(now[count])), now[count + 1 :]
        return reduced_objective(
            [
                _moved(prepared, start, share * prepared.capacity_ah, ocv_v)
                for prepared, start in zip(records, (told + now[:count]).tolist(), strict=True)
            ],
            plain,
            box,
        )

    with one_blas_thread():
        shares = (1.0,) if is_own else SHARES
        now = _first_guess(objective_at, ranges, shares, prior, count)
        if now is None:
            return {}
        objective = objective_at(now, ranges)
        best = find_best(objective)
        weights, found = _weights_at(objective, soc), None
        for _ in range(ROUNDS):
            rests = None if is_own else _rests(objective, now)
            found = estimate(objective, best, _columns, now, prior, weights, rests)
            step = np.clip(found.values - now, -LARGEST_STEP, LARGEST_STEP)
            now = now + step
            if not is_own:
                # Of the largest likelihood (MacKay 1992): so much of each step is told.
                told_parts = np.maximum(1 - (found.errors[shape] / prior[shape]) ** 2, 0.0)
                squares_v2 = np.sum(found.values[shape] ** 2) + of_shape[0] ** 2
                prior[shape] = np.sqrt(squares_v2 / (np.sum(told_parts) + 1))
            if np.max(np.abs(step)) < SETTLED:
                break
            lows, highs = np.log(np.array([*ranges.values()])).T
            scales = np.clip(np.array(best.log_scales) + found.moved_scales, lows, highs)
            try:
                objective = objective_at(now, held_at(objective, scales.tolist()))
            except InputError:
                return {}
            best = objective.solve(tuple(scales.tolist()), exact=True)
    assert found is not None, "there is a round"
    is_visited = bool(np.any(objective.visited @ weights[0, : objective.nodes]))
    every = dict(_told(found, records, told, is_visited))
    return {name: every[name] for name in (R0,) if name in every} if is_own else every


def _first_guess(
    objective_at: Any, ranges: Mapping[str, Range], shares: Sequence[float], like: Nuisance, at: int
) -> Nuisance | None:
    """The share of the capacity that fits best where all else is as told; None where none does."""
    tried = {name: (tau_s, tau_s) for name, tau_s in zip(ranges, TRIED_S, strict=True)}
    costs: dict[float, Nuisance] = {}
    for share in shares:
        now = np.zeros_like(like)
        now[at] = np.log(share)
        try:
            objective = objective_at(now, tried)
        except InputError:
            continue
        costs[objective.solve(tuple(np.log(TRIED_S).tolist())).objective_v2] = now
    return costs[min(costs)] if costs else None


def _moved(
    prepared: PreparedRecord, soc: float, capacity_ah: float, ocv_v: Nuisance | None = None
) -> PreparedRecord:
    """The record with another start, capacity and OCV."""
    found = replace(prepared, circuit=CIRCUIT).registered(soc, capacity_ah)
    found = replace(found, scored=found.scored & (found.soc >= EMPTY_SOC))
    if np.count_nonzero(found.scored) < FEWEST_SAMPLES:
        raise InputError(f"{prepared.record.name}: hardly a sample is above {EMPTY_SOC:.0%} SOC")
    if ocv_v is None:
        return found
    return replace(found, source_v=found.source_v + _ocv_columns(found, found.soc) @ ocv_v)


def _ocv_columns(
    prepared: PreparedRecord, soc: Float[np.ndarray, "samples"]
) -> Float[np.ndarray, "samples ocv"]:
    """The columns of the OCV's shift, of its axis, of its errors, and of steps of its shape."""
    steps = np.clip((OCV_NODES[1:] - soc[:, None]) / np.diff(OCV_NODES), 0.0, 1.0)
    return np.column_stack([np.ones_like(soc), _slope(prepared, soc), hats(soc, OCV_NODES), steps])


def _slope(
    prepared: PreparedRecord, soc: Float[np.ndarray, "samples"], step_soc: float = SLOPE_SOC
) -> Float[np.ndarray, "samples"]:
    """The slope of the OCV over such a step, beside its ends as there."""
    low, high = prepared.cell.soc_range
    inside = np.clip(soc, max(low, 0.0) + step_soc / 2, min(high, 1.0) - step_soc / 2)
    return slope_of(prepared, inside, step_soc)


def shows_empty(prepared_records: Sequence[PreparedRecord]) -> bool:
    """True where one of the records rests so near empty that this tells its capacity, however the
    OCV above has changed."""
    rests = (rest for prepared in prepared_records for rest in _steep_rests(prepared))
    return any(rested < NEAR_EMPTY_SOC for _, rested, _ in rests)


def _steep_rests(prepared: PreparedRecord) -> Iterator[tuple[int, float, float]]:
    """The last sample of every long rest where the OCV is so steep that it tells the SOC within
    `FULL_SD`, that SOC, and the slope."""
    resting = np.abs(prepared.current_a) < prepared.rest_current_a
    for first, last in zip(*runs(resting), strict=True):
        if prepared.time_s[last] - prepared.time_s[first] < MINIMUM_REST_S - CLOCK_SLACK_S:
            continue
        with suppress(InputError):
            rested = prepared.cell.soc_from_rest_voltage(float(prepared.voltage_v[last]))
            slope = float(_slope(prepared, np.array([rested]), REST_SLOPE_SOC)[0])
            if slope * FULL_SD >= REST_SD_V:
                yield int(last), rested, slope


def _rests(objective: TableObjective, now: Nuisance) -> Measured | None:
    """The voltages of steep rests, None where there are none. All is as at the SOC that the voltage
    tells: a wrong capacity may have led to where the OCV is flat."""
    count, rests = len(objective.prepared_records), []
    for place, prepared in enumerate(objective.prepared_records):
        for last, rested, slope in _steep_rests(prepared):
            soc, of_ocv = float(prepared.soc[last]), _ocv_columns(prepared, np.array([rested]))[0]
            columns = np.zeros(count + 1)
            columns[[place, count]] = slope, slope * (prepared.start.soc - soc)
            error_v = slope * (rested - soc) - of_ocv @ now[count + 1 :]
            # What is called empty differs as what is called full does.
            rests.append(([*columns, *of_ocv], error_v, np.hypot(REST_SD_V, FULL_SD * slope)))
    return Measured(*map(np.array, zip(*rests, strict=True))) if rests else None


def _start_sd(prepared: PreparedRecord) -> float:
    """The standard deviation of a start; one that a voltage told moves with a shift of the OCV."""
    return told_within(prepared, SHIFT_SD_V)[0]


def _columns(
    objective: TableObjective, found: Solution, place: int
) -> Float[np.ndarray, "samples nuisances"]:
    """The columns of every record's start, of the logarithm of their capacity, and of the OCV."""
    prepared = objective.prepared_records[place]
    soc = prepared.soc[prepared.scored]
    columns = of_starts(objective, place, _slope(prepared, soc))
    shared = columns[:, 1::2].sum(axis=1), _ocv_columns(prepared, soc)
    return np.column_stack([columns[:, 0::2], *shared])


def _weights_at(objective: TableObjective, soc: float) -> Float[np.ndarray, "two values"]:
    """Weights of the tables' values in R0, and in the sum of all resistances, at a SOC."""
    own = hats(np.array([soc]), objective.nodes_of[0])[0]
    return np.stack([np.append(own, np.zeros(objective.pairs * len(own))),
                     np.tile(own, 1 + objective.pairs)])  # fmt: skip


def _told(
    found: Estimated, records: Sequence[PreparedRecord], told: Nuisance, is_visited: bool
) -> Iterator[tuple[str, Aged]]:
    """The quantities that are determined, with intervals."""
    reach = float(ndtri((1 + CONFIDENCE) / 2))
    count = len(records)
    by_ocv = found.by_prior[:, count + 2 :]

    def around(place: int, value: float, error: float) -> Aged:
        own = tuple(by_ocv[place].tolist())
        return Aged(value, value - reach * error, value + reach * error, own)

    yield "start SOC", around(0, float(told[0] + found.values[0]), float(found.errors[0]))
    if reach * found.errors[count] < DETERMINED[CAPACITY]:
        share = around(count, float(found.values[count]), float(found.errors[count]))
        ends = np.array([share.value, share.low, share.high])
        value, low, high = (records[0].capacity_ah * np.exp(ends)).tolist()
        yield CAPACITY, Aged(value, low, high, tuple(value * own for own in share.by_ocv))
    yield SHIFT, around(count + 1, *(float(e[count + 1]) for e in (found.values, found.errors)))
    sums = zip((R0, R), found.sums.tolist(), found.sum_errors.tolist(), strict=True)
    for place, (name, value, error) in enumerate(sums, len(found.values)):
        if is_visited and 0 < reach * error < DETERMINED[name] * value:
            yield name, around(place, value, error)

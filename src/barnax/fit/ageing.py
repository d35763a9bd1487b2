"""Ageing from one record: capacity, resistances and OCV compared with an earlier state of the cell.

With U the cell's earlier OCV over its state of charge s, a record's voltage is

    v = U(s) + d + g(s) - R0(s) i - ...,    s = s0 - charge / C,

with the record's own capacity C, start s0 and shift d of the OCV, which includes a sensor's offset.
They are estimated together with all tables (`nuisances`), allowing for errors of U. There are
priors on s0 and d, and almost none on C. A capacity with too wide an interval is not determined.

As a cell ages, its OCV changes shape by g, because its electrodes lose lithium and material
unequally. Charges end at one voltage, so g is zero where the cell is full; below, it is a random
walk. Estimates are averaged over sizes of the walk, weighted by the probability of the record under
each; `life.rows` knows the sizes better, from the other cells of a fleet. Unless a record reaches
the empty end, a change of shape is mistaken for a change of capacity: of a 6.6 % loss of capacity
in PyBaMM, the earlier OCV stretched over the upper 70 % accounts for half. A record from full to a
rest near empty, where the OCV is steep, does determine the capacity.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.special import softmax

from ..cell.parameters import OHMIC
from ..cell.tables import hats
from ..execution import in_float64
from ..model.prepared import FEWEST_SAMPLES, PreparedRecord
from ..model.search_space import Range
from ..records.record import is_long, runs
from .nuisances import NuisanceEstimate, PseudoMeasurements, estimate, of_starts
from .objective import Solution, TableObjective
from .registration import FROM_VOLTAGE, FULL_SD, REACH, REST_SD_V, prior_sd
from .settings import TableSettings
from .table_problem import find_best, reduced_objective, search_ranges, solve_at

Nuisance = Float[np.ndarray, "nuisances"]
CIRCUIT = "so-rc"
# SOC at which resistances are reported.
AT_SOC = 0.5
CAPACITY, SHIFT, R0, R = "capacity [A.h]", "OCV shift [V]", OHMIC, "R [Ohm]"
AGED = (CAPACITY, "start SOC", SHIFT, R0, R)
# Prior standard deviations of a shift of the OCV, of the logarithm of a capacity, and of a start
# without any information.
SHIFT_SD_V, CAPACITY_SD, UNTOLD_SD = 0.02, 1.0, 1.0
# An OCV identified from records ripples between its nodes; a real cell's does not. Slopes over this
# step of SOC leave the ripple out: it would wrongly separate start and capacity from a shift.
SLOPE_SOC = 0.1
# Standard deviations of the earlier OCV at its nodes, and of a quantity that is held.
OCV_SD_V, OCV_NODES = 1.5e-3, np.linspace(0.0, 1.0, 21)
HELD_SD = 1e-7
# Standard deviations of a change of the OCV's shape over the whole SOC range, and their prior
# weights: as if one step of the walk had been observed at the usual size. Cells in PyBaMM that lost
# 1 to 17 % of their capacity have 5 to 48 mV. A change that looks like another capacity appears in
# no step, so without these weights the size is underestimated.
SHAPES_V, USUAL_SHAPE_V = np.geomspace(2e-3, 64e-3, 6), 0.025
SHAPE_ODDS = np.exp(-((USUAL_SHAPE_V / SHAPES_V) ** 2) / 2) / SHAPES_V
SHAPE_ODDS /= np.sum(SHAPE_ODDS)
# Below the first SOC circuits do not model the voltage and only rests count; a rest below the
# second determines the capacity of a record that was above the third. The last is the step of SOC
# over which a rest's slope is taken.
EMPTY_SOC, NEAR_EMPTY_SOC, NEAR_FULL_SOC, REST_SLOPE_SOC = 0.05, 0.15, 0.95, 0.01
# Shares of the capacity that are tried first, and time constants in s that serve for all of them.
SHARES, TRIED_S = (1.05, 0.98, 0.9, 0.82, 0.74, 0.66), (10.0, 100.0)
# The iteration ends when every step is below this share of its standard error; the distance left is
# a few times that. The largest step is in SOC, as a share, or in V.
SETTLED, LARGEST_STEP, ROUNDS = 0.05, 0.1, 16
# A value is not determined if its interval extends further than this share of it to either side.
DETERMINED = {CAPACITY: 0.05, R0: 0.25, R: 0.5}


@dataclass(frozen=True)
class AgeingEstimate:
    """One aged quantity with its 95 % interval. `by_ocv` is the error of the value if the earlier
    OCV is off by one standard deviation at one of its nodes: it is common to all records evaluated
    with one OCV. `by_shape` has value, standard error and `by_ocv` under each of `SHAPES_V`,
    `log_evidence` the log probability of the records under each. `is_settled` is False if the
    values were still moving when the rounds ended."""

    value: float
    low: float
    high: float
    by_ocv: tuple[float, ...]
    by_shape: tuple[tuple[float, ...], ...]
    log_evidence: tuple[float, ...]
    is_determined: bool
    is_settled: bool


def is_determined(name: str, value: Any, error: Any) -> Any:
    """True if an interval is narrow enough for its quantity."""
    is_narrow = name not in DETERMINED or REACH * error < DETERMINED[name] * value
    return (error > 0) & is_narrow


@in_float64
def measure_ageing(
    prepared_records: Sequence[PreparedRecord],
    settings: TableSettings,
    *,
    is_fitted: bool = False,
) -> dict[str, AgeingEstimate]:
    """Capacity, start, OCV shift, and R0 and the sum of all resistances at `AT_SOC` of the
    estimated capacity, by name.

    Args:
        prepared_records: Records of one cell at one age, with its earlier OCV.
        settings: The bounds and weights of tables.
        is_fitted: Whether the OCV was identified from these very records, which then determine only
            R0, on the given capacity.

    Quantities that the records do not determine are marked so, because other records may determine
    them; the result is empty if no capacity fits the records.
    """
    given_records = [prepared.unregistered for prepared in prepared_records]
    starts_sd = [*map(_start_sd, given_records)]
    starts = [(prepared.start.soc, prepared.capacity_ah) for prepared in given_records]
    records = _all_moved(given_records, starts)
    if records is None:
        return {}
    plain = replace(
        settings, folds=0, max_boxes=0, resistances_follow="none", half_hysteresis=False
    )
    # A pair slower than a correction of the OCV allows for imitates a capacity.
    ranges = search_ranges(records, plain)
    plain = replace(plain, ocv_correction=False)
    given_soc, count = np.array([prepared.start.soc for prepared in records]), len(records)
    # The SOC called full when the OCV was identified has this error.
    axis_sd = FULL_SD if records[0].cell.ocv_is_fitted else HELD_SD
    steps = len(OCV_NODES) - 1
    sds = [*starts_sd, CAPACITY_SD, SHIFT_SD_V, axis_sd, *[OCV_SD_V] * len(OCV_NODES)]
    priors = [np.array([*sds, *[shape_v / np.sqrt(steps)] * steps]) for shape_v in SHAPES_V]
    priors = [np.full_like(priors[0], HELD_SD)] if is_fitted else priors

    def moved_to(iterate: Nuisance) -> list[PreparedRecord] | None:
        share, starts = float(np.exp(iterate[count])), (given_soc + iterate[:count]).tolist()
        capacities_ah = [share * prepared.capacity_ah for prepared in records]
        return _all_moved(records, zip(starts, capacities_ah, strict=True), iterate[count + 1 :])

    shares = (1.0,) if is_fitted else SHARES
    guesses = [np.where(np.arange(len(priors[0])) == count, np.log(share), 0.0) for share in shares]
    best_guess = _best_guess(guesses, moved_to, plain, ranges)
    if best_guess is None:
        return {}
    iterate, moved = best_guess
    objective = reduced_objective(moved, plain, ranges)
    best = find_best(objective)
    # Weights of R0, and of the sum of all resistances.
    at_soc = hats(np.array([AT_SOC]), objective.nodes_of[0])[0]
    weights = np.stack([np.append(at_soc, np.zeros(objective.pairs * len(at_soc))),
                        np.tile(at_soc, 1 + objective.pairs)])  # fmt: skip
    estimates, averaged, is_settled = [], None, False
    for _ in range(ROUNDS):
        rests = None if is_fitted else _rests(objective.prepared_records, iterate)
        estimates = estimate(objective, best, _columns, iterate, priors, weights, rests)
        averaged = _averaged(estimates)
        step = np.clip(averaged.values[: iterate.size] - iterate, -LARGEST_STEP, LARGEST_STEP)
        iterate = iterate + step
        are_settled = np.abs(step) < SETTLED * averaged.errors[: iterate.size] + HELD_SD
        # Steps of the OCV's shape, which nothing measures, keep moving longest.
        is_settled = bool(np.all(are_settled[: count + 2]))
        if np.all(are_settled):
            break
        lows, highs = np.log(np.array([*ranges.values()])).T
        scales = np.clip(np.array(best.log_scales) + averaged.moved_scales, lows, highs)
        moved = moved_to(iterate)
        if moved is None:
            return {}
        at = tuple(scales.tolist())
        objective, best = solve_at(moved, plain, objective.ranges, at, exact=True)
    assert averaged is not None, "there is a round"
    is_visited = bool(np.any(objective.visited @ weights[0, : objective.nodes]))
    every = dict(_quantities(averaged, estimates, records, given_soc, is_visited, is_settled))
    return {name: every[name] for name in (R0,) if name in every} if is_fitted else every


def _averaged(under: Sequence[NuisanceEstimate]) -> NuisanceEstimate:
    """The estimates averaged over the sizes of the shape change, weighted by their
    probabilities."""
    evidence = np.array([each.log_evidence for each in under])
    evidence += np.log(SHAPE_ODDS[: len(under)])
    shares = softmax(evidence)
    names = ("values", "covariance", "moved_scales", "by_prior")
    stacked = {name: np.stack([getattr(each, name) for each in under]) for name in names}
    mean = {name: np.tensordot(shares, values, 1) for name, values in stacked.items()}
    off = stacked["values"] - mean["values"]
    mean["covariance"] += np.einsum("s,si,sj->ij", shares, off, off)
    return NuisanceEstimate(**mean, log_evidence=float(np.logaddexp.reduce(evidence)))


def _best_guess(
    guesses: Sequence[Nuisance],
    moved_to: Callable[[Nuisance], list[PreparedRecord] | None],
    settings: TableSettings,
    ranges: Mapping[str, Range],
) -> tuple[Nuisance, list[PreparedRecord]] | None:
    """The guess with the lowest cost on the samples that all guesses score, with its records; None
    if no guess is possible."""
    tried = ((guess, moved_to(guess)) for guess in guesses)
    moved = [(guess, records) for guess, records in tried if records is not None]
    if not moved:
        return None
    # The end of a window in SOC depends on the capacity.
    scored = []
    for alike in zip(*(records for _, records in moved), strict=True):
        end = min(len(record.scored) for record in alike)
        scored.append(np.all([record.scored[:end] for record in alike], axis=0))
    tried = tuple(np.log(TRIED_S).tolist())

    def cost_v2(records: Sequence[PreparedRecord]) -> float:
        alike = [
            replace(record, scored=np.pad(here, (0, len(record.scored) - len(here))))
            for record, here in zip(records, scored, strict=True)
        ]
        return solve_at(alike, settings, ranges, tried)[1].objective_v2

    return min(moved, key=lambda guess: cost_v2(guess[1]))


def _all_moved(
    records: Sequence[PreparedRecord],
    starts: Iterable[tuple[float, float]],
    ocv_v: Nuisance | None = None,
) -> list[PreparedRecord] | None:
    """The records with other starts, capacities and OCV; None if one of them is impossible or has
    too few samples where circuits apply."""
    moved = []
    for prepared, start in zip(records, starts, strict=True):
        shifted = replace(prepared, circuit=CIRCUIT).registered(*start)
        scored = None if shifted is None else shifted.scored & (shifted.soc >= EMPTY_SOC)
        if shifted is None or scored is None or np.count_nonzero(scored) < FEWEST_SAMPLES:
            return None
        added_v = 0.0 if ocv_v is None else _ocv_columns(shifted, shifted.soc) @ ocv_v
        moved.append(replace(shifted, scored=scored, source_v=shifted.source_v + added_v))
    return moved


def _ocv_columns(
    prepared: PreparedRecord, soc: Float[np.ndarray, "samples"]
) -> Float[np.ndarray, "samples ocv"]:
    """The columns of the OCV's shift, of its axis, of its errors, and of steps of its shape."""
    steps = np.clip((OCV_NODES[1:] - soc[:, None]) / np.diff(OCV_NODES), 0.0, 1.0)
    return np.column_stack([np.ones_like(soc), _slope(prepared, soc), hats(soc, OCV_NODES), steps])


def _slope(
    prepared: PreparedRecord, soc: Float[np.ndarray, "samples"], step_soc: float = SLOPE_SOC
) -> Float[np.ndarray, "samples"]:
    """The slope of the OCV over a step of SOC, held constant beyond its ends."""
    low, high = prepared.cell.soc_range
    inside = np.clip(soc, max(low, 0.0) + step_soc / 2, min(high, 1.0) - step_soc / 2)
    return prepared.cell.ocv_slope(inside, step_soc)


def shows_both_ends(prepared_records: Sequence[PreparedRecord], capacity_ah: float) -> bool:
    """True if a record is full, at the identified capacity, and rests so near empty that the rest
    determines the capacity however the OCV in between has changed."""
    return any(
        rested < NEAR_EMPTY_SOC
        and rested + np.max(prepared.soc - prepared.soc[last]) * prepared.capacity_ah / capacity_ah
        > NEAR_FULL_SOC
        for prepared in prepared_records
        for _, last, rested, _ in _steep_rests(prepared)
    )


def _steep_rests(prepared: PreparedRecord) -> Iterator[tuple[int, int, float, float]]:
    """The first and the last sample of every long rest where the OCV is steep enough to give the
    SOC within `FULL_SD`, that SOC, and the slope."""
    resting = np.abs(prepared.current_a) < prepared.rest_current_a
    for first, last in zip(*runs(resting), strict=True):
        rested = prepared.cell.soc_at_rest(float(prepared.voltage_v[last]))
        if rested is None or not is_long(float(prepared.time_s[last] - prepared.time_s[first])):
            continue
        slope = float(_slope(prepared, np.array([rested]), REST_SLOPE_SOC)[0])
        if slope * FULL_SD >= REST_SD_V:
            yield int(first), int(last), rested, slope


def _rests(prepared_records: Sequence[PreparedRecord], now: Nuisance) -> PseudoMeasurements | None:
    """The voltages of steep rests; None if there are none. They are linearized at the SOC given by
    the voltage: a wrong capacity may have led to where the OCV is flat."""
    count, columns, errors_v, slopes = len(prepared_records), [], [], []
    for index, prepared in enumerate(prepared_records):
        for _, last, rested, slope in _steep_rests(prepared):
            soc, of_ocv = float(prepared.soc[last]), _ocv_columns(prepared, np.array([rested]))[0]
            of_start = np.zeros(count + 1)
            of_start[[index, count]] = slope, slope * (prepared.start.soc - soc)
            columns.append([*of_start, *of_ocv])
            errors_v.append(slope * (rested - soc) - of_ocv @ now[count + 1 :])
            slopes.append((slope, 0.0) if rested < 0.5 else (0.0, slope))
    if not columns:
        return None
    # The SOC called empty varies as that called full does, equally for all rests near it.
    common = FULL_SD * np.array(slopes)
    root = np.linalg.cholesky(common @ common.T + REST_SD_V**2 * np.eye(len(columns)))
    return PseudoMeasurements(
        np.linalg.solve(root, np.array(columns)), np.linalg.solve(root, errors_v)
    )


def _start_sd(prepared: PreparedRecord) -> float:
    """The standard deviation of a start. One derived from a voltage moves with a shift of the OCV;
    one derived from a steep rest is left to that rest, which is fitted with all others."""
    first, row = prepared.first, prepared.start.row
    if prepared.start.soc_source in FROM_VOLTAGE and any(
        prepared.record.row[first + begun] <= row <= prepared.record.row[first + last]
        for begun, last, _, _ in _steep_rests(prepared)
    ):
        return UNTOLD_SD
    return prior_sd(prepared, SHIFT_SD_V)[0]


def _columns(
    objective: TableObjective, best: Solution, index: int
) -> Float[np.ndarray, "samples nuisances"]:
    """The columns of every record's start, of the logarithm of their capacity, and of the OCV."""
    prepared = objective.prepared_records[index]
    soc = prepared.soc[prepared.scored]
    columns = of_starts(objective, best, index, _slope(prepared, soc))
    shared = columns[:, 1::2].sum(axis=1), _ocv_columns(prepared, soc)
    return np.column_stack([columns[:, 0::2], *shared])


def _quantities(
    averaged: NuisanceEstimate,
    under: Sequence[NuisanceEstimate],
    records: Sequence[PreparedRecord],
    given_soc: Nuisance,
    is_visited: bool,
    is_settled: bool,
) -> Iterator[tuple[str, AgeingEstimate]]:
    """The quantities with intervals."""
    count, nominal_ah = len(records), records[0].capacity_ah
    rows = {"start SOC": 0, CAPACITY: count, SHIFT: count + 1}
    rows |= {R0: -2, R: -1} if is_visited else {}
    log_evidence = tuple(estimated.log_evidence for estimated in under)
    for name, row in rows.items():
        at_zero = given_soc[0] if name == "start SOC" else 0.0
        value, error, *by_ocv = _numbers(averaged, name, row, at_zero, nominal_ah)
        by_shape = tuple(_numbers(estimated, name, row, at_zero, nominal_ah) for estimated in under)
        common = by_shape, log_evidence, bool(is_determined(name, value, error)), is_settled
        ends = value - REACH * error, value + REACH * error
        yield name, AgeingEstimate(value, *ends, tuple(by_ocv), *common)


def _numbers(
    of: NuisanceEstimate, name: str, row: int, at_zero: float, nominal_ah: float
) -> tuple[float, ...]:
    """Value, standard error, and the error of the value due to the earlier OCV."""
    # The OCV's axis and its errors: changes of its shape belong to this age alone.
    steps = len(OCV_NODES) - 1
    by_ocv = of.by_prior[row, -steps - len(OCV_NODES) - 1 : -steps]
    value, numbers = at_zero + of.values[row], np.append(of.errors[row], by_ocv)
    if name == CAPACITY:
        value = nominal_ah * np.exp(value)
        numbers = numbers * value
    return (float(value), *numbers.tolist())

"""Starts and capacities of the records of one cell, estimated from all of them together.

The SOC that is called full differs by some tenths of a percent from one charge to the next, and so
does the charge that a coulomb counter counts. In the records of one cell this is most of the error
left near empty, where the OCV is steep. To first order the voltage is linear in a record's start
and capacity: dv = U'(s) (ds0 + (s0 - s) dC / C). They are fitted together with all tables, each
with a prior at its given value, and the record is prepared again.

A single record, whose rests are far from the OCV test, is registered on that test: on a flat OCV, 3
% of the charge, lost between two testers, is a voltage error of hundreds of mV near empty, which
tables would take for resistance and for an OCV that no other record has.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize
from scipy.special import ndtri

from ..cell import Dependence
from ..execution import in_float64
from ..metrics import CONFIDENCE
from ..model.descent import LogScales
from ..model.prepared import PreparedRecord
from ..notices import Notice
from ..records.log import in_means
from ..records.record import runs
from ..settings import Registration
from .cross_validation import held_out
from .current_offset import shared_offset
from .dependence import refine_dependence
from .folds import is_loaded
from .nuisances import estimate, of_starts
from .settings import TableSettings
from .table_problem import find_best, reduced_objective, search_ranges, solve_at

# Standard deviations of a start at a full charge, of the voltage at a rest, of a start derived from
# a rest at most, and of a capacity.
FULL_SD, REST_SD_V, MAX_SD, CAPACITY_SD = 0.004, 0.005, 0.05, 0.002
FROM_VOLTAGE = ("rested voltage", "rest elsewhere", "fitted")
# Standard errors from a value to either end of its interval.
REACH = float(ndtri((1 + CONFIDENCE) / 2))
# For a single record: the shortest rest and the least distance of its end from the OCV; the
# standard deviation of counted charge as a share of the capacity; the reach of the descent in
# standard deviations, its first steps in start and share, and its evaluations.
LEAST_REST_S, FAR_V = 240.0, 0.1
COUNTED_SD, FURTHEST, FIRST_STEPS, LOOKS = 0.03, 2.5, (-0.003, 0.005), 40
# Least reduction of sqrt(J), as a share, for another start of a single record.
LEAST_FALL = 0.1
# Fast records are registered on means over this.
MEANS_S = 1.0
# The tables change with each registration: it is repeated until nothing moves by more than this
# share of its standard error, at most this often.
SETTLED, ROUNDS = 0.2, 5


@in_float64
def register(
    prepared_records: Sequence[PreparedRecord],
    settings: TableSettings,
    rounds: int = ROUNDS,
    log_scales: LogScales | None = None,
) -> list[PreparedRecord]:
    """Several records of one cell with their starts and capacities registered, in their windows.

    Args:
        prepared_records: The records as given, with the cell's OCV.
        settings: Settings of the tables fitted to them, with a table of the OCV or its correction.
        rounds: Most rounds; the first gives nearly all of the result.
        log_scales: Logarithms of the time constants and gamma; None searches for the best.

    If the records would leave the SOC axis, they stay as given.
    """
    plain = replace(settings, folds=0, max_boxes=0)
    means = [
        averaged_to_seconds(prepared).with_dependence(prepared.dependence)
        for prepared in prepared_records
    ]
    records, moves = list(means), np.empty((0, 4))
    prior = np.array([prior_sd(prepared) for prepared in prepared_records])
    shifts, errors = np.zeros_like(prior), np.zeros_like(prior)
    # SOC is scaled so that the given values are right on average.
    shares = (prior**-2.0 / np.sum(prior**-2.0, axis=0))[:, :, None] * np.eye(2)
    to_axis = np.eye(prior.size) - np.tile(shares.reshape(-1, 2).T, (len(prior), 1))
    dependence = prepared_records[0].dependence
    if log_scales:
        objective, best = solve_at(records, plain, search_ranges(records, plain), log_scales)
    else:
        objective = reduced_objective(records, plain)
        best = find_best(objective)
    at_first = objective, best
    for number in range(rounds):
        if number:
            objective, best = solve_at(records, plain, objective.ranges, best.log_scales)
            dependence = dependence and refine_dependence(objective, best, dependence)[0]
        estimated = estimate(objective, best, of_starts, shifts.ravel(), [prior.ravel()])[0]
        moved = (to_axis @ estimated.values).reshape(shifts.shape)
        errors = np.sqrt(np.diag(to_axis @ estimated.covariance @ to_axis.T))
        errors = errors.reshape(shifts.shape)
        steps = np.abs(moved - shifts) / estimated.errors.reshape(shifts.shape)
        is_settled, shifts = np.all(steps <= SETTLED), moved
        moves = np.hstack([shifts, errors])
        moved_means = _all_moved(means, prepared_records, moves, dependence)
        if moved_means is None:
            return list(prepared_records)
        records = [prepared.with_dependence(dependence) for prepared in moved_means]
        if is_settled:
            break
    # The effect of straight lines between nodes, of resistances and of the OCV's correction, is
    # about the change when only every second node is used; it is limited to what the given values
    # leave open.
    nodes, ocv_nodes = plain.nodes, plain.nodes_of_ocv
    halved = [(_halved(nodes), ocv_nodes), (nodes, _halved(ocv_nodes))]
    for nodes, ocv_nodes in halved if rounds > 1 else []:
        coarser = replace(plain, nodes=nodes, ocv_nodes=ocv_nodes)
        solved = solve_at(records, coarser, objective.ranges, best.log_scales)
        estimated = estimate(*solved, of_starts, shifts.ravel(), [prior.ravel()])[0]
        apart = (to_axis @ estimated.values).reshape(shifts.shape) - shifts
        errors = np.minimum(np.hypot(errors, apart), np.maximum(errors, prior))
    moves = np.hstack([shifts, errors])
    offset = shared_offset(*at_first, prior, best.rms_v) or ()
    shared = dict(zip(("offset_a", "offset_error_a"), offset, strict=False))
    whole = _all_moved(prepared_records, prepared_records, moves, dependence, **shared)
    return whole or list(prepared_records)


def _halved(nodes: tuple[float, ...]) -> tuple[float, ...]:
    """Every second node, and both ends."""
    return tuple(dict.fromkeys((*nodes[::2], nodes[-1])))


def averaged_to_seconds(prepared: PreparedRecord) -> PreparedRecord:
    """A fast record in means over a second, for slow dynamics; other records unchanged."""
    means = in_means(prepared.record, MEANS_S)
    return prepared if means is prepared.record else prepared.in_window(prepared.window, means)


def _all_moved(
    prepared_records: Sequence[PreparedRecord],
    as_given: Sequence[PreparedRecord],
    moves: Float[np.ndarray, "records four"],
    follows: Dependence | None,
    **shared: float,
) -> list[PreparedRecord] | None:
    """The records with their starts and capacities moved from the given ones, each by its row of
    moves; None if one of them is impossible."""
    tried = [
        with_start(prepared, given, *move, follows=follows, **shared)
        for prepared, given, move in zip(prepared_records, as_given, moves.tolist(), strict=True)
    ]
    moved = [prepared for prepared in tried if prepared is not None]
    return moved if len(moved) == len(tried) else None


@in_float64
def register_on_ocv_test(prepared: PreparedRecord, settings: TableSettings) -> PreparedRecord:
    """A record with the start and capacity at which its tables fit best, with the OCV of its cell.

    It stays as given if its rests lie on the OCV, if tables fit it no better by a tenth, or if
    held-out blocks are predicted worse.

    Args:
        prepared: The record as given, with the OCV of a test.
        settings: Settings of the tables fitted to it.
    """
    rest = _far_rest(prepared)
    if rest is None:
        return prepared
    furthest = FURTHEST * np.array([prior_sd(prepared)[0], COUNTED_SD])
    plain = replace(settings, folds=0, max_boxes=0)

    def moved(shift: Float[np.ndarray, "two"], *errors: float) -> PreparedRecord | None:
        return with_start(
            prepared, prepared, *shift.tolist(), *(errors or (0.0, 0.0)), by="OCV test"
        )

    def objective_v2(shift: Float[np.ndarray, "two"]) -> float:
        record = moved(shift) if np.all(np.abs(shift) <= furthest) else None
        if record is None:
            return np.inf
        return solve_at([record], plain, objective.ranges, at)[1].objective_v2

    # From the rest alone; the time constants at the given start would be fitted to a wrong OCV.
    guess = np.array([0.0, rest.share])
    guessed = moved(guess)
    if guessed is None:
        return prepared
    objective = reduced_objective([prepared], plain)
    kept = find_best(objective)
    at = find_best(reduced_objective([guessed], plain)).log_scales
    simplex = guess + np.array([(0.0, 0.0), (FIRST_STEPS[0], 0.0), (0.0, FIRST_STEPS[1])])
    options = {"initial_simplex": simplex, "maxfev": LOOKS, "xatol": 1e-4, "fatol": 0.0}
    # Beyond the reach of the descent the objective is infinite, and infinities are subtracted.
    with np.errstate(invalid="ignore"):
        best = minimize(objective_v2, guess, method="Nelder-Mead", options=options)
    registered = moved(best.x)
    if registered is None or best.fun > (1 - LEAST_FALL) ** 2 * kept.objective_v2:
        return prepared
    names = objective.ranges
    before = held_out(*solve_at([prepared], settings, names, kept.log_scales))
    after = held_out(*solve_at([registered], settings, names, at))
    if before is not None and after is not None:
        one, other = after.errors, before.errors
        # Over all samples, or over those above 10 % SOC.
        if one.rmse_v > other.rmse_v or (one.above_v or 0.0) > (other.above_v or math.inf):
            return prepared
    prior = furthest / FURTHEST
    fitted = solve_at([registered], plain, names, at)
    errors = estimate(*fitted, of_starts, np.zeros(2), [prior])[0].errors
    return moved(best.x, *errors.tolist()) or registered


def with_common_capacity(
    given: Sequence[PreparedRecord], registered: Sequence[PreparedRecord]
) -> list[PreparedRecord]:
    """Records registered alone, and charges, whose rests contain no information, over the capacity
    that the OCV test gives for the registered ones: testers of one cell count some percent apart,
    and its records are mostly from one of them."""
    pairs = list(zip(given, registered, strict=True))
    shares = [after.capacity_ah / one.capacity_ah for one, after in pairs if after is not one]
    if not shares:
        return list(registered)

    share = float(np.mean(shares))

    def counted(prepared: PreparedRecord) -> PreparedRecord | None:
        if prepared.window.capacity_ah is not None or is_loaded(prepared):
            return prepared
        move = 0.0, share - 1, *prior_sd(prepared)
        moved = with_start(prepared, prepared, *move, by="OCV test")
        if moved is None:
            return None
        # The start is determined as before.
        registration, capacity_ah = moved.window.registration, share * prepared.capacity_ah
        window = replace(prepared.window, capacity_ah=capacity_ah, registration=registration)
        return prepared.in_window(window)

    tried = [counted(after) if after is one else after for one, after in pairs]
    moved = [prepared for prepared in tried if prepared is not None]
    return moved if len(moved) == len(tried) else list(given)


class _Rest(NamedTuple):
    """The last sample of a rest, the distance of its voltage from the OCV at the counted SOC, and
    the relative change of capacity that would put it there."""

    sample: int
    apart_v: float
    share: float


def rest_warnings(prepared: PreparedRecord) -> list[Notice]:
    """A warning if a rest lies far from the OCV: the capacity or the start may be wrong."""
    rest = _far_rest(prepared)
    if rest is None:
        return []
    values = {
        "apart_v": rest.apart_v,
        "soc": float(prepared.soc[rest.sample]),
        "capacity_ah": prepared.capacity_ah,
        "own_ah": prepared.capacity_ah * (1 + rest.share),
    }
    row = int(prepared.record.row[prepared.first + rest.sample])
    return [Notice("soc.rest-off-ocv", values, prepared.record.name, row)]


def _far_rest(prepared: PreparedRecord) -> _Rest | None:
    """The rest whose voltage is furthest from the OCV; None if none is far."""
    farthest: _Rest | None = None
    resting = np.abs(prepared.current_a) < prepared.rest_current_a
    for first, last in zip(*runs(resting), strict=True):
        gone_soc = prepared.start.soc - prepared.soc[last]
        is_long = prepared.time_s[last] - prepared.time_s[first] >= LEAST_REST_S
        if not is_long or not prepared.scored[last] or not gone_soc:
            continue
        voltage_v = float(prepared.voltage_v[last])
        # Between distant OCV points, any voltage between theirs is accepted.
        around_v = prepared.cell.ocv_around_v(float(prepared.soc[last]))
        apart_v = voltage_v - min(max(voltage_v, min(around_v)), max(around_v))
        if abs(apart_v) <= (abs(farthest.apart_v) if farthest else FAR_V):
            continue
        rested_soc = prepared.cell.soc_at_rest(voltage_v)
        if rested_soc is None:
            continue
        shown_soc = prepared.start.soc - rested_soc
        if shown_soc * gone_soc > 0:
            farthest = _Rest(int(last), apart_v, float(gone_soc / shown_soc - 1))
    return farthest


def prior_sd(prepared: PreparedRecord, level_v: float = 0.0) -> tuple[float, float]:
    """The standard deviations of a record's start in SOC and of its capacity, as a share, with an
    OCV whose level is known within `level_v`."""
    start_sd = FULL_SD
    if prepared.start.soc_source in FROM_VOLTAGE:
        slope = abs(float(prepared.cell.ocv_slope(np.array([prepared.start.soc]))[0]))
        start_sd = min(max(start_sd, (REST_SD_V + level_v) / max(slope, 1e-9)), MAX_SD)
    start_sd = min(float(np.hypot(start_sd, prepared.start.soc_sd)), MAX_SD)
    # A capacity that contradicts the cell's is uncertain by the difference.
    capacity_sd, is_given = CAPACITY_SD, prepared.window.capacity_ah is not None
    if not is_given:
        capacity_sd = max(capacity_sd, abs(prepared.capacity_ah / prepared.cell.capacity_ah - 1))
    return start_sd, capacity_sd


def with_start(
    prepared: PreparedRecord,
    given: PreparedRecord,
    soc_shift: float,
    share: float,
    soc_error: float,
    share_error: float,
    follows: Dependence | None = None,
    **by: Any,
) -> PreparedRecord | None:
    """The record with its start and capacity moved from the given ones, `by` as in `Registration`;
    None if it is impossible, or if more of it than before lies far beyond the OCV points."""
    soc, capacity_ah = given.start.soc, given.capacity_ah
    moved_soc, moved_ah = soc + soc_shift, capacity_ah * (1 + share)
    reach, reach_ah = REACH * soc_error, capacity_ah * REACH * share_error
    registration = Registration(
        given=prepared.window,
        given_soc=soc,
        given_capacity_ah=capacity_ah,
        given_source=prepared.start.soc_source,
        soc_low=moved_soc - reach,
        soc_high=moved_soc + reach,
        capacity_low_ah=moved_ah - reach_ah,
        capacity_high_ah=moved_ah + reach_ah,
        follows={} if follows is None else asdict(follows),
        **by,
    )
    moved = prepared.registered(moved_soc, moved_ah, registration=registration)
    if moved is None:
        return None
    is_beyond = any(notice.code == "soc.without-ocv" for notice in moved.warnings)
    # Fewer samples would fit better wherever the rest is.
    leaves = is_beyond and np.sum(moved.scored) < np.sum(prepared.scored)
    return None if leaves else moved

"""A voltage that is older or newer than the current of its row, by several samples or a part of
one.

If the voltage is n samples older than the current, and a load switches on a clock of its own a part
of a sample later, a step appears in two neighboring samples. With differences D between samples,

    D v_(k+n) = - sum over j = -1, 0, 1 of b_j D i_(k-j) - slow

for the n with the smallest residual, R0 = sum of b_j and the lag is n + (b_1 - b_-1) / R0 in
samples. The slow part consists of pairs with time constants of three samples or more and the OCV. A
pair faster than a sample looks like a part of one, and is then included in R0.
"""

import itertools
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import get_lapack_funcs

from ..blas import one_blas_thread
from ..errors import InputError
from ..metrics import NORMAL_95
from .record import Record

# Time constants in samples that represent the pairs, and the number of samples used.
_SLOW, _NEAR = (3.0, 10.0, 30.0, 100.0, 300.0), 3
# The largest number of whole samples tried. A lag is one if the remaining part of a sample is below
# the first share, and less than the second share of the squares without a lag is left.
_FAR, _NEAREST, _LEFT = 5, 0.6, 0.9
# If hardly anything remains at lag zero, there is none: half a period of delay looks like the
# opposite sign.
_NOTHING = 0.01
# The least lag in samples, and in standard errors over this many parts of the record.
_LEAST, _SURE, _PARTS = 0.1, 4.0, 24
# On its other side a step has less than this share of its effect on the near side.
_OTHER_SIDE = 0.25
# Number of intervals used to determine whole samples, and parts of a sample.
_ENOUGH, _MANY = 10_000, 30_000
# In slower logs, averages or a pair that ends within a sample are likelier than a part of a sample:
# a lag is then this close to whole samples.
_SLOWEST_S, _NEARLY = 1.5, 0.1
# The number of even intervals needed next to current steps of this share of the largest current.
_FEWEST, _LEAST_STEP, _EVEN = 200, 0.05, 0.1


Intervals = Float[np.ndarray, "intervals"]
Rows = Float[np.ndarray, "samples"]
Table = Float[np.ndarray, "samples changes"]
Voltages = Float[np.ndarray, "samples cells"]
Changes = tuple[Int[np.ndarray, "samples"], Table, Float[np.ndarray, "changes"]]


@dataclass(frozen=True)
class Lag:
    """The age of a voltage relative to the current in its row.

    Attributes:
        seconds: The lag; negative where the voltage is newer.
        samples: The same in samples.
        error: Its standard error in samples.
        ohm: What the voltage shows of a step of the current, at once but for the lag.
        is_certain: False where there may be none.
    """

    seconds: float
    samples: float
    error: float
    ohm: float
    is_certain: bool


def find_lag(record: Record) -> Lag | None:
    """The lag of a record's voltage; None without clear evidence of one."""
    whole = whole_lag(record.interval_s, record.current_a, record.voltage_v)
    lag = _fitted(record, record.voltage_v, whole)
    return lag if lag is not None and lag.is_certain else None


def _fitted(record: Record, voltage_v: Rows, whole: int) -> Lag | None:
    """The lag of a voltage that is about this many samples older than the record's current; None if
    there are too few steps."""
    moves = _changes(record.interval_s, record.current_a, _NEAR, _MANY)
    if moves is None or not np.ptp(voltage_v):
        return None
    rows, changes, scale = moves
    table = np.column_stack([changes, -np.diff(voltage_v)[rows + whole]])
    edges = np.linspace(0, len(table), _PARTS + 1).astype(int)
    parts = np.array([table[a:b].T @ table[a:b] for a, b in itertools.pairwise(edges)])
    products = parts.sum(axis=0)
    ohm, _ = _answers(products, scale)
    of_parts = np.array([_answers(products - part, scale)[0] for part in parts])
    error = float(np.sqrt((_PARTS - 1) * np.var(_share(of_parts.T))))
    samples, usual_s = float(whole + _share(ohm)), _usual_s(record.interval_s)
    first, at_once, last = ohm
    beside, other = (last, first) if samples > whole else (first, last)
    # With whole samples there may be no part of one.
    least_ohm = max(_OTHER_SIDE * beside, _LEAST * at_once if whole else 0.0)
    is_sure = max(_LEAST, _SURE * error) < abs(samples) < 1 + abs(whole) and ohm.sum() > 0
    is_part = usual_s > _SLOWEST_S and not (whole and abs(samples - whole) < _NEARLY)
    is_certain = bool(is_sure and not is_part and abs(other) <= least_ohm)
    return Lag(samples * usual_s, samples, error, float(ohm.sum()), is_certain)


@dataclass(frozen=True, eq=False)
class Scan:
    """Cells that were measured one after another.

    Attributes:
        lag_s: The lag of every cell's voltage.
        error_s: Its standard error.
        ohm: What every cell shows of a step of the current, at once but for the lag.
    """

    lag_s: Float[np.ndarray, "cells"]
    error_s: Float[np.ndarray, "cells"]
    ohm: Float[np.ndarray, "cells"]

    def aligned_v(self, record: Record, cells_v: Voltages) -> Voltages:
        """The voltages as if all had the mean lag; `record` is their mean, before any lag.

        Between rows everything is taken as linear, so a lag of x samples omits x D v of the voltage
        v, with D the step to the row. Of D v, the drop R0 D i is the cell's own, and the slow part
        that of the mean of the cells.
        """
        usual_s = _usual_s(record.interval_s)
        step_a = np.diff(record.current_a, prepend=record.current_a[:1])
        lagged_a = aligned(record, float(np.mean(self.lag_s))).current_a
        slow_v = np.diff(record.voltage_v, prepend=record.voltage_v[:1])
        slow_v += np.mean(self.ohm) * np.diff(lagged_a, prepend=lagged_a[:1])
        later = (self.lag_s - np.mean(self.lag_s)) / usual_s
        return cells_v + later * (slow_v[:, None] - self.ohm * step_a[:, None])

    def reach_ohm(self, record: Record) -> Float[np.ndarray, "cells"]:
        """Half the 95 % interval of each cell's immediate resistance due to the error of its lag
        alone."""
        step_a = np.diff(record.current_a)
        lagged_a = np.diff(aligned(record, float(np.mean(self.lag_s))).current_a)
        share = np.diff(step_a) @ lagged_a[1:] / (lagged_a @ lagged_a)
        return NORMAL_95 * np.abs(self.error_s / _usual_s(record.interval_s) * self.ohm * share)


def find_scan(record: Record, cells_v: Voltages) -> Scan | None:
    """The lags of cells relative to the current of a record without a lag; None if all have the
    same."""
    whole = whole_lag(record.interval_s, record.current_a, record.voltage_v)
    fits = [_fitted(record, voltage_v, whole) for voltage_v in cells_v.T]
    lags = [lag for lag in fits if lag is not None]
    if len(lags) < cells_v.shape[1] or not any(lag.is_certain for lag in lags):
        return None
    samples, error, ohm = np.array([(lag.samples, lag.error, lag.ohm) for lag in lags]).T
    if not np.ptp(samples) > max(_LEAST, 2 * _SURE * float(np.median(error))):
        return None
    usual_s = _usual_s(record.interval_s)
    return Scan(samples * usual_s, error * usual_s, ohm)


def whole_lag(interval_s: Intervals, current_a: Rows, voltage_v: Rows) -> int:
    """The number of whole samples by which a voltage is older than a current of either sign."""
    # The steps within reach of every lag that is tried.
    moves = _changes(interval_s, current_a, _NEAR + _FAR, _ENOUGH)
    if moves is None:
        return 0
    indices, changes, scale = moves
    moved_v, tried = np.diff(voltage_v), range(-_FAR, _FAR + 1)
    table = np.column_stack([changes, *(-moved_v[indices + late] for late in tried)])
    # On a busy machine threads wait for each other far longer than this takes.
    with one_blas_thread(), np.errstate(divide="ignore", invalid="ignore"):
        ohm, left = _answers(table.T @ table, scale)
        left = np.where(np.abs(_share(ohm)) < _NEAREST, left, 1.0)
    best = int(np.argmin(left))
    is_late = left[_FAR] > _NOTHING and left[best] < _LEFT * left[_FAR]
    return tried[best] if is_late else 0


def _changes(interval_s: Intervals, current_a: Rows, near: int, most: int) -> Changes | None:
    """At most this many intervals near current steps; D i and the slow part there as equally scaled
    columns, and the scale. None if too few are on an even clock."""
    usual_s, step_a = _usual_s(interval_s), np.diff(current_a)
    if len(step_a) < _FEWEST + 2 * _FAR:
        return None
    is_step = np.abs(step_a) > _LEAST_STEP * float(np.max(np.abs(current_a)))
    # The first steps suffice; a long record has more.
    end = int(np.append(0, np.flatnonzero(is_step)[:most])[-1]) + near + _FAR + 2
    is_step = is_step[:end]
    is_uneven = np.abs(interval_s[:end] - usual_s) >= _EVEN * usual_s
    # True where such an interval is near, except for as many at both ends.
    around = np.ones(2 * near + 1, int)
    steps, gaps = (np.convolve(flags, around, "valid") for flags in (is_step, is_uneven))
    indices = np.flatnonzero((steps > 0) & (gaps == 0)) + near
    indices = indices[(indices >= _FAR) & (indices < len(step_a) - _FAR)][:most]
    if len(indices) < _FEWEST:
        return None
    current_a = current_a[: indices[-1] + 2]
    columns = [step_a[indices - late] for late in (-1, 0, 1)]
    for samples in _SLOW:
        columns.append(np.diff(lagged(current_a - current_a[0], samples))[indices])
    table = np.column_stack([*columns, current_a[indices], np.ones(len(indices))])
    scale = np.sqrt(np.mean(table**2, axis=0))
    return (indices, table / scale, scale) if np.all(scale > 0) else None


def _usual_s(interval_s: Intervals) -> float:
    """The median of an evenly spaced subset."""
    return float(np.median(interval_s[:: 1 + len(interval_s) // _ENOUGH]))


def _share(ohm: Float[np.ndarray, "3 ..."]) -> Float[np.ndarray, "..."]:
    """The part of a sample by which responses are late."""
    return (ohm[2] - ohm[0]) / ohm.sum(axis=0)


def _answers(
    products: Float[np.ndarray, "columns columns"], scale: Float[np.ndarray, "changes"]
) -> tuple[Float[np.ndarray, "3 moves"], Float[np.ndarray, "moves"]]:
    """The responses b_j of the voltage's changes, the last columns, and the remaining share of
    squares."""
    count = len(scale)
    table, moves = products[:count, :count], products[:count, count:]
    answers = np.linalg.lstsq(table, moves, rcond=1e-12)[0]
    left = 1 - np.sum(answers * moves, axis=0) / np.diag(products)[count:]
    return (answers[:3] / scale[:3, None]).squeeze(), left


def aligned(record: Record, lag_s: float | None) -> Record:
    """The record with the current at the times of its voltage; with None, the lag is estimated.

    The current between rows is taken as linear, so its charge stays the same.

    Raises `InputError` for a lag that is not a number, or is longer than the record.
    """
    if lag_s is None:
        lag = find_lag(record)
        lag_s = 0.0 if lag is None else lag.seconds
    require_lag(record, lag_s)
    if lag_s == 0.0:
        return record
    time_s = record.time_s
    moved_a = np.interp(time_s - lag_s, time_s, record.current_a)
    return replace(record, current_a=moved_a, voltage_lag_s=lag_s)


def require_lag(record: Record, lag_s: float) -> None:
    """Raise `InputError` for a lag that is not a number, or is longer than the record."""
    if lag_s and not abs(lag_s) < record.time_s[-1] - record.time_s[0]:
        raise InputError(
            f"{record.name}: `voltage_lag` is {lag_s:g} s; give seconds by which the voltage is "
            "older than the current of its row, negative where it is newer, 0 for none"
        )


def lagged(
    values: Float[np.ndarray, "*rows samples"], tau: float, interval: Intervals | float = 1.0
) -> Float[np.ndarray, "*rows samples"]:
    """A first-order lag of values that are held from sample to sample, with a time constant in
    samples or in the unit of the intervals: y' = k y + (1 - k) x with k = exp(-interval / tau),
    from zero on.

    The same as SciPy's `lfilter`, whose import would take a quarter of a command's loading time.
    """
    kept = np.exp(-np.asarray(interval) / tau)
    bands = np.ones((2, values.shape[-1]))
    bands[1, :-1] = -kept
    (solve,) = get_lapack_funcs(("tbtrs",), (bands,))
    driven = np.zeros(values.shape)
    driven[..., 1:] = (1 - kept) * values[..., :-1]
    return solve(bands, driven.T, uplo="L")[0].T


# The response to a step is estimated over this many samples, at this many steps, which say as much
# as all of them.
_ANSWERS, _FEWEST_STEPS, _ENOUGH_STEPS = 5, 50, 15_000
# A pair's response in the next sample is at most this many times that in the sample after it,
# unless the pair ends within two samples. More than this share of the whole, by this many standard
# deviations, is late.
LASTING, _LATE_SHARE, LATE_SURE = 2.0, 0.03, 4.0
Answers = tuple[Float[np.ndarray, "answers"], Float[np.ndarray, "answers answers"]]


def answers_ohm(record: Record) -> Answers | None:
    """The responses of the voltage to a current step in the samples from it on, with their
    covariance; None if too few steps are on an even clock.

    By least squares on the differences between samples: the first is R0 with everything immediate,
    the others are the contributions of RC pairs, which decay with their time constants.
    """
    moved_a, usual_s = np.diff(record.current_a), record.usual_s
    least_a = _LEAST_STEP * float(np.max(np.abs(record.current_a)))
    steps = np.flatnonzero(np.abs(moved_a) > least_a)[:_ENOUGH_STEPS]
    is_after = np.zeros(len(moved_a) + _ANSWERS, bool)
    is_after[steps[:, None] + np.arange(_ANSWERS)] = True
    indices = np.flatnonzero(is_after[: len(moved_a)])
    indices = indices[indices >= _ANSWERS - 1]
    window = indices[:, None] - np.arange(_ANSWERS)
    is_even = np.all(np.abs(record.interval_s[window] - usual_s) < _EVEN * usual_s, axis=1)
    indices, window = indices[is_even], window[is_even]
    if len(indices) < _FEWEST_STEPS:
        return None
    # The current before the steps and a constant represent everything slow.
    before_a = record.current_a[window[:, -1]]
    design = np.column_stack([moved_a[window], before_a, np.ones(len(indices))])
    moved_v = np.diff(record.voltage_v)[indices]
    if np.linalg.matrix_rank(design) < design.shape[1]:
        return None
    inverse = np.linalg.inv(design.T @ design)
    answers = -inverse @ (design.T @ moved_v)
    error_v = moved_v + design @ answers
    variance_v2 = float(error_v @ error_v) / (len(moved_v) - len(answers))
    return answers[:_ANSWERS], variance_v2 * inverse[:_ANSWERS, :_ANSWERS]


def late_r0_ohm(step_answers: Answers | None) -> float | None:
    """The sum of the immediate response to a current step and that one sample later.

    None if nothing is late. The second response is late if it is far larger than the third one
    allows.
    """
    if step_answers is None:
        return None
    answers, covariance = step_answers
    late = np.zeros(len(answers))
    late[1:3] = 1, -LASTING
    ohm, whole = float(late @ answers), float(answers[0] + answers[1])
    error_ohm = np.sqrt(late @ covariance @ late)
    if not ohm > max(_LATE_SHARE * whole, LATE_SURE * error_ohm) or np.min(answers[:2]) <= 0:
        return None
    return whole

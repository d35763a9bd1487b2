"""A voltage that is older or newer than the current of its row, by some samples or part of one.

Where the voltage is n samples older than the current, and where a load changes on a clock of its
own by a part of one more, a step shows in two samples next to each other. With differences D
between samples,

    D v_(k+n) = - sum over j = -1, 0, 1 of b_j D i_(k-j) - slow

for the n that leaves the least, R0 = sum of b_j and the lag is n + (b_1 - b_-1) / R0 in samples.
What is slow are pairs with time constants from three samples on and the OCV. A pair faster than a
sample looks like a part of one, and R0 then holds it.
"""

import itertools
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import get_lapack_funcs

from ..blas import one_blas_thread
from ..errors import InputError
from .record import Record

# Time constants in samples that stand for the pairs, and how many samples are looked at.
_SLOW, _NEAR = (3.0, 10.0, 30.0, 100.0, 300.0), 3
# Up to so many whole samples are tried. Of those that are the nearest to the lag another than none
# leaves less than this share of what none does, or where that is not the nearest, of all.
_FAR, _NEAREST, _LEFT = 5, 0.6, 0.9
# Where none leaves hardly anything, it is none: half a period late looks like the other sign.
_NOTHING = 0.01
# The least lag in samples, and in standard errors over so many parts of the record.
_LEAST, _SURE, _PARTS = 0.1, 4.0, 24
# On its other side a step shows less than this share of what it shows beside itself.
_OTHER_SIDE = 0.25
# The whole samples of a lag are found by so many places, the parts of one by so many.
_ENOUGH, _MANY = 10_000, 30_000
# In slower logs averages, or a pair that is over within a sample, are likelier than part of one:
# a lag is so near to whole samples.
_SLOWEST_S, _NEARLY = 1.5, 0.1
# So many intervals beside steps of this share of the largest current are needed, of an even clock.
_FEWEST, _STEP_SHARE, _EVEN = 200, 0.05, 0.1


Intervals = Float[np.ndarray, "intervals"]
Rows = Float[np.ndarray, "samples"]
Table = Float[np.ndarray, "places changes"]


@dataclass(frozen=True)
class Lag:
    """The age of a voltage beside its row's current.

    Attributes:
        seconds: The lag; negative where the voltage is newer.
        samples: The same in samples.
        ohm: What the voltage shows of a step of the current, at once but for the lag.
    """

    seconds: float
    samples: float
    ohm: float


def find_lag(record: Record) -> Lag | None:
    """The lag of a record's voltage, None where it shows none for certain."""
    usual_s = _usual_s(record.interval_s)
    known = _changes(record.interval_s, record.current_a, _NEAR, _MANY)
    if known is None or not np.ptp(record.voltage_v):
        return None
    places, changes, scale = known
    whole = whole_lag(record.interval_s, record.current_a, record.voltage_v)
    table = np.column_stack([changes, -np.diff(record.voltage_v)[places + whole]])
    edges = np.linspace(0, len(table), _PARTS + 1).astype(int)
    parts = np.array([table[a:b].T @ table[a:b] for a, b in itertools.pairwise(edges)])
    products = parts.sum(axis=0)
    ohm, _ = _answers(products, scale)
    first, at_once, last = ohm
    of_parts = np.array([_answers(products - part, scale)[0] for part in parts])
    samples, error = whole + _share(ohm), np.sqrt((_PARTS - 1) * np.var(_share(of_parts.T)))
    beside, other = (last, first) if samples > whole else (first, last)
    # Beside whole samples there may be no part of one.
    least_ohm = max(_OTHER_SIDE * beside, _LEAST * at_once if whole else 0.0)
    is_sure = max(_LEAST, _SURE * error) < abs(samples) < 1 + abs(whole) and ohm.sum() > 0
    is_part = usual_s > _SLOWEST_S and not (whole and abs(samples - whole) < _NEARLY)
    if not is_sure or is_part or abs(other) > least_ohm:
        return None
    return Lag(float(samples * usual_s), float(samples), float(ohm.sum()))


def whole_lag(interval_s: Intervals, current_a: Rows, voltage_v: Rows) -> int:
    """The whole samples by which a voltage is older than a current, whose sign may be either."""
    # The steps are within reach of all that is tried.
    known = _changes(interval_s, current_a, _NEAR + _FAR, _ENOUGH)
    if known is None:
        return 0
    places, changes, scale = known
    moved_v, tried = np.diff(voltage_v), range(-_FAR, _FAR + 1)
    table = np.column_stack([changes, *(-moved_v[places + late] for late in tried)])
    # On a busy machine threads wait for each other far longer than this takes.
    with one_blas_thread(), np.errstate(divide="ignore", invalid="ignore"):
        ohm, left = _answers(table.T @ table, scale)
        left = np.where(np.abs(_share(ohm)) < _NEAREST, left, 1.0)
    best = int(np.argmin(left))
    is_late = left[_FAR] > _NOTHING and left[best] < _LEFT * left[_FAR]
    return tried[best] if is_late else 0


def _changes(
    interval_s: Intervals, current_a: Rows, near: int, most: int
) -> tuple[Int[np.ndarray, "places"], Table, Float[np.ndarray, "changes"]] | None:
    """Intervals so near to steps of the current, at most so many, D i and what is slow there as
    columns of one scale, and that scale; None where too few are on an even clock."""
    usual_s, step_a = _usual_s(interval_s), np.diff(current_a)
    if len(step_a) < _FEWEST + 2 * _FAR:
        return None
    is_step = np.abs(step_a) > _STEP_SHARE * float(np.max(np.abs(current_a)))
    # The first steps are enough, and a long record has more.
    end = int(np.append(0, np.flatnonzero(is_step)[:most])[-1]) + near + _FAR + 2
    is_step = is_step[:end]
    is_uneven = np.abs(interval_s[:end] - usual_s) >= _EVEN * usual_s
    places = np.flatnonzero(_any_near(is_step, near) & ~_any_near(is_uneven, near)) + near
    places = places[(places >= _FAR) & (places < len(step_a) - _FAR)][:most]
    if len(places) < _FEWEST:
        return None
    current_a = current_a[: places[-1] + 2]
    columns = [step_a[places - late] for late in (-1, 0, 1)]
    for samples in _SLOW:
        kept = np.exp(-1 / samples)
        answer = lagged(current_a - current_a[0], kept)
        columns.append(np.diff(answer)[places])
    table = np.column_stack([*columns, current_a[places], np.ones(len(places))])
    scale = np.sqrt(np.mean(table**2, axis=0))
    return (places, table / scale, scale) if np.all(scale > 0) else None


def _usual_s(interval_s: Intervals) -> float:
    """The median, of an even share of many."""
    return float(np.median(interval_s[:: 1 + len(interval_s) // _ENOUGH]))


def _any_near(flags: Bool[np.ndarray, "intervals"], near: int) -> Bool[np.ndarray, "fewer"]:
    """True where any so near is, but for as many at both ends."""
    inner = max(len(flags) - 2 * near, 0)
    found = flags[:inner].copy()
    for first in range(1, 2 * near + 1):
        found |= flags[first : first + inner]
    return found


def _share(ohm: Float[np.ndarray, "3 ..."]) -> Float[np.ndarray, "..."]:
    """The part of a sample by which answers are late."""
    return (ohm[2] - ohm[0]) / ohm.sum(axis=0)


def _answers(
    products: Float[np.ndarray, "columns columns"], scale: Float[np.ndarray, "changes"]
) -> tuple[Float[np.ndarray, "3 moves"], Float[np.ndarray, "moves"]]:
    """Answers b_j of the voltage's moves, the last columns, and the share of squares left."""
    count = len(scale)
    table, moves = products[:count, :count], products[:count, count:]
    found = np.linalg.lstsq(table, moves, rcond=1e-12)[0]
    left = 1 - np.sum(found * moves, axis=0) / np.diag(products)[count:]
    return (found[:3] / scale[:3, None]).squeeze(), left


def aligned(record: Record, lag_s: float | None) -> Record:
    """The record with the current of the moments of its voltage; None finds how much older that is.

    The current between rows is taken for linear, so that its charge stays the same.

    Raises `InputError` for a lag that is no number, or is longer than the record.
    """
    if lag_s is None:
        found = find_lag(record)
        lag_s = 0.0 if found is None else found.seconds
    require_lag(record, lag_s)
    if lag_s == 0.0:
        return record
    time_s = record.time_s
    moved_a = np.interp(time_s - lag_s, time_s, record.current_a)
    return replace(record, current_a=moved_a, voltage_lag_s=lag_s)


def require_lag(record: Record, lag_s: float) -> None:
    """Raise `InputError` for a lag that is no number, or is longer than the record."""
    if lag_s and not abs(lag_s) < record.time_s[-1] - record.time_s[0]:
        raise InputError(
            f"{record.name}: `voltage_lag` is {lag_s:g} s; give seconds by which the voltage is "
            "older than the current of its row, negative where it is newer, 0 for none"
        )


def lagged(values: Float[np.ndarray, "samples"], kept: float) -> Float[np.ndarray, "samples"]:
    """A first-order lag behind the values, of which it keeps a share from sample to sample:
    y' = kept y + (1 - kept) x, from zero on.

    SciPy's `lfilter` is that too, but a quarter of what a command loads comes with it.
    """
    bands = np.tile([1.0, -kept], (len(values), 1)).T
    (solve,) = get_lapack_funcs(("tbtrs",), (bands,))
    return solve(bands, np.append(0.0, (1 - kept) * values[:-1]), uplo="L")[0]

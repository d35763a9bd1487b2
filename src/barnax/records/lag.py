"""A voltage that is older or newer than the current of its row, by part of a sample.

Where a load changes on a clock of its own, a voltage that is taken d earlier than the current shows
a share of every step only in the next sample, one that is taken later shows it a sample before the
current does. With differences D between samples,

    D v_k = - sum over j = -1, 0, 1 of b_j D i_(k-j) - slow

and R0 = sum of b_j, d = (b_1 - b_-1) / R0 in samples. What is slow are pairs with time constants
from three samples on and the OCV. A pair faster than a sample looks alike, and R0 then holds it.
"""

import itertools
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.signal import lfilter

from ..errors import InputError
from .record import Record

# Time constants in samples that stand for the pairs, and how many samples are looked at.
_SLOW, _NEAR = (3.0, 10.0, 30.0, 100.0, 300.0), 3
# The least lag in samples, and in standard errors over so many parts of the record.
_LEAST, _SURE, _PARTS = 0.1, 4.0, 24
# On its other side a step shows less than this share of what it shows beside itself.
_OTHER_SIDE = 0.25
# In slower logs a pair that is over within a sample is likelier than a lag.
_SLOWEST_S = 1.5
# So many intervals beside steps of this share of the largest current are needed, of an even clock.
_FEWEST, _STEP_SHARE, _EVEN = 200, 0.05, 0.1


@dataclass(frozen=True)
class Lag:
    """The age of a voltage beside its row's current, and what it shows of R0 at each sample.

    Attributes:
        seconds: The lag; negative where the voltage is newer.
        share: The same in samples.
        at_once_ohm: What a step of the current shows in its own sample.
        beside_ohm: What it shows in the next one, or where the voltage is newer in the one before.
    """

    seconds: float
    share: float
    at_once_ohm: float
    beside_ohm: float


def find_lag(record: Record) -> Lag | None:
    """The lag of a record's voltage, None where it shows none for certain."""
    interval_s, step_a = record.interval_s, np.diff(record.current_a)
    usual_s = float(np.median(interval_s))
    if usual_s > _SLOWEST_S or len(step_a) < _FEWEST + 2 * _NEAR:
        return None
    near = np.lib.stride_tricks.sliding_window_view
    is_even = np.all(np.abs(near(interval_s, 2 * _NEAR + 1) - usual_s) < _EVEN * usual_s, axis=1)
    least_a = _STEP_SHARE * float(np.max(np.abs(record.current_a)))
    is_beside = np.any(np.abs(near(step_a, 2 * _NEAR + 1)) > least_a, axis=1)
    places = np.flatnonzero(is_even & is_beside) + _NEAR
    if len(places) < _FEWEST:
        return None
    columns = [step_a[places - late] for late in (-1, 0, 1)]
    for samples in _SLOW:
        kept = np.exp(-1 / samples)
        answer = lfilter([0.0, 1 - kept], [1.0, -kept], record.current_a - record.current_a[0])
        columns.append(np.diff(answer)[places])
    columns += [record.current_a[places], np.ones(len(places))]
    columns.append(-np.diff(record.voltage_v)[places])
    table = np.column_stack(columns)
    table /= np.maximum(np.sqrt(np.mean(table**2, axis=0)), np.finfo(float).tiny)
    edges = np.linspace(0, len(table), _PARTS + 1).astype(int)
    parts = np.array([table[a:b].T @ table[a:b] for a, b in itertools.pairwise(edges)])
    whole = parts.sum(axis=0)
    scale = np.sqrt(np.mean(np.square(columns), axis=1))
    if not np.all(scale > 0):
        return None
    ohm = _answers(whole) * scale[-1] / scale[:3]
    total = float(ohm.sum())
    ends = np.array([_answers(whole - part) / scale[:3] for part in parts])
    shares = (ends[:, 2] - ends[:, 0]) / ends.sum(axis=1)
    error = np.sqrt((_PARTS - 1) * np.var(shares))
    share = float((ohm[2] - ohm[0]) / total)
    beside, other = (ohm[2], ohm[0]) if share > 0 else (ohm[0], ohm[2])
    is_sure = max(_LEAST, _SURE * error) < abs(share) < 1 and total > 0
    if not is_sure or abs(other) > _OTHER_SIDE * beside:
        return None
    return Lag(share * usual_s, share, float(ohm[1]), float(beside))


def _answers(products: Float[np.ndarray, "columns columns"]) -> Float[np.ndarray, "3"]:
    """Answers to steps of the current one sample before, at once and one sample after."""
    return np.linalg.lstsq(products[:-1, :-1], products[:-1, -1], rcond=1e-12)[0][:3]


def aligned(record: Record, lag_s: float | None) -> Record:
    """The record with the current of the moments of its voltage; None finds how much older that is.

    The current between rows is taken for linear, so that its charge stays the same.

    Raises `InputError` for a lag that is no number, or is longer than the record.
    """
    if lag_s is None:
        found = find_lag(record)
        lag_s = 0.0 if found is None else found.seconds
    if lag_s == 0.0:
        return record
    time_s = record.time_s
    if not abs(lag_s) < time_s[-1] - time_s[0]:
        raise InputError(
            f"{record.name}: `voltage_lag` is {lag_s:g} s; give seconds by which the voltage is "
            "older than the current of its row, negative where it is newer, 0 for none"
        )
    moved_a = np.interp(time_s - lag_s, time_s, record.current_a)
    return replace(record, current_a=moved_a, voltage_lag_s=lag_s)

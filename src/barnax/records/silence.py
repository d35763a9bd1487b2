"""Loggers that write no current, or no rows, while no current flows.

The voltage shows whether that is the reason for a gap. When a load is switched off, the voltage
steps by R times the current. Through a gap in which the load continues, E = v + R i falls by the
charge times the slope of E; through a rest it relaxes in the other direction.
"""

import numpy as np
from jaxtyping import Float, Int

from .quantities import NEEDED
from .record import STEP_SHARE, Record, step_resistance_ohm
from .table import Lines

# An interval is a gap if it is this much longer than the usual ones on both of its sides.
_GAP, _BESIDE = 3.0, 7
# Such intervals are gaps only if they are more than this share of all intervals with a length
# within this factor.
_ALIKE, _FEW_ALIKE = 0.02, 0.05
# A logger that writes nothing at rest has less than this share of the gaps' time in rows with less
# than this share of the largest current.
_WRITTEN, _NO_CURRENT = 0.2, 1e-3
# The response to the current of the last minute has not relaxed yet; it does so in about this time,
# by this share of R times the current, with this uncertainty.
_LATELY_S, _RELAXING, _USUAL_DROP = 60.0, 0.5, 0.01
# E is known within this value and this share of R times the difference of the currents, its fall
# under load within this share; its slope is that of this many rows before a gap.
_WITHIN_V, _WITHIN_SHARE, _FALL_SHARE, _ROWS = 2e-3, 0.1, 0.4, 2000
# The loads on either side of a gap are equal if they differ by less than this share; if this share
# of them is, gaps say nothing about each other.
_STEADY, _STEADY_SHARE = 0.05, 0.5
# Log-likelihoods: no gap contributes more than this to the total, which has to reach as much.
_MOST = 4.0
# Of the steps where a current ends or begins to be written, this share has to be of a load.
_AGREEING, _NEAR, _FEWEST = 0.8, 0.5, 2


def flowing_shares(record: Record) -> Float[np.ndarray, "intervals"] | None:
    """The share of each interval in which its current flowed: for gaps that are rests, no more than
    a usual interval's. None without such gaps.

    Gaps are rests if the course of E is more likely than with the load before them or a usual load.
    """
    interval_s, current_a, held_a = record.interval_s, record.current_a, record.interval_current_a
    usual_s, peak_a = record.usual_s, float(np.max(np.abs(current_a)))
    either_a = np.minimum(np.abs(current_a[:-1]), np.abs(current_a[1:]))
    shown_a = either_a if record.hold.value == "centered" else np.abs(held_a)
    is_written = shown_a < _NO_CURRENT * peak_a
    gaps = gaps_in(interval_s)
    gaps = gaps[~is_written[gaps] & (interval_s[gaps] > usual_s)]
    if not len(gaps):
        return None
    is_silent = np.sum(interval_s[is_written]) < _WRITTEN * np.sum(interval_s[gaps])
    # Without current steps, R is a typical one, and E follows the voltage.
    ohm = record.resistance_ohm or _USUAL_DROP * np.median(record.voltage_v) / peak_a
    gap_s = interval_s[gaps]
    shown_s = interval_s.copy()
    shown_s[gaps] = usual_s
    amounts = held_a * shown_s / 3600, shown_s
    out_ah, clock_s = (np.append(0.0, np.cumsum(amount)) for amount in amounts)
    first = np.searchsorted(clock_s, clock_s[gaps] - _LATELY_S)
    passed_s = np.maximum(clock_s[gaps] - clock_s[first], usual_s)
    lately_a = 3600 * (out_ah[gaps] - out_ah[first]) / passed_s
    source_v = record.voltage_v + ohm * current_a
    before = [slice(max(gap - _ROWS, 0), gap + 1) for gap in gaps.tolist()]
    falls = np.array([_fall(out_ah[rows], source_v[rows]) for rows in before])
    error_v = _WITHIN_V + _WITHIN_SHARE * ohm * np.abs(np.diff(current_a)[gaps])

    def likelihood(flowing_a: Float[np.ndarray, "gaps"] | float) -> Float[np.ndarray, "gaps"]:
        """The log-likelihood of the course of E if this current flows through the gaps."""
        relaxing_v = _RELAXING * ohm * (lately_a - flowing_a) * -np.expm1(-gap_s / _LATELY_S)
        fall_v = falls * flowing_a * gap_s / 3600
        variance = error_v**2 + relaxing_v**2 + (_FALL_SHARE * fall_v) ** 2
        apart_v = np.diff(source_v)[gaps] - relaxing_v + fall_v
        return -np.log(variance) / 2 - 2 * np.log1p(apart_v**2 / variance / 3)

    usual_a = 3600 * out_ah[-1] / clock_s[-1]
    evidence = likelihood(0.0) - np.maximum(likelihood(held_a[gaps]), likelihood(usual_a))
    # A logger that writes changes only has gaps between rows with equal current, under a steady
    # load.
    is_steady = np.abs(np.diff(current_a)[gaps]) < _STEADY * np.abs(current_a[gaps])
    is_silent &= np.mean(is_steady) < _STEADY_SHARE
    # For a logger that does write rests, a gap is an exception, such as a clock that was set.
    is_conclusive = is_silent and np.sum(np.clip(evidence, -_MOST, _MOST)) >= _MOST
    rests = gaps[evidence > -_MOST] if is_conclusive else gaps[evidence >= _MOST]
    shares = np.ones(len(interval_s))
    shares[rests] = usual_s / interval_s[rests]
    return shares if len(rests) else None


def gaps_in(interval_s: Float[np.ndarray, "intervals"]) -> Int[np.ndarray, "gaps"]:
    """The intervals far longer than the usual ones before and after them."""
    # Only intervals that are long compared to the shortest in a hundred are candidates.
    likely = np.flatnonzero(interval_s > _GAP * np.quantile(interval_s, 0.01))
    padded = np.concatenate([np.full(_BESIDE, np.nan), interval_s, np.full(_BESIDE, np.nan)])
    near = likely[:, None] + np.arange(_BESIDE)
    before, after = padded[near], padded[near + _BESIDE + 1]
    # An interval at either end has neighbors on one side only.
    before[likely == 0] = -np.inf
    after[likely == len(interval_s) - 1] = -np.inf
    usual_s = np.maximum(np.nanmedian(before, axis=1), np.nanmedian(after, axis=1))
    gaps = likely[interval_s[likely] > _GAP * usual_s]
    # An interval of a length that is common elsewhere is part of the tester's sampling.
    gap_s = interval_s[gaps]
    among_gaps, among_all = (
        np.searchsorted(sorted_s, gap_s * (1 + _ALIKE), "right")
        - np.searchsorted(sorted_s, gap_s * (1 - _ALIKE))
        for sorted_s in (np.sort(gap_s), np.sort(interval_s))
    )
    return gaps[among_gaps > _FEW_ALIKE * among_all]


def _fall(out_ah: Float[np.ndarray, "rows"], source_v: Float[np.ndarray, "rows"]) -> float:
    """The fall of E per ampere-hour, in V."""
    apart_ah = out_ah - np.mean(out_ah)
    spread = float(apart_ah @ apart_ah)
    return max(-float(apart_ah @ source_v) / spread, 0.0) if spread else 0.0


@np.errstate(all="ignore")  # Absurd values overflow before they are detected.
def examine_empty_current(lines: Lines) -> Lines:
    """The lines with a current of zero where none is written, if the voltage steps there as it does
    where a written current shows that the load is off."""
    if not lines.columns.keys() >= NEEDED:
        return lines
    column = lines.table.columns[lines.columns["current"].index]
    nothing = column.is_null()
    if column.dtype.is_float():
        nothing = nothing | column.is_nan().fill_null(True)
    empty = nothing.to_numpy()[lines.at] & ~lines.bad("time") & ~lines.bad("voltage")
    if not np.any(empty):
        return lines
    current = np.where(empty, 0.0, lines.values["current"])
    step, step_v = np.diff(current), np.diff(lines.values["voltage"])
    is_step = np.abs(step) > STEP_SHARE * np.max(np.abs(current))
    ends = is_step & (empty[1:] != empty[:-1])
    is_logged = is_step & ~empty[1:] & ~empty[:-1]
    ohm = step_resistance_ohm(step[is_logged], step_v[is_logged])
    if not ohm or np.count_nonzero(ends) < _FEWEST:
        return lines
    rising = np.sign(np.sum(step[is_logged] * step_v[is_logged]))
    agreeing = np.abs(rising * step_v[ends] / (ohm * step[ends]) - 1) < _NEAR
    if np.mean(agreeing) < _AGREEING:
        return lines
    given = {"column": lines.header("current"), "rows": np.count_nonzero(empty)}
    return lines.telling(empty, "cells.empty-current", **given).having(current=current)

"""The evidence of a record about its scale: numbers that other units multiply, and their possible
range."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from .cell_values import FINEST_S, epoch_unit, is_clock, is_usual, numbers
from .counters import gain_ah
from .quantities import Unit
from .samples import COUNTERS, STEADY_SHARE, Samples, few

CHARGE = "charge"
# A reading is certain from this weight on.
CERTAIN = 1.5


@dataclass(frozen=True)
class UnitReading:
    """Columns in another unit: the factor of their values, the unit in words, and the evidence.

    Without a `unit` they were converted twice. `weight` is that of the witnesses that the reading
    reconciles, less those that it contradicts.
    """

    quantity: str
    names: tuple[str, ...]
    unit: Unit | None
    factor: float
    words: str = ""
    weight: float = 0.0
    reasons: tuple[str, ...] = ()

    def option(self, samples: Samples) -> str:
        """The columns with the unit, as `columns` takes them."""
        unit = f":{self.unit.symbol}" if self.unit else ""
        return ",".join(f"{name}={samples.header(name)}{unit}" for name in self.names)


@dataclass(frozen=True)
class Witness:
    """A number, the power of each quantity's factor in it, and its possible range.

    `says` is the evidence against the units with which it was computed. Together with a current in
    another unit, a column without a unit may be in a fraction of its own: `follows` is the factor
    of that.
    """

    value: float
    powers: Mapping[str, int]
    holds: Callable[[float], bool]
    says: str
    weight: float = 1.0
    follows: float = 1.0

    def vote(self, reading: UnitReading) -> float:
        """The vote for a reading: its weight if only the reading agrees, the negative weight if
        only the present units do."""
        value = self.value * reading.factor ** self.powers.get(reading.quantity, 0)
        is_agreed, is_agreed_too = self.holds(value), self.holds(self.follows * value)
        if self.holds(self.value):
            return 0.0 if is_agreed or is_agreed_too else -self.weight
        is_agreed_too &= reading.quantity == "current" and reading.factor >= 1
        return self.weight if is_agreed or is_agreed_too else 0.0


# No record is longer, and without a unit no samples are further apart.
_LONGEST_S, _FAR_S = 1e8, 500.0
# Bulk times that are too short for any cell, at a steep end of the curve and elsewhere, and one too
# long for a record that is sampled so slowly.
_STEEP_S, _SHORT_S, _BULK_S, _SLOW_S = 0.5, 40.0, 1e4, 50.0
# The voltage has to move for this, and by more than at a steep end.
_TRAVEL_V, _STEEP_BELOW_V = 0.3, 3.0
# A load has this many steps; a sweep has fewer. An interval this many times the usual one is a gap
# that may hide a load, because a rest does not move the voltage this far between two samples.
_MANY_STEPS, _FAR_LONGER, _LOAD_V = 10, 30, 0.02
# Between these intervals, numbers that no tester is set to are equally plausible.
_FINE_S, _COARSE_S = 0.2, 90.0
# Testers are set to no other interval this fast, and no load steps this often.
_FAST_S, _STEPS_HZ = 0.05, 15.0
# Charge relative to the given capacity that favors a factor of a thousand in either direction.
_TOO_MUCH, _TOO_LITTLE = 20.0, 0.01
# The largest cells have little over 1000 Ah; 500 A is the load of a large one, and a 2 Ah cell at
# 1C reads 2000 in milliamperes. A slow sweep of a small cell shows by its ampere-hours instead: 2
# Ah read as 2000.
_LOADED_A, _SWING_AH = 500.0, 1500.0
# Far below any tester's resolution; squares of much less underflow.
LEAST_A = 1e-12
# No cell has less than a tenth of a milliohm; those close to it carry hundreds of amperes. Coin
# cells come close to the largest value, which alone proves nothing.
_LEAST_OHM, _HEAVY_A, _MAX_OHM, _HALF = 1e-4, 50.0, 20.0, 0.5
_RATIO = 0.15


def witnesses_of(samples: Samples, capacity_ah: float | None) -> Iterator[Witness]:
    """The evidence of the record about its scale."""
    yield from _of_time(samples)
    yield from _other_clocks(samples)
    yield from _of_current(samples)
    yield from _of_charge(samples, capacity_ah)


def _of_time(samples: Samples) -> Iterator[Witness]:
    """The length, the sampling, how often the load steps, and the bulk time."""
    once = {"time": 1}
    interval_s, length_s = samples.apart_s, samples.length_s
    yield Witness(length_s, once, lambda s: s <= _LONGEST_S, f"it lasts {length_s:.3g} s")
    if interval_s > 0:
        # Against a unit in the name, slow sampling is weak evidence.
        is_odd = FINEST_S < interval_s < _FAST_S and not is_usual(interval_s)
        is_sure = samples.columns["time"].is_unit_assumed or is_odd
        weight = 1.0 if is_sure else _HALF
        apart = f"samples lie {interval_s:.5g} s apart"
        yield Witness(interval_s, once, lambda s: FINEST_S <= s <= _FAR_S, apart, weight)
        if is_usual(interval_s) or not _FINE_S <= interval_s < _COARSE_S:
            is_far = not FINEST_S <= interval_s <= _FAR_S
            digits = apart if is_far else f"{apart}, which is no usual interval"
            yield Witness(interval_s, once, is_usual, digits, weight)
    if length_s > 0:
        steps_hz = len(samples.steps) / length_s
        often = f"the load steps {steps_hz:.3g} times a second"
        yield Witness(steps_hz, {"time": -1}, lambda hz: hz <= _STEPS_HZ, often)
    if (unit := epoch_unit(samples.time_s)) and unit.factor > 1:
        dates = f"its values are {unit.symbol}"
        yield Witness(1.0, once, lambda days: abs(days / unit.factor - 1) < _RATIO, dates)
    bulk_s, travel_v = samples.bulk_time
    # Relaxation within an interval, or a delay, is a large resistance at some of a sweep's few
    # steps; means and smoothed currents have small ones at some of a load's many steps.
    steps = samples.steps[samples.answer_v[samples.steps] != 0]
    ohm = np.abs(samples.answer_v[steps] / samples.step_a[steps])
    least_ohm = float(np.quantile(ohm, 0.25)) if len(ohm) else 0.0
    least_s = bulk_s * least_ohm / (abs(samples.answered_ohm) or 1.0)
    is_load = len(samples.steps) >= _MANY_STEPS
    is_shown = samples.resistance_ohm > 0 and (is_load or least_s > _BULK_S)
    if bulk_s and (is_shown or bulk_s <= _BULK_S):
        yield _of_bulk(samples, bulk_s, travel_v)


def _of_bulk(samples: Samples, bulk_s: float, travel_v: float) -> Witness:
    """The resistance times the charge per volt, with part of the charge possibly missing.

    The charge of a load in a gap is missing, and only the rest of the travel is due to the logged
    charge.
    """
    gaps = np.flatnonzero(samples.intervals_s > _FAR_LONGER * samples.interval_s)
    ends_a = np.maximum(np.abs(samples.current_a[gaps]), np.abs(samples.current_a[gaps + 1]))
    moved_v = np.abs(samples.step_v[gaps[ends_a < STEADY_SHARE * samples.peak_a]])
    shown_v = travel_v - float(moved_v[moved_v > _LOAD_V].sum())
    is_steep = samples.middle_v < _STEEP_BELOW_V or shown_v < 2 * _TRAVEL_V
    least_s = (_STEEP_S if is_steep else _SHORT_S) * shown_v / travel_v
    least_s = least_s if shown_v >= _TRAVEL_V else 0.0
    size, shown = (
        ("high", f"{bulk_s / 3600:,.3g} h") if bulk_s > _BULK_S else ("low", f"{bulk_s:.3g} s")
    )
    words = f"the resistance would be so {size} that all charge could pass in {shown}"

    def is_cells(time_s: float) -> bool:
        is_fine = samples.apart_s * time_s / bulk_s < _SLOW_S
        return least_s <= time_s and (is_fine or time_s <= _BULK_S)

    # Only another unit explains such a slow or fast record.
    is_certain = bulk_s < least_s / 8 or (bulk_s > _BULK_S and travel_v >= _TRAVEL_V)
    return Witness(bulk_s, {"time": 1}, is_cells, words, CERTAIN if is_certain else 1.0)


def _of_current(samples: Samples) -> Iterator[Witness]:
    """The load, and the resistance at its steps."""
    peak_a, ohm = samples.peak_a, samples.resistance_ohm
    magnitude_a = np.abs(few(samples.current_a))
    loaded_a = float(np.median(magnitude_a[magnitude_a >= 0.05 * peak_a], axis=None))
    load = f"the current under load is {loaded_a:.6g} A"
    yield Witness(loaded_a, {"current": 1}, lambda a: a <= _LOADED_A, load)
    if samples.columns["current"].is_unit_assumed and samples.columns["time"].is_unit_assumed:
        # Minutes and milliamperes together are the charge of a larger cell.
        yield Witness(loaded_a, {}, lambda a: a <= _HEAVY_A, load, 0.0)
    if not ohm:
        return
    is_large, over = ohm > _MAX_OHM, {"current": -1}
    shown = f"{ohm:.3g} ohm" if is_large else f"{1e6 * ohm:.3g} microohm"
    words = f"the cell's resistance would be {shown}"
    weight = _HALF if is_large else 1.0

    def is_cells(cell_ohm: float) -> bool:
        is_heavy = peak_a * ohm / cell_ohm > _HEAVY_A
        return cell_ohm <= _MAX_OHM and (cell_ohm >= _LEAST_OHM or not is_heavy)

    yield Witness(ohm, over, is_cells, words, weight)


def _of_charge(samples: Samples, capacity_ah: float | None) -> Iterator[Witness]:
    """The charge that is moved, and its ratio to the counters and to the capacity."""
    moved = {"time": 1, "current": 1}
    span_ah, travel_v = samples.span_ah, samples.bulk_time[1]
    moves = f"the record moves {span_ah:.4g} Ah"
    yield Witness(span_ah, moved, lambda ah: ah <= _SWING_AH, f"{moves} one way")
    if capacity_ah:
        least_ah = _TOO_LITTLE * capacity_ah if travel_v >= _TRAVEL_V else 0.0
        words = f"{moves} of a cell of {capacity_ah:.4g} Ah, and its voltage by {travel_v:.2g} V"
        yield Witness(span_ah, moved, lambda ah: least_ah < ah <= _TOO_MUCH * capacity_ah, words)
    counted_ah = sum(map(gain_ah, samples.counters.both))
    # A counter printed to 0.1 mAh that moved a few times proves nothing.
    if counted_ah > 1e-3:
        ratio = float(np.sum(np.abs(samples.ended_ah))) / counted_ah
    else:
        ratio = samples.counters.net_ratio(samples.ended_ah, samples.is_loaded) or 0.0
    if ratio:
        times = f"{ratio:.4g} times" if ratio > 1 else f"1/{1 / ratio:.4g} of"
        words = f"the current integrates to {times} the tester's Ah"
        counter = next(samples.columns[name] for name in COUNTERS if name in samples.columns)
        powers, follows = {**moved, CHARGE: -1}, 1e3 if counter.is_unit_assumed else 1.0
        yield Witness(ratio, powers, lambda r: abs(r - 1) < _RATIO, words, follows=follows)


# The number of intervals that are compared with another clock, and the length from which dates in
# seconds resolve them; most have to agree within this.
_PAIRS, _DATED_S, _ALIKE, _AGREEING = 50, 100.0, 0.01, 0.5


def _other_clocks(samples: Samples) -> Iterator[Witness]:
    """The dates and the clock of the steps in addition to the time.

    By the median of many intervals, because a test may pause, and steps restart.
    """
    table, time = samples.table, samples.columns["time"]
    apart = np.arange(0, len(samples), 1 + len(samples) // (2 * _PAIRS))
    # Neighbors, because steps restart; randomly drawn, because even ones could miss steps of one
    # length.
    last = len(samples) - 1
    beside = np.random.default_rng(0).choice(last, min(last, 20 * _PAIRS), replace=False)
    beside = (np.sort(beside)[:, None] + [0, 1]).ravel()
    for name, column in table.header.columns.items():
        if name not in ("date", "step time") or column.index == time.index:
            continue
        cells, is_step = table.columns[column.index], name == "step time"
        if is_step and column.is_unit_assumed and not is_clock(cells):
            continue
        lines = beside if is_step else apart
        other_s = numbers(cells.gather(samples.at[lines]), column)
        lag, least_s, later_s = 1, 0.0, np.diff(other_s)
        if not is_step and np.any(later_s > 0):
            least_s = _DATED_S
            lag += int(least_s / np.median(later_s[later_s > 0]))
        time_s, stride = samples.time_s[lines], 2 if is_step else 1
        later_s, apart_s = (
            values[lag::stride] - values[:-lag:stride] for values in (other_s, time_s)
        )
        moved = (apart_s > 0) & (later_s > least_s)
        if moved.sum() < 2:
            continue
        ratios = apart_s[moved] / later_s[moved]
        usual = float(np.median(ratios))
        if np.mean(np.abs(ratios / usual - 1) < _ALIKE) > _AGREEING:
            words = f"intervals by '{column.header}' are {1 / usual:.4g} times as long"
            yield Witness(usual, {"time": 1}, lambda ratio: abs(ratio - 1) < _ALIKE, words, 2.0)

"""One judgement of scale: whether time, current and the tester's charge are in the units named.

A witness is a number that other units multiply, and what it must be for a cell and a tester. A
reading in another unit is judged by the witnesses that it brings to agree, less those that it puts
off. A unit that the user gives is not in doubt.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from .cell_values import FINEST_S, epoch_unit, is_clock, is_usual, numbers
from .column_rules import bare_units
from .columns import NOTHING, Column, columns_of
from .counters import gain_ah
from .quantities import QUANTITIES, Unit
from .samples import Samples, few
from .table import found_at

CHARGE = "charge"
_COUNTERS = ("charging capacity", "discharging capacity", "net capacity")
# Weights of readings from which one is told: as a doubt, and as certain.
_DOUBTFUL, _CERTAIN = 1.0, 1.5


@dataclass(frozen=True)
class Witness:
    """A number, how often each quantity's factor multiplies it, and what it must be.

    `says` is what it tells against the units that it was computed in. Beside a reading in a part of
    the unit, what has no unit may be in such a part too: `follows` is what that multiplies it by.
    """

    value: float
    powers: Mapping[str, int]
    holds: Callable[[float], bool]
    says: str
    weight: float = 1.0
    follows: float = 1.0

    def agrees(self, quantity: str, factor: float, other: float = 1.0) -> bool:
        return bool(self.holds(other * self.value * factor ** self.powers.get(quantity, 0)))

    def is_brought(self, quantity: str, factor: float) -> bool:
        others = (1.0,) if factor < 1 or quantity != "current" else (1.0, self.follows)
        return any(self.agrees(quantity, factor, other) for other in others)

    def is_put_off(self, quantity: str, factor: float) -> bool:
        values = (self.agrees(quantity, factor, other) for other in (1.0, self.follows))
        return self.holds(self.value) and not any(values)


@dataclass(frozen=True)
class Reading:
    """A quantity in another unit: by how much its values change, and the unit's name in words.

    Without a `unit` they were converted twice.
    """

    quantity: str
    unit: Unit | None
    factor: float
    words: str


@dataclass(frozen=True)
class Verdict:
    """A reading, its weight, and what tells it."""

    reading: Reading
    weight: float
    reasons: tuple[str, ...]


def examine_scale(
    samples: Samples, capacity_ah: float | None = None, given: Mapping[str, str] = NOTHING
) -> Samples:
    """The samples in s, A and Ah, told which unit is another than was named or assumed.

    A time whose name has no unit, and a charge, are taken in the one that the witnesses tell; where
    they leave several, the user is asked. `capacity_ah` is a witness too, and `given` are the
    user's own names of columns.
    """
    if samples.peak_a < _LEAST_A:
        samples = samples.telling(0, "current-unit.zero", column=samples.header("current"))
    asked = None
    # One unit is the odd one out, and behind it may be another.
    for _ in range(2):
        best = _best(samples, list(_witnesses(samples, capacity_ah, given)))
        if not best:
            break
        samples = _settled(samples, best)
        if samples.findings[-1].code.endswith((".doubtful", ".open")):
            asked = best[0].reading.quantity
            break
    witnesses = _witnesses(samples, capacity_ah, given)
    left = [one for one in witnesses if asked not in one.powers and not one.holds(one.value)]
    if left and samples.columns["time"].is_unit_assumed:
        # No other unit explains it, and none is named.
        reason = "; ".join(dict.fromkeys(one.says for one in left))
        samples = samples.noting(bare_units(samples.columns, reason))
    return samples


def _best(samples: Samples, witnesses: list[Witness]) -> list[Verdict]:
    """The readings of the largest weight; none where the units as they are agree best."""
    against = [witness for witness in witnesses if not witness.holds(witness.value)]
    verdicts = []
    for reading in _readings(samples) if against else ():
        how = reading.quantity, reading.factor
        brought = [witness for witness in against if witness.is_brought(*how)]
        put_off = [witness for witness in witnesses if witness.is_put_off(*how)]
        weight = sum(w.weight for w in brought) - sum(w.weight for w in put_off)
        if weight >= _DOUBTFUL:
            verdicts.append(Verdict(reading, weight, tuple(w.says for w in brought)))
    most = max((verdict.weight for verdict in verdicts), default=0.0)
    best = [verdict for verdict in verdicts if verdict.weight == most]
    # Of two units of the current as good, the usual one.
    currents = [verdict for verdict in best if verdict.reading.quantity == "current"]
    return [verdict for verdict in best if verdict not in currents[1:]]


def _readings(samples: Samples) -> Iterator[Reading]:
    """The other units that a quantity may be in, which the user has not given."""
    time, current = samples.columns["time"], samples.columns["current"]
    # Clock times have no unit, and dates one of their own.
    is_number = not is_clock(samples.table.columns[time.index])
    is_number &= time.unit in time.quantity.units.values()
    if is_number and not (time.is_unit_given or samples.table.has_known_units):
        for unit in dict.fromkeys(_UNITS["time"].values()):
            if unit != time.unit:
                yield Reading("time", unit, unit.factor / time.unit.factor, _WORDS[unit.symbol])
        if time.unit.factor == 1 and not time.is_unit_assumed:
            yield Reading("time", None, 1 / 60, "minutes, converted to seconds twice")
            yield Reading("time", None, 1 / 3600, "hours, converted to seconds twice")
    # By factors, for a current may be given as the charge of every interval.
    units = {unit.factor: unit for unit in _UNITS["current"].values()}
    for factor, unit in () if current.is_unit_given else units.items():
        if factor != current.unit.factor and current.unit.factor in units:
            words = f"{_WORDS[unit.symbol]}, not {_WORDS[units[current.unit.factor].symbol]}"
            yield Reading("current", unit, factor / current.unit.factor, words)
    counters = [samples.columns[name] for name in _COUNTERS if name in samples.columns]
    if counters and not any(column.is_unit_given or column.unit.factor != 1 for column in counters):
        yield Reading(CHARGE, _UNITS["net capacity"]["mah"], 1e-3, "milliampere-hours")


_UNITS = {quantity.name: quantity.units for quantity in QUANTITIES}
_WORDS = {
    "s": "seconds",
    "ms": "milliseconds",
    "us": "microseconds",
    "ns": "nanoseconds",
    "min": "minutes",
    "h": "hours",
    "d": "days",
    "A": "amperes",
    "mA": "milliamperes",
    "uA": "microamperes",
}


_CODES = (
    *("time-unit.open", "time-unit.doubtful", "time-unit.wrong", "time-unit.taken"),
    *("current-unit.open", "current-unit.doubtful", "current-unit.wrong", "charge-unit.taken"),
)
# What asks for the unit of a column, or takes one.
UNITS_ASKED = (*_CODES[:-1], "voltage-unit.milli")


def _settled(samples: Samples, best: list[Verdict]) -> Samples:
    """The samples in the unit that is told, and the notice of it."""
    reading, kind, weight = best[0].reading, best[0].reading.quantity, best[0].weight
    column = _column(samples, kind)
    code = {code.partition(".")[2]: code for code in _CODES if code.startswith(kind)}
    is_free = column.is_unit_assumed and kind != "current"
    symbol = reading.unit.symbol if reading.unit else ""
    told = {
        "column": column.header,
        "quantity": _quantities(samples, kind)[0],
        "unit": symbol,
        "reading": reading.words,
        "reason": "; ".join(dict.fromkeys(best[0].reasons)),
        "rename": column.quantity.name_in(symbol),
        "option": _option(samples, reading),
    }
    if not reading.unit:
        told |= {"rename": "divided", "divisor": 1 / reading.factor}
    at = int(np.argmax(np.abs(samples.current_a))) if kind == "current" else 0
    if len(best) > 1 or (weight < _CERTAIN and is_free and kind == "time"):
        told["choices"] = " or ".join(_choices(samples, best))
        found = found_at(samples, at, code["open"], **told)
        return samples.noting(found.rated("error" if is_free else "warning"))
    # Where nothing but the counters is in another unit, the current tells which.
    if weight < _CERTAIN and kind != CHARGE:
        return samples.telling(at, code["doubtful"], **told)
    changed = _quantities(samples, kind)
    scaled = {own: samples.values[own] * reading.factor for own in changed}
    mended = samples.having(**scaled)
    if kind != CHARGE and not is_free:
        return mended.telling(at, code["wrong"], **told)
    columns = dict(samples.columns)
    for own in changed:
        columns[own] = replace(columns[own], unit=reading.unit, is_unit_assumed=False)  # pyrefly: ignore
    return replace(mended, columns=columns).telling(at, code["taken"], **told)


def _quantities(samples: Samples, kind: str) -> list[str]:
    names = _COUNTERS if kind == CHARGE else (kind,)
    return [name for name in names if name in samples.columns]


def _column(samples: Samples, kind: str) -> Column:
    return samples.columns[_quantities(samples, kind)[0]]


def _option(samples: Samples, reading: Reading) -> str:
    """The columns of a quantity with the unit of a reading, as `columns` takes them."""
    unit = f":{reading.unit.symbol}" if reading.unit else ""
    names = _quantities(samples, reading.quantity)
    return ",".join(f"{name}={samples.columns[name].header}{unit}" for name in names)


def _choices(samples: Samples, best: list[Verdict]) -> Iterator[str]:
    """What the user may give, and how far samples are apart in each unit of the time."""
    first = _column(samples, best[0].reading.quantity)
    as_it_is = Reading(best[0].reading.quantity, first.unit, 1.0, "")
    for reading in (as_it_is, *(verdict.reading for verdict in best)):
        if reading.unit is not None:
            apart = f" (samples {_interval_s(samples) * reading.factor:.3g} s apart)"
            apart = apart if reading.quantity == "time" else ""
            yield f"`columns='{_option(samples, reading)}'`{apart}"


# No record lasts longer, and of one without a unit no samples lie further apart.
_LONGEST_S, _FAR_S = 1e8, 500.0
# The bulk time that would be too short for any cell, of a steep end of the curve and of others, and
# too long for a record that is sampled so slowly.
_STEEP_S, _SHORT_S, _BULK_S, _SLOW_S = 0.5, 40.0, 1e4, 50.0
# The voltage must have moved for that to mean anything, and through more than the steep end.
_TRAVEL_V, _STEEP_BELOW_V = 0.3, 3.0
# Between these intervals, numbers that no tester is set to are as good.
_FINE_S, _COARSE_S = 0.2, 90.0
# The share of an interval by which few digits may change it.
_ROUNDED = 0.6
# Charge against the given capacity, in favor of a factor of a thousand either way.
_TOO_MUCH, _TOO_LITTLE = 20.0, 0.01
# The largest cells made hold a little over 1000 Ah; 500 A is the load of a large one, and a 2 Ah
# cell at 1C reads 2000 in milliamperes. A slow sweep of a small cell gives itself away by its
# ampere-hours instead: 2 Ah read as 2000.
_LOADED_A, _SWING_AH = 500.0, 1500.0
# Far below what any tester resolves; squares of much less are lost.
_LEAST_A = 1e-12
# No cell has less than a tenth of a milliohm; those that come near carry hundreds of amperes. Coin
# cells come near to the largest, which alone tells nothing.
_LEAST_OHM, _HEAVY_A, _MAX_OHM, _HALF = 1e-4, 50.0, 20.0, 0.5
_RATIO = 0.15


def _witnesses(
    samples: Samples, capacity_ah: float | None, given: Mapping[str, str]
) -> Iterator[Witness]:
    """What the record shows of its own scale."""
    yield from _of_time(samples)
    yield from _other_clocks(samples, given)
    yield from _of_current(samples)
    yield from _of_charge(samples, capacity_ah)


def _interval_s(samples: Samples) -> float:
    """The usual interval; between two, where few digits round it to either."""
    usual_s = samples.interval_s
    is_near = np.abs(samples.intervals_s - usual_s) < _ROUNDED * usual_s
    return float(np.mean(samples.intervals_s[is_near])) if is_near.any() else usual_s


def _of_time(samples: Samples) -> Iterator[Witness]:
    """The length, the sampling and its digits, and the resistance times the charge a volt moves."""
    once = {"time": 1}
    interval_s, length_s = _interval_s(samples), samples.length_s
    yield Witness(length_s, once, lambda s: s <= _LONGEST_S, f"it lasts {length_s:.3g} s")
    if interval_s > 0:
        # Beside a unit that the name states, the sampling tells little.
        weight = 1.0 if samples.columns["time"].is_unit_assumed else _HALF
        apart = f"samples lie {interval_s:.5g} s apart"
        yield Witness(interval_s, once, lambda s: FINEST_S <= s <= _FAR_S, apart, weight)
        if is_usual(interval_s) or not _FINE_S <= interval_s < _COARSE_S:
            is_far = not FINEST_S <= interval_s <= _FAR_S
            digits = apart if is_far else f"{apart}, which is no usual interval"
            yield Witness(interval_s, once, is_usual, digits, weight)
    if (unit := epoch_unit(samples.time_s)) and unit.factor > 1:
        dates = f"its values are {unit.symbol}"
        yield Witness(1.0, once, lambda days: abs(days / unit.factor - 1) < _RATIO, dates)
    bulk_s, travel_v = samples.bulk_time
    if not bulk_s or travel_v < _TRAVEL_V:
        return
    is_steep = samples.middle_v < _STEEP_BELOW_V or travel_v < 2 * _TRAVEL_V
    least_s = _STEEP_S if is_steep else _SHORT_S
    # A load in a gap was not logged: its charge is missing, and the unit may be right.
    least_s = least_s if samples.hidden_v < travel_v / 2 else 0.0
    words = f"the resistance would be so low that all charge could pass in {bulk_s:.3g} s"

    def is_cells(own_s: float) -> bool:
        is_fine = interval_s * own_s / bulk_s < _SLOW_S
        return least_s <= own_s and (is_fine or own_s <= _BULK_S)

    # Nothing but another unit is so slow.
    yield Witness(bulk_s, once, is_cells, words, _CERTAIN if bulk_s > _BULK_S else 1.0)


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

    def is_cells(own_ohm: float) -> bool:
        is_heavy = peak_a * ohm / own_ohm > _HEAVY_A
        return own_ohm <= _MAX_OHM and (own_ohm >= _LEAST_OHM or not is_heavy)

    yield Witness(ohm, over, is_cells, words, weight)


def _of_charge(samples: Samples, capacity_ah: float | None) -> Iterator[Witness]:
    """The charge that is moved, and its ratio to what the tester counted and to the capacity."""
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
        powers, is_free = {**moved, CHARGE: -1}, _column(samples, CHARGE).is_unit_assumed
        follows = 1e3 if is_free else 1.0
        yield Witness(ratio, powers, lambda r: abs(r - 1) < _RATIO, words, follows=follows)


# The number of intervals that are compared with another clock, and how long those of dates are that
# seconds resolve; most must agree so well.
_PAIRS, _DATED_S, _ALIKE, _AGREEING = 50, 100.0, 0.01, 0.5


def _other_clocks(samples: Samples, given: Mapping[str, str]) -> Iterator[Witness]:
    """The dates and the clock of the steps beside the time.

    By the median of many intervals, for a test may have paused, and steps begin anew.
    """
    table, time = samples.table, samples.columns["time"]
    lines = np.arange(0, len(samples), 1 + len(samples) // (2 * _PAIRS))
    for name, column in columns_of(table.header, given).items():
        if name not in ("date", "step time") or column.index == time.index:
            continue
        if name == "step time":
            if column.is_unit_assumed and not is_clock(table.columns[column.index]):
                continue
            lines = np.arange(len(samples))
        other_s = numbers(table.columns[column.index].gather(samples.at[lines]), column)
        lag, least_s, later_s = 1, 0.0, np.diff(other_s)
        if name == "date" and np.any(later_s > 0):
            least_s = _DATED_S
            lag += int(least_s / np.median(later_s[later_s > 0]))
        later_s = other_s[lag:] - other_s[:-lag]
        apart_s = samples.time_s[lines][lag:] - samples.time_s[lines][:-lag]
        moved = (apart_s > 0) & (later_s > least_s)
        if moved.sum() < 2:
            continue
        ratios = apart_s[moved] / later_s[moved]
        usual = float(np.median(ratios))
        if np.mean(np.abs(ratios / usual - 1) < _ALIKE) > _AGREEING:
            words = f"intervals by '{column.header}' are {1 / usual:.4g} times as long"
            yield Witness(usual, {"time": 1}, lambda ratio: abs(ratio - 1) < _ALIKE, words, 2.0)

"""A file's samples in s, A and V and the tester's ampere-hours, before the sign is decided."""

from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from ..metrics import TO_SD
from ..notices import Notice
from .cell_values import DATED_S
from .counters import Counters
from .dialects import Dialect
from .lag import whole_lag
from .record import STEP_SHARE, held, step_resistance_ohm
from .table import COUNTS, Lines

# The quantities of `Counters`, in its order.
COUNTERS = ("charging capacity", "discharging capacity", "net capacity")
# A steady current changes by less than this share of the largest.
STEADY_SHARE = 0.01
# Levels of a load are constant within this share of the largest current and this far apart; this
# many changes through a value between them, more than direct ones, indicate means.
_STEADY, _APART, _BETWEEN, _FEWEST_BETWEEN = 0.015, 0.1, (0.1, 0.9), 5
# An unconnected input, or a value that was not measured, reads less than this.
_CONNECTED_V = 1e-3
# The median of this many values is as good as that of all; of more, some are left out.
_ENOUGH, MORE = 50_000, 250_000
_FEWEST_SAMPLES, _SHORTEST_S = 5, 1e-6
# The share of an interval by which limited digits may change it.
_ROUNDED = 0.6


class Samples(Lines):
    """The lines of a record: numbers in s, A and V throughout; the current has the file's sign.

    If the time is a date, it counts from the first sample.
    """

    @property
    def time_s(self) -> Float[np.ndarray, "samples"]:
        return self.values["time"]

    @property
    def current_a(self) -> Float[np.ndarray, "samples"]:
        return self.values["current"]

    @property
    def voltage_v(self) -> Float[np.ndarray, "samples"]:
        return self.values["voltage"]

    @property
    def step(self) -> Int[np.ndarray, "samples"] | None:
        return self.values.get("step")

    @property
    def state(self) -> Int[np.ndarray, "samples"] | None:
        return self.values.get("state")

    @cached_property
    def counters(self) -> Counters:
        """The tester's ampere-hour counters."""
        return Counters(*(self.values.get(name) for name in COUNTERS))

    @property
    def dialect(self) -> Dialect:
        """The make with these column names."""
        return self.table.header.dialect

    @cached_property
    def intervals_s(self) -> Float[np.ndarray, "intervals"]:
        """Seconds between neighboring samples."""
        return np.diff(self.time_s)

    @cached_property
    def interval_s(self) -> float:
        """The usual interval."""
        return float(np.median(few(self.intervals_s)))

    @cached_property
    def apart_s(self) -> float:
        """The usual interval; between two, where limited digits round it to either."""
        usual_s = self.interval_s
        is_near = np.abs(self.intervals_s - usual_s) < _ROUNDED * usual_s
        return float(np.mean(self.intervals_s[is_near])) if is_near.any() else usual_s

    @cached_property
    def length_s(self) -> float:
        """Seconds from the first sample to the last."""
        return float(self.time_s[-1] - self.time_s[0])

    @cached_property
    def too_short(self) -> Notice | None:
        """An error if there are too few samples, or too little time."""
        if len(self) < _FEWEST_SAMPLES:
            return Notice("length.short", {"samples": len(self), "needed": _FEWEST_SAMPLES})
        span_s = np.ptp(self.time_s)
        if self.length_s < _SHORTEST_S > span_s:
            return Notice("length.short", {"length_s": span_s, "column": self.header("time")})
        return None

    @cached_property
    def step_a(self) -> Float[np.ndarray, "intervals"]:
        return np.diff(self.current_a)

    @cached_property
    def step_v(self) -> Float[np.ndarray, "intervals"]:
        return np.diff(self.voltage_v)

    @cached_property
    def answer_v(self) -> Float[np.ndarray, "intervals"]:
        """The response of the voltage to the current step in each interval, even several rows
        late."""
        late = whole_lag(self.intervals_s, self.current_a, self.voltage_v)
        rows = np.arange(len(self.step_v)) + late
        is_there = (rows >= 0) & (rows < len(rows))
        return np.where(is_there, self.step_v[rows % len(rows)], 0.0)

    @cached_property
    def peak_a(self) -> float:
        return float(max(self.current_a.max(), -self.current_a.min()))

    @cached_property
    def middle_v(self) -> float:
        """The median voltage."""
        return float(np.median(few(self.voltage_v)))

    @cached_property
    def is_step(self) -> Bool[np.ndarray, "intervals"]:
        """True where the current steps."""
        least_a = STEP_SHARE * self.peak_a
        return (self.step_a > least_a) | (self.step_a < -least_a)

    @cached_property
    def steps(self) -> Int[np.ndarray, "steps"]:
        """The intervals over which the current steps."""
        return np.flatnonzero(self.is_step)

    @cached_property
    def resistance_ohm(self) -> float:
        """The resistance at the current steps; zero if they do not determine it."""
        return step_resistance_ohm(self.step_a[self.steps], self.answer_v[self.steps])

    @cached_property
    def begun_ah(self) -> Float[np.ndarray, "intervals"]:
        """The charge of each interval if its first sample's current flowed throughout."""
        return self.current_a[:-1] * self.intervals_s / 3600

    @cached_property
    def ended_ah(self) -> Float[np.ndarray, "intervals"]:
        """The charge of each interval if its last sample's current flowed throughout."""
        return self.current_a[1:] * self.intervals_s / 3600

    def held_ah(self, hold: str) -> Float[np.ndarray, "intervals"]:
        """The charge of each interval by a hold of the current."""
        return held(hold, self.begun_ah, self.ended_ah)

    @cached_property
    def is_loaded(self) -> Bool[np.ndarray, "intervals"]:
        """The intervals with a load at either end."""
        is_loaded = np.abs(self.current_a) > STEADY_SHARE * self.peak_a
        return is_loaded[1:] | is_loaded[:-1]

    @cached_property
    def span_ah(self) -> float:
        """The charge between the fullest and emptiest moments, including what only counters
        show."""
        # With many intervals, sums of several in a row give the same.
        starts = np.arange(0, len(self.ended_ah), 1 + len(self.ended_ah) // _ENOUGH)
        integrated_ah = float(np.ptp(np.cumsum(np.add.reduceat(self.ended_ah, starts))))
        counted_ah = self.counters.charge_ah(self.ended_ah, self.is_loaded)
        return integrated_ah if counted_ah is None else max(integrated_ah, np.ptp(counted_ah))

    @cached_property
    def noise_v(self) -> float:
        """The noise of a voltage step while the current is steady."""
        is_quiet = np.abs(few(self.step_a, MORE)) < STEADY_SHARE * self.peak_a
        return voltage_noise_v(few(self.step_v, MORE)[is_quiet])

    @cached_property
    def answered_ohm(self) -> float:
        """The resistance at the steps with a response of the voltage, even if there is only one;
        zero if they do not determine it. Its sign is that of the response."""
        steps = self.steps[self.answer_v[self.steps] != 0]
        step_a, step_v = self.step_a[steps], self.answer_v[steps]
        if len(steps) < 3:
            # With so few, the lag is unknown: the next row belongs to the step too.
            after = np.minimum(steps + 2, len(self.voltage_v) - 1)
            step_v = self.voltage_v[after] - self.voltage_v[steps]
        rising = np.sign(np.sum(step_a * step_v))
        return rising * step_resistance_ohm(step_a, step_v, fewest=1)

    @cached_property
    def bulk_time(self) -> tuple[float, float]:
        """R dQ/dV over the record, in s, and the travel of its voltage without R I, in V.

        The time is zero if the current steps do not determine R.
        """
        voltage_v = few(self.voltage_v)
        source_v = voltage_v - self.answered_ohm * few(self.current_a)
        # Samples without a connected cell say nothing about it.
        source_v = source_v[np.abs(voltage_v) > _CONNECTED_V]
        if not len(source_v):
            return 0.0, 0.0
        low_v, high_v = np.quantile(source_v, [0.02, 0.98])
        travel_v = float(high_v - low_v)
        if travel_v <= 0:
            return 0.0, travel_v
        return abs(self.answered_ohm) * 3600 * self.span_ah / travel_v, travel_v


def few(values: np.ndarray, most: int = _ENOUGH) -> np.ndarray:
    """An evenly spaced subset, whose median and quantiles are as good as those of all."""
    return values[:: 1 + len(values) // most]


def samples_of(lines: Lines) -> Samples:
    """The samples of lines with finite time, current and voltage."""
    values = dict(lines.values)
    for name in values.keys() & COUNTS:
        values[name] = values[name].astype(int)
    time_s, zero_date_s = values["time"], lines.zero_date_s
    if lines.columns["time"].quantity.name == "date" and len(time_s):
        zero_date_s = float(time_s[0]) if time_s[0] >= DATED_S else None
        values["time"] = time_s = time_s - time_s[0]
    if lines.columns["current"].quantity.name == "charge of the interval":
        interval_h = np.diff(time_s, prepend=time_s[:1]) / 3600
        values["current"] = values["current"] / np.where(interval_h > 0, interval_h, np.inf)
    return Samples(lines.table, lines.columns, values, lines.at, zero_date_s, lines.findings)


def voltage_noise_v(step_v: Float[np.ndarray, "quiet"]) -> float:
    """Robust noise of one voltage step without any event, in V.

    At least half of the tester's resolution, which is the smallest such step.
    """
    steps = few(step_v)
    moved = np.abs(steps[steps != 0])
    if not len(moved):
        return 0.0
    spread_v = TO_SD * float(np.median(np.abs(steps - np.median(steps))))
    return max(spread_v, float(moved.min()) / 2)


def changes_through_values_between(current_a: Float[np.ndarray, "rows"]) -> int:
    """The number of changes of a load's level that go through a row with a value in between; 0 if
    most do not."""
    largest_a = float(np.max(np.abs(current_a)))
    is_steady = np.abs(np.diff(current_a)) < _STEADY * largest_a
    is_far = np.abs(np.diff(current_a)) > _APART * largest_a
    straight = np.count_nonzero(is_steady[:-2] & is_far[1:-1] & is_steady[2:])
    whole_a = current_a[3:-1] - current_a[1:-3]
    is_apart = np.abs(whole_a) > _APART * largest_a
    share = (current_a[2:-2] - current_a[1:-3]) / np.where(is_apart, whole_a, 1.0)
    is_between = (share > _BETWEEN[0]) & (share < _BETWEEN[1])
    through = np.count_nonzero(is_steady[:-3] & is_apart & is_between & is_steady[3:])
    return int(through) if through > max(straight, _FEWEST_BETWEEN - 1) else 0

"""One measured record of one cell in one convention, with its rests, loads and charges."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ..display import Brief
from ..metrics import TO_SD
from ..notices import Notice
from .logger import Decision, SamplingEvidence

# Between two rows, a centered current has this share of the first row's. The current of means
# changes within its row, and the new current has less than half of the row to act: with one half,
# R0 from means over 10 s is 1 to 3 % low under most loads, with this value within 2 %.
EARLIER_SHARE = 0.54
# Long enough for a robust spread of the current's noise, short compared to a rest.
_WINDOW_SAMPLES = 32
# In `Record.state`, anything but discharge (+1), charge (-1) and rest (0).
OTHER_STATE = 9
# A hyphen may separate words.
_NAMED_DEGC = re.compile(
    r"(?<![\d.])(?P<minus>(?<![a-zA-Z\d])(?:-|minus|neg|m|n)[ _]?)?(?P<degrees>\d{1,2}(?:\.\d+)?)"
    r"[ _]?(?:degC|deg_?C|°C)(?![a-zA-Z])",
    re.IGNORECASE,
)

Indices = Int[np.ndarray, "indices"]
Channel = Float[np.ndarray, "samples"]
Intervals = Float[np.ndarray, "intervals"]


@dataclass(frozen=True, eq=False, repr=False)
class Record(Brief):
    """A checked record. Discharge current is positive, and time strictly increases.

    The arrays belong to the record and cannot be written to.

    Attributes:
        name: Name of the file.
        time_s: Time on the file's own clock.
        current_a: Current, at the moments of the voltage.
        voltage_v: Voltage.
        temperature_degc: Temperature, if the file has a column of it.
        step: The tester's step numbers.
        row: Each sample's row in the file, with the header in row 1, so that a message can name it.
        sign: The file's own sign of the current, and why.
        hold: A sample's current flows in the interval after it ("forward"), before it ("backward")
            or in about half of both ("centered"), and why.
        sha256: Digest of the file.
        warnings: What is doubtful, with what to do.
        notes: What was assumed or changed in reading.
        charge_ah: The tester's own net charge out of the cell since its counters began, which may
            be before the first sample.
        skipped_ah: Charge that the counters counted in intervals whose load was not logged, beyond
            that of the current.
        cycle: The tester's cycle numbers.
        flowing: The share of each interval for which its current flowed, where the logger wrote
            nothing at rest; None for all of all.
        state: +1 where the file says that a step discharges, -1 where it charges, 0 where it rests,
            and `OTHER_STATE` for any other word.
        voltage_lag_s: By how much the file's voltage is older than the current in its row.
        zero_date_s: The date at which the clock is zero, in s since 1970, where it has dates.
        evidence: Evidence on its logger.
    """

    name: str
    time_s: Channel
    current_a: Channel
    voltage_v: Channel
    temperature_degc: Channel | None
    step: Int[np.ndarray, "samples"] | None
    row: Int[np.ndarray, "samples"]
    sign: Decision
    hold: Decision
    sha256: str
    warnings: tuple[Notice, ...] = ()
    notes: tuple[Notice, ...] = ()
    charge_ah: Channel | None = None
    skipped_ah: Intervals | None = None
    flowing: Intervals | None = None
    cycle: Int[np.ndarray, "samples"] | None = None
    state: Int[np.ndarray, "samples"] | None = None
    voltage_lag_s: float = 0.0
    zero_date_s: float | None = None
    evidence: SamplingEvidence | None = None

    def __post_init__(self):
        for name, values in vars(self).copy().items():
            # The memory of a table is not a NumPy array, and cannot be written to.
            is_array = isinstance(values, np.ndarray) and not isinstance(values.base, np.ndarray)
            if isinstance(values, np.ndarray) and not (is_array and not values.flags.writeable):
                # A copy, because the caller may change the given array later.
                copied = values.copy()
                copied.flags.writeable = False
                object.__setattr__(self, name, copied)

    @classmethod
    def of_load(
        cls,
        name: str,
        time_s: Channel,
        current_a: Channel,
        voltage_v: Channel,
        temperature_degc: Channel | None = None,
    ) -> "Record":
        """A record of an unmeasured current that is constant from each time to the next."""
        row, made = np.arange(len(time_s)) + 2, ("given", "for a simulation")
        sign, hold = Decision("discharge-positive", *made), Decision("forward", *made)
        signals = time_s, current_a, voltage_v, temperature_degc
        return cls(name, *signals, step=None, row=row, sign=sign, hold=hold, sha256="")

    def __reduce__(self) -> tuple[type["Record"], tuple[Any, ...]]:
        """For pickle: the fields, without anything computed from them."""
        return Record, tuple(getattr(self, field.name) for field in fields(self))

    @property
    def samples(self) -> int:
        return len(self.time_s)

    @property
    def interval_s(self) -> Intervals:
        """Seconds between neighboring samples."""
        return np.diff(self.time_s)

    @cached_property
    def usual_s(self) -> float:
        """The median interval."""
        return float(np.median(self.interval_s))

    @property
    def interval_current_a(self) -> Intervals:
        """The mean current between neighboring samples, by the record's hold."""
        held_a = held(self.hold.value, self.current_a[:-1], self.current_a[1:])
        return held_a if self.flowing is None else self.flowing * held_a

    @property
    def discharged_ah(self) -> Channel:
        """Ampere-hours discharged since the first sample: integrated, and counted where a load was
        skipped."""
        return np.concatenate([np.zeros(1), np.cumsum(self.moved_ah)])

    @property
    def moved_ah(self) -> Intervals:
        """Ampere-hours discharged in each interval."""
        moved_ah = self.interval_current_a * self.interval_s / 3600
        return moved_ah if self.skipped_ah is None else moved_ah + self.skipped_ah

    @cached_property
    def span_ah(self) -> float:
        """The charge between the fullest and the emptiest sample."""
        return float(np.ptp(self.discharged_ah))

    @cached_property
    def resistance_ohm(self) -> float:
        """The resistance at the current steps; zero if they do not determine it."""
        step_a, step_v = np.diff(self.current_a), np.diff(self.voltage_v)
        is_step = np.abs(step_a) > STEP_SHARE * np.abs(self.current_a).max()
        return step_resistance_ohm(step_a[is_step], step_v[is_step])

    @cached_property
    def source_v(self) -> Channel:
        """The voltage without the drop R I."""
        return self.voltage_v + self.resistance_ohm * self.current_a

    def usual_degc(self, samples: slice | Int[np.ndarray, "_"] = slice(None)) -> float | None:
        """The median of the temperatures measured at some samples, else the one in the name, if
        any."""
        measured = np.empty(0) if self.temperature_degc is None else self.temperature_degc[samples]
        finite = measured[np.isfinite(measured)]
        return float(np.median(finite)) if len(finite) else degc_in_name(self.name)

    def flowing_between(self, first: Indices, last: Indices) -> tuple[Indices, Indices]:
        """The samples between which the currents of samples `first` to `last` flowed."""
        if self.hold.value == "backward":
            return np.maximum(first - 1, 0), last
        return first, np.minimum(last + 1, self.samples - 1)

    def rest_current_a(self, capacity_ah: float) -> float:
        """The current in A below which a cell of this capacity counts as resting.

        C/100, but at least five times the current's noise at rest, because a tester's offset is not
        a direction.

        >>> from barnax import bundled_file, read_record
        >>> read_record(bundled_file("ocv_discharge")).rest_current_a(2.0)
        0.02
        """
        # The noise is the median of robust estimates in short windows that are below C/20
        # throughout and below C/50 in the median. Differences of neighbors over sqrt(2) contain the
        # white noise and little of a drift or a slow oscillation.
        windows = self.samples // _WINDOW_SAMPLES
        current_a = self.current_a[: windows * _WINDOW_SAMPLES].reshape(windows, _WINDOW_SAMPLES)
        current_a = current_a[(np.abs(current_a) < capacity_ah / 20).all(axis=1)]
        noise_a = TO_SD * np.median(np.abs(np.diff(current_a, axis=1)), axis=1) / np.sqrt(2)
        # The means of two halves hardly differ for white noise, but do for an oscillation.
        half = _WINDOW_SAMPLES // 2
        drift_a = np.abs(current_a[:, :half].mean(axis=1) - current_a[:, half:].mean(axis=1))
        is_steady = drift_a <= 3 * noise_a * np.sqrt(2 / half)
        is_steady &= np.abs(np.median(current_a, axis=1)) < capacity_ah / 50
        usual_a = float(np.median(noise_a[is_steady])) if is_steady.any() else 0.0
        return max(capacity_ah / 100, 5 * usual_a)

    @cached_property
    def _segments(self) -> dict[float, "Segments"]:
        return {}

    def segments(self, rest_a: float) -> "Segments":
        """Its rests, loads and charges, where currents below `rest_a` count as none; computed once.

        >>> from barnax import bundled_file, read_record
        >>> len(read_record(bundled_file("ocv_discharge")).segments(0.02).rests)
        22
        """
        return self._segments.setdefault(rest_a, Segments(self, rest_a))


def held(hold: str, begun: Intervals, ended: Intervals) -> Intervals:
    """The mean of each interval by a hold, from the values at its start and end."""
    if hold == "centered":
        return EARLIER_SHARE * begun + (1 - EARLIER_SHARE) * ended
    return begun if hold == "forward" else ended


# The rest after which the voltage is the OCV, and how much shorter a rest programmed as 30 min may
# be on the tester's clock.
MINIMUM_REST_S, CLOCK_SLACK_S = 1800.0, 1.0
# A voltage that moves by less than this is settled.
SETTLED_V = 5e-3
# A charge that ends full has at least this duration, because a regenerative brake is shorter. At
# its end the voltage is held within the next value for the next time, as an LFP cell is full within
# minutes; meanwhile the current falls below this share, and would need the last time for the
# capacity.
CHARGE_S, HELD_V, HELD_S, TAPERED, LEAST_HOURS = 300.0, 0.01, 60.0, 0.5, 10.0
# A held voltage is this close to the record's highest, which braking of a cold cell exceeds.
NEAR_HIGHEST_V = 0.06


def is_long(rest_s: float) -> bool:
    """True for a rest after which the voltage is the OCV."""
    return rest_s >= MINIMUM_REST_S - CLOCK_SLACK_S


class Rest(NamedTuple):
    """First and last sample of an uninterrupted rest, and the time in s without a current."""

    first: int
    last: int
    duration_s: float


@dataclass(frozen=True, eq=False)
class Segments:
    """The rests, loads and charges of a record in which currents below `rest_a` count as none."""

    record: Record
    rest_a: float

    @cached_property
    def is_rested(self) -> Bool[np.ndarray, "samples"]:
        return np.abs(self.record.current_a) < self.rest_a

    @cached_property
    def loaded(self) -> Int[np.ndarray, "loaded"]:
        """The samples under load."""
        return np.flatnonzero(~self.is_rested)

    @cached_property
    def rests(self) -> tuple[Rest, ...]:
        """Every rest, in order, with the interval of the hold at one of its ends."""
        first, last = runs(self.is_rested)
        begin_s, end_s = (self.record.time_s[at] for at in self.record.flowing_between(first, last))
        return tuple(map(Rest, first.tolist(), last.tolist(), (end_s - begin_s).tolist()))

    def rest_before(self, sample: int) -> tuple[int, float]:
        """The last rested sample before the load at `sample` or the next one, and the duration of
        the rest until then in s; zero without a rest, or if nothing came before."""
        at = np.searchsorted(self.loaded, sample)
        last = int(self.loaded[at]) - 1 if at < len(self.loaded) else sample
        if at == 0 or last <= self.loaded[at - 1]:
            return max(last, 0), 0.0
        return last, float(self.record.time_s[last] - self.record.time_s[self.loaded[at - 1]])

    def directions(self, initial: int = 1) -> Channel:
        """The last direction of the current: +1 charging, -1 discharging (Sig of Eq. 5).

        A rest keeps the last direction; before the first load it is `initial`, +1 for a cell that
        was charged before.

        >>> from barnax import bundled_file, read_record
        >>> directions = read_record(bundled_file("ocv_discharge")).segments(0.02).directions()
        >>> float(directions[0]), float(directions[-1])
        (1.0, -1.0)
        """
        current_a = self.record.current_a
        moving = ~self.is_rested & (current_a != 0)
        last_moving = np.maximum.accumulate(np.where(moving, np.arange(len(moving)), -1))
        return np.where(last_moving >= 0, -np.sign(current_a[last_moving]), float(initial))

    def long_loads(self, direction: int) -> list[tuple[int, int]]:
        """First and last samples of charges (+1) or discharges (-1) without a pause, apart from
        braking and other short interruptions."""
        ends = np.stack(runs(-direction * self.record.current_a > self.rest_a), axis=1)
        is_lasting = np.diff(self.record.time_s[ends], axis=1)[:, 0] >= CHARGE_S
        return [(first, last) for first, last in ends[is_lasting].tolist()]

    def held_charges(self, capacity_ah: float, least_v: float = -np.inf) -> Iterator[int]:
        """The last samples of charges that end like a full charge: at a voltage above the given
        one, held while the current tapers."""
        for first, last in self.long_loads(1):
            voltage_v = self.record.voltage_v[first : last + 1]
            moving = np.flatnonzero(np.abs(voltage_v - voltage_v[-1]) > HELD_V)
            held = first + int(moving[-1]) + 1 if len(moving) else first
            held_s = self.record.time_s[last] - self.record.time_s[held]
            end_a = -float(self.record.current_a[last])
            is_tapered = end_a < -TAPERED * self.record.current_a[held]
            is_tapered &= end_a <= capacity_ah / LEAST_HOURS
            if held_s >= HELD_S and is_tapered and voltage_v[-1] >= least_v:
                yield last

    def full_charges(self, capacity_ah: float) -> list[int]:
        """Those at the record's highest voltage, whatever the cell."""
        highest_v = float(self.record.voltage_v.max())
        return list(self.held_charges(capacity_ah, highest_v - NEAR_HIGHEST_V))


def runs(holds: Bool[np.ndarray, "samples"]) -> tuple[Indices, Indices]:
    """First and last index of each uninterrupted run where `holds` is true, in order."""
    edges = np.flatnonzero(np.diff(holds, prepend=False, append=False))
    return edges[::2], edges[1::2] - 1


def equal_runs(values: np.ndarray, fewest: int = 1) -> tuple[Indices, Indices]:
    """First and last index of each run of at least this many equal values."""
    edges = np.flatnonzero(np.diff(values, prepend=np.nan, append=np.nan) != 0)
    is_long = np.diff(edges) >= fewest
    return edges[:-1][is_long], edges[1:][is_long] - 1


def run_sums(values: np.ndarray, first: Indices, last: Indices) -> np.ndarray:
    """The sum over each run, given by its first and last index."""
    total = np.append(0, np.cumsum(values))
    return total[last + 1] - total[first]


def degc_in_name(name: str) -> float | None:
    """The temperature in degC in a file's name; None without one.

    >>> [degc_in_name(name) for name in ("dst_25degC.csv", "ocv-5degC", "us06_minus10degC.csv")]
    [25.0, 5.0, -10.0]
    """
    named = _NAMED_DEGC.search(name)
    return named and (-1 if named["minus"] else 1) * float(named["degrees"])


# Responses to current steps agree if this share of them has one sign.
_AGREEING = 0.5
Steps = Float[np.ndarray, "steps"]
# Steps of the current are changes by this share of the largest. Those of a load extend over this
# share of the charge, between these quantiles, since a few may be outside.
STEP_SHARE, LEAST_REACH, _ENDS = 0.1, 0.05, (0.05, 0.95)
# Fewer steps are not a load.
_FEWEST_STEPS = 10


def reach_of_steps(current_a: Channel, charge: Channel) -> float:
    """The charge, or the SOC, over which most current steps extend; zero if there are few, as in a
    charge at one current, which has them at its ends.

    >>> round(reach_of_steps(np.resize([0.0, 1.0], 21), np.linspace(0.0, 1.0, 21)), 3)
    0.855
    """
    step_a = np.abs(np.diff(current_a))
    at = charge[1:][step_a > STEP_SHARE * np.max(np.abs(current_a), initial=0.0)]
    return reach(at) if len(at) >= _FEWEST_STEPS else 0.0


def reach(at: Float[np.ndarray, "steps"]) -> float:
    """The charge, or the SOC, over which steps at these values extend, except for a few at either
    end."""
    return float(np.ptp(np.quantile(at, _ENDS)))


def step_resistance_ohm(step_a: Steps, step_v: Steps, fewest: int = 3) -> float:
    """The median |dV/dI| of the larger half of the current steps; zero if they disagree.

    They agree if most of dI dV has one sign: small steps during relaxation carry less weight.
    """
    if len(step_a) < fewest:
        return 0.0
    product = step_a * step_v
    if abs(product.sum()) < _AGREEING * np.abs(product).sum() or not product.any():
        return 0.0
    is_large = np.abs(step_a) >= np.median(np.abs(step_a))
    return abs(float(np.median(step_v[is_large] / step_a[is_large])))

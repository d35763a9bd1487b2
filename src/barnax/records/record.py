"""One measured record of one cell in one convention, its rests and its direction."""

import re
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from ..display import Brief
from ..notices import Notice

Hold = Literal["forward", "backward", "centered"]
Strength = Literal["given", "strong", "weak", "assumed"]
# A centered current is, between two rows, so much of the first one's. That of means changes within
# its row, and what it changes to has less than half of the row to be answered in: with one half, R0
# of means over 10 s is 1 to 3 % low under most loads, with this within 2 %.
EARLIER_SHARE = 0.54
# In `Record.state`, what is no discharge (+1), charge (-1) or rest (0).
OTHER_STATE = 9
# A hyphen may be one between words.
_NAMED_DEGC = re.compile(
    r"(?<![\d.])(?P<minus>(?<![a-zA-Z\d])(?:-|minus|neg|m|n)[ _]?)?(?P<degrees>\d{1,2}(?:\.\d+)?)"
    r"[ _]?(?:degC|deg_?C|°C)(?![a-zA-Z])",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class FullCharge:
    """The marks of a charge that ends full: a voltage that is held while the current tapers.

    Attributes:
        least_s: It lasts so long; what a brake gives back is shorter.
        held_v: The held voltage stays within this.
        least_held_s: For so long; an LFP cell is full within minutes of holding its voltage.
        tapered: The current falls below this share.
        near_v: The last voltage is so near the record's highest.
        held_near_v: So near is a held voltage, which brakes of a cold cell exceed.
    """

    least_s: float = 300.0
    held_v: float = 0.01
    least_held_s: float = 60.0
    tapered: float = 0.5
    near_v: float = 0.02
    held_near_v: float = 0.06

    def has_tapered(self, first_a: float, last_a: float) -> bool:
        return abs(last_a) < self.tapered * abs(first_a)


FULL_CHARGE = FullCharge()


@dataclass(frozen=True)
class Decision:
    """A decision about a file, how firm it is, and why, in words for the user."""

    value: str
    strength: Strength
    reason: str


@dataclass(frozen=True, eq=False, repr=False)
class Record(Brief):
    """A checked record. Discharge current is positive; time strictly increases.

    The arrays are the record's own and cannot be written to.

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
        skipped_ah: What the counters counted in intervals whose load was not logged, beyond what
            the current tells.
        cycle: The tester's cycle numbers.
        flowing: The share of each interval for which its current flowed, where the logger wrote
            nothing at rest; None for all of all.
        state: +1 where the file says that a step discharges, -1 where it charges, 0 where it rests,
            and `OTHER_STATE` where it says anything else.
        voltage_lag_s: By how much the file's voltage is older than the current in its row.
    """

    name: str
    time_s: Float[np.ndarray, "samples"]
    current_a: Float[np.ndarray, "samples"]
    voltage_v: Float[np.ndarray, "samples"]
    temperature_degc: Float[np.ndarray, "samples"] | None
    step: Int[np.ndarray, "samples"] | None
    row: Int[np.ndarray, "samples"]
    sign: Decision
    hold: Decision
    sha256: str
    warnings: tuple[Notice, ...] = ()
    notes: tuple[Notice, ...] = ()
    charge_ah: Float[np.ndarray, "samples"] | None = None
    skipped_ah: Float[np.ndarray, "intervals"] | None = None
    flowing: Float[np.ndarray, "intervals"] | None = None
    cycle: Int[np.ndarray, "samples"] | None = None
    state: Int[np.ndarray, "samples"] | None = None
    voltage_lag_s: float = 0.0

    def __post_init__(self):
        for name, values in vars(self).copy().items():
            # The memory of a table is no array, and cannot be written to.
            is_own = isinstance(values, np.ndarray) and not isinstance(values.base, np.ndarray)
            if isinstance(values, np.ndarray) and not (is_own and not values.flags.writeable):
                # A copy, for the caller may go on writing to what was given.
                own = values.copy()
                own.flags.writeable = False
                object.__setattr__(self, name, own)

    @property
    def samples(self) -> int:
        return len(self.time_s)

    @property
    def interval_s(self) -> Float[np.ndarray, "intervals"]:
        """Seconds between neighboring samples."""
        return np.diff(self.time_s)

    @property
    def interval_current_a(self) -> Float[np.ndarray, "intervals"]:
        """The mean current between neighboring samples, by the record's hold."""
        before_a, after_a = self.current_a[:-1], self.current_a[1:]
        held_a = before_a if self.hold.value == "forward" else after_a
        if self.hold.value == "centered":
            held_a = EARLIER_SHARE * before_a + (1 - EARLIER_SHARE) * after_a
        return held_a if self.flowing is None else self.flowing * held_a

    @property
    def discharged_ah(self) -> Float[np.ndarray, "samples"]:
        """Ampere-hours taken out since the first sample: integrated, and counted where skipped."""
        return np.concatenate([np.zeros(1), np.cumsum(self.moved_ah)])

    @property
    def moved_ah(self) -> Float[np.ndarray, "intervals"]:
        """Ampere-hours that came out in each interval."""
        moved_ah = self.interval_current_a * self.interval_s / 3600
        return moved_ah if self.skipped_ah is None else moved_ah + self.skipped_ah


def runs(
    holds: Bool[np.ndarray, "places"],
) -> tuple[Int[np.ndarray, "runs"], Int[np.ndarray, "runs"]]:
    """First and last place of each unbroken run where `holds` is true, in order."""
    edges = np.flatnonzero(np.diff(holds, prepend=False, append=False))
    return edges[::2], edges[1::2] - 1


def equal_runs(
    values: Float[np.ndarray, "places"] | Int[np.ndarray, "places"],
) -> tuple[Int[np.ndarray, "runs"], Int[np.ndarray, "runs"]]:
    """First and last place of each run of equal values."""
    changes = np.flatnonzero(np.diff(values) != 0)
    return np.append(0, changes + 1), np.append(changes, len(values) - 1)


def in_means(record: Record, interval_s: float) -> Record:
    """The record in means over intervals, with all its charge; itself where it is no faster.

    >>> from barnax.bundled import bundled_file
    >>> from barnax.records import read_record
    >>> means = in_means(read_record(bundled_file("identification")), 10.0)
    >>> means.samples, float(np.median(means.interval_s))
    (1968, 10.0)
    """
    if 2 * float(np.median(record.interval_s)) > interval_s:
        return record
    number = np.floor((record.time_s - record.time_s[0]) / interval_s)
    is_first = np.diff(number, prepend=-1.0) > 0
    if record.step is not None:
        is_first |= np.diff(record.step, prepend=record.step[0]) != 0
    first = np.flatnonzero(is_first)
    counts = np.diff(np.append(first, record.samples))

    def mean(values: Float[np.ndarray, "samples"]) -> Float[np.ndarray, "means"]:
        return np.add.reduceat(values, first) / counts

    def begun(values):
        return None if values is None else values[first]

    found = replace(
        record,
        time_s=mean(record.time_s),
        current_a=mean(record.current_a),
        voltage_v=mean(record.voltage_v),
        temperature_degc=begun(record.temperature_degc),
        step=begun(record.step),
        row=record.row[first],
        hold=replace(record.hold, value="centered"),
        charge_ah=begun(record.charge_ah),
        skipped_ah=None,
        flowing=None,
        cycle=begun(record.cycle),
        state=begun(record.state),
    )
    moved_ah = np.diff(mean(record.discharged_ah))
    if record.flowing is not None:
        # Where the logger wrote nothing at rest, a mean's current does not flow through that.
        group = np.cumsum(is_first) - 1
        silent = group[:-1][record.flowing < 1]
        silent = silent[silent < len(moved_ah)]
        flowing, held_ah = np.ones(len(moved_ah)), found.moved_ah[silent]
        shares = np.divide(moved_ah[silent], held_ah, np.ones(len(silent)), where=held_ah != 0)
        flowing[silent] = np.clip(shares, 0.0, 1.0)
        found = replace(found, flowing=flowing)
    return replace(found, skipped_ah=moved_ah - found.moved_ah)


# Long enough for a robust spread, short against a rest.
_WINDOW_SAMPLES = 32


def rest_current_a(record: Record, capacity_ah: float) -> float:
    """The current below which a cell counts as resting, in A.

    C/100, and never under five times the current's noise at rest: a tester's offset is not a
    direction.

    >>> from barnax.bundled import bundled_file
    >>> from barnax.records import read_record
    >>> record = read_record(bundled_file("ocv_discharge"))
    >>> rest_current_a(record, capacity_ah=2.0)
    0.02
    """
    return max(capacity_ah / 100, 5 * _noise_at_rest_a(record, capacity_ah))


def _noise_at_rest_a(record: Record, capacity_ah: float) -> float:
    """The median robust noise of short windows of small, steady current; zero without such.

    The windows lie below C/20 throughout and below C/50 in the median. Differences of neighbors
    over sqrt(2) give the noise of white noise and little of a drift or a slow dither.
    """
    windows = record.samples // _WINDOW_SAMPLES
    current = record.current_a[: windows * _WINDOW_SAMPLES].reshape(windows, _WINDOW_SAMPLES)
    is_small = (np.abs(current) < capacity_ah / 20).all(axis=1)
    current = current[is_small]
    steps = np.diff(current, axis=1)
    noise_a = 1.4826 * np.median(np.abs(steps), axis=1) / np.sqrt(2)
    # Half against half: the means of white noise hardly differ, those of a swing do.
    half = _WINDOW_SAMPLES // 2
    drift_a = np.abs(current[:, :half].mean(axis=1) - current[:, half:].mean(axis=1))
    is_low = np.abs(np.median(current, axis=1)) < capacity_ah / 50
    is_steady = is_low & (drift_a <= 3 * noise_a * np.sqrt(2 / half))
    return float(np.median(noise_a[is_steady])) if is_steady.any() else 0.0


def is_rested(record: Record, threshold_a: float) -> Bool[np.ndarray, "samples"]:
    """True where the current's magnitude is below `threshold_a`.

    >>> from barnax.bundled import bundled_file
    >>> from barnax.records import read_record
    >>> record = read_record(bundled_file("ocv_discharge"))
    >>> bool(is_rested(record, threshold_a=0.02)[0])
    True
    """
    return np.abs(record.current_a) < threshold_a


def current_direction(
    record: Record, threshold_a: float, initial: int = 1
) -> Float[np.ndarray, "samples"]:
    """The last direction of the current: +1 charging, -1 discharging (Sig of Eq. 5).

    Below `threshold_a` the last direction goes on; before the first one it is `initial`, +1 for
    a cell that comes from a charge.

    >>> from barnax.bundled import bundled_file
    >>> from barnax.records import read_record
    >>> record = read_record(bundled_file("ocv_discharge"))
    >>> direction = current_direction(record, threshold_a=0.02)
    >>> float(direction[0]), float(direction[-1])
    (1.0, -1.0)
    """
    moving = ~is_rested(record, threshold_a) & (record.current_a != 0)
    last_moving = np.maximum.accumulate(np.where(moving, np.arange(record.samples), -1))
    direction = -np.sign(record.current_a[last_moving])
    return np.where(last_moving >= 0, direction, float(initial))


def rest_blocks(record: Record, threshold_a: float) -> list[tuple[int, int]]:
    """First and last sample of each unbroken rest, in order.

    >>> from barnax.bundled import bundled_file
    >>> from barnax.records import read_record
    >>> record = read_record(bundled_file("ocv_discharge"))
    >>> len(rest_blocks(record, threshold_a=0.02))
    22
    """
    first, last = runs(is_rested(record, threshold_a))
    return list(zip(first.tolist(), last.tolist(), strict=True))


def degc_in_name(name: str) -> float | None:
    """The temperature in degC that a file's name tells, None without such.

    >>> [degc_in_name(name) for name in ("dst_25degC.csv", "ocv-5degC", "us06_minus10degC.csv")]
    [25.0, 5.0, -10.0]
    """
    named = _NAMED_DEGC.search(name)
    if named is None:
        return None
    return -float(named["degrees"]) if named["minus"] else float(named["degrees"])

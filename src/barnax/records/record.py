"""One measured record of one cell in one convention, its rests and its direction."""

import re
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from ..display import Brief
from ..notices import Notice
from .logger import Decision, SamplingEvidence

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
        zero_date_s: The date at which the clock is zero, in s since 1970, where it has dates.
        evidence: What it shows of its logger.
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
    zero_date_s: float | None = None
    evidence: SamplingEvidence | None = None

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


def pause_s(earlier: Record, later: Record) -> float:
    """Seconds from the end of one record to the start of another, by the dates of both, or else by
    their clocks."""
    between_s = float(later.time_s[0] - earlier.time_s[-1])
    if earlier.zero_date_s is None or later.zero_date_s is None:
        return between_s
    # Dates that are numbers of days are no more exact.
    return round(between_s + later.zero_date_s - earlier.zero_date_s, 3)


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

    names = ("temperature_degc", "step", "row", "charge_ah", "cycle", "state")
    begun = {name: getattr(record, name) for name in names}
    found = replace(
        record,
        time_s=mean(record.time_s),
        current_a=mean(record.current_a),
        voltage_v=mean(record.voltage_v),
        hold=replace(record.hold, value="centered"),
        skipped_ah=None,
        flowing=None,
        **{name: own if own is None else own[first] for name, own in begun.items()},
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


def degc_in_name(name: str) -> float | None:
    """The temperature in degC that a file's name tells, None without such.

    >>> [degc_in_name(name) for name in ("dst_25degC.csv", "ocv-5degC", "us06_minus10degC.csv")]
    [25.0, 5.0, -10.0]
    """
    named = _NAMED_DEGC.search(name)
    if named is None:
        return None
    return -float(named["degrees"]) if named["minus"] else float(named["degrees"])

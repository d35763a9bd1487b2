"""A record as the checks use it, repaired as far as possible, and traits that show its kind."""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, Self

import numpy as np
from jaxtyping import Float, Int

from ..cell.ocv_points import OcvSweeps, find_sweeps
from ..cell.soc_axis import Sweep
from ..errors import counted
from ..metrics import NORMAL_95, t_quantile
from ..notices import Notice
from ..records import Record
from ..records.lag import Lag, find_lag, require_lag
from ..records.record import Segments, reach
from ..records.samples import Samples
from ..records.scale import STILL_V
from ..records.table import LineIndex, notice_at
from ..schema import Json

_FEWEST_READINGS, _MAX_STEPS = 20, 0.9


@dataclass(frozen=True, eq=False)
class CheckInput:
    """A file's samples, with the file's sign of the current, and the record made of them, with each
    voltage in the row of its current.

    Both have the same samples. `capacity_ah` and `given_rest_a`, the current below which the cell
    rests, are the user's. `lag` is that of the voltage, None if it has none or one is given. The
    voltage of a sample is `late_rows` further down in the file.
    """

    samples: Samples
    record: Record
    capacity_ah: float | None
    given_rest_a: float | None
    lag: Lag | None
    is_lag_given: bool
    late_rows: int = 0

    @classmethod
    def of(cls, samples: Samples, record: Record, lag_s: float | None, **user: Any) -> Self:
        """The input of the checks with the user's values; with None, the lag is estimated.

        Raises `InputError` for a lag that is not a number, or is longer than the record.
        """
        require_lag(record, lag_s or 0.0)
        lag = find_lag(record) if lag_s is None else None
        given = cls(samples, record, lag=lag, is_lag_given=lag_s is not None, **user)
        late_s = lag.seconds if lag else lag_s or 0.0
        given = replace(given, late_rows=round(late_s / record.usual_s))
        if not given.late_rows:
            return given
        moved_v = record.voltage_v[given.indices("voltage")]
        samples, record = samples.having(voltage=moved_v), replace(record, voltage_v=moved_v)
        return replace(given, samples=samples, record=record)

    @cached_property
    def charged_ah(self) -> float:
        """All the charge that entered the cell."""
        return float(np.sum(np.maximum(-self.record.moved_ah, 0)))

    @cached_property
    def discharged_ah(self) -> float:
        """All the charge that left the cell."""
        return float(np.sum(np.maximum(self.record.moved_ah, 0)))

    @cached_property
    def scale_ah(self) -> float:
        """The capacity: the given one, else the charge the record spans."""
        return self.capacity_ah or self.record.span_ah

    @cached_property
    def segments(self) -> Segments:
        """Rests and loads, by the given current or a hundredth of the capacity."""
        return self.record.segments(self.given_rest_a or self.record.rest_current_a(self.scale_ah))

    @cached_property
    def resolution_v(self) -> float:
        """The resolution of the voltage readings, in V; zero if too few of them differ."""
        return _resolution(self.record.voltage_v)

    @cached_property
    def resolution_a(self) -> float:
        """The resolution of the current readings, in A; zero if too few of them differ."""
        return _resolution(self.record.current_a)

    @cached_property
    def response_ohm(self) -> float:
        """The resistance that most current steps stay below, two samples after them.

        A voltage that is logged late shows less at the step itself.
        """
        at = self.samples.steps
        if not len(at):
            return 0.0
        before, after = np.maximum(at - 1, 0), np.minimum(at + 2, self.record.samples - 1)
        moved_v = np.abs(self.record.voltage_v[after] - self.record.voltage_v[before])
        return float(np.quantile(moved_v / np.abs(self.samples.step_a[at]), _MAX_STEPS))

    @cached_property
    def ocv(self) -> OcvSweeps:
        """The OCV sweeps of the record, or the reason why it is not an OCV test."""
        return find_sweeps(self.record, self.capacity_ah)

    def indices(self, channel: str) -> Int[np.ndarray, "samples"]:
        """The index in the file of each sample's reading of a channel."""
        late = self.late_rows if channel == "voltage" else 0
        return np.clip(np.arange(self.record.samples) + late, 0, self.record.samples - 1)

    def at(self, line: LineIndex, code: str, channel: str = "current", /, **values: Any) -> Notice:
        """A notice of one sample, or the first of several, in the row of its channel."""
        line = int(np.argmax(line)) if isinstance(line, np.ndarray) else line
        return notice_at(self.samples, int(self.indices(channel)[line]), code, **values)


Check = Callable[[CheckInput], Iterable[Notice]]


def _resolution(readings: Float[np.ndarray, "samples"]) -> float:
    steps = np.diff(np.unique(readings))
    # Conversions leave differences in the last bits.
    steps = steps[steps > 1e-9]
    return float(steps.min()) if len(steps) >= _FEWEST_READINGS else 0.0


Kind = Literal[
    "OCV test", "slow sweep", "pulse test", "drive cycle", "capacity test", "charge", "no test"
]

# The share of R0 that its 95 % interval may reach to either side, and the longest sampling interval
# that still shows the response after a current step.
MAX_HALF_WIDTH, FINE_S = 1 / 3, 10.5
# The standard deviation of log R0 between the first step and the last, from which it is predicted
# between steps: a random walk, because R0 depends on the SOC.
_DRIFT, _BETWEEN = 0.5, 201
# Steps that extend over a smaller part of the capacity, or the bulk time of a steep end, say
# little.
LEAST_SHARE, STEEP_S, _FEWEST_ANSWERS = 0.05, 20.0, 3
# Pulses and rests alone give two steps per point; an HPPC test has pulses of its own in addition.
_STEPS_A_POINT = 3
# A discharge of this share of the total charge was part of a capacity test.
_MOST = 0.8


@dataclass(frozen=True)
class Traits:
    """Numbers that determine the possible roles of a record, and `facts` to be shown with them,
    with units in the keys.

    `steps` are the current steps that are sampled finely enough; they extend over `reach_ah` of
    charge. `half_width_at_steps` and `half_width_between` are predicted half-widths of the 95 %
    interval of R0, as shares of it, at the steps and at half of the charge between them; infinite
    if R0 is not identifiable. `steep_v` is the travel of the voltage if the cell is at a steep end
    throughout, else zero. `temperature_degc` is the column's median, else the one in the name, else
    None.
    """

    facts: Json = field(default_factory=dict)
    sweeps: tuple[Sweep, ...] = ()
    steps: int = 0
    reach_ah: float = 0.0
    half_width_at_steps: float = math.inf
    half_width_between: float = math.inf
    span_ah: float = 0.0
    charged_ah: float = 0.0
    discharged_ah: float = 0.0
    longest_discharge_ah: float = 0.0
    interval_s: float = math.inf
    steep_v: float = 0.0
    constant_v: float | None = None
    temperature_degc: float | None = None

    @property
    def is_slow(self) -> bool:
        """True if the record has only slow sweeps."""
        return bool(self.sweeps) and all(sweep.kind == "slow" for sweep in self.sweeps)

    def kind(self, capacity_ah: float | None, has_test: bool = False) -> Kind:
        """The kind of test, for a cell of this capacity; with an OCV test, the fit's interval of R0
        decides whether the steps of a charge suffice."""
        if self.sweeps:
            points = sum(len(sweep.points) - 1 for sweep in self.sweeps)
            has_pulses = self.steps >= _STEPS_A_POINT * points
            return "slow sweep" if self.is_slow else "pulse test" if has_pulses else "OCV test"
        if not self.missing_for(capacity_ah):
            return "drive cycle"
        whole_ah = capacity_ah or self.span_ah
        is_dead = self.steep_v or self.constant_v is not None
        if is_dead or self.span_ah < LEAST_SHARE * whole_ah:
            return "no test"
        if self.longest_discharge_ah > _MOST * whole_ah:
            return "capacity test"
        if has_test and self.half_width_at_steps < math.inf:
            return "drive cycle"
        return "charge" if self.charged_ah > self.discharged_ah else "no test"

    def half_width(self, is_validated: bool) -> float:
        """The predicted half-width of the interval of R0 that decides whether a record can be used:
        for validation it need not be determined between the steps."""
        return self.half_width_at_steps if is_validated else self.half_width_between

    def missing_for(self, capacity_ah: float | None, is_validated: bool = False) -> str:
        """The reason why no circuit can be identified, or validated, on the record; empty if one
        can."""
        return self.unfit(capacity_ah) or self.steps_lack(capacity_ah, is_validated)

    def unfit(self, capacity_ah: float | None) -> str:
        """A reason that no current steps would change; empty if there is none."""
        if self.constant_v is not None:
            return f"every voltage is {self.constant_v:.6g} V"
        if self.is_slow and self.half_width_at_steps <= MAX_HALF_WIDTH:
            steps = counted(self.steps, "current step")
            return f"it holds a slow sweep beside {steps}; give the part with the steps by itself"
        if self.is_slow:
            return "a slow sweep does not show what follows a step of current"
        if self.steep_v:
            moved = f"{self.span_ah:.3g} Ah move its voltage by {self.steep_v:.2g} V"
            return f"the cell is at the steep end of its OCV: {moved}"
        if capacity_ah is not None and self.span_ah < LEAST_SHARE * capacity_ah:
            share = 100 * self.span_ah / capacity_ah
            of = f"{share:.2g} % of the capacity of {capacity_ah:.4g} Ah"
            return f"it spans {self.span_ah:.3g} Ah, {of}"
        return ""

    def steps_lack(self, capacity_ah: float | None, is_validated: bool) -> str:
        """What the current steps lack to identify the resistances on their own, if anything."""
        half_width = self.half_width(is_validated)
        steps = counted(self.steps, "current step")
        if half_width > MAX_HALF_WIDTH:
            wanted = f"{100 * MAX_HALF_WIDTH:.0f} % is needed without an OCV test"
            if not self.steps:
                return f"no current step is sampled finely enough to determine R0; {wanted}"
            within = f" only within {100 * half_width:.0f} %" if half_width < math.inf else ""
            sampled = f"{steps} sampled finely enough"
            return f"{sampled} {'' if within else 'do not '}determine R0{within}; {wanted}"
        # Without a capacity, an oscillation is recognized by how often it reverses.
        whole_ah = capacity_ah or self.charged_ah + self.discharged_ah
        if self.reach_ah < LEAST_SHARE * whole_ah:
            share = 100 * self.reach_ah / whole_ah
            of = "the capacity" if capacity_ah else "what it passes"
            return f"its {steps} lie within {self.reach_ah:.2g} Ah, {share:.2g} % of {of}"
        return ""


# The traits of a file that is not a record.
NO_TRAITS = Traits()


def traits_of(given: CheckInput) -> Traits:
    """The numbers that determine the kind of a record."""
    record = given.record
    fine = np.flatnonzero(given.samples.is_step & (record.interval_s <= FINE_S))
    discharged_ah = record.discharged_ah
    loaded_s = record.interval_s[~given.segments.is_rested[1:]]
    bulk_s, travel_v = given.samples.bulk_time
    # With fewer responses of the voltage, as in a charge with steps only at its ends, a steep end
    # cannot be recognized.
    answered = np.count_nonzero(given.samples.answer_v[given.samples.steps])
    # The deepest point below the highest one before it: discharged charge without recharging.
    out_ah = discharged_ah - np.minimum.accumulate(discharged_ah)
    at_steps = _half_width(given.samples.step_a[fine], given.samples.answer_v[fine])
    facts = {
        "samples": record.samples,
        "time [s]": (float(record.time_s[0]), float(record.time_s[-1])),
        "median interval [s]": given.samples.interval_s,
        "voltage [V]": (float(record.voltage_v.min()), float(record.voltage_v.max())),
        "charged [A.h]": given.charged_ah,
        "discharged [A.h]": given.discharged_ah,
        "current sign": record.sign.value,
        "current hold": record.hold.value,
    }
    return Traits(
        facts=facts,
        sweeps=given.ocv.sweeps,
        steps=len(fine),
        reach_ah=reach(discharged_ah[fine]) if len(fine) else 0.0,
        half_width_at_steps=at_steps,
        half_width_between=math.hypot(at_steps, NORMAL_95 * _drift(discharged_ah[fine])),
        span_ah=given.record.span_ah,
        charged_ah=given.charged_ah,
        discharged_ah=given.discharged_ah,
        longest_discharge_ah=float(out_ah.max()),
        interval_s=float(np.median(loaded_s)) if len(loaded_s) else np.inf,
        steep_v=travel_v if answered >= _FEWEST_ANSWERS and 0 < bulk_s < STEEP_S else 0.0,
        constant_v=float(record.voltage_v[0]) if np.ptp(record.voltage_v) <= STILL_V else None,
        temperature_degc=record.usual_degc(),
    )


def _half_width(step_a: Float[np.ndarray, "steps"], step_v: Float[np.ndarray, "steps"]) -> float:
    """The half-width of the 95 % interval of the resistance that fits all steps, as a share of it;
    infinite with fewer than two, because one shows no scatter."""
    product = float(np.sum(step_a * step_v))
    if len(step_a) < 2 or product == 0:
        return math.inf
    left_v = step_v - product / np.sum(step_a**2) * step_a
    error = float(np.linalg.norm(left_v * step_a)) / abs(product)
    freedom = len(step_a) - 1
    return t_quantile(freedom) * error * math.sqrt(len(step_a) / freedom)


def _drift(at_ah: Float[np.ndarray, "steps"]) -> float:
    """The standard deviation of log R0 that half of the charge between the steps stays below."""
    ends_ah = np.sort(at_ah)
    if len(ends_ah) < 2 or ends_ah[0] == ends_ah[-1]:
        return 0.0
    between_ah = np.linspace(ends_ah[0], ends_ah[-1], _BETWEEN)
    after = np.clip(np.searchsorted(ends_ah, between_ah), 1, len(ends_ah) - 1)
    before_ah, after_ah = between_ah - ends_ah[after - 1], ends_ah[after] - between_ah
    # The variance of a random walk between two known values.
    bridge_ah = before_ah * after_ah / np.maximum(before_ah + after_ah, np.finfo(float).tiny)
    return _DRIFT * math.sqrt(np.median(bridge_ah) / (ends_ah[-1] - ends_ah[0]))

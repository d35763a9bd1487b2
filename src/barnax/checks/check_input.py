"""What the checks of a record look at: the record, mended so far as it could be."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from ..cell.ocv_points import Sweep, find_sweeps
from ..errors import InputError
from ..records import Record, is_rested, rest_current_a
from ..records.record import voltage_noise_v
from ..records.samples import Samples
from .finding import Finding, Severity, found_at

# A current step: a change by more than this share of the largest current.
STEP_SHARE = 0.1
# A current that stands still: it changes by less than this share.
STEADY_SHARE = 0.01
_FEWEST_STEPS = 3
_AGREEING = 0.5
_FEWEST_READINGS = 20


@dataclass(frozen=True, eq=False)
class CheckInput:
    """A file's samples, in its own sign of current, and the record made of them.

    Both have the same samples. `capacity_ah` is the one the user gave.
    """

    samples: Samples
    record: Record
    capacity_ah: float | None

    @cached_property
    def span_ah(self) -> float:
        """The charge between the record's fullest and emptiest moments."""
        return float(np.ptp(self.record.discharged_ah))

    @cached_property
    def charged_ah(self) -> float:
        """All the charge that went in."""
        return float(np.sum(np.maximum(-self._moved_ah, 0)))

    @cached_property
    def discharged_ah(self) -> float:
        """All the charge that came out."""
        return float(np.sum(np.maximum(self._moved_ah, 0)))

    @cached_property
    def _moved_ah(self) -> Float[np.ndarray, "intervals"]:
        return self.record.interval_current_a * self.record.interval_s / 3600

    @cached_property
    def scale_ah(self) -> float:
        """The capacity: the given one, else the charge the record spans."""
        return self.capacity_ah or self.span_ah

    @cached_property
    def rest_current_a(self) -> float:
        return rest_current_a(self.record, self.scale_ah)

    @cached_property
    def is_rested(self) -> Bool[np.ndarray, "samples"]:
        return is_rested(self.record, self.rest_current_a)

    @cached_property
    def peak_a(self) -> float:
        return float(np.abs(self.record.current_a).max())

    @cached_property
    def step_a(self) -> Float[np.ndarray, "intervals"]:
        return np.diff(self.record.current_a)

    @cached_property
    def step_v(self) -> Float[np.ndarray, "intervals"]:
        return np.diff(self.record.voltage_v)

    @cached_property
    def is_step(self) -> Bool[np.ndarray, "intervals"]:
        """Where the current steps."""
        return np.abs(self.step_a) > STEP_SHARE * self.peak_a

    @cached_property
    def noise_v(self) -> float:
        """The noise of a voltage step while the current stands still."""
        return voltage_noise_v(self.step_v, np.abs(self.step_a) < STEADY_SHARE * self.peak_a)

    @cached_property
    def resolution_v(self) -> float:
        """The smallest step of the voltage's readings; zero where too few differ to tell."""
        return _resolution(self.record.voltage_v)

    @cached_property
    def resolution_a(self) -> float:
        """The smallest step of the current's readings; zero where too few differ to tell."""
        return _resolution(self.record.current_a)

    @cached_property
    def resistance_ohm(self) -> float:
        """The resistance at the current's steps; zero where too few tell."""
        return step_resistance_ohm(self.step_a[self.is_step], self.step_v[self.is_step])

    @cached_property
    def sweeps(self) -> list[Sweep] | str:
        """The OCV sweeps of the record, or why it is no OCV test."""
        try:
            return find_sweeps(self.record, self.capacity_ah)[0]
        except InputError as problem:
            reason = str(problem).removeprefix(f"{self.record.name} is not an OCV test: ")
            return reason.partition(". An OCV test needs")[0]

    def at(self, sample: int, severity: Severity, what: str, remedy: str = "") -> Finding:
        """A finding at one sample."""
        return found_at(self.samples, sample, severity, what, remedy)


Check = Callable[[CheckInput], Iterable[Finding]]


def step_resistance_ohm(
    step_a: Float[np.ndarray, "steps"], step_v: Float[np.ndarray, "steps"]
) -> float:
    """The median |dV/dI| of the larger half of the current steps; zero where they do not agree.

    They agree where most of dI dV has one sign: small steps among relaxations are outweighed.
    """
    if len(step_a) < _FEWEST_STEPS:
        return 0.0
    product = step_a * step_v
    if abs(product.sum()) < _AGREEING * np.abs(product).sum() or not product.any():
        return 0.0
    is_large = np.abs(step_a) >= np.median(np.abs(step_a))
    return abs(float(np.median(step_v[is_large] / step_a[is_large])))


def _resolution(readings: Float[np.ndarray, "samples"]) -> float:
    steps = np.diff(np.unique(readings))
    # Conversions leave differences in the last bits.
    steps = steps[steps > 1e-9]
    return float(steps.min()) if len(steps) >= _FEWEST_READINGS else 0.0


def bulk_time_s(samples: Samples) -> tuple[float, float]:
    """R dQ/dV over the record, in s, and the travel of its voltage without R I, in V.

    The time is zero where the current's steps do not tell R.
    """
    step_a, step_v = np.diff(samples.current_a), np.diff(samples.voltage_v)
    is_step = (np.abs(step_a) > STEP_SHARE * np.abs(samples.current_a).max()) & (step_v != 0)
    resistance_ohm = step_resistance_ohm(step_a[is_step], step_v[is_step])
    rising = np.sign(np.sum(step_a[is_step] * step_v[is_step]))
    source_v = samples.voltage_v - rising * resistance_ohm * samples.current_a
    low_v, high_v = np.quantile(source_v, [0.02, 0.98])
    travel_v = float(high_v - low_v)
    if not resistance_ohm or travel_v <= 0:
        return 0.0, travel_v
    return resistance_ohm * 3600 * span_ah(samples) / travel_v, travel_v


def span_ah(samples: Samples) -> float:
    """The charge between the fullest and emptiest moments."""
    passed = np.cumsum(samples.current_a[1:] * np.diff(samples.time_s))
    return float(np.ptp(passed)) / 3600

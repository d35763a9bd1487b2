"""The input of the checks: a record, mended so far as it could be."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from ..cell.ocv_points import find_sweeps
from ..cell.soc_axis import Sweep
from ..errors import InputError
from ..notices import Notice
from ..records import Record, is_rested, rest_current_a
from ..records.lag import Known, Lag, answers_ohm, find_lag, require_lag
from ..records.samples import Samples
from ..records.table import found_at

_FEWEST_READINGS, _MAX_STEPS = 20, 0.9


@dataclass(frozen=True, eq=False)
class CheckInput:
    """A file's samples, in its own sign of current, and the record made of them.

    Both have the same samples. `capacity_ah` and `given_rest_a`, the current below which the cell
    rests, are the user's. `lag` is that of the voltage, None where it has none or one is given. The
    voltage of a sample stands `late_rows` further down in the file.
    """

    samples: Samples
    record: Record
    capacity_ah: float | None
    given_rest_a: float | None = None
    lag: Lag | None = None
    is_lag_given: bool = False
    late_rows: int = 0

    @cached_property
    def span_ah(self) -> float:
        """The charge between the record's fullest and emptiest moments."""
        return float(np.ptp(self.record.discharged_ah))

    @cached_property
    def charged_ah(self) -> float:
        """All the charge that went in."""
        return float(np.sum(np.maximum(-self.moved_ah, 0)))

    @cached_property
    def discharged_ah(self) -> float:
        """All the charge that came out."""
        return float(np.sum(np.maximum(self.moved_ah, 0)))

    @cached_property
    def moved_ah(self) -> Float[np.ndarray, "intervals"]:
        """Ampere-hours that came out in each interval."""
        return self.record.moved_ah

    @cached_property
    def scale_ah(self) -> float:
        """The capacity: the given one, else the charge the record spans."""
        return self.capacity_ah or self.span_ah

    @cached_property
    def rest_current_a(self) -> float:
        return self.given_rest_a or rest_current_a(self.record, self.scale_ah)

    @cached_property
    def is_rested(self) -> Bool[np.ndarray, "samples"]:
        return is_rested(self.record, self.rest_current_a)

    @cached_property
    def resolution_v(self) -> float:
        """The smallest step of the voltage's readings; zero where too few differ to tell."""
        return _resolution(self.record.voltage_v)

    @cached_property
    def resolution_a(self) -> float:
        """The smallest step of the current's readings; zero where too few differ to tell."""
        return _resolution(self.record.current_a)

    @property
    def resistance_ohm(self) -> float:
        """The resistance at the current's steps; zero where too few tell."""
        return self.samples.resistance_ohm

    @cached_property
    def response_ohm(self) -> float:
        """The resistance that most steps of the current stay below, two samples after them.

        A voltage that is logged late shows less at the step itself.
        """
        at = self.samples.steps
        if not len(at):
            return 0.0
        before, after = np.maximum(at - 1, 0), np.minimum(at + 2, self.record.samples - 1)
        moved_v = np.abs(self.record.voltage_v[after] - self.record.voltage_v[before])
        return float(np.quantile(moved_v / np.abs(self.samples.step_a[at]), _MAX_STEPS))

    @cached_property
    def answers_ohm(self) -> Known | None:
        """The answers of the voltage to a step of the current; None where too few steps tell."""
        return answers_ohm(self.record)

    @cached_property
    def source_v(self) -> Float[np.ndarray, "samples"]:
        """The voltage without the drop over the resistance."""
        return self.record.voltage_v + self.resistance_ohm * self.record.current_a

    @cached_property
    def sweeps(self) -> list[Sweep] | str:
        """The OCV sweeps of the record, or why it is no OCV test."""
        try:
            return find_sweeps(self.record, self.capacity_ah)[0]
        except InputError as problem:
            is_other = problem.code == "ocv-test.none"
            return problem.notice.values["reason"] if is_other else str(problem)

    def places(self, channel: str) -> Int[np.ndarray, "samples"]:
        """Where the file has each sample's reading of a channel."""
        late = self.late_rows if channel == "voltage" else 0
        return np.clip(np.arange(self.record.samples) + late, 0, self.record.samples - 1)

    def at(
        self,
        place: int | Bool[np.ndarray, "samples"],
        code: str,
        channel: str = "current",
        /,
        **values: Any,
    ) -> Notice:
        """A notice of one sample, or the first of several, in the row of its channel."""
        place = int(np.argmax(place)) if isinstance(place, np.ndarray) else place
        return found_at(self.samples, int(self.places(channel)[place]), code, **values)


def in_its_rows(given: CheckInput, lag_s: float | None) -> CheckInput:
    """The same with each voltage in the row of its current; a lag of None is looked for.

    Raises `InputError` for a lag that is no number, or is longer than the record.
    """
    record = given.record
    require_lag(record, lag_s or 0.0)
    lag = find_lag(record) if lag_s is None else None
    known_s = lag.seconds if lag else lag_s or 0.0
    rows = round(known_s / float(np.median(record.interval_s)))
    given = replace(given, lag=lag, is_lag_given=lag_s is not None, late_rows=rows)
    if not rows:
        return given
    moved_v = record.voltage_v[given.places("voltage")]
    samples = given.samples.having(voltage=moved_v)
    return replace(given, samples=samples, record=replace(record, voltage_v=moved_v))


Check = Callable[[CheckInput], Iterable[Notice]]


def _resolution(readings: Float[np.ndarray, "samples"]) -> float:
    steps = np.diff(np.unique(readings))
    # Conversions leave differences in the last bits.
    steps = steps[steps > 1e-9]
    return float(steps.min()) if len(steps) >= _FEWEST_READINGS else 0.0

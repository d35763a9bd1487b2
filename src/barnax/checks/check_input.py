"""A record as the checks see it, mended so far as it could be."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from jaxtyping import Float, Int

from ..cell.ocv_points import OcvSweeps, find_sweeps
from ..notices import Notice
from ..records import Record
from ..records.lag import Lag, find_lag, require_lag
from ..records.record import Segments
from ..records.samples import Samples
from ..records.table import LineIndex, notice_at

_FEWEST_READINGS, _MAX_STEPS = 20, 0.9


@dataclass(frozen=True, eq=False)
class CheckInput:
    """A file's samples, in its own sign of current, and the record made of them, each voltage in
    the row of its current.

    Both have the same samples. `capacity_ah` and `given_rest_a`, the current below which the cell
    rests, are the user's. `lag` is that of the voltage, None where it has none or one is given. The
    voltage of a sample stands `late_rows` further down in the file.
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
        """The input of the checks with the user's values; a lag of None is looked for.

        Raises `InputError` for a lag that is no number, or is longer than the record.
        """
        require_lag(record, lag_s or 0.0)
        lag = find_lag(record) if lag_s is None else None
        given = cls(samples, record, lag=lag, is_lag_given=lag_s is not None, **user)
        late_s = lag.seconds if lag else lag_s or 0.0
        given = replace(given, late_rows=round(late_s / record.usual_s))
        if not given.late_rows:
            return given
        moved_v = record.voltage_v[given.places("voltage")]
        samples, record = samples.having(voltage=moved_v), replace(record, voltage_v=moved_v)
        return replace(given, samples=samples, record=record)

    @cached_property
    def charged_ah(self) -> float:
        """All the charge that went in."""
        return float(np.sum(np.maximum(-self.record.moved_ah, 0)))

    @cached_property
    def discharged_ah(self) -> float:
        """All the charge that came out."""
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
        """The smallest step of the voltage's readings; zero where too few differ to tell."""
        return _resolution(self.record.voltage_v)

    @cached_property
    def resolution_a(self) -> float:
        """The smallest step of the current's readings; zero where too few differ to tell."""
        return _resolution(self.record.current_a)

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
    def source_v(self) -> Float[np.ndarray, "samples"]:
        """The voltage without the drop over the resistance."""
        return self.record.voltage_v + self.samples.resistance_ohm * self.record.current_a

    @cached_property
    def ocv(self) -> OcvSweeps:
        """The OCV sweeps of the record, or why it is no OCV test."""
        return find_sweeps(self.record, self.capacity_ah)

    def places(self, channel: str) -> Int[np.ndarray, "samples"]:
        """Where the file has each sample's reading of a channel."""
        late = self.late_rows if channel == "voltage" else 0
        return np.clip(np.arange(self.record.samples) + late, 0, self.record.samples - 1)

    def at(self, line: LineIndex, code: str, channel: str = "current", /, **values: Any) -> Notice:
        """A notice of one sample, or the first of several, in the row of its channel."""
        line = int(np.argmax(line)) if isinstance(line, np.ndarray) else line
        return notice_at(self.samples, int(self.places(channel)[line]), code, **values)


Check = Callable[[CheckInput], Iterable[Notice]]


def _resolution(readings: Float[np.ndarray, "samples"]) -> float:
    steps = np.diff(np.unique(readings))
    # Conversions leave differences in the last bits.
    steps = steps[steps > 1e-9]
    return float(steps.min()) if len(steps) >= _FEWEST_READINGS else 0.0

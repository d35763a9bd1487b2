"""One measured record: time, current and voltage of one cell, checked and in one convention."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

Hold = Literal["forward", "backward"]
Strength = Literal["given", "strong", "weak", "assumed"]


@dataclass(frozen=True)
class Decision:
    """What was decided about a file, how firmly, and why, in words for the user."""

    value: str
    strength: Strength
    reason: str


@dataclass(frozen=True, eq=False)
class Record:
    """A checked record. Discharge current is positive; time strictly increases.

    The arrays are the record's own and cannot be written to.

    `hold` says whether a sample's current flowed in the interval after it ("forward") or before
    it ("backward"). `row` is each sample's row in the source file, the header being row 1, so
    that a message can name it. `sign` holds the file's own convention
    ("charge-positive" or "discharge-positive") and the reason it was taken for that.
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
    warnings: tuple[str, ...] = ()

    def __post_init__(self):
        for name, values in vars(self).copy().items():
            if isinstance(values, np.ndarray):
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
        """The current that flowed between neighboring samples, by the record's hold."""
        return self.current_a[:-1] if self.hold.value == "forward" else self.current_a[1:]

    @property
    def discharged_ah(self) -> Float[np.ndarray, "samples"]:
        """Ampere-hours taken out since the first sample."""
        passed = np.cumsum(self.interval_current_a * self.interval_s) / 3600
        return np.concatenate([np.zeros(1), passed])

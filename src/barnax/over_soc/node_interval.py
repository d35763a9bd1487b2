"""A value of a table, a constant or a mean, with its confidence interval."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

# The ends of what another record would show.
RECORD_ENDS = ("record_low", "record_high")


@dataclass(frozen=True)
class NodeInterval:
    """One node's value of one table with its confidence interval; `soc` is None of a constant.

    `standard_error` allows for the residuals' autocorrelation, `bias` is what smoothing and the
    straight lines between nodes may have moved; the interval holds both. Of a value at a bound only
    the other end is known, and the error is zero; of one that no sample depends on, neither is.
    A mean over SOC has no `soc` either. `record_low` and
    `record_high` are what another record of the cell would show, by the spread of those identified
    on; None of fewer than three.
    """

    name: str
    soc: float | None
    value: float
    standard_error: float
    bias: float
    low: float | None
    high: float | None
    record_low: float | None = None
    record_high: float | None = None

    @property
    def is_biased(self) -> bool:
        """True where the value may have been moved further than its standard error."""
        return abs(self.bias) > self.standard_error

    @property
    def on_another_record(self) -> "NodeInterval":
        """What another record of the cell would show."""
        return replace(self, low=self.record_low, high=self.record_high)

    def opened(self) -> "NodeInterval":
        """The same, not determined."""
        ends = dict.fromkeys(("low", "high", "record_low", "record_high"))
        return replace(self, standard_error=0.0, **ends)

    def between(self, other: "NodeInterval", soc: float) -> "NodeInterval":
        """What lies on the line to another node: no wider, for what the two leave open is not all
        in common. Not determined where one of them is not."""
        first, last = self.soc or 0.0, other.soc or 0.0
        share = (soc - first) / (last - first)
        pairs = {
            name: (getattr(self, name), getattr(other, name))
            for name in ("value", "standard_error", "bias", "low", "high", *RECORD_ENDS)
        }
        lines = {
            name: None if None in pair else (1 - share) * pair[0] + share * pair[1]
            for name, pair in pairs.items()
        }
        line = replace(self, soc=soc, **lines)
        return line.opened() if line.low is None or line.high is None else line

    def moved(self, by: float) -> "NodeInterval":
        """The same with value and interval counted from elsewhere."""
        ends = {
            name: None if (end := getattr(self, name)) is None else end + by
            for name in ("low", "high", "record_low", "record_high")
        }
        return replace(self, value=self.value + by, **ends)

    def spanning(self, shifts: Sequence[float]) -> "NodeInterval":
        """The same with an interval that includes those of equally possible values so far off."""
        ends = {}
        if self.low is not None:
            ends["low"] = max(self.low + min([0.0, *shifts]), 0.0)
        if self.high is not None:
            ends["high"] = self.high + max([0.0, *shifts])
        # Another record leaves it open too.
        if self.record_low is not None and self.record_high is not None:
            ends["record_low"] = min(self.record_low, ends.get("low", self.record_low))
            ends["record_high"] = max(self.record_high, ends.get("high", self.record_high))
        return replace(self, **ends)

"""One line of the table: a work, its baseline in the same turns, the aim, and whether it is met."""

from dataclasses import dataclass
from typing import Literal

Kind = Literal["times faster", "times as long"]


@dataclass(frozen=True)
class Row:
    """Seconds of ours and of the baseline; `ratio` is in the words of `kind`.

    "times faster" wants a ratio of at least `aim`, "times as long" one of at most that; without
    an aim the ratio is stated and that is all. `note` says what was counted.
    """

    work: str
    ours_s: float
    baseline: str
    baseline_s: float
    ratio: float
    kind: Kind
    aim: float | None
    note: str = ""

    @property
    def verdict(self) -> str:
        """Met, or missed by how much."""
        if self.aim is None:
            return "stated"
        is_faster = self.kind == "times faster"
        lack = self.aim / self.ratio if is_faster else self.ratio / self.aim
        return "met" if lack <= 1 else f"missed by a factor of {lack:.2g}"

    @property
    def aim_text(self) -> str:
        if self.aim is None:
            return "-"
        bound = "at least" if self.kind == "times faster" else "at most"
        return f"{bound} {self.aim:g} {self.kind}"


def seconds(value: float) -> str:
    """A time with three figures and its unit.

    >>> seconds(0.0123)
    '12.3 ms'
    """
    for factor, unit in ((1.0, "s"), (1e3, "ms"), (1e6, "us")):
        if value * factor >= 1:
            digits = f"{value * factor:.3g}"
            return f"{float(digits):g} {unit}" if float(digits) < 1e4 else f"{value:.0f} {unit}"
    return f"{value * 1e9:.3g} ns"

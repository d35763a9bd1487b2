"""Values of tables, constants and means over SOC, each with its confidence interval."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from ..cell.soc_axis import ABOVE_SOC, is_above
from .objective import TableObjective

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


def node_weights(
    nodes: Float[np.ndarray, "nodes"], visited: Bool[np.ndarray, "nodes"]
) -> Float[np.ndarray, "nodes"]:
    """The weights of nodes in the mean over SOC of what is linear between them.

    It is taken between visited neighbors, above 10 % SOC; where there are none, the visited nodes
    count alike.

    >>> nodes, visited = np.array([0.0, 0.2, 0.6, 1.0]), np.array([True, True, True, False])
    >>> np.round(node_weights(nodes, visited), 3).tolist()
    [0.05, 0.55, 0.4, 0.0]
    """
    first, last = nodes[:-1], nodes[1:]
    low = np.maximum(first, ABOVE_SOC)
    length = np.where(visited[:-1] & visited[1:], np.maximum(last - low, 0.0), 0.0)
    to_last = length * ((low + last) / 2 - first) / (last - first)
    weights = np.append(length - to_last, 0.0) + np.append(0.0, to_last)
    if not weights.any():
        above = visited & is_above(nodes)
        weights = 1.0 * (above if above.any() else visited)
    return weights / weights.sum()


def mean_weights(objective: TableObjective, name: str) -> Float[np.ndarray, "values"]:
    """The same of the values of all tables, for a table or a sum such as "R1 + R2 [Ohm]"."""
    weights = np.zeros(len(objective.to_tables))
    for part in parts_of(name):
        table = objective.names.index(part)
        own = node_weights(objective.nodes_of[table], objective.visited_of(table))
        weights[objective.block(table)] = own
    return weights


def parts_of(name: str) -> list[str]:
    """The resistances that a sum is of.

    >>> parts_of("R1 + R2 [Ohm]"), parts_of("R0 [Ohm]")
    (['R1 [Ohm]', 'R2 [Ohm]'], ['R0 [Ohm]'])
    """
    *others, last = name.split(" + ")
    return [*(f"{part} [Ohm]" for part in others), last]


def sum_name(names: Sequence[str]) -> str:
    """A sum of resistances, as it is called.

    >>> sum_name(["R1 [Ohm]", "R2 [Ohm]"])
    'R1 + R2 [Ohm]'
    """
    return f"{' + '.join(name.removesuffix(' [Ohm]') for name in names)} [Ohm]"

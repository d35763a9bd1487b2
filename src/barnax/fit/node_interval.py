"""Values of tables, constants and means over SOC, each with its confidence interval."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from jaxtyping import Bool, Float

from ..cell.soc_axis import ABOVE_SOC, is_above
from .objective import TableObjective

# The ends of the interval to expect on another record.
ENDS = ("low", "high", "record_low", "record_high")
# A value closer to an end than this share of its interval is at that end.
AT_EDGE = 0.01


@dataclass(frozen=True)
class NodeInterval:
    """The value of one table at one node with its confidence interval; `soc` is None for a
    constant.

    `standard_error` allows for the residuals' autocorrelation, `bias` is the possible effect of
    smoothing and of straight lines between nodes; the interval includes both. For a value at a
    bound only the other end is determined, and the error is zero; for one on which no sample
    depends, neither end is. A mean over SOC has no `soc` either. `record_low` and `record_high` are
    the interval to expect on another record of the cell, from the spread of the identified records;
    None for fewer than three.
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
        """True if the value may have been moved by more than its standard error."""
        return abs(self.bias) > self.standard_error

    @property
    def on_another_record(self) -> Self:
        """A copy with the interval to expect on another record of the cell."""
        return replace(self, low=self.record_low, high=self.record_high)

    def as_undetermined(self) -> "NodeInterval":
        """A copy that is not determined."""
        return replace(self, standard_error=0.0, **dict.fromkeys(ENDS))

    def between(self, other: "NodeInterval", soc: float) -> "NodeInterval":
        """The interval interpolated on the line to another node; the true one is no wider, because
        the errors of the two are not fully shared. An end is open if either node's is."""
        first, last = self.soc or 0.0, other.soc or 0.0
        share = (soc - first) / (last - first)
        pairs = {
            name: (getattr(self, name), getattr(other, name))
            for name in ("value", "standard_error", "bias", *ENDS)
        }
        lines = {
            name: None if None in pair else (1 - share) * pair[0] + share * pair[1]
            for name, pair in pairs.items()
        }
        line = replace(self, soc=soc, **lines)
        return line.as_undetermined() if line.low is None and line.high is None else line

    def moved(self, by: float) -> "NodeInterval":
        """A copy with value and interval shifted."""
        ends = {name: None if (end := getattr(self, name)) is None else end + by for name in ENDS}
        return replace(self, value=self.value + by, **ends)

    def spanning(self, shifts: Sequence[float]) -> "NodeInterval":
        """A copy with the interval extended to equally possible values at these distances."""
        ends = {}
        if self.low is not None:
            ends["low"] = max(self.low + min([0.0, *shifts]), 0.0)
        if self.high is not None:
            ends["high"] = self.high + max([0.0, *shifts])
        # Open for another record too.
        if self.record_low is not None and self.record_high is not None:
            ends["record_low"] = min(self.record_low, ends.get("low", self.record_low))
            ends["record_high"] = max(self.record_high, ends.get("high", self.record_high))
        return replace(self, **ends)


@dataclass(frozen=True)
class Fact(NodeInterval):
    """A number of a fit, in the unit of its name: a node of a table or, without `soc`, a constant
    or a mean over SOC.

    An end is None if the interval is open there. `is_assessed` is True if there is an interval at
    all, and `is_visited` if samples are near the node.
    """

    is_mean: bool = False
    is_assessed: bool = True
    is_visited: bool = True

    @property
    def is_at_edge(self) -> bool:
        """True if the value is at an end of its interval, because smoothing moved it there."""
        if self.low is None or self.high is None or self.record_low is not None:
            return False
        near = AT_EDGE * (self.high - self.low)
        return min(self.value - self.low, self.high - self.value) <= near

    @property
    def label(self) -> str:
        """The short name in a list of numbers."""
        return f"mean {self.name}" if self.is_mean else self.name


def node_weights(
    nodes: Float[np.ndarray, "nodes"], visited: Bool[np.ndarray, "nodes"]
) -> Float[np.ndarray, "nodes"]:
    """The weights of nodes in the mean over SOC of a function linear between them.

    The mean is taken between visited neighbors above 10 % SOC; without any, all visited nodes have
    equal weights.

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
    """The weights of the values of all tables in the mean of a table, or of a sum such as "R1 + R2
    [Ohm]".
    """
    weights = np.zeros(len(objective.to_tables))
    for part in parts_of(name):
        table = objective.names.index(part)
        of_nodes = node_weights(objective.nodes_of[table], objective.visited_of(table))
        weights[objective.block(table)] = of_nodes
    return weights


def parts_of(name: str) -> list[str]:
    """The resistances in a sum.

    >>> parts_of("R1 + R2 [Ohm]"), parts_of("R0 [Ohm]")
    (['R1 [Ohm]', 'R2 [Ohm]'], ['R0 [Ohm]'])
    """
    *others, last = name.split(" + ")
    return [*(f"{part} [Ohm]" for part in others), last]


def sum_name(names: Sequence[str]) -> str:
    """The name of a sum of resistances.

    >>> sum_name(["R1 [Ohm]", "R2 [Ohm]"])
    'R1 + R2 [Ohm]'
    """
    return f"{' + '.join(name.removesuffix(' [Ohm]') for name in names)} [Ohm]"

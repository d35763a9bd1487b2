"""The curves that tables approximate by straight lines between nodes.

A resistance or an OCV over SOC is smooth; its table is linear from node to node. Least squares put
these lines below the curve at the nodes where it bends upward, and the part that lines cannot
represent moves other values. The curve is taken to be the cubic spline whose best approximation by
lines is the table.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from ..cell.soc_axis import ABOVE_SOC
from .objective import Solution, TableObjective

# Points of Gauss quadrature between two nodes: exact for a cubic times a line.
POINTS = 4


def chord_offset(
    nodes: Float[np.ndarray, "nodes"], values: Float[np.ndarray, "nodes"]
) -> Float[np.ndarray, "nodes"]:
    """Distances at the nodes of a curve above its best approximation by lines.

    Assumes evenly distributed samples. A twelfth of the second difference for a parabola on even
    nodes; zero for fewer than three nodes.

    >>> x = np.array([0.0, 0.5, 1.0, 1.5])
    >>> chord_offset(x, x**2).round(6).tolist()
    [0.041667, 0.041667, 0.041667, 0.041667]
    """
    if len(nodes) < 3:
        return np.zeros(len(nodes))
    points, weights = np.polynomial.legendre.leggauss(POINTS)
    steps = np.diff(nodes)
    soc = (nodes[:-1, None] + steps[:, None] * (points + 1) / 2).ravel()
    roots = np.sqrt(steps[:, None] * weights).reshape(-1, 1)
    unit = np.eye(len(nodes))
    lines = np.stack([np.interp(soc, nodes, row) for row in unit], axis=1)
    to_lines = np.linalg.lstsq(roots * lines, roots * CubicSpline(nodes, unit)(soc))[0]
    return np.linalg.solve(to_lines, values) - values


@dataclass(frozen=True)
class TableCurve:
    """The curve of one table at its visited nodes, `sags` above the table."""

    nodes: Float[np.ndarray, "nodes"]
    values: Float[np.ndarray, "nodes"]
    sags: Float[np.ndarray, "nodes"]

    def above_lines(self, soc: Float[np.ndarray, "samples"]) -> Float[np.ndarray, "samples"]:
        """The curve minus the table; zero outside of its nodes."""
        if len(self.nodes) < 3:
            return np.zeros(len(soc))
        curve = CubicSpline(self.nodes, self.values + self.sags)(soc)
        inside = (self.nodes[0] <= soc) & (soc <= self.nodes[-1])
        return np.where(inside, curve - np.interp(soc, self.nodes, self.values), 0.0)

    @property
    def mean_above_lines(self) -> float:
        """The mean of the curve minus the table over its nodes above 10 % SOC."""
        low, high = max(self.nodes[0], ABOVE_SOC), self.nodes[-1]
        if len(self.nodes) < 3 or low >= high:
            return 0.0
        curve = CubicSpline(self.nodes, self.values + self.sags).integrate(low, high)
        ends = np.append(low, self.nodes[self.nodes > low])
        lines = np.trapezoid(np.interp(ends, self.nodes, self.values), ends)
        return float((curve - lines) / (high - low))


def curves_of(objective: TableObjective, best: Solution) -> Iterator[TableCurve]:
    """The curves of all tables."""
    for table, (nodes, values) in enumerate(zip(objective.nodes_of, best.values, strict=True)):
        seen = objective.visited_of(table)
        points = nodes[seen], values[seen]
        yield TableCurve(*points, chord_offset(*points))

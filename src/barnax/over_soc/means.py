"""The mean of a table over the visited SOC above 10 %, as weights of its nodes."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from ..cell.soc_axis import ABOVE_SOC, is_above
from .objective import TableObjective


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

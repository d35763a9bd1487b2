"""Tables over state of charge at several temperatures, and the hat functions of which tables
consist."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from ..records.quantities import KELVIN
from .dependence import between
from .parameters import CircuitParameters, Rows, Table

# Below this, a resistance is at its bound of zero, which has no logarithm.
LEAST_OHM = 1e-7


def hats(soc: Float[np.ndarray, "samples"], nodes: Rows) -> Float[np.ndarray, "samples nodes"]:
    """Each node's share of a table's value at every SOC: linear between nodes, constant beyond.

    >>> hats(np.array([-1.0, 0.25, 1.0]), (0.0, 0.5, 1.0)).tolist()
    [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.0, 0.0, 1.0]]
    """
    at, shares = np.asarray(nodes, float), np.zeros((len(soc), len(nodes)))
    soc = np.clip(soc, at[0], at[-1])
    below = np.clip(np.searchsorted(at, soc, "right") - 1, 0, max(len(at) - 2, 0))
    rows = np.arange(len(soc))
    if len(at) == 1:
        return shares + 1.0
    way = (soc - at[below]) / (at[below + 1] - at[below])
    shares[rows, below], shares[rows, below + 1] = 1 - way, way
    return shares


@dataclass(frozen=True)
class TemperatureTables:
    """A circuit with tables over SOC at several temperatures, from cold to warm, with the same
    nodes and time constants at all of them.

    Raises `InputError` where temperatures do not rise, or tables are not alike.

    >>> cold, warm = (
    ...     CircuitParameters.over_soc((0.5,), (60.0,), (r0,), ((0.01,),)) for r0 in (0.08, 0.02)
    ... )
    >>> stack = TemperatureTables((0.0, 40.0), (cold, warm))
    >>> round(stack.at(18.635).r0, 5), stack.at(-20.0).r0
    (0.04, 0.08)
    """

    temperatures_degc: tuple[float, ...]
    tables: tuple[CircuitParameters, ...]

    def __post_init__(self) -> None:
        if not self.tables or len(self.tables) != len(self.temperatures_degc):
            raise InputError("tables over temperature need one set of tables for each temperature")
        if np.any(np.diff(self.temperatures_degc) <= 0):
            raise InputError("the temperatures of tables must each be above the previous one")
        first = self.tables[0]
        for tables in self.tables:
            alike = (tables.nodes, tables.scales, tables.tables.keys())
            if alike != (first.nodes, first.scales, first.tables.keys()):
                raise InputError(
                    "the tables of all temperatures need the same nodes, the same time constants "
                    "and the same names"
                )

    def at(self, temperature_degc: float) -> CircuitParameters:
        """The tables at a temperature; beyond the ends those of the nearest one. In between the
        logarithm of every resistance is linear in 1/T (Arrhenius), and voltages in T."""
        measured_degc = self.temperatures_degc
        if not measured_degc[0] < temperature_degc < measured_degc[-1]:
            return self.tables[0 if temperature_degc <= measured_degc[0] else -1]
        above = int(np.searchsorted(measured_degc, temperature_degc))
        if measured_degc[above] == temperature_degc:
            return self.tables[above]
        cold, warm = self.tables[above - 1], self.tables[above]
        ends = np.array([measured_degc[above - 1], measured_degc[above]])
        inverse_k = 1 / (ends - KELVIN.offset)
        here = (1 / (temperature_degc - KELVIN.offset) - inverse_k[0]) / np.diff(inverse_k)[0]
        along = (temperature_degc - ends[0]) / np.diff(ends)[0]

        def mixed(name: str) -> Table:
            first, second = (np.array(end.tables[name]) for end in (cold, warm))
            row = (1 - along) * first + along * second
            if name.endswith("[Ohm]"):
                row = _log_linear(first, second, here)
            return tuple(row.tolist())

        return replace(
            cold,
            tables={name: mixed(name) for name in cold.tables},
            visited=tuple(map(all, zip(cold.visited, warm.visited, strict=True))),
            dependence=between(cold.dependence, warm.dependence, temperature_degc, along),
        )


def _log_linear(first: np.ndarray, second: np.ndarray, share: float) -> np.ndarray:
    has_logarithm = np.minimum(first, second) > LEAST_OHM
    powers = np.maximum(first, LEAST_OHM) ** (1 - share) * np.maximum(second, LEAST_OHM) ** share
    return np.where(has_logarithm, powers, (1 - share) * first + share * second)

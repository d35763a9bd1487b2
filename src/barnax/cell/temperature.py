"""Tables over state of charge at several temperatures, and what lies between them."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ..errors import InputError
from .tables import SocTables, Table

ZERO_DEGC_K = 273.15
# What was measured within this is of one temperature.
SAME_DEGC = 5.0
# Where one temperature stands for all, it is that nearest to this.
REFERENCE_DEGC = 25.0
# Below this a resistance is at its bound of zero, which has no logarithm.
LEAST_OHM = 1e-7

Item = TypeVar("Item")


@dataclass(frozen=True)
class TemperatureTables:
    """A circuit tabulated over SOC at some temperatures, from cold to warm, with the same nodes and
    time constants at all of them.

    Raises `InputError` where temperatures do not rise, or tables are not alike.

    >>> cold, warm = (SocTables((0.5,), (60.0,), (r0,), ((0.01,),)) for r0 in (0.08, 0.02))
    >>> tables = TemperatureTables((0.0, 40.0), (cold, warm))
    >>> round(tables.at(18.635).r0_ohm[0], 5), tables.at(-20.0).r0_ohm[0]
    (0.04, 0.08)
    """

    temperatures_degc: tuple[float, ...]
    tables: tuple[SocTables, ...]

    def __post_init__(self) -> None:
        if not self.tables or len(self.tables) != len(self.temperatures_degc):
            raise InputError("tables over temperature need one set of tables for each temperature")
        if np.any(np.diff(self.temperatures_degc) <= 0):
            raise InputError("the temperatures of tables must each be above the previous one")
        first = self.tables[0]
        for each in self.tables:
            alike = (each.nodes, each.constants, each.tables.keys())
            if alike != (first.nodes, first.constants, first.tables.keys()):
                raise InputError(
                    "the tables of all temperatures need the same nodes, the same time constants "
                    "and the same names"
                )

    def at(self, temperature_degc: float) -> SocTables:
        """The tables at a temperature: those of the nearest one beyond the ends. In between the
        logarithm of every resistance is linear in 1/T (Arrhenius), and voltages in T."""
        known = self.temperatures_degc
        if not known[0] < temperature_degc < known[-1]:
            return self.tables[0 if temperature_degc <= known[0] else -1]
        above = int(np.searchsorted(known, temperature_degc))
        if known[above] == temperature_degc:
            return self.tables[above]
        cold, warm = self.tables[above - 1], self.tables[above]
        ends = np.array([known[above - 1], known[above]])
        inverse_k = 1 / (ZERO_DEGC_K + ends)
        here = (1 / (ZERO_DEGC_K + temperature_degc) - inverse_k[0]) / np.diff(inverse_k)[0]
        along = (temperature_degc - ends[0]) / np.diff(ends)[0]

        def resistance(first: Table, second: Table) -> Table:
            return _mixed(_log_linear, first, second, here)

        def voltage(first: Table | None, second: Table | None) -> Table | None:
            if first is None or second is None:
                return None
            return _mixed(_linear, first, second, along)

        return SocTables(
            nodes=cold.nodes,
            tau_s=cold.tau_s,
            r0_ohm=resistance(cold.r0_ohm, warm.r0_ohm),
            r_ohm=tuple(map(resistance, cold.r_ohm, warm.r_ohm)),
            ocv_correction_v=voltage(cold.ocv_correction_v, warm.ocv_correction_v),
            half_hysteresis_v=voltage(cold.half_hysteresis_v, warm.half_hysteresis_v),
            gamma=cold.gamma,
            visited=tuple(a and b for a, b in zip(cold.visited, warm.visited, strict=True)),
        )


def group_near(known: Iterable[tuple[float, Item]]) -> dict[float, list[Item]]:
    """What is within `SAME_DEGC` of the coldest together, under the mean of their temperatures.

    >>> group_near([(25.0, "a"), (0.0, "b"), (27.0, "c")])
    {0.0: ['b'], 26.0: ['a', 'c']}
    """
    groups: list[list[tuple[float, Item]]] = []
    for degc, each in sorted(known, key=lambda pair: pair[0]):
        if not groups or degc - groups[-1][0][0] > SAME_DEGC:
            groups.append([])
        groups[-1].append((degc, each))
    return {
        float(np.mean([degc for degc, _ in group])): [each for _, each in group] for group in groups
    }


def _mixed(mix: Callable, first: Table, second: Table, share: float) -> Table:
    return tuple(mix(np.array(first), np.array(second), share).tolist())


def _linear(first: np.ndarray, second: np.ndarray, share: float) -> np.ndarray:
    return (1 - share) * first + share * second


def _log_linear(first: np.ndarray, second: np.ndarray, share: float) -> np.ndarray:
    has_logarithm = np.minimum(first, second) > LEAST_OHM
    powers = np.maximum(first, LEAST_OHM) ** (1 - share) * np.maximum(second, LEAST_OHM) ** share
    return np.where(has_logarithm, powers, _linear(first, second, share))

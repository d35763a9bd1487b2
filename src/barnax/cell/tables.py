"""A circuit whose resistances are tables over state of charge, at one or several temperatures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ..display import Brief
from ..errors import InputError
from .dependence import ZERO_DEGC_K, Dependence, between
from .elements import RC, names_of, require_order, rungs_of
from .parameters import OHMIC, RATE

OCV_CORRECTION = "OCV correction [V]"
HALF_HYSTERESIS = "half hysteresis [V]"

# Below this a resistance is at its bound of zero, which has no logarithm.
LEAST_OHM = 1e-7

Table = tuple[float, ...]


def hats(
    soc: Float[np.ndarray, "samples"], nodes: Sequence[float] | Float[np.ndarray, "nodes"]
) -> Float[np.ndarray, "samples nodes"]:
    """Each node's share of a table's value at every SOC: linear between nodes, constant beyond.

    >>> hats(np.array([-1.0, 0.25, 1.0]), (0.0, 0.5, 1.0)).tolist()
    [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [0.0, 0.0, 1.0]]
    """
    return np.stack([np.interp(soc, nodes, each) for each in np.eye(len(nodes))], axis=1)


@dataclass(frozen=True, repr=False)
class SocTables(Brief):
    """A circuit with tables over SOC: one value per node, linear between nodes, constant beyond.

    Args:
        nodes: States of charge, increasing.
        tau_s: Time constant of each RC pair, the same at every SOC.
        r0_ohm: Ohmic resistance at the nodes.
        r_ohm: Resistance of each pair at the nodes.
        ocv_correction_v: What is added to the average OCV at the nodes; None means no correction.
        half_hysteresis_v: Amplitude of a dynamic hysteresis at the nodes; None uses half the
            measured hysteresis voltage.
        gamma: Rate of a dynamic hysteresis per unit of SOC.
        visited: True for nodes that are the nearest of some counted sample: the values of the
            others follow from their neighbors and mean nothing by themselves.
        elements: What each pair is, by name; an RC pair where nothing is said.
        dependence: What the resistances follow beside SOC; None for nothing.

    Raises `InputError` if nodes do not rise or a table has another length.

    >>> tables = SocTables((0.0, 1.0), (60.0,), (0.06, 0.04), ((0.02, 0.01),), visited=(True, True))
    >>> float(tables.at("R0 [Ohm]", np.array([0.5]))[0])
    0.05
    """

    nodes: Table
    tau_s: Table
    r0_ohm: Table
    r_ohm: tuple[Table, ...]
    ocv_correction_v: Table | None = None
    half_hysteresis_v: Table | None = None
    gamma: float | None = None
    visited: tuple[bool, ...] = ()
    elements: tuple[str, ...] = ()
    dependence: Dependence | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "elements", self.elements or (RC.name,) * len(self.tau_s))
        require_nodes(self.nodes)
        require_order(self.elements)
        if not len(self.r_ohm) == len(self.tau_s) == len(self.elements):
            raise InputError(
                f"a circuit has a table of R and a time constant for each of its "
                f"{len(self.elements)} elements; {len(self.r_ohm)} tables of R and "
                f"{len(self.tau_s)} time constants were given"
            )
        for name, table in self.tables.items():
            if len(table) != len(self.nodes):
                raise InputError(
                    f"the table of {name} has {len(table)} values for {len(self.nodes)} nodes"
                )

    @property
    def pairs(self) -> int:
        return len(self.tau_s)

    @property
    def tables(self) -> Mapping[str, Table]:
        """Every table under PyBaMM's name of what it tabulates."""
        names = [each.resistance for each in names_of(self.elements)]
        named = {OHMIC: self.r0_ohm, **dict(zip(names, self.r_ohm, strict=True))}
        if self.ocv_correction_v is not None:
            named[OCV_CORRECTION] = self.ocv_correction_v
        if self.half_hysteresis_v is not None:
            named[HALF_HYSTERESIS] = self.half_hysteresis_v
        return named

    @property
    def constants(self) -> Mapping[str, float]:
        """What does not change with SOC, by name: the time constants and, if any, gamma and the
        numbers of a dependence."""
        names = [each.tau for each in names_of(self.elements)]
        named = dict(zip(names, self.tau_s, strict=True))
        if self.gamma is not None:
            named[RATE] = self.gamma
        return named if self.dependence is None else named | self.dependence.numbers

    def laddered(self) -> "SocTables":
        """The same tables, those of each element as of the RC pairs that it consists of."""
        rungs = rungs_of(self.elements)
        if len(rungs) == self.pairs:
            return self
        return replace(
            self,
            tau_s=tuple(self.tau_s[each.element] * each.ratio for each in rungs),
            r_ohm=tuple(
                tuple(each.share * value for value in self.r_ohm[each.element]) for each in rungs
            ),
            elements=(RC.name,) * len(rungs),
        )

    def at(self, name: str, soc: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """The table of that name at some states of charge. Raises `KeyError` for an unknown one."""
        return np.interp(soc, self.nodes, self.tables[name])


def require_nodes(nodes: Sequence[float]) -> None:
    """Raise `InputError` unless there are nodes, finite and each above the one before."""
    if not len(nodes) or not np.all(np.isfinite(nodes)) or np.any(np.diff(nodes) <= 0):
        raise InputError(
            f"the nodes {', '.join(f'{node:g}' for node in nodes)} must be states of charge, each "
            "above the previous one"
        )


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
            alike = (each.nodes, each.tau_s, each.gamma, each.tables.keys())
            if alike != (first.nodes, first.tau_s, first.gamma, first.tables.keys()):
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
            elements=cold.elements,
            dependence=between(cold.dependence, warm.dependence, temperature_degc, along),
        )


def _mixed(mix: Callable, first: Table, second: Table, share: float) -> Table:
    return tuple(mix(np.array(first), np.array(second), share).tolist())


def _linear(first: np.ndarray, second: np.ndarray, share: float) -> np.ndarray:
    return (1 - share) * first + share * second


def _log_linear(first: np.ndarray, second: np.ndarray, share: float) -> np.ndarray:
    has_logarithm = np.minimum(first, second) > LEAST_OHM
    powers = np.maximum(first, LEAST_OHM) ** (1 - share) * np.maximum(second, LEAST_OHM) ** share
    return np.where(has_logarithm, powers, _linear(first, second, share))

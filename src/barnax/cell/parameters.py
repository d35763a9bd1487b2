"""The numbers of a circuit, and their names."""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Self

import numpy as np
from jaxtyping import Float, Int
from pydantic import model_serializer, model_validator

from ..display import Brief
from ..errors import InputError
from .dependence import Dependence
from .elements import (
    ELEMENTS,
    RC,
    ElementNames,
    alike,
    element_of,
    names_of,
    require_order,
    rungs_of,
    suffix_of,
)

MAX_PAIRS = 4
OHMIC, RATE = "R0 [Ohm]", "gamma"
OCV_CORRECTION = "OCV correction [V]"
# An OCV in place of a measured one, with its own nodes.
OCV = "OCV [V]"
HALF_HYSTERESIS = "half hysteresis [V]"

Names = Sequence[str]
Table = tuple[float, ...]
Rows = Sequence[float] | np.ndarray

# The one node of a circuit that does not change with SOC; its position has no meaning.
ANYWHERE = (0.5,)


def parameter_names(elements: Sequence[str], has_rate: bool = False) -> tuple[str, ...]:
    """PyBaMM's names of a constant circuit's parameters, with their units.

    >>> parameter_names(("rc", "rc"))
    ('R0 [Ohm]', 'R1 [Ohm]', 'C1 [F]', 'R2 [Ohm]', 'C2 [F]')
    >>> parameter_names(("rc", "diffusion"))
    ('R0 [Ohm]', 'R1 [Ohm]', 'C1 [F]', 'R_D [Ohm]', 'tau_D [s]')
    """
    named = [name for names in names_of(elements) for name in (names.resistance, names.stored)]
    return (OHMIC, *named, *([RATE] if has_rate else []))


def elements_in(names: Iterable[str]) -> tuple[str, ...]:
    """The elements with parameters of these names, in their order.

    >>> elements_in(["R0 [Ohm]", "R1 [Ohm]", "C1 [F]", "R_D [Ohm]", "tau_D [s]"])
    ('rc', 'diffusion')
    """
    symbols = dict.fromkeys(map(suffix_of, names))
    numbers = {str(number): number for number in range(1, MAX_PAIRS + 1)}
    pairs = max((numbers.get(symbol, 0) for symbol in symbols), default=0)
    others = {f"_{element.symbol}": element.name for element in ELEMENTS.values() if element.symbol}
    return (*[RC.name] * pairs, *(others[symbol] for symbol in symbols if symbol in others))


@dataclass(frozen=True, repr=False)
class CircuitParameters(Brief):
    """The numbers of a circuit by name: tables over SOC, and what does not change with it.

    A table is linear between its nodes and constant beyond. A constant circuit has one node; with
    two pairs its numbers are the paper's R, Rpa, Cpa, Rpb, Cpb (Li et al. 2023, Eq. 1-3).

    Args:
        tables: One value per node under each of PyBaMM's names: R0, the resistance of every
            element, and where they are fitted the OCV correction, which is added to the average
            OCV, and the half hysteresis, the amplitude of a dynamic one in place of half the
            measured hysteresis voltage.
        scales: The time constant of every element in s, or of an RC pair of a constant circuit its
            capacitance in F; then the rate of a dynamic hysteresis per unit of SOC, if any.
        nodes: States of charge, increasing.
        visited: True for nodes that are the nearest of some counted sample: the values of the
            others follow from their neighbors and mean nothing on their own.
        dependence: What the resistances follow beside SOC; None for nothing.

    Raises `InputError` if nodes do not rise, a table has another length or is missing, or elements
    are not in order.

    >>> CircuitParameters.constant(r0=0.05, r=(0.02, 0.03), c=(500.0, 2000.0)).tau_s
    (10.0, 60.0)
    >>> tables = {"R0 [Ohm]": (0.06, 0.04), "R1 [Ohm]": (0.02, 0.01)}
    >>> circuit = CircuitParameters(tables, {"tau1 [s]": 60.0}, nodes=(0.0, 1.0))
    >>> float(circuit.at("R0 [Ohm]", np.array([0.5]))[0])
    0.05
    """

    tables: dict[str, Table]
    scales: dict[str, float]
    nodes: Table = ANYWHERE
    visited: tuple[bool, ...] = ()
    dependence: Dependence | None = None

    def __post_init__(self) -> None:
        require_nodes(self.nodes)
        require_order(self.elements)
        missing = [name for name in self.resistances if name not in self.tables]
        if missing:
            raise InputError(f"circuit parameters are missing: {', '.join(missing)}")
        for name, table in self.tables.items():
            if len(table) != len(self.nodes):
                raise InputError(
                    f"the table of {name} has {len(table)} values for {len(self.nodes)} nodes"
                )

    @classmethod
    def constant(
        cls, r0: float, r: Rows, c: Rows, gamma: float | None = None, elements: Names = ()
    ) -> Self:
        """A constant circuit.

        Args:
            r0: Ohmic resistance in ohm.
            r: Resistance of each element in ohm.
            c: Capacitance of each in F; of one that is no RC pair its time constant over R.
            gamma: Rate of a dynamic hysteresis per unit of SOC, None for a circuit without.
            elements: What each is, by name; RC pairs where nothing is said.

        Raises `ValueError` for a value that is not positive and finite.
        """
        names = names_of(elements or (RC.name,) * len(r))
        if not len(r) == len(c) == len(names):
            needed = f"a circuit has one R and one C for each of its {len(names)} elements"
            raise ValueError(f"{needed}; {len(r)} R and {len(c)} C were given")
        numbers = {OHMIC: float(r0)}
        for pair, ohm, farad in zip(names, map(float, r), map(float, c), strict=True):
            numbers |= {
                pair.resistance: ohm,
                pair.stored: farad if pair.capacitance else ohm * farad,
            }
        return cls._of_numbers(numbers if gamma is None else numbers | {RATE: float(gamma)})

    @classmethod
    def of_tau(
        cls, r0: float, r: Rows, tau_s: Rows, gamma: float | None = None, elements: Names = ()
    ) -> Self:
        """The constant circuit whose elements have these resistances and time constants."""
        c = [float(tau / ohm) for ohm, tau in zip(r, tau_s, strict=True)]
        return cls.constant(r0, r, c, gamma, elements)

    @classmethod
    def over_soc(
        cls,
        nodes: Rows,
        tau_s: Rows,
        r0_ohm: Rows,
        r_ohm: Sequence[Rows],
        *,
        ocv_correction_v: Rows | None = None,
        half_hysteresis_v: Rows | None = None,
        gamma: float | None = None,
        visited: Sequence[bool] = (),
        elements: Sequence[str] = (),
        dependence: Dependence | None = None,
    ) -> Self:
        """A circuit whose resistances, in ohm, are tables over SOC, with one value per node."""
        names = names_of(elements or (RC.name,) * len(tau_s))
        if not len(r_ohm) == len(tau_s) == len(names):
            needed = f"a table of R and a time constant for each of its {len(names)} elements"
            given = f"{len(r_ohm)} tables of R and {len(tau_s)} time constants were given"
            raise InputError(f"a circuit has {needed}; {given}")
        rows = {OHMIC: r0_ohm} | dict(zip((pair.resistance for pair in names), r_ohm, strict=True))
        rows |= {OCV_CORRECTION: ocv_correction_v, HALF_HYSTERESIS: half_hysteresis_v}
        tables = {name: tuple(map(float, row)) for name, row in rows.items() if row is not None}
        scales = dict(zip((pair.tau for pair in names), map(float, tau_s), strict=True))
        scales |= {} if gamma is None else {RATE: float(gamma)}
        at = tuple(map(float, nodes))
        return cls(tables, scales, at, tuple(map(bool, visited)), dependence)

    @cached_property
    def elements(self) -> tuple[str, ...]:
        """The elements by name."""
        return tuple(element_of(name).name for name in self.scales if name != RATE)

    @cached_property
    def names(self) -> tuple[ElementNames, ...]:
        """The names of every element's parameters."""
        return names_of(self.elements)

    @property
    def resistances(self) -> tuple[str, ...]:
        """The names of R0 and of every element's resistance."""
        return (OHMIC, *(pair.resistance for pair in self.names))

    @property
    def pairs(self) -> int:
        """Number of elements, usually RC pairs."""
        return len(self.elements)

    @property
    def is_constant(self) -> bool:
        """True for a circuit that does not change with SOC."""
        return self.nodes == ANYWHERE and not self.visited

    @property
    def ohm(self) -> Float[np.ndarray, "resistances nodes"]:
        """R0 and every element's resistance at the nodes."""
        return np.array([self.tables[name] for name in self.resistances])

    @property
    def r0(self) -> float:
        """R0 of a constant circuit, in ohm."""
        return self.tables[OHMIC][0]

    @property
    def r(self) -> tuple[float, ...]:
        """The resistances of the elements of a constant circuit, in ohm."""
        return tuple(self.tables[pair.resistance][0] for pair in self.names)

    @property
    def c(self) -> tuple[float, ...]:
        """The capacitances R C / R of the elements of a constant circuit, in F."""
        pairs = zip(self.names, self.tau_s, self.r, strict=True)
        return tuple(
            self.scales.get(pair.capacitance or "", tau_s / ohm) for pair, tau_s, ohm in pairs
        )

    @property
    def named_ohm(self) -> dict[str, float]:
        """Every resistance of a constant circuit by its name, R0 first."""
        return {name: self.tables[name][0] for name in self.resistances}

    @property
    def named_tau_s(self) -> dict[str, float]:
        """Every time constant by its name."""
        return {
            pair.tau: self.scales[pair.tau]
            if pair.tau in self.scales
            else self.tables[pair.resistance][0] * self.scales[pair.stored]
            for pair in self.names
        }

    @property
    def tau_s(self) -> tuple[float, ...]:
        """The time constant of every element, in s."""
        return tuple(self.named_tau_s.values())

    @property
    def gamma(self) -> float | None:
        """The rate of a dynamic hysteresis per unit of SOC, if there is one."""
        return self.scales.get(RATE)

    @property
    def constants(self) -> dict[str, float]:
        """The numbers that do not change with SOC: time constants, gamma, those of a dependence."""
        rate = {} if self.gamma is None else {RATE: self.gamma}
        return self.named_tau_s | rate | (self.dependence.numbers if self.dependence else {})

    def at(self, name: str, soc: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """The table of this name at some states of charge. Raises `KeyError` for an unknown
        name."""
        return np.interp(soc, self.nodes, self.tables[name])

    def level_beyond(self, low_soc: float, high_soc: float) -> Self:
        """A copy with tables that are level beyond the nodes next to these states of charge."""
        nodes = self.nodes_beside(low_soc, high_soc)
        tables = {name: tuple(table[node] for node in nodes) for name, table in self.tables.items()}
        return replace(self, tables=tables)

    def nodes_beside(self, low_soc: float, high_soc: float) -> Int[np.ndarray, "nodes"]:
        """The index of every node; beyond those next to two states of charge, that of the last
        one."""
        first = np.searchsorted(self.nodes, low_soc, side="right") - 1
        last = np.searchsorted(self.nodes, high_soc)
        return np.clip(np.arange(len(self.nodes)), max(first, 0), last)

    def with_tables(self, changed: Mapping[str, Rows]) -> Self:
        """A copy with other values in some tables, or with additional ones."""
        pair = {name: tuple(map(float, row)) for name, row in changed.items()}
        return replace(self, tables=self.tables | pair)

    def without(self, name: str) -> Self:
        """A copy without a table, such as that of the half hysteresis."""
        tables = {each: row for each, row in self.tables.items() if each != name}
        return replace(self, tables=tables)

    def ordered(self) -> Self:
        """The circuit with its pairs from fast to slow."""
        pairs = self.names[: alike(self.elements)]
        by_tau = sorted(pairs, key=lambda pair: self.named_tau_s[pair.tau])
        source = dict(zip(itertools.chain(*pairs), itertools.chain(*by_tau), strict=True))
        tables, scales = (
            {name: values[source.get(name) or name] for name in values}
            for values in (self.tables, self.scales)
        )
        return replace(self, tables=tables, scales=scales)

    def laddered(self) -> Self:
        """The circuit with each element as the RC pairs that it consists of."""
        rungs = rungs_of(self.elements)
        if len(rungs) == self.pairs:
            return self
        taus_s, rows = self.tau_s, self.ohm
        names = names_of((RC.name,) * len(rungs))
        ladder = {
            pair.resistance: tuple((rung.share * rows[1 + rung.element]).tolist())
            for pair, rung in zip(names, rungs, strict=True)
        }
        ladder = {OHMIC: self.tables[OHMIC]} | ladder
        others = {n: row for n, row in self.tables.items() if n not in self.resistances}
        scales = {
            pair.tau: taus_s[rung.element] * rung.ratio
            for pair, rung in zip(names, rungs, strict=True)
        }
        rate = {} if self.gamma is None else {RATE: self.gamma}
        return replace(self, tables=ladder | others, scales=scales | rate)

    def to_dict(self) -> dict[str, float]:
        """The values of a constant circuit under PyBaMM's parameter names."""
        values = self.named_ohm | self.scales
        values |= {
            pair.stored: c for pair, c in zip(self.names, self.c, strict=True) if pair.capacitance
        }
        return {name: values[name] for name in parameter_names(self.elements, RATE in values)}

    @classmethod
    def from_dict(cls, values: Mapping[str, float]) -> Self:
        """The circuit from the values of `to_dict`. Raises `InputError` for a missing or unusable
        value."""
        elements = elements_in(values) or (RC.name,)
        names = parameter_names(elements, has_rate=RATE in values)
        missing = [name for name in names if name not in values]
        if missing:
            raise InputError(f"circuit parameters are missing: {', '.join(missing)}")
        unknown = sorted(values.keys() - set(names))
        if unknown:
            raise InputError(f"these are not circuit parameters: {', '.join(unknown)}")
        try:
            return cls._of_numbers({name: float(values[name]) for name in names})
        except (TypeError, ValueError) as error:
            raise InputError(f"circuit parameters cannot be used: {error}") from error

    @classmethod
    def _of_numbers(cls, numbers: Mapping[str, float]) -> Self:
        tables: dict[str, tuple[float, ...]] = {}
        tables |= {name: (ohm,) for name, ohm in numbers.items() if name.endswith("[Ohm]")}
        made = cls(tables, {name: numbers[name] for name in numbers if name not in tables})
        for name, value in {**numbers, **made.named_tau_s}.items():
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name} must be positive and finite; {value} was given")
        return made

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: Any, handler: Any) -> dict[str, Any]:
        flat = {"type": "object", "additionalProperties": {"type": "number"}}
        return {"anyOf": [flat, handler(schema["schema"])]}

    @model_validator(mode="wrap")
    @classmethod
    def _read(cls, given: Any, by_fields: Any) -> Self:
        """From its stored fields; a constant circuit from the values of `to_dict`."""
        is_flat = isinstance(given, Mapping) and "nodes" not in given
        return cls.from_dict(given) if is_flat else by_fields(given)

    @model_serializer(mode="wrap")
    def _write(self, by_fields: Any) -> Any:
        return self.to_dict() if self.is_constant else by_fields(self)


def require_nodes(nodes: Sequence[float]) -> None:
    """Raise `InputError` unless there are nodes, finite and increasing."""
    if not len(nodes) or not np.all(np.isfinite(nodes)) or np.any(np.diff(nodes) <= 0):
        raise InputError(
            f"the nodes {', '.join(f'{node:g}' for node in nodes)} must be states of charge, each "
            "above the previous one"
        )

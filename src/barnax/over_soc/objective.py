"""The objective of some tables, and its least value for given time constants."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import block_diag

from ..cell import SocTables
from ..cell.circuits import get_circuit
from ..cell.elements import RC, Element, get_element, names_of
from ..cell.parameters import OHMIC, RATE
from ..cell.tables import hats, require_nodes
from ..errors import InputError
from ..model.compressed import BLOCK
from ..model.exponentials import Span
from ..model.prepared import PreparedRecord
from ..model.search_space import Range
from ..settings import TableOptions
from .axes import Axis
from .reduced import Columns, Reduced
from .search import Place, Sides, Solved, least_in_box, least_squares_in_box

FASTEST_TAU_S, SLOWEST_TAU_S = 2.0, 1000.0
# With an OCV correction a slower pair than this share of the record imitates a wrong capacity.
SLOWEST_SHARE = 0.1
# What can be bounded or fixed; which of these a circuit has is known when it is fitted.
TABULATED = re.compile(r"R(\d|_\w+) \[Ohm\]|tau(\d|_\w+) \[s\]|gamma")


@dataclass(frozen=True, kw_only=True)
class TableSettings(TableOptions):
    """Tables over SOC: the options of `TableOptions`, with bounds and fixed values.

    Args:
        bounds: Lowest and highest value by PyBaMM's names; those of a resistance hold at every SOC.
        fixed: Values by the same names; a time constant or gamma has one for all SOC.

    Raises `InputError` for nodes that do not rise, weights that are not positive, and bounds or
    fixed values that are unknown, reversed, negative or both given.
    """

    bounds: Mapping[str, Range] = field(default_factory=dict)
    fixed: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_nodes(self.nodes)
        for name in ("roughness", "resistance_ridge", "voltage_ridge", "block_s"):
            if not 0 < getattr(self, name) < np.inf:
                raise InputError(f"`{name}` {getattr(self, name):g} must be positive")
        if self.folds < 0 or self.folds == 1:
            raise InputError(f"`folds` {self.folds} must be 0 or at least 2")
        for name in [*self.bounds, *self.fixed]:
            if TABULATED.fullmatch(name):
                continue
            raise InputError(
                f"{name!r} cannot be bounded or fixed with tables over SOC; only resistances, time "
                "constants such as 'tau1 [s]' and gamma can"
            )
        for name in self.bounds.keys() & self.fixed.keys():
            raise InputError(f"{name!r} is both bounded and fixed; give one of them")
        for name, (low, high) in self.ranges.items():
            least = 0.0 if name.endswith("[Ohm]") else np.finfo(float).tiny
            if not least <= low <= high < np.inf:
                raise InputError(
                    f"the bounds of {name!r} are [{low:g}, {high:g}]; the lower one comes first, "
                    "and neither is negative"
                )

    @property
    def ranges(self) -> dict[str, Range]:
        """Bounds and fixed values alike, as ranges."""
        return {**self.bounds, **{name: (each, each) for name, each in self.fixed.items()}}


@dataclass(frozen=True, eq=False)
class Solution(Solved):
    """The best tables at a place: rows of R0, every pair's R, then what else is tabulated.

    `unknowns` are the same as the problem in a box has them (`Objective.to_tables`).
    """

    values: Float[np.ndarray, "tables nodes"]
    unknowns: Float[np.ndarray, "unknowns"]
    error: Float[np.ndarray, "rows"]

    @property
    def root(self) -> float:
        """sqrt(J), in V."""
        return math.sqrt(self.squared)


@dataclass(frozen=True, eq=False)
class Objective:
    """J of `settings` over some records of a cell, for circuits with so many pairs.

    `ranges` are those of every pair's time constant in s, then of gamma where there is one, by
    name; places are the logarithms of these. `reduced` is the factor of all scored samples, `parts`
    those of the groups of `blocks_of`; `share` scales all smoothing weights.
    """

    prepared_records: Sequence[PreparedRecord]
    settings: TableSettings
    ranges: Mapping[str, Range]
    reduced: Reduced
    parts: Sequence[Reduced] = ()
    share: float = 1.0

    @property
    def elements(self) -> tuple[str, ...]:
        return get_circuit(self.prepared_records[0].circuit).elements

    @property
    def pairs(self) -> int:
        """How many elements there are, RC pairs mostly."""
        return len(self.ranges) - (RATE in self.ranges)

    @property
    def nodes(self) -> int:
        return len(self.reduced.layout.nodes)

    @cached_property
    def visited(self) -> Bool[np.ndarray, "nodes"]:
        """Which nodes some scored sample is nearest to."""
        found = np.zeros(self.nodes, bool)
        for prepared in self.prepared_records:
            for part in prepared.parts(BLOCK):
                shares = hats(part.soc[part.scored], self.reduced.layout.nodes)
                found |= np.any(shares >= 0.5, axis=0)
        return found

    def block(self, table: int) -> slice:
        """The unknowns of a table."""
        return slice(table * self.nodes, (table + 1) * self.nodes)

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        """The searched coordinates."""
        layout = self.reduced.layout
        taus, turns = self.reduced.part("pairs"), self.reduced.part("turns")

        def axis(
            name: str,
            table: int | None,
            part: np.ndarray,
            span: Span,
            direction: int,
            element: Element = RC,
        ):
            low, high = np.log(self.ranges[name]).tolist()
            flat = part.reshape(len(part), -1)
            return Axis(name, low, high, table, flat, part.shape[1:], span, direction, element)

        axes = [
            axis(names.tau, pair, taus, layout.in_tau, 1, get_element(element))
            for pair, (element, names) in enumerate(
                zip(self.elements, names_of(self.elements), strict=True), 1
            )
        ]
        if layout.in_rate is not None:
            table = self.tables - 1 if layout.has_amplitude else None
            axes.append(axis(RATE, table, turns, layout.in_rate, -1))
        return tuple(axes)

    @property
    def tables(self) -> int:
        layout = self.reduced.layout
        return 1 + self.pairs + layout.has_correction + layout.has_amplitude

    @cached_property
    def fixed_columns(self) -> dict[int, Columns]:
        """The columns of tables that no axis changes, and what an axis adds to."""
        layout = self.reduced.layout
        own = {0: self.reduced.part("current")[0]}
        if layout.has_correction:
            own[1 + self.pairs] = self.reduced.part("correction")[0] @ self._to_correction
        if layout.has_amplitude:
            own[self.tables - 1] = self.reduced.part("standing")[0]
        return own

    @cached_property
    def base(self) -> Float[np.ndarray, "rows"]:
        return self.reduced.part("base")[0][:, 0]

    @cached_property
    def weights(self) -> list[tuple[float, float]]:
        """Every table's w, of resistances the capacity in Ah over 1 h, and its ridge."""
        settings, others = self.settings, self.tables - self.pairs - 1
        resistance = self.prepared_records[0].capacity_ah, settings.resistance_ridge
        return [resistance] * (self.pairs + 1) + [(1.0, settings.voltage_ridge)] * others

    @cached_property
    def _to_correction(self) -> Float[np.ndarray, "nodes nodes"]:
        """The OCV correction at every node from its unknowns: its value at the first node and the
        steps from node to node, each with a bound of its own, where the OCV is to rise."""
        steps = np.tril(np.ones((self.nodes, self.nodes)))
        return steps if self.settings.rising_ocv else np.eye(self.nodes)

    @cached_property
    def to_tables(self) -> Float[np.ndarray, "values unknowns"]:
        """All tables' values from the unknowns."""
        blocks = [np.eye(self.nodes)] * self.tables
        if self.reduced.layout.has_correction:
            blocks[1 + self.pairs] = self._to_correction
        return np.asarray(block_diag(*blocks))

    @cached_property
    def penalty(self) -> Float[np.ndarray, "penalties unknowns"]:
        """The rows whose squares are added to the mean squared error."""
        return self.table_penalty @ self.to_tables

    @cached_property
    def table_penalty(self) -> Float[np.ndarray, "penalties values"]:
        """The same by the tables' values."""
        bent = math.sqrt(self.settings.roughness) * np.diff(np.eye(self.nodes), 2, axis=0)
        blocks = [
            weight
            * math.sqrt(self.share)
            * np.concatenate([bent, math.sqrt(ridge) * np.eye(self.nodes)])
            for weight, ridge in self.weights
        ]
        return np.asarray(block_diag(*blocks))

    @cached_property
    def penalty_normal(self) -> Float[np.ndarray, "unknowns unknowns"]:
        return self.penalty.T @ self.penalty

    @cached_property
    def box(self) -> tuple[Float[np.ndarray, "unknowns"], Float[np.ndarray, "unknowns"]]:
        """Lowest and highest value of every unknown. From node to node, a correction of an OCV that
        is to rise may fall by as much as the known OCV rises at least; else it is free."""
        low, high = np.zeros((self.tables, self.nodes)), np.full((self.tables, self.nodes), np.inf)
        ranges = self.settings.ranges
        names = (OHMIC, *(each.resistance for each in names_of(self.elements)))
        for table, name in enumerate(names):
            if name in ranges:
                low[table], high[table] = ranges[name]
        if self.reduced.layout.has_correction:
            low[self.pairs + 1] = -np.inf
            if self.settings.rising_ocv:
                nodes = np.array(self.reduced.layout.nodes)
                slopes = [each.cell.least_ocv_slopes(nodes) for each in self.prepared_records]
                low[self.pairs + 1, 1:] = -np.diff(nodes) * np.min(slopes, axis=0)
        return low.ravel(), high.ravel()

    def columns(self, place: Place) -> tuple[Columns, Float[np.ndarray, "rows"]]:
        """Columns of all unknowns at a place, and the base error there."""
        blocks, base = dict(self.fixed_columns), self.base
        for axis, where in zip(self.axes, place, strict=True):
            if axis.table is None:
                base = base + axis.columns(where)[:, 0]
            else:
                blocks[axis.table] = blocks.get(axis.table, 0.0) + axis.columns(where)
        return np.concatenate([blocks[table] for table in range(self.tables)], axis=1), base

    def solve(self, place: Place, sides: Sides | None = None, exact: bool = False) -> Solution:
        """The best tables at a place; `exact` takes the orthogonal factorization's digits."""
        columns, base = self.columns(place)
        low, high = self.box
        if exact:
            whole = np.concatenate([columns, self.penalty])
            longer = np.append(base, np.zeros(len(self.penalty)))
            x, sides = least_squares_in_box(whole, longer, low, high, sides)
        else:
            normal = columns.T @ columns + self.penalty_normal
            x, sides = least_in_box(normal, columns.T @ base, low, high, sides)
        error = base + columns @ x
        bent = self.penalty @ x
        squared = float(error @ error + bent @ bent)
        values = (self.to_tables @ x).reshape(self.tables, -1)
        return Solution(place, sides, squared, values, x, error)

    def ways(self, found: Solution) -> Float[np.ndarray, "values ways"]:
        """The ways in which tables can move within their bounds, unless no sample is near.

        Values at a bound stay. The OCV correction of nodes that a bound ties together moves as one.
        """
        blocks = []
        for table in range(self.tables):
            is_free = found.sides[self.block(table)] == 0
            own = np.eye(self.nodes)[is_free]
            if self.reduced.layout.has_correction and table == self.pairs + 1:
                tied = np.cumsum(is_free) - 1
                own = np.eye(self.nodes)[: tied[-1] + 1, tied] if self.settings.rising_ocv else own
            blocks.append(own[own @ self.visited > 0].T)
        return np.asarray(block_diag(*blocks))

    def moved(self, found: Solution) -> list[Float[np.ndarray, "rows"]]:
        """The derivatives of the error by every axis's place, at fixed tables."""
        return [
            axis.slopes(where) @ (np.ones(1) if axis.table is None else found.values[axis.table])
            for axis, where in zip(self.axes, found.place, strict=True)
        ]

    def slope(self, found: Solution) -> Float[np.ndarray, "axes"]:
        """The derivative of the least J by the place: that at fixed tables, which are optimal."""
        return np.array([2 * float(found.error @ each) for each in self.moved(found)])

    def tables_at(self, found: Solution) -> SocTables:
        """A solution as stored, pairs from fast to slow."""
        layout, values = self.reduced.layout, found.values.tolist()
        tau_s = np.exp(found.place[: self.pairs]).tolist()
        gamma = math.exp(found.place[-1]) if len(found.place) > self.pairs else None
        return SocTables(
            nodes=layout.nodes,
            tau_s=tuple(tau_s),
            r0_ohm=tuple(values[0]),
            r_ohm=tuple(tuple(row) for row in values[1 : self.pairs + 1]),
            ocv_correction_v=tuple(values[self.pairs + 1]) if layout.has_correction else None,
            half_hysteresis_v=tuple(values[-1]) if layout.has_amplitude else None,
            gamma=gamma,
            visited=tuple(self.visited.tolist()),
            elements=self.elements,
        )

"""The objective of some tables, and its least value for given time constants."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ..cell import SocTables
from ..cell.circuits import RATE
from ..model.exponentials import Span
from ..model.search_space import RESISTANCES, Range
from .bounded import Sides, least_in_box, least_squares_in_box
from .reduced import Columns, Reduced
from .settings import TableSettings

# What was computed for so many places of an axis is kept.
KEPT = 4096

Place = tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Axis:
    """One of the coordinates in which the error is not linear: log of a tau in s, or of gamma.

    Its columns multiply the table of that number; `table` is None where they are one column that
    counts as it is, the dynamic hysteresis of the measured gap.
    """

    low: float
    high: float
    table: int | None
    parts: Float[np.ndarray, "few entries"]
    span: Span
    direction: int
    _known: dict[float, Columns] = field(default_factory=dict)

    def columns(self, place: float) -> Columns:
        """The columns at a place."""
        if place not in self._known:
            while len(self._known) >= KEPT:
                del self._known[next(iter(self._known))]
            counts = self.span.from_skeleton @ _cardinal(self.span, self.direction * place)[0]
            self._known[place] = self._product(counts)
        return self._known[place]

    def slopes(self, place: float) -> Columns:
        """Their derivatives by the place."""
        _, slopes = _cardinal(self.span, self.direction * place)
        return self._product(self.direction * (self.span.from_skeleton @ slopes))

    def _product(self, counts: Float[np.ndarray, "few"]) -> Columns:
        rows, width = self.shape
        return (counts @ self.parts).reshape(rows, width)

    shape: tuple[int, int] = (0, 0)


def _cardinal(span: Span, place: float):
    """What each node counts at a place, and the derivatives (Berrut and Trefethen, 2004)."""
    gaps = (place - span.center) / span.half_width - span.nodes
    terms = span.weights / np.where(gaps == 0, np.finfo(float).tiny, gaps)
    counts = terms / np.sum(terms)
    return counts, counts @ span.slope / span.half_width


@dataclass(frozen=True, eq=False)
class Solution:
    """The best tables at a place: rows of R0, every pair's R, then what else is tabulated."""

    place: Place
    values: Float[np.ndarray, "tables nodes"]
    sides: Sides
    error: Float[np.ndarray, "rows"]
    squared: float

    @property
    def root(self) -> float:
        """sqrt(J), in V."""
        return math.sqrt(self.squared)


@dataclass(frozen=True, eq=False)
class Objective:
    """J of `settings` over reduced records, for circuits with so many pairs.

    Places are the logarithms of every pair's time constant in s, then of gamma where there is one.
    `weight_a` is the capacity in Ah over 1 h; `share` scales all smoothing weights.
    """

    reduced: Reduced
    settings: TableSettings
    tau_ranges_s: tuple[Range, ...]
    gamma_range: Range | None
    weight_a: float
    share: float = 1.0

    @property
    def pairs(self) -> int:
        return len(self.tau_ranges_s)

    @property
    def nodes(self) -> int:
        return len(self.reduced.layout.nodes)

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        """The searched coordinates."""
        layout, taus, turns = self.reduced.layout, self.reduced.part(0), self.reduced.part(1)

        def axis(limits: Range, table: int | None, part: np.ndarray, span: Span, direction: int):
            low, high = np.log(limits).tolist()
            flat, shape = part.reshape(len(part), -1), part.shape[1:]
            return Axis(low, high, table, flat, span, direction, shape=shape)

        axes = [
            axis(limits, pair + 1, taus, layout.in_tau, 1)
            for pair, limits in enumerate(self.tau_ranges_s)
        ]
        if self.gamma_range is not None and layout.in_rate is not None:
            table = self.tables - 1 if layout.has_amplitude else None
            axes.append(axis(self.gamma_range, table, turns, layout.in_rate, -1))
        return tuple(axes)

    @property
    def tables(self) -> int:
        layout = self.reduced.layout
        return 1 + self.pairs + layout.has_correction + layout.has_amplitude

    @cached_property
    def fixed_columns(self) -> dict[int, Columns]:
        """The columns of tables that no axis changes, and what an axis adds to."""
        layout = self.reduced.layout
        own = {0: self.reduced.part(3)[0]}
        if layout.has_correction:
            own[1 + self.pairs] = self.reduced.part(4)[0]
        if layout.has_amplitude:
            own[self.tables - 1] = self.reduced.part(2)[0]
        return own

    @cached_property
    def base(self) -> Float[np.ndarray, "rows"]:
        return self.reduced.part(5)[0][:, 0]

    @cached_property
    def penalty(self) -> Float[np.ndarray, "penalties unknowns"]:
        """The rows whose squares are added to the mean squared error."""
        settings, nodes = self.settings, self.nodes
        bent = math.sqrt(settings.roughness) * np.diff(np.eye(nodes), 2, axis=0)
        blocks = []
        for table in range(self.tables):
            is_resistance = table <= self.pairs
            ridge = settings.resistance_ridge if is_resistance else settings.voltage_ridge
            weight = (self.weight_a if is_resistance else 1.0) * math.sqrt(self.share)
            rows = weight * np.concatenate([bent, math.sqrt(ridge) * np.eye(nodes)])
            blocks.append(
                np.pad(rows, ((0, 0), (table * nodes, (self.tables - table - 1) * nodes)))
            )
        return np.concatenate(blocks)

    @cached_property
    def penalty_normal(self) -> Float[np.ndarray, "unknowns unknowns"]:
        return self.penalty.T @ self.penalty

    @cached_property
    def box(self) -> tuple[Float[np.ndarray, "unknowns"], Float[np.ndarray, "unknowns"]]:
        """Lowest and highest value of every unknown; a correction of the OCV is free."""
        low, high = np.zeros((self.tables, self.nodes)), np.full((self.tables, self.nodes), np.inf)
        ranges = self.settings.ranges
        for table, name in enumerate(RESISTANCES[: self.pairs + 1]):
            if name in ranges:
                low[table], high[table] = ranges[name]
        if self.reduced.layout.has_correction:
            low[self.pairs + 1] = -np.inf
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
        return Solution(place, x.reshape(self.tables, -1), sides, error, squared)

    def moved(self, found: Solution) -> list[Float[np.ndarray, "rows"]]:
        """The derivatives of the error by every axis's place, at fixed tables."""
        return [
            axis.slopes(where) @ (np.ones(1) if axis.table is None else found.values[axis.table])
            for axis, where in zip(self.axes, found.place, strict=True)
        ]

    def slope(self, found: Solution) -> Float[np.ndarray, "axes"]:
        """The derivative of the least J by the place: that at fixed tables, which are optimal."""
        return np.array([2 * float(found.error @ each) for each in self.moved(found)])

    def tables_at(self, found: Solution, visited: Sequence[bool]) -> SocTables:
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
            visited=tuple(visited),
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Those of the axes."""
        named = tuple(f"tau{pair + 1} [s]" for pair in range(self.pairs))
        return named if self.gamma_range is None else (*named, RATE)

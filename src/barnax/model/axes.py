"""The searched coordinates: logarithms of every time constant in s, and of gamma."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from ..cell.elements import RC, Element, get_element, names_of
from ..cell.parameters import RATE
from .exponentials import Span
from .reduced import Reduced
from .search_space import Range

# What was computed for so many scales of an axis is kept.
KEPT = 4096
# An RC pair is no faster than the fastest of a span by less than this, in the logarithm.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Axis:
    """One of the coordinates in which the error is not linear: log of a tau in s, or of gamma.

    Its columns multiply the table of that number; `table` is None where they are one column that
    counts as it is, the dynamic hysteresis of the measured gap. `answers` are those of the span's
    skeleton, from which `to_nodes` gives all nodes, or of the nodes themselves. `sign` is -1 where
    a time constant is one over the number searched.
    """

    name: str
    low: float
    high: float
    table: int | None
    answers: Float[np.ndarray, "few rows width"]
    to_nodes: Float[np.ndarray, "few nodes"] | None
    span: Span
    sign: int
    element: Element
    _known: dict[float, Float[np.ndarray, "rows width"]] = field(default_factory=dict)

    def columns(
        self, scales: Float[np.ndarray, "points"]
    ) -> Float[np.ndarray, "points rows width"]:
        """The columns at some scales."""
        rungs = self._rungs(scales)
        return self._product(sum(share * self.span.counts(at) for share, at, _ in rungs))

    def columns_at(self, scale: float) -> Float[np.ndarray, "rows width"]:
        """The columns at one scale, which are kept."""
        if scale not in self._known:
            while len(self._known) >= KEPT:
                del self._known[next(iter(self._known))]
            self._known[scale] = self.columns(np.array([scale]))[0]
        return self._known[scale]

    def slopes_at(self, scale: float) -> Float[np.ndarray, "rows width"]:
        """Their derivatives by the scale."""
        rungs = self._rungs(np.array([scale]))
        slopes = sum(
            share * moves * (self.span.counts(at) @ self.span.slope) for share, at, moves in rungs
        )
        return self._product(self.sign * slopes / self.span.half_width)[0]

    def _rungs(
        self, scales: Float[np.ndarray, "points"]
    ) -> Iterator[tuple[float, Float[np.ndarray, "points"], Float[np.ndarray, "points 1"]]]:
        """The share of each of the element's RC pairs, its log of tau, and whether that moves."""
        lowest = self.span.center - self.span.half_width
        for share, ratio in zip(self.element.shares, self.element.ratios, strict=True):
            own = self.sign * scales + math.log(ratio)
            # What is faster is at its end within every interval too.
            yield share, np.maximum(own, lowest), (own > lowest - ROUNDING)[:, None]

    def _product(self, counts) -> Float[np.ndarray, "points rows width"]:
        if self.to_nodes is not None:
            counts = counts @ self.to_nodes.T
        flat = self.answers.reshape(len(self.answers), -1)
        return (counts @ flat).reshape(-1, *self.answers.shape[1:])


def axes_of(
    reduced: Reduced, elements: Sequence[str], ranges: Mapping[str, Range]
) -> tuple[Axis, ...]:
    """The axes of every element's time constant, then of gamma where there is one; R0 is table 0,
    and what is tabulated beside resistances comes after them."""
    layout, found = reduced.layout, []

    def add(name: str, table: int | None, part: str, span: Span, sign: int, element: Element):
        low, high = np.log(ranges[name]).tolist()
        answers, to_nodes = reduced.part(part), span.from_skeleton
        found.append(Axis(name, low, high, table, answers, to_nodes, span, sign, element))

    for table, (names, name) in enumerate(zip(names_of(elements), elements, strict=True), 1):
        add(names.tau, table, "pairs", layout.in_tau, 1, get_element(name))
    if layout.in_rate is not None:
        table = 1 + len(elements) + layout.has_correction if layout.has_amplitude else None
        add(RATE, table, "hysteresis_response", layout.in_rate, -1, RC)
    return tuple(found)

"""The searched coordinates: logarithms of every time constant in s, and of gamma."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from ..cell.elements import Element
from .exponentials import Span

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
        """Those at one, which are kept."""
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

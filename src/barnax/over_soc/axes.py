"""The searched coordinates of tables: one for every time constant, and for gamma."""

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from ..cell.elements import RC, Element
from ..model.exponentials import Span
from .reduced import Columns

# What was computed for so many places of an axis is kept.
KEPT = 4096


@dataclass(frozen=True, eq=False)
class Axis:
    """One of the coordinates in which the error is not linear: log of a tau in s, or of gamma.

    Its columns multiply the table of that number; `table` is None where they are one column that
    counts as it is, the dynamic hysteresis of the measured gap.
    """

    name: str
    low: float
    high: float
    table: int | None
    parts: Float[np.ndarray, "few entries"]
    shape: tuple[int, int]
    span: Span
    direction: int
    element: Element
    _known: dict[float, Columns] = field(default_factory=dict)

    def columns(self, place: float) -> Columns:
        """The columns at a place."""
        if place not in self._known:
            while len(self._known) >= KEPT:
                del self._known[next(iter(self._known))]
            self._known[place] = self._product(self.span.from_skeleton @ self._counts(place)[0])
        return self._known[place]

    def slopes(self, place: float) -> Columns:
        """Their derivatives by the place."""
        _, slopes = self._counts(place)
        return self._product(self.direction * (self.span.from_skeleton @ slopes))

    def _counts(self, place: float):
        """What each node counts in the element's answer, and the derivatives."""
        if self.element == RC:
            return _cardinal(self.span, self.direction * place)
        lowest = self.span.center - self.span.half_width
        counts, slopes = np.zeros((2, len(self.span.nodes)))
        for share, ratio in zip(self.element.shares, self.element.ratios, strict=True):
            own = place + math.log(ratio)
            # What is faster is at its end within every interval too.
            count, slope = _cardinal(self.span, max(own, lowest))
            counts += share * count
            slopes += share * slope * (own >= lowest)
        return counts, slopes

    def _product(self, counts: Float[np.ndarray, "few"]) -> Columns:
        return (counts @ self.parts).reshape(self.shape)


def _cardinal(span: Span, place: float):
    """What each node counts at a place, and the derivatives (Berrut and Trefethen, 2004)."""
    gaps = (place - span.center) / span.half_width - span.nodes
    terms = span.weights / np.where(gaps == 0, np.finfo(float).tiny, gaps)
    counts = terms / np.sum(terms)
    return counts, counts @ span.slope / span.half_width

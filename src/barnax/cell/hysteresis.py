"""The hysteresis voltage over SOC: five straight segments."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from jaxtyping import Float

from ..display import Brief
from ..errors import InputError
from ..settings import HysteresisFit
from .curves import Values
from .tables import hats

Ends = Float[np.ndarray, "5 2"]
KNOTS = np.array([0.0, 0.1, 0.35, 0.75, 0.95, 1.0])
FLAT = 2
# Which of the five nodal values (W(0), W(0.1), P, W(0.95), W(1)) stands at each knot.
NODE_AT_KNOT = np.array([0, 1, 2, 2, 3, 4])
# Weight of the tie between neighboring nodes. Squared against one point's weight of 1 it moves a
# measured node by about a millionth of W, but decides where no point does.
TIE = 1e-3


@dataclass(frozen=True, repr=False)
class SegmentedHysteresis(Brief):
    """W(soc), charge minus discharge OCV in V, linear on five segments, the middle one constant.

    `ends_v` holds each segment's values at its left and right end. `continuous` has five nodal
    values; `independent` is Eq. 4 as printed: nine parameters, with steps at the knots, the value
    at a knot being that of the segment to its right. SOC beyond 0 and 1 takes the end values.
    `points` are the (SOC, W in V) it was fitted to.

    >>> soc = np.linspace(0.0, 1.0, 21)
    >>> w = SegmentedHysteresis.fit(soc, np.full(21, 0.01))
    >>> round(w.parameters["P"], 9)
    0.01
    """

    kind: HysteresisFit
    ends_v: tuple[tuple[float, float], ...]
    points: tuple[tuple[float, float], ...]

    @classmethod
    def fit(cls, soc: Values, hysteresis_v: Values, kind: HysteresisFit = "continuous") -> Self:
        """Linear least squares.

        Where a segment holds too few points, its open values follow their neighbors (continuous)
        or the continuous fit (independent), by a tie too weak to matter elsewhere. Raises
        `InputError` for an unknown kind, and without any point.
        """
        if kind not in ("continuous", "independent"):
            raise InputError(
                f"no hysteresis fit is called {kind!r}; there are continuous, independent"
            )
        if len(soc) == 0:
            raise InputError("the hysteresis voltage needs at least one SOC on both branches")
        ends_v = _continuous_ends(soc, hysteresis_v)
        if kind == "independent":
            ends_v = _independent_ends(soc, hysteresis_v, ends_v)
        points = tuple(zip(soc.tolist(), hysteresis_v.tolist(), strict=True))
        return cls(kind, tuple(map(tuple, ends_v.tolist())), points)

    @classmethod
    def zero(cls) -> Self:
        """No hysteresis, where only one branch was measured."""
        return cls("continuous", ((0.0, 0.0),) * 5, ())

    def __call__(self, soc: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """W in V at `soc`."""
        segment, fraction = _locate(np.asarray(soc))
        left_v, right_v = np.array(self.ends_v).T
        return np.asarray(left_v[segment] * (1 - fraction) + right_v[segment] * fraction)

    @property
    def errors_v(self) -> Values:
        """Segments minus measured hysteresis voltage at the points."""
        soc = np.array([soc for soc, _ in self.points])
        return self(soc) - np.array([w for _, w in self.points])

    @property
    def parameters(self) -> dict[str, float]:
        """A to H and P of Eq. 4: slope and intercept of each sloping segment, and the constant."""
        values: dict[str, float] = {}
        for (slope, intercept), segment in (("AB", 0), ("CD", 1), ("EF", 3), ("GH", 4)):
            left_v, right_v = self.ends_v[segment]
            slope_v = (right_v - left_v) / float(KNOTS[segment + 1] - KNOTS[segment])
            values[slope] = slope_v
            values[intercept] = left_v - slope_v * float(KNOTS[segment])
        return values | {"P": self.ends_v[FLAT][0]}


def _locate(soc: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The segment of each SOC and how far into it, 0 to 1."""
    inside = np.clip(soc, 0.0, 1.0)
    segment = np.clip(np.searchsorted(KNOTS, inside, side="right") - 1, 0, len(KNOTS) - 2)
    return segment, (inside - KNOTS[segment]) / (KNOTS[segment + 1] - KNOTS[segment])


def _continuous_ends(soc: Values, hysteresis_v: Values) -> Ends:
    shares = hats(soc, KNOTS) @ np.eye(5)[NODE_AT_KNOT]
    ties = TIE * np.diff(np.eye(5), axis=0)
    matrix = np.concatenate([shares, ties])
    target = np.concatenate([hysteresis_v, np.zeros(len(ties))])
    nodes_v = np.linalg.lstsq(matrix, target)[0]
    at_knots_v = nodes_v[NODE_AT_KNOT]
    return np.stack([at_knots_v[:-1], at_knots_v[1:]], axis=1)


def _independent_ends(soc: Values, hysteresis_v: Values, continuous_v: Ends) -> Ends:
    segment, fraction = _locate(np.asarray(soc))
    ends_v = continuous_v.copy()
    for index in range(len(ends_v)):
        inside = segment == index
        if index == FLAT:
            if inside.any():
                ends_v[index] = hysteresis_v[inside].mean()
            continue
        line = np.stack([1 - fraction[inside], fraction[inside]], axis=1)
        excess_v = hysteresis_v[inside] - line @ continuous_v[index]
        matrix = np.concatenate([line, TIE * np.eye(2)])
        target = np.concatenate([excess_v, np.zeros(2)])
        ends_v[index] += np.linalg.lstsq(matrix, target)[0]
    return ends_v

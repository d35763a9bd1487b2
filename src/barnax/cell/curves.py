"""OCV and hysteresis voltage over SOC: curves through measured points, and straight segments."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self, get_args

import numpy as np
from jaxtyping import Float
from numpy.polynomial import Polynomial
from scipy.interpolate import PchipInterpolator

from ..display import Brief
from ..errors import InputError, require_choice
from ..notices import Notice
from ..settings import HysteresisFit, OcvFit

POLYNOMIAL_DEGREE = 7
# Each of two rested points may be off by 1.5 mV.
FALL_TOLERANCE_V = OVERSHOOT_TOLERANCE_V = 3e-3
MISS_TOLERANCE_V = 10e-3
CHECKS_PER_GAP = 50
Values = Float[np.ndarray, "points"]


@dataclass(frozen=True, repr=False)
class AbstractCurve(Brief, ABC):
    """A curve over SOC, constant beyond its end points.

    `points` are the (SOC, voltage in V) it was fitted to, with increasing SOC. Raises `InputError`
    if they are not finite or not increasing.
    """

    kind: ClassVar[OcvFit]
    points: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        values = np.asarray(self.points, dtype=float)
        if values.ndim != 2 or values.shape[1] != 2 or len(values) < 2:
            raise InputError("an OCV curve needs at least two points of SOC and voltage")
        if not np.isfinite(values).all() or not (np.diff(values[:, 0]) > 0).all():
            raise InputError("the points of an OCV curve must be finite and increase in SOC")

    @cached_property
    def soc(self) -> Float[np.ndarray, "points"]:
        return np.array([soc for soc, _ in self.points])

    @cached_property
    def voltage_v(self) -> Float[np.ndarray, "points"]:
        return np.array([voltage for _, voltage in self.points])

    @property
    def errors_v(self) -> Float[np.ndarray, "points"]:
        """Curve minus measured voltage at the points."""
        return self(self.soc) - self.voltage_v

    def __call__(self, soc: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """Voltage in V at `soc`."""
        inside = np.atleast_1d(np.clip(soc, self.soc[0], self.soc[-1]))
        return self._inside(inside).reshape(np.shape(soc))

    @abstractmethod
    def _inside(self, soc: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        """Voltage between the end points, for an array of at least one axis."""


@dataclass(frozen=True, repr=False)
class PolynomialCurve(AbstractCurve):
    """The seventh-order polynomial of Li et al. (2023), Eq. 21.

    `coefficients` are a0 to a7 of the plain powers of SOC, in V.

    >>> soc = np.linspace(0.0, 1.0, 9)
    >>> curve = PolynomialCurve.fit(soc, 3.0 + soc**2)
    >>> float(np.round(curve(np.array(0.5)), 9))
    3.25
    """

    kind = "polynomial"
    coefficients: tuple[float, ...]

    @classmethod
    def fit(cls, soc: Values, voltage_v: Values) -> Self:
        """Least squares. Raises `InputError` for fewer points than coefficients."""
        needed = POLYNOMIAL_DEGREE + 1
        if len(soc) < needed:
            raise InputError(
                f"a polynomial of degree {POLYNOMIAL_DEGREE} needs at least {needed} OCV points; "
                f"there are {len(soc)}. Use `ocv_fit='interpolated'`."
            )
        points = tuple(zip(soc.tolist(), voltage_v.tolist(), strict=True))
        # Fitted on [-1, 1], where the powers are far from parallel; stored in powers of SOC.
        fitted = Polynomial.fit(soc, voltage_v, POLYNOMIAL_DEGREE).convert()
        coefficients = np.pad(fitted.coef, (0, needed - len(fitted.coef)))
        return cls(points, tuple(coefficients.tolist()))

    def _inside(self, soc: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        return np.polynomial.polynomial.polyval(soc, self.coefficients)


@dataclass(frozen=True, repr=False)
class InterpolatedCurve(AbstractCurve):
    """The monotone cubic through the points (PCHIP; Fritsch and Carlson 1980, as in SciPy).

    >>> curve = InterpolatedCurve.fit(np.array([0.0, 0.5, 1.0]), np.array([3.0, 3.5, 4.0]))
    >>> float(curve(np.array(0.25)))
    3.25
    """

    kind = "interpolated"

    @classmethod
    def fit(cls, soc: Values, voltage_v: Values) -> Self:
        return cls(tuple(zip(soc.tolist(), voltage_v.tolist(), strict=True)))

    @cached_property
    def _pchip(self) -> PchipInterpolator:
        return PchipInterpolator(self.soc, self.voltage_v)

    def _inside(self, soc: Float[np.ndarray, "*any"]) -> Float[np.ndarray, "*any"]:
        return self._pchip(soc)


Curve = PolynomialCurve | InterpolatedCurve


def fit_curve(soc: Values, voltage_v: Values, fit: OcvFit) -> Curve:
    """The curve of the kind `fit` through the points, with increasing SOC.

    Raises `InputError` for an unknown kind and for too few points.
    """
    require_choice("ocv_fit", fit, get_args(OcvFit))
    kind = PolynomialCurve if fit == "polynomial" else InterpolatedCurve
    return kind.fit(soc, voltage_v)


def curve_warnings(curve: AbstractCurve, branch: str | None) -> Iterator[Notice]:
    """Warnings if the curve falls with SOC, leaves the range of its points or misses them.

    `branch` is its name, if it has one. An OCV rises with SOC; a fall between good points is due to
    the fit, not the cell.
    """
    inside = np.linspace(curve.soc[:-1], curve.soc[1:], CHECKS_PER_GAP, endpoint=False, axis=1)
    grid = np.append(inside, curve.soc[-1])
    voltage_v = curve(grid)
    fall_v = np.maximum.accumulate(voltage_v) - voltage_v
    worst = int(np.argmax(fall_v))
    top = int(np.argmax(voltage_v[: worst + 1]))
    left_v, right_v = curve.voltage_v[:-1], curve.voltage_v[1:]
    margin_v = np.abs(right_v - left_v) + OVERSHOOT_TOLERANCE_V
    between_v = voltage_v[:-1].reshape(len(left_v), CHECKS_PER_GAP)
    above_v = between_v.max(axis=1) - np.maximum(left_v, right_v)
    below_v = np.minimum(left_v, right_v) - between_v.min(axis=1)
    beyond_v = np.maximum(above_v, below_v)
    gap = int(np.argmax(beyond_v - margin_v))
    errors_v = np.abs(curve.errors_v)
    missed = int(np.argmax(errors_v))
    falls = {"from_soc": grid[top], "to_soc": grid[worst]}
    overshoots = {"from_soc": curve.soc[gap], "to_soc": curve.soc[gap + 1]}
    for fault, fault_v, allowed_v, at in (
        ("falls", fall_v[worst], FALL_TOLERANCE_V, falls),
        ("overshoots", beyond_v[gap], margin_v[gap], overshoots),
        ("misses", errors_v[missed], MISS_TOLERANCE_V, {"soc": curve.soc[missed]}),
    ):
        if fault_v > allowed_v:
            values = {"fault": fault, "fault_v": fault_v, **at}
            yield Notice("ocv-curve.fit", {**values, "branch": branch, "fit": curve.kind})


Ends = Float[np.ndarray, "5 2"]
Basis = Float[np.ndarray, "5 2 values"]
KNOTS = np.array([0.0, 0.1, 0.35, 0.75, 0.95, 1.0])
FLAT = 2
SEGMENTS = len(KNOTS) - 1
# The ends of the segments from five nodal values (W(0), W(0.1), P, W(0.95), W(1)), and from nine
# separate ones, one of them for the flat segment.
NODES: Basis = np.eye(5)[[[0, 1], [1, 2], [2, 2], [2, 3], [3, 4]]]
STEPPED: Basis = np.eye(9)[[[0, 1], [2, 3], [4, 4], [5, 6], [7, 8]]]
# Weight of the tie between neighboring nodes. Squared, relative to one point's weight of 1, it
# moves a measured node by about a millionth of W, but decides where there is no point.
TIE = 1e-3


@dataclass(frozen=True, repr=False)
class SegmentedHysteresis(Brief):
    """W(soc), charge minus discharge OCV in V, linear on five segments, the middle one constant.

    `ends_v` has each segment's values at its left and right end. `continuous` has five nodal
    values; `independent` is Eq. 4 as printed: nine parameters, with steps at the knots, where the
    segment to the right applies. Beyond 0 and 1, the end values apply. `points` are the (SOC, W in
    V) it was fitted to.

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

        If a segment has too few points, its open values follow their neighbors (continuous) or the
        continuous fit (independent), by a tie too weak to matter elsewhere. Raises `InputError` for
        an unknown kind, and without any point.
        """
        require_choice("hysteresis_fit", kind, get_args(HysteresisFit))
        if len(soc) == 0:
            raise InputError("the hysteresis voltage needs at least one SOC on both branches")
        segment, fraction = _locate(np.asarray(soc))
        lines, rows = np.zeros((len(soc), SEGMENTS, 2)), np.arange(len(soc))
        lines[rows, segment, 0], lines[rows, segment, 1] = 1 - fraction, fraction
        ends_v = _tied(lines, hysteresis_v, NODES, np.diff(np.eye(5), axis=0))
        if kind == "independent":
            left_v = hysteresis_v - np.sum(lines * ends_v, axis=(1, 2))
            ends_v = ends_v + _tied(lines, left_v, STEPPED, np.eye(STEPPED.shape[-1]))
        points = tuple(zip(soc.tolist(), hysteresis_v.tolist(), strict=True))
        return cls(kind, tuple(map(tuple, ends_v.tolist())), points)

    @classmethod
    def zero(cls) -> Self:
        """No hysteresis, if only one branch was measured."""
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
    """The segment of each SOC and the position in it, 0 to 1."""
    inside = np.clip(soc, 0.0, 1.0)
    segment = np.clip(np.searchsorted(KNOTS, inside, side="right") - 1, 0, len(KNOTS) - 2)
    return segment, (inside - KNOTS[segment]) / (KNOTS[segment + 1] - KNOTS[segment])


def _tied(
    lines: Float[np.ndarray, "points 5 2"], target_v: Values, basis: Basis, ties: np.ndarray
) -> Ends:
    """The ends of all segments that fit a target by least squares, with ties where they are
    open."""
    matrix = np.concatenate([np.tensordot(lines, basis), TIE * ties])
    values = np.linalg.lstsq(matrix, np.append(target_v, np.zeros(len(ties))))[0]
    return basis @ values

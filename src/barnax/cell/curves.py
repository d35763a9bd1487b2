"""OCV over SOC: curves through measured points."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self

import numpy as np
from jaxtyping import Float
from numpy.polynomial import Polynomial
from scipy.interpolate import PchipInterpolator

from ..display import Brief
from ..errors import InputError
from ..notices import Notice
from ..settings import OcvFit

POLYNOMIAL_DEGREE = 7
# Of two rested points each may be 1.5 mV off.
FALL_TOLERANCE_V = OVERSHOOT_TOLERANCE_V = 3e-3
MISS_TOLERANCE_V = 10e-3
CHECKS_PER_GAP = 50
Values = Float[np.ndarray, "points"]


@dataclass(frozen=True, repr=False)
class AbstractCurve(Brief, ABC):
    """A curve over SOC, constant beyond its end points.

    `points` are the (SOC, voltage in V) it was fitted to, SOC strictly increasing. Raises
    `InputError` where they are not finite or not increasing.
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
    """The curve of the kind `fit` through the points, SOC strictly increasing.

    Raises `InputError` for an unknown kind and for too few points.
    """
    if fit == "polynomial":
        return PolynomialCurve.fit(soc, voltage_v)
    if fit == "interpolated":
        return InterpolatedCurve.fit(soc, voltage_v)
    raise InputError(f"no OCV fit is called {fit!r}; there are polynomial, interpolated")


def curve_warnings(curve: AbstractCurve, branch: str | None) -> Iterator[Notice]:
    """Warnings where the curve falls with SOC, leaves the range of its points or misses them.

    `branch` is its name, if it has one. An OCV rises with SOC; what falls between good points
    is the fit, not the cell.
    """
    curve_values = {"branch": branch, "fit": curve.kind}
    inside = np.linspace(curve.soc[:-1], curve.soc[1:], CHECKS_PER_GAP, endpoint=False, axis=1)
    grid = np.append(inside, curve.soc[-1])
    voltage_v = curve(grid)
    fall_v = np.maximum.accumulate(voltage_v) - voltage_v
    worst = int(np.argmax(fall_v))
    if fall_v[worst] > FALL_TOLERANCE_V:
        top = int(np.argmax(voltage_v[:worst]))
        at = {"from_soc": grid[top], "to_soc": grid[worst]}
        fault = {"fault": "falls", "fault_v": fall_v[worst]}
        yield Notice("ocv-curve.fit", {**fault, **at, **curve_values})
    left_v, right_v = curve.voltage_v[:-1], curve.voltage_v[1:]
    margin_v = np.abs(right_v - left_v) + OVERSHOOT_TOLERANCE_V
    between_v = voltage_v[:-1].reshape(len(left_v), CHECKS_PER_GAP)
    above_v = between_v.max(axis=1) - np.maximum(left_v, right_v)
    below_v = np.minimum(left_v, right_v) - between_v.min(axis=1)
    beyond_v = np.maximum(above_v, below_v)
    gap = int(np.argmax(beyond_v - margin_v))
    if beyond_v[gap] > margin_v[gap]:
        at = {"from_soc": curve.soc[gap], "to_soc": curve.soc[gap + 1]}
        fault = {"fault": "overshoots", "fault_v": beyond_v[gap]}
        yield Notice("ocv-curve.fit", {**fault, **at, **curve_values})
    errors_v = np.abs(curve.errors_v)
    missed = int(np.argmax(errors_v))
    if errors_v[missed] > MISS_TOLERANCE_V:
        fault = {"fault": "misses", "fault_v": errors_v[missed], "soc": curve.soc[missed]}
        yield Notice("ocv-curve.fit", {**fault, **curve_values})

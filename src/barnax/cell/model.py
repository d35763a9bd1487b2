"""One characterized cell: capacity, OCV branches and hysteresis voltage."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from jaxtyping import Float

from ..display import Brief
from ..errors import InputError
from ..schema import NoticeField
from .curves import Curve, InterpolatedCurve, PolynomialCurve, SegmentedHysteresis
from .soc_axis import GIVEN, OcvPoint

INVERSION_POINTS = 4001
REST_VOLTAGE_MARGIN_V = 50e-3
# For an LFP cell, half the gap corresponds to at least this much state of charge.
FLAT = 0.08
# Parts of an interval of SOC in which the OCV's slope is evaluated.
SLOPES = 1000
# Points of an OCV curve between two measured temperatures, in addition to the measured ones.
MIXED_POINTS = 501
# Measurements this close count as one temperature.
SAME_DEGC = 5.0
NEAR_DEGC = SAME_DEGC / 2
# If one temperature represents all, it is the one nearest to this.
REFERENCE_DEGC = 25.0

Soc = Float[np.ndarray, "*any"]
Item = TypeVar("Item")

# The OCV's slope is a difference over this much SOC.
STEP_SOC = 1e-3


@dataclass(frozen=True)
class FitError:
    """The distance of a curve from its points, in V."""

    rms_v: float
    max_v: float


@dataclass(frozen=True, repr=False)
class CellModel(Brief):
    """A cell without its circuit: OCV curves, hysteresis voltage and capacity. Immutable.

    SOC is a fraction. If a branch was not measured, it equals the other, and the hysteresis voltage
    is zero.

    Attributes:
        capacity_ah: Capacity.
        capacity_origin: Where it comes from.
        charge: OCV over SOC after a charge; call it with SOC for V.
        discharge: OCV over SOC after a discharge.
        hysteresis: Hysteresis voltage over SOC, in segments.
        charge_points: Measured points of the charge branch.
        discharge_points: Measured points of the discharge branch.
        errors: Fit errors of "charge", "discharge", "average" and "hysteresis", in V.
        warnings: What is doubtful, with what to do.
        temperature_degc: Temperature of the OCV test, where there are tests at others.
        elsewhere: The cell by OCV tests at other temperatures.
        sweep_ohm: Resistance whose drop is subtracted from slow sweeps; None if none is.
    """

    capacity_ah: float
    capacity_origin: str
    charge: Curve
    discharge: Curve
    hysteresis: SegmentedHysteresis
    charge_points: tuple[OcvPoint, ...]
    discharge_points: tuple[OcvPoint, ...]
    errors: Mapping[str, FitError]
    warnings: tuple[NoticeField, ...] = ()
    temperature_degc: float | None = None
    elsewhere: tuple["CellModel", ...] = ()
    sweep_ohm: float | None = None

    def __post_init__(self) -> None:
        if not 0 < self.capacity_ah < np.inf:
            raise InputError(f"the capacity {self.capacity_ah:g} Ah must be positive and finite")
        if not self.points:
            raise InputError("a cell needs OCV points")

    def at(self, temperature_degc: float | None) -> "CellModel":
        """The cell at a temperature: as measured within `NEAR_DEGC` of it; in between with OCV,
        hysteresis and capacity linear in temperature; beyond as at the nearest. Unchanged if all
        tests have one temperature."""
        if not self.elsewhere or temperature_degc is None:
            return self
        cells = sorted((self, *self.elsewhere), key=lambda cell: cell.temperature_degc or 0.0)
        degc = np.array([cell.temperature_degc for cell in cells], float)
        above = int(np.searchsorted(degc, temperature_degc))
        nearest = int(np.argmin(np.abs(degc - temperature_degc)))
        is_near = abs(degc[nearest] - temperature_degc) <= NEAR_DEGC
        if is_near or above in (0, len(cells)):
            return cells[nearest]
        share = (temperature_degc - degc[above - 1]) / (degc[above] - degc[above - 1])
        return _between(cells[above - 1], cells[above], float(share))

    def average_ocv_v(self, soc: Soc) -> Soc:
        """The mean of both branches in V, each constant beyond its end points."""
        return np.asarray((self.charge(soc) + self.discharge(soc)) / 2)

    def ocv_slope(self, soc: Soc, step_soc: float = STEP_SOC) -> Soc:
        """The slope of the average OCV in V per SOC, as a difference over this step."""
        half = step_soc / 2
        return (self.average_ocv_v(soc + half) - self.average_ocv_v(soc - half)) / step_soc

    def ocv_around_v(self, soc: float) -> tuple[float, float]:
        """The average OCV in V at the measured points below and above a SOC, between which it is
        interpolated; at an end point beyond the ends."""
        points = np.unique([point.soc for point in self.points])
        above = int(np.clip(np.searchsorted(points, soc), 0, len(points) - 1))
        below = above - 1 if points[above] > soc and above else above
        low_v, high_v = self.average_ocv_v(points[[below, above]]).tolist()
        return low_v, high_v

    def least_ocv_slopes(self, nodes: Float[np.ndarray, "nodes"]) -> Float[np.ndarray, "_"]:
        """The least slope of the average OCV in V per SOC between neighbors of these SOC."""
        soc = np.linspace(nodes[:-1], nodes[1:], SLOPES + 1)
        return np.min(np.diff(self.average_ocv_v(soc), axis=0) / np.diff(soc, axis=0), axis=0)

    def hysteresis_v(self, soc: Soc) -> Soc:
        """Charge minus discharge OCV in V, from the fitted segments."""
        return self.hysteresis(soc)

    def branch_gap_v(self, soc: Soc) -> Soc:
        """Charge minus discharge OCV in V as measured, at least zero; between polynomials, which
        miss their points, that of the segments."""
        if not self.hysteresis.points or isinstance(self.charge, PolynomialCurve):
            return self.hysteresis(soc)
        return np.maximum(self.charge(soc) - self.discharge(soc), 0.0)

    @property
    def points(self) -> tuple[OcvPoint, ...]:
        """The measured points of both branches."""
        return self.charge_points + self.discharge_points

    @property
    def soc_range(self) -> tuple[float, float]:
        """Lowest and highest SOC of the measured points."""
        soc = [point.soc for point in self.points]
        return min(soc), max(soc)

    @property
    def ocv_is_fitted(self) -> bool:
        """True if its OCV was identified with the circuit, on records without an OCV test."""
        return all(not point.row for point in self.points)

    @property
    def has_spanned_capacity(self) -> bool:
        """True if the capacity is only the charge that a record spans: it may be larger."""
        return self.ocv_is_fitted and self.capacity_origin != GIVEN

    @property
    def has_sweep_drop(self) -> bool:
        """True if points were measured under load and still include its drop."""
        return self.sweep_ohm is None and any(point.current_a for point in self.points)

    @property
    def has_flat_ocv(self) -> bool:
        """True if hysteresis matters as it does for LFP: half the gap between the branches is as
        large as the rise of the OCV over `FLAT` of the SOC, between 20 and 80 %.

        Cells with layered oxides have 1 %, or 4 % if the gap was measured at C/20; LFP has 12 %.
        """
        soc = np.linspace(0.2, 0.8, INVERSION_POINTS)
        half_gap_v = float(np.mean(self.charge(soc) - self.discharge(soc))) / 2
        rise_v = float(np.ptp(self.average_ocv_v(soc[[0, -1]])))
        return half_gap_v * 0.6 > FLAT * rise_v

    @property
    def has_gap(self) -> bool:
        """True if the OCV test has branches in both directions."""
        return bool(self.hysteresis.points)

    def soc_from_rest_voltage(self, voltage_v: float, direction: int = 0) -> float:
        """The SOC of a rested cell.

        On the average curve, or with `direction` +1 or -1 on the charge or discharge branch.
        Raises `InputError` more than 50 mV outside the curve.
        """
        soc = self.soc_at_rest(voltage_v, direction)
        if soc is None:
            raise self.beyond_ocv(voltage_v, direction)
        return soc

    def soc_at_rest(self, voltage_v: float, direction: int = 0) -> float | None:
        """The SOC of a rested cell; None if the voltage is more than 50 mV outside the curve."""
        soc, ocv_v = self._rising_ocv(direction)
        low_v, high_v = ocv_v[0] - REST_VOLTAGE_MARGIN_V, ocv_v[-1] + REST_VOLTAGE_MARGIN_V
        if not low_v <= voltage_v <= high_v:
            return None
        # A flat stretch has no inverse; its lowest sample is kept.
        rises = np.concatenate([[True], np.diff(ocv_v) > 0])
        return float(np.interp(voltage_v, ocv_v[rises], soc[rises]))

    def beyond_ocv(self, voltage_v: float, direction: int) -> InputError:
        """The refusal of a rested voltage that is more than 50 mV outside the curve."""
        _, (low_v, *_, high_v) = self._rising_ocv(direction)
        whose, remedy = "of this cell", "check that the OCV test is of this cell and reaches"
        if self.ocv_is_fitted:
            whose, remedy = "that the records show", "identify on records that reach"
        return InputError(
            f"the rested voltage {voltage_v:.4f} V is outside the OCV {whose}, {low_v:.4f} to "
            f"{high_v:.4f} V; {remedy} that voltage, or give the SOC there as `initial_soc`"
        )

    def _rising_ocv(self, direction: int) -> tuple[Soc, Soc]:
        """SOC, and the OCV there in a direction: if a fitted curve falls, its running maximum is
        the only monotone reading of it."""
        soc = np.linspace(*self.soc_range, INVERSION_POINTS)
        curve = {0: self.average_ocv_v, 1: self.charge, -1: self.discharge}[direction]
        return soc, np.maximum.accumulate(curve(soc))


def _between(cold: CellModel, warm: CellModel, share: float) -> CellModel:
    """The cell at a temperature this share of the way from one to another, with the measured points
    of the nearer one."""

    def mixed(first: Curve, second: Curve) -> Curve:
        if isinstance(first, PolynomialCurve) and isinstance(second, PolynomialCurve):
            ends = np.array(first.coefficients), np.array(second.coefficients)
            mixed_v = (1 - share) * ends[0] + share * ends[1]
            return replace(first, coefficients=tuple(mixed_v.tolist()))
        ends = min(first.soc[0], second.soc[0]), max(first.soc[-1], second.soc[-1])
        soc = np.unique([*first.soc, *second.soc, *np.linspace(*ends, MIXED_POINTS)])
        # Points closer than rounding would give a step, not a curve.
        soc = soc[np.append(True, np.diff(soc) > 1e-9)]
        return InterpolatedCurve.fit(soc, (1 - share) * first(soc) + share * second(soc))

    cold_v, warm_v = (np.array(cell.hysteresis.ends_v) for cell in (cold, warm))
    ends_v = (1 - share) * cold_v + share * warm_v
    degc = (1 - share) * (cold.temperature_degc or 0.0) + share * (warm.temperature_degc or 0.0)
    return replace(
        cold if share < 0.5 else warm,
        temperature_degc=degc,
        capacity_ah=(1 - share) * cold.capacity_ah + share * warm.capacity_ah,
        charge=mixed(cold.charge, warm.charge),
        discharge=mixed(cold.discharge, warm.discharge),
        hysteresis=replace(cold.hysteresis, ends_v=tuple(map(tuple, ends_v.tolist()))),
        elsewhere=(),
    )


def fit_error(errors_v: Float[np.ndarray, "points"]) -> FitError:
    """Root mean square and largest error."""
    return FitError(float(np.sqrt(np.mean(errors_v**2))), float(np.abs(errors_v).max()))


def group_near(pairs: Iterable[tuple[float, Item]]) -> dict[float, list[Item]]:
    """Groups within `SAME_DEGC` of the coldest of each, by the mean of their temperatures.

    >>> group_near([(25.0, "a"), (0.0, "b"), (27.0, "c")])
    {0.0: ['b'], 26.0: ['a', 'c']}
    """
    groups: list[list[tuple[float, Item]]] = []
    for degc, value in sorted(pairs, key=lambda pair: pair[0]):
        if not groups or degc - groups[-1][0][0] > SAME_DEGC:
            groups.append([])
        groups[-1].append((degc, value))
    means = [float(np.mean([degc for degc, _ in group])) for group in groups]
    return {degc: [each for _, each in group] for degc, group in zip(means, groups, strict=True)}

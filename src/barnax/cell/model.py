"""One characterized cell: capacity, OCV branches and hysteresis voltage."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np
from jaxtyping import Float

from ..errors import InputError
from .curves import AbstractCurve, PolynomialCurve, curve_from_dict
from .hysteresis import SegmentedHysteresis
from .soc_axis import OcvPoint
from .stored import LARGEST_AH, stored_number, stored_texts, stored_value

INVERSION_POINTS = 4001
REST_VOLTAGE_MARGIN_V = 50e-3

Soc = Float[np.ndarray, "*any"]


@dataclass(frozen=True)
class FitError:
    """How far a curve passes from its points, in V."""

    rms_v: float
    max_v: float


@dataclass(frozen=True)
class CellModel:
    """What a candidate circuit does not change. Immutable; SOC is a fraction.

    `capacity_origin` says in words where the capacity comes from. A branch that was not measured
    equals the other, and the hysteresis voltage is zero. `errors` holds the fit errors of
    "charge", "discharge", "average" and "hysteresis".
    """

    capacity_ah: float
    capacity_origin: str
    charge: AbstractCurve
    discharge: AbstractCurve
    hysteresis: SegmentedHysteresis
    charge_points: tuple[OcvPoint, ...]
    discharge_points: tuple[OcvPoint, ...]
    errors: Mapping[str, FitError]
    warnings: tuple[str, ...] = ()

    def average_ocv_v(self, soc: Soc) -> Soc:
        """The mean of both branches in V, each constant beyond its end points."""
        return np.asarray((self.charge(soc) + self.discharge(soc)) / 2)

    def hysteresis_v(self, soc: Soc) -> Soc:
        """Charge minus discharge OCV in V, from the fitted segments."""
        return self.hysteresis(soc)

    @property
    def soc_range(self) -> tuple[float, float]:
        """Lowest and highest SOC of the measured points."""
        soc = [point.soc for point in self.charge_points + self.discharge_points]
        return min(soc), max(soc)

    def soc_from_rest_voltage(self, voltage_v: float, direction: int = 0) -> float:
        """The SOC of a rested cell.

        On the average curve, or with `direction` +1 or -1 on the charge or discharge branch.
        Raises `InputError` more than 50 mV outside the curve.
        """
        soc = np.linspace(*self.soc_range, INVERSION_POINTS)
        curve = {0: self.average_ocv_v, 1: self.charge, -1: self.discharge}[direction]
        # Where a fitted curve falls, its running maximum is the only monotone reading of it.
        ocv_v = np.maximum.accumulate(curve(soc))
        low_v, high_v = ocv_v[0], ocv_v[-1]
        if not low_v - REST_VOLTAGE_MARGIN_V <= voltage_v <= high_v + REST_VOLTAGE_MARGIN_V:
            raise InputError(
                f"the rested voltage {voltage_v:.4f} V is outside the OCV of this cell, "
                f"{low_v:.4f} to {high_v:.4f} V: give the SOC there as `initial_soc`"
            )
        # Flat stretches have no inverse; keep their lowest sample.
        rises = np.concatenate([[True], np.diff(ocv_v) > 0])
        return float(np.interp(voltage_v, ocv_v[rises], soc[rises]))

    def to_dict(self) -> dict[str, Any]:
        """The cell as plain numbers and words, for JSON."""
        stored = {
            "capacity [A.h]": self.capacity_ah,
            "capacity origin": self.capacity_origin,
            "charge": self.charge.to_dict(),
            "discharge": self.discharge.to_dict(),
            "hysteresis": self.hysteresis.to_dict(),
            "charge points": [_point_to_dict(point) for point in self.charge_points],
            "discharge points": [_point_to_dict(point) for point in self.discharge_points],
            "fit errors": {
                name: {"rms [V]": error.rms_v, "max [V]": error.max_v}
                for name, error in self.errors.items()
            },
            "warnings": list(self.warnings),
        }
        if isinstance(self.charge, PolynomialCurve) and isinstance(self.discharge, PolynomialCurve):
            # The average only where both branches are inside their end points.
            pairs = zip(self.charge.coefficients, self.discharge.coefficients, strict=True)
            stored["average coefficients [V]"] = [(a + b) / 2 for a, b in pairs]
        return stored

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> Self:
        """The cell that `to_dict` wrote. Raises `InputError` for what it did not write."""
        what = "cell"
        capacity_ah = stored_number(stored, "capacity [A.h]", what)
        if not 1 / LARGEST_AH <= capacity_ah <= LARGEST_AH:
            raise InputError(f"the stored capacity of {capacity_ah:g} Ah is no cell's")
        charge_points = _points_from(stored_value(stored, "charge points", what))
        discharge_points = _points_from(stored_value(stored, "discharge points", what))
        if not charge_points + discharge_points:
            raise InputError("the stored cell has no OCV points")
        errors = stored_value(stored, "fit errors", what)
        if not isinstance(errors, Mapping):
            raise InputError("the fit errors of the stored cell must be a table")
        return cls(
            capacity_ah=capacity_ah,
            capacity_origin=str(stored_value(stored, "capacity origin", what)),
            charge=curve_from_dict(stored_value(stored, "charge", what)),
            discharge=curve_from_dict(stored_value(stored, "discharge", what)),
            hysteresis=SegmentedHysteresis.from_dict(stored_value(stored, "hysteresis", what)),
            charge_points=charge_points,
            discharge_points=discharge_points,
            errors={
                str(name): FitError(
                    stored_number(error, "rms [V]", "fit error"),
                    stored_number(error, "max [V]", "fit error"),
                )
                for name, error in errors.items()
            },
            warnings=stored_texts(stored, "warnings", what),
        )


def fit_error(errors_v: Float[np.ndarray, "points"]) -> FitError:
    """Root mean square and largest error."""
    return FitError(float(np.sqrt(np.mean(errors_v**2))), float(np.abs(errors_v).max()))


def _point_to_dict(point: OcvPoint) -> dict[str, Any]:
    values = asdict(point)
    return {
        "soc": values["soc"],
        "voltage [V]": values["voltage_v"],
        "source": values["source"],
        "row": values["row"],
        "rest [s]": values["rest_s"],
    }


def _points_from(stored: Any) -> tuple[OcvPoint, ...]:
    if not isinstance(stored, list):
        raise InputError("the OCV points of the stored cell must be a list")
    what = "OCV point"
    return tuple(
        OcvPoint(
            soc=stored_number(point, "soc", what),
            voltage_v=stored_number(point, "voltage [V]", what),
            source=str(stored_value(point, "source", what)),
            row=int(stored_number(point, "row", what)),
            rest_s=stored_number(point, "rest [s]", what),
        )
        for point in stored
    )

"""From the records of an OCV test to a characterized cell."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator

from ..errors import InputError
from ..records.record import Record
from .curves import AbstractCurve, OcvFit, curve_warnings, fit_curve
from .hysteresis import HysteresisFit, SegmentedHysteresis
from .model import CellModel, FitError, fit_error
from .ocv_points import find_sweeps
from .soc_axis import OcvPoint, decide_capacity, place_on_soc, scale_warnings
from .sweeps import CHARGE, DISCHARGE, WORD, Sweep, join_sweeps

SAME_POINT = 1e-6


def characterize(
    records: Sequence[Record],
    *,
    capacity_ah: float | None = None,
    ocv_fit: OcvFit = "polynomial",
    hysteresis_fit: HysteresisFit = "continuous",
    rest_current_a: float | None = None,
) -> CellModel:
    """The cell that an OCV test shows: one or several records, in any order.

    Each record is a pulse-rest test or a slow sweep, of either direction or both. The cell rests
    below `rest_current_a`, by default C/100 and never under five times the noise at rest. Raises
    `InputError` that names the record where it is neither, and `ValueError` for an unknown fit.
    """
    if not records:
        raise InputError("an OCV test is needed; no record was given")
    if capacity_ah is not None and not capacity_ah > 0:
        raise InputError(f"the capacity must be positive, in Ah; {capacity_ah} was given")
    if rest_current_a is not None and not rest_current_a > 0:
        raise InputError(f"the rest current must be positive, in A; {rest_current_a} was given")
    tests = [find_sweeps(record, capacity_ah, rest_current_a) for record in records]
    found = [sweep for of_record, _ in tests for sweep in of_record]
    sweeps = {
        direction: join_sweeps(same)
        for direction in (DISCHARGE, CHARGE)
        if (same := [sweep for sweep in found if sweep.direction == direction])
    }
    capacity = decide_capacity(sweeps, capacity_ah)
    shares_axis = len(records) == 1
    points = place_on_soc(sweeps, capacity, shares_axis)
    measured = {direction: _curve(branch, ocv_fit) for direction, branch in points.items()}
    warnings = [text for _, of_record in tests for text in of_record]
    warnings.extend(capacity.warnings)
    warnings.extend(scale_warnings(sweeps, capacity, shares_axis))
    warnings.extend(_kind_warnings(sweeps))
    for direction, curve in measured.items():
        warnings.extend(curve_warnings(curve, WORD[direction]))
    only = next(iter(measured.values()))
    charge, discharge = measured.get(CHARGE, only), measured.get(DISCHARGE, only)
    if len(measured) == 2:
        soc = _shared_soc(charge, discharge)
        hysteresis = SegmentedHysteresis.fit(soc, charge(soc) - discharge(soc), hysteresis_fit)
    else:
        hysteresis = SegmentedHysteresis.zero()
    return CellModel(
        capacity_ah=capacity.value_ah,
        capacity_origin=capacity.origin,
        charge=charge,
        discharge=discharge,
        hysteresis=hysteresis,
        charge_points=points.get(CHARGE, ()),
        discharge_points=points.get(DISCHARGE, ()),
        errors=_errors(measured, hysteresis),
        warnings=tuple(warnings),
    )


def _curve(points: tuple[OcvPoint, ...], ocv_fit: OcvFit) -> AbstractCurve:
    soc = np.array([point.soc for point in points])
    voltage_v = np.array([point.voltage_v for point in points])
    return fit_curve(soc, voltage_v, ocv_fit)


def _shared_soc(charge: AbstractCurve, discharge: AbstractCurve) -> Float[np.ndarray, "points"]:
    """SOC of all points of both branches that lie on both."""
    low = max(charge.soc[0], discharge.soc[0])
    high = min(charge.soc[-1], discharge.soc[-1])
    soc = np.union1d(charge.soc, discharge.soc)
    soc = soc[(soc >= low) & (soc <= high)]
    # Points of both branches at the same SOC differ in their last bits; one of them is enough.
    soc = soc[np.concatenate([[True], np.diff(soc) > SAME_POINT])[: soc.size]]
    if soc.size == 0:
        raise InputError(
            f"the charge covers SOC {charge.soc[0]:.3f} to {charge.soc[-1]:.3f}, the discharge "
            f"{discharge.soc[0]:.3f} to {discharge.soc[-1]:.3f}: they share nothing, so they are "
            "not one test"
        )
    return soc


def _errors(
    measured: Mapping[int, AbstractCurve], hysteresis: SegmentedHysteresis
) -> dict[str, FitError]:
    """Errors at the points; those of the average against the mean of both branches' PCHIP."""
    errors = {WORD[direction]: fit_error(curve.errors_v) for direction, curve in measured.items()}
    curves = list(measured.values())
    if len(curves) == 2:
        soc = _shared_soc(measured[CHARGE], measured[DISCHARGE])
        through_v = [PchipInterpolator(curve.soc, curve.voltage_v)(soc) for curve in curves]
        fitted_v = [curve(soc) for curve in curves]
        errors["average"] = fit_error(np.mean(fitted_v, axis=0) - np.mean(through_v, axis=0))
        errors["hysteresis"] = fit_error(hysteresis.errors_v)
    else:
        errors["average"] = errors[WORD[next(iter(measured))]]
    return errors


def _kind_warnings(sweeps: Mapping[int, Sweep]) -> list[str]:
    if len(sweeps) == 1:
        (only,) = sweeps.values()
        return [
            f"only the {WORD[only.direction]} was measured: the hysteresis voltage is unknown and "
            "taken as zero"
        ]
    kinds = {sweep.kind for sweep in sweeps.values()}
    if len(kinds) == 2:
        return [
            "one branch comes from rests, the other from a slow sweep: the hysteresis voltage "
            "holds the overpotential of the slow current"
        ]
    return []

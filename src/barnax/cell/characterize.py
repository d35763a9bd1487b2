"""From an OCV test, as records or as a table, to a characterized cell."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator

from ..errors import InputError
from ..notices import Notice, notice
from ..records import Record
from .curves import (
    AbstractCurve,
    Curve,
    HysteresisFit,
    InterpolatedCurve,
    OcvFit,
    PolynomialCurve,
    SegmentedHysteresis,
    curve_warnings,
    fit_curve,
)
from .model import REFERENCE_DEGC, CellModel, FitError, fit_error
from .ocv_points import find_sweeps
from .ocv_table import EITHER, OcvTable
from .soc_axis import (
    CHARGE,
    DISCHARGE,
    GIVEN,
    WORD,
    Capacity,
    OcvPoint,
    Sweep,
    decide_capacity,
    join_sweeps,
    place_on_soc,
)

# Two branches of a cell without hysteresis may cross by what their fits and tests are off.
_LEAST_GAP_V = -2e-3
SAME_POINT = 1e-6
# C/15, with the slack of a cell that holds a little less than its rating.
SLOW_HOURS = 14.0


def characterize(
    tests: Sequence[Record | OcvTable],
    *,
    capacity_ah: float | None = None,
    ocv_capacity_ah: float | None = None,
    ocv_fit: OcvFit = "interpolated",
    hysteresis_fit: HysteresisFit = "continuous",
    rest_current_a: float | None = None,
) -> CellModel:
    """The cell model from an OCV test.

    Args:
        tests: One or several records or tables, in any order. A record is a test with pulses and
            rests or a slow sweep, in one direction or both; a table has an SOC, but no capacity.
        capacity_ah: The capacity in simulations. It does not change the SOC axis of a test from
            full to empty, which is scaled by its own charge.
        ocv_capacity_ah: The capacity that scales any other test; by default `capacity_ah`.
        ocv_fit: A monotone interpolation, or a polynomial of degree seven (Li et al., 2023, Eq.
            21).
        hysteresis_fit: Five segments of the hysteresis voltage, joined or each by itself.
        rest_current_a: The cell rests below this current; by default C/100, or five times the noise
            at rest if that is more.

    Raises `InputError` naming a record that is not an OCV test, and `ValueError` for an unknown
    fit.
    """
    if not tests:
        raise InputError("an OCV test is needed; no record was given")
    _require_positive("capacity", capacity_ah, "Ah")
    _require_positive("ocv_capacity", ocv_capacity_ah, "Ah")
    _require_positive("rest_current", rest_current_a, "A")
    tables = [test for test in tests if isinstance(test, OcvTable)]
    records = [test for test in tests if isinstance(test, Record)]
    found = [find_sweeps(record, capacity_ah, rest_current_a) for record in records]
    sweeps = {
        direction: join_sweeps(same)
        for direction in (DISCHARGE, CHARGE)
        if (same := [sweep for one, _ in found for sweep in one if sweep.direction == direction])
    }
    warnings = [warning for table in tables for warning in table.warnings]
    warnings.extend(warning for _, of_record in found for warning in of_record)
    points: dict[int, tuple[OcvPoint, ...]] = {}
    for table in tables:
        _join(points, table.branches, tables)
    if sweeps:
        capacity = decide_capacity(sweeps, capacity_ah, ocv_capacity_ah)
        warnings.extend(capacity.warnings)
        placed, scaled = place_on_soc(sweeps, capacity, len(records) == 1)
        warnings.extend(scaled)
        _join(points, placed, tables)
    elif capacity_ah is not None:
        capacity = Capacity(capacity_ah, GIVEN, capacity_ah)
    else:
        raise notice("ocv-table.no-capacity", tables[0].name).error()
    warnings.extend(_kind_warnings(sweeps, points))
    warnings.extend(_speed_warnings(sweeps))
    fitted = _fitted(points, ocv_fit, hysteresis_fit)
    charge, discharge = fitted["charge"], fitted["discharge"]
    for direction, of_direction in sorted(points.items()):
        curve = charge if direction == CHARGE else discharge
        of_curve = curve_warnings(curve, WORD.get(direction))
        warnings.extend(warning.about(_sources(of_direction)) for warning in of_curve)
    if len(points) == 2:
        soc = _shared_soc(charge, discharge)
        if (mean_v := float(np.mean(charge(soc) - discharge(soc)))) < _LEAST_GAP_V:
            both = _sources([*points[CHARGE], *points[DISCHARGE]])
            warnings.append(notice("ocv-test.exchanged", both, below_v=-mean_v))
    return CellModel(
        capacity_ah=capacity.value_ah,
        capacity_origin=capacity.origin,
        warnings=tuple(warnings),
        **fitted,
    )


def without_drop(cell: CellModel, resistance_ohm: float) -> CellModel:
    """The cell at rest: what slow sweeps lost at a resistance is given back to their branches.

    Where that is more than lies between the branches they meet, and there is no hysteresis.
    """
    branches = {CHARGE: cell.charge_points, DISCHARGE: cell.discharge_points}
    points = {way: branch for way, branch in branches.items() if branch}
    soc, voltage_v, current_a = (
        {way: np.array([getattr(point, name) for point in points[way]]) for way in points}
        for name in ("soc", "voltage_v", "current_a")
    )
    drop_v = {way: resistance_ohm * current_a[way] for way in points}
    share: dict[int, Any] = dict.fromkeys(points, 1.0)
    if len(points) == 2:
        for way in points:
            other_v = InterpolatedCurve.fit(soc[-way], voltage_v[-way])(soc[way])
            drops_v = drop_v[way] - np.interp(soc[way], soc[-way], drop_v[-way])
            gap_v = np.maximum(way * (voltage_v[way] - other_v), 0.0)
            share[way] = gap_v / np.maximum(gap_v, np.abs(drops_v) + np.finfo(float).tiny)
    at_rest = {
        way: tuple(
            replace(point, voltage_v=float(rested_v))
            for point, rested_v in zip(
                points[way], voltage_v[way] + share[way] * drop_v[way], strict=True
            )
        )
        for way in points
    }
    ocv_fit = "polynomial" if isinstance(cell.discharge, PolynomialCurve) else "interpolated"
    fitted = _fitted(at_rest, ocv_fit, cell.hysteresis.kind)
    return replace(cell, sweep_ohm=resistance_ohm, **fitted)


def characterize_over_temperature(
    by_degc: Mapping[float, Sequence[Record | OcvTable]], **options: Any
) -> CellModel:
    """The cell that OCV tests at several temperatures show: as at the one nearest to 25 degC, and
    with `CellModel.at` at the others. Options are those of `characterize`, which raises what it
    does for the tests of one temperature."""
    return over_temperatures(
        {degc: characterize(tests, **options) for degc, tests in sorted(by_degc.items())}
    )


def over_temperatures(by_degc: Mapping[float, CellModel]) -> CellModel:
    """One cell of those of several temperatures in degC, from cold to warm."""
    cells = {degc: replace(cell, temperature_degc=degc) for degc, cell in by_degc.items()}
    nearest = min(cells, key=lambda degc: abs(degc - REFERENCE_DEGC))
    others = tuple(cell for degc, cell in cells.items() if degc != nearest)
    warnings = dict.fromkeys(one for cell in cells.values() for one in cell.warnings)
    return replace(cells[nearest], elsewhere=others, warnings=tuple(warnings))


def _require_positive(option: str, value: float | None, unit: str) -> None:
    if value is not None and not value > 0:
        raise InputError(f"`{option}` must be positive, in {unit}; {value} was given")


def _join(
    points: dict[int, tuple[OcvPoint, ...]],
    more: Mapping[int, tuple[OcvPoint, ...]],
    tables: Sequence[OcvTable],
) -> None:
    """Add branches. Raises `InputError` for one given twice, or a single curve beside another."""
    if points and (points.keys() & more.keys() or EITHER in {*points, *more}):
        names = ", ".join(table.name for table in tables)
        raise InputError(
            f"the OCV table {names} has a branch that another OCV test also has; give only one of "
            "them"
        )
    points.update(more)


def _fitted(
    points: Mapping[int, tuple[OcvPoint, ...]], ocv_fit: OcvFit, hysteresis_fit: HysteresisFit
) -> dict[str, Any]:
    """The fields of a cell that follow from its points: curves, hysteresis, and their errors."""
    measured = {
        direction: _curve(points[direction], ocv_fit)
        for direction in (DISCHARGE, CHARGE, EITHER)
        if direction in points
    }
    only = next(iter(measured.values()))
    charge, discharge = measured.get(CHARGE, only), measured.get(DISCHARGE, only)
    hysteresis = SegmentedHysteresis.zero()
    if len(measured) == 2:
        soc = _shared_soc(charge, discharge)
        hysteresis = SegmentedHysteresis.fit(soc, charge(soc) - discharge(soc), hysteresis_fit)
    return {
        "charge": charge,
        "discharge": discharge,
        "hysteresis": hysteresis,
        "charge_points": points.get(CHARGE, ()),
        "discharge_points": points.get(DISCHARGE, points.get(EITHER, ())),
        "errors": _errors(measured, hysteresis),
    }


def _curve(points: tuple[OcvPoint, ...], ocv_fit: OcvFit) -> Curve:
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
            f"{discharge.soc[0]:.3f} to {discharge.soc[-1]:.3f}: they do not overlap; give two "
            "branches of the same cell"
        )
    return soc


def _errors(
    measured: Mapping[int, AbstractCurve], hysteresis: SegmentedHysteresis
) -> dict[str, FitError]:
    """Errors at the points; those of the average against the mean of both branches' PCHIP."""
    errors = {
        WORD.get(direction, "discharge"): fit_error(curve.errors_v)
        for direction, curve in measured.items()
    }
    curves = list(measured.values())
    if len(curves) == 2:
        soc = _shared_soc(measured[CHARGE], measured[DISCHARGE])
        through_v = [PchipInterpolator(curve.soc, curve.voltage_v)(soc) for curve in curves]
        fitted_v = [curve(soc) for curve in curves]
        errors["average"] = fit_error(np.mean(fitted_v, axis=0) - np.mean(through_v, axis=0))
        errors["hysteresis"] = fit_error(hysteresis.errors_v)
    else:
        (errors["average"],) = errors.values()
    return errors


def _sources(points: Sequence[OcvPoint]) -> str:
    """The files that the points come from."""
    return ", ".join(dict.fromkeys(point.source for point in points))


def _kind_warnings(
    sweeps: Mapping[int, Sweep], points: Mapping[int, tuple[OcvPoint, ...]]
) -> list[Notice]:
    source = _sources([point for branch in points.values() for point in branch])
    if len(points) == 1:
        # A table of one voltage has no direction.
        return [notice("ocv-test.no-hysteresis", source, direction=WORD.get(*points))]
    if len({sweep.kind for sweep in sweeps.values()}) == 2:
        return [notice("ocv-test.mixed", source)]
    return []


def _speed_warnings(sweeps: Mapping[int, Sweep]) -> list[Notice]:
    """A warning where a sweep is too fast for its hysteresis."""
    hours = {
        sweep.passed_ah / float(np.median([abs(point.current_a) for point in sweep.points])): sweep
        for sweep in sweeps.values()
        if sweep.kind == "slow"
    }
    fastest = min(hours, default=SLOW_HOURS)
    if fastest >= SLOW_HOURS:
        return []
    return [notice("ocv-test.fast", hours[fastest].source, hours=fastest)]

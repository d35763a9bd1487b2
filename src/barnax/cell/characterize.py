"""From an OCV test, as records or as a table, to a characterized cell."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator

from ..errors import InputError, require_positive
from ..notices import Notice
from ..records import Record
from ..settings import HysteresisFit, OcvFit
from .curves import Curve, InterpolatedCurve, SegmentedHysteresis, curve_warnings, fit_curve
from .model import REFERENCE_DEGC, CellModel, fit_error
from .ocv_points import EITHER, OcvTable, find_sweeps
from .soc_axis import (
    CHARGE,
    DISCHARGE,
    GIVEN,
    WORD,
    Capacity,
    OcvPoint,
    Sweep,
    by_direction,
    decide_capacity,
    scale_to_soc,
)

Tests = Sequence[Record | OcvTable]
# The discharge branch and the charge branch.
Points = Mapping[int, Sequence[OcvPoint]]

# Two branches of a cell without hysteresis may cross within the errors of their fits and tests.
_LEAST_GAP_V = -2e-3
SAME_POINT = 1e-6
# C/15, with a tolerance for a cell that has slightly less than its rated capacity.
SLOW_HOURS = 14.0


def characterize(
    tests: Tests,
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

    Raises `InputError` naming a record that is not an OCV test, and for an unknown fit.
    """
    if not tests:
        raise InputError("an OCV test is needed; no record was given")
    given = (("capacity", capacity_ah, "Ah"), ("ocv_capacity", ocv_capacity_ah, "Ah"))
    for option, value, unit in (*given, ("rest_current", rest_current_a, "A")):
        require_positive(option, value, unit)
    of_records = [
        find_sweeps(test, capacity_ah, rest_current_a) for test in tests if isinstance(test, Record)
    ]
    tables = [test for test in tests if isinstance(test, OcvTable)]
    for missing in (one.missing for one in of_records if one.missing):
        raise missing.error(".")
    sweeps = by_direction([sweep for one in of_records for sweep in one.sweeps])
    warnings = [warning for one in (*tables, *of_records) for warning in one.warnings]
    ways = [way for table in tables for way in table.branches] + [*sweeps]
    if len(set(ways)) < len(ways) or (EITHER in ways and len(ways) > 1):
        names = ", ".join(table.name for table in tables)
        raise InputError(
            f"the OCV table {names} has a branch that another OCV test also has; give only one of "
            "them"
        )
    points = {way: branch for table in tables for way, branch in table.branches.items()}
    if sweeps:
        capacity = decide_capacity(sweeps, capacity_ah, ocv_capacity_ah)
        placed, scaled = scale_to_soc(sweeps, capacity, len(of_records) == 1)
        warnings += [*capacity.warnings, *scaled]
        points |= placed
    elif capacity_ah is not None:
        capacity = Capacity(capacity_ah, GIVEN, capacity_ah)
    else:
        raise Notice("ocv-table.no-capacity", subject=tables[0].name).error()
    warnings += _test_warnings(sweeps, points)
    if len(points) == 2:
        (charge_low, *_, charge_high), (low, *_, high) = (
            [point.soc for point in points[way]] for way in (CHARGE, DISCHARGE)
        )
        if max(charge_low, low) > min(charge_high, high):
            raise InputError(
                f"the charge covers SOC {charge_low:.3f} to {charge_high:.3f}, the discharge "
                f"{low:.3f} to {high:.3f}: they do not overlap; give two branches of the same cell"
            )
    fitted = _fitted(points, ocv_fit, hysteresis_fit)
    for way, branch in sorted(points.items()):
        curve = fitted["charge" if way == CHARGE else "discharge"]
        of_curve = curve_warnings(curve, WORD.get(way))
        warnings += [warning.about(_sources(branch)) for warning in of_curve]
    gaps_v = [gap_v for _, gap_v in fitted["hysteresis"].points]
    if gaps_v and (mean_v := float(np.mean(gaps_v))) < _LEAST_GAP_V:
        both = _sources([*points[CHARGE], *points[DISCHARGE]])
        warnings.append(Notice("ocv-test.exchanged", {"below_v": -mean_v}, both))
    return CellModel(capacity.value_ah, capacity.origin, warnings=tuple(warnings), **fitted)


def without_drop(cell: CellModel, resistance_ohm: float) -> CellModel:
    """The cell at rest: the voltage that slow sweeps lost in a resistance is returned to their
    branches.

    If that is more than the distance between the branches, they meet, and there is no hysteresis.
    """
    branches = {CHARGE: cell.charge_points, DISCHARGE: cell.discharge_points}
    points = {way: branch for way, branch in branches.items() if branch}
    soc, voltage_v, current_a = (
        {way: np.array([getattr(point, name) for point in points[way]]) for way in points}
        for name in ("soc", "voltage_v", "current_a")
    )
    drop_v = {way: resistance_ohm * current_a[way] for way in points}
    at_rest: dict[int, tuple[OcvPoint, ...]] = {}
    for way in points:
        share: Any = 1.0
        if len(points) == 2:
            other_v = InterpolatedCurve.fit(soc[-way], voltage_v[-way])(soc[way])
            drops_v = drop_v[way] - np.interp(soc[way], soc[-way], drop_v[-way])
            gap_v = np.maximum(way * (voltage_v[way] - other_v), 0.0)
            share = gap_v / np.maximum(gap_v, np.abs(drops_v) + np.finfo(float).tiny)
        rested_v = (voltage_v[way] + share * drop_v[way]).tolist()
        moved = zip(points[way], rested_v, strict=True)
        at_rest[way] = tuple(replace(point, voltage_v=rest_v) for point, rest_v in moved)
    fitted = _fitted(at_rest, cell.discharge.kind, cell.hysteresis.kind)
    return replace(cell, sweep_ohm=resistance_ohm, **fitted)


def characterize_over_temperature(by_degc: Mapping[float, Tests], **options: Any) -> CellModel:
    """The cell from OCV tests at several temperatures: that of the temperature nearest to 25 degC,
    with `CellModel.at` for the others. Options and errors are those of `characterize`."""
    cells = {degc: characterize(tests, **options) for degc, tests in sorted(by_degc.items())}
    return over_temperatures(cells)


def over_temperatures(by_degc: Mapping[float, CellModel]) -> CellModel:
    """One cell from those at several temperatures in degC, from cold to warm."""
    cells = {degc: replace(cell, temperature_degc=degc) for degc, cell in by_degc.items()}
    nearest = min(cells, key=lambda degc: abs(degc - REFERENCE_DEGC))
    others = tuple(cell for degc, cell in cells.items() if degc != nearest)
    warnings = dict.fromkeys(one for cell in cells.values() for one in cell.warnings)
    return replace(cells[nearest], elsewhere=others, warnings=tuple(warnings))


def _fitted(points: Points, ocv_fit: OcvFit, hysteresis_fit: HysteresisFit) -> dict[str, Any]:
    """The fields of a cell that follow from its points: curves, hysteresis, and their errors; those
    of the average are relative to the mean of both branches' PCHIP."""
    curves: dict[int, Curve] = {}
    for way in (way for way in (DISCHARGE, CHARGE, EITHER) if way in points):
        soc = np.array([point.soc for point in points[way]])
        voltage_v = np.array([point.voltage_v for point in points[way]])
        curves[way] = fit_curve(soc, voltage_v, ocv_fit)
    only = next(iter(curves.values()))
    charge, discharge = curves.get(CHARGE, only), curves.get(DISCHARGE, only)
    errors = {WORD.get(way, "discharge"): fit_error(curves[way].errors_v) for way in curves}
    hysteresis = SegmentedHysteresis.zero()
    if len(curves) == 1:
        errors["average"] = fit_error(only.errors_v)
    else:
        soc = _shared_soc(charge, discharge)
        fitted_v = [curve(soc) for curve in curves.values()]
        through_v = [
            PchipInterpolator(sweep.soc, sweep.voltage_v)(soc) for sweep in curves.values()
        ]
        errors["average"] = fit_error(np.mean(fitted_v, axis=0) - np.mean(through_v, axis=0))
        hysteresis = SegmentedHysteresis.fit(soc, charge(soc) - discharge(soc), hysteresis_fit)
        errors["hysteresis"] = fit_error(hysteresis.errors_v)
    return {
        "charge": charge,
        "discharge": discharge,
        "hysteresis": hysteresis,
        "charge_points": points.get(CHARGE, ()),
        "discharge_points": points.get(DISCHARGE, points.get(EITHER, ())),
        "errors": errors,
    }


def _shared_soc(charge: Curve, discharge: Curve) -> Float[np.ndarray, "points"]:
    """SOC of all points of both branches within their common range."""
    soc = np.union1d(charge.soc, discharge.soc)
    low, high = max(charge.soc[0], discharge.soc[0]), min(charge.soc[-1], discharge.soc[-1])
    soc = soc[(soc >= low) & (soc <= high)]
    # Points of both branches at the same SOC differ in their last bits; one of them suffices.
    return soc[np.append(True, np.diff(soc) > SAME_POINT)]


def _sources(points: Sequence[OcvPoint]) -> str:
    """The files of the points."""
    return ", ".join(dict.fromkeys(point.source for point in points))


def _test_warnings(sweeps: Mapping[int, Sweep], points: Points) -> Iterator[Notice]:
    """Warnings of what the kind of test leaves unknown, and of a sweep too fast for its
    hysteresis."""
    source = _sources([point for branch in points.values() for point in branch])
    if len(points) == 1:
        # A table of one voltage has no direction.
        yield Notice("ocv-test.no-hysteresis", {"direction": WORD.get(*points)}, source)
    elif len({sweep.kind for sweep in sweeps.values()}) == 2:
        yield Notice("ocv-test.under-load", subject=source)
    slow = [sweep for sweep in sweeps.values() if sweep.kind == "slow"]
    fastest = min(slow, key=lambda sweep: sweep.hours, default=None)
    if fastest and fastest.hours < SLOW_HOURS:
        yield Notice("ocv-test.under-load", {"hours": fastest.hours}, fastest.source)

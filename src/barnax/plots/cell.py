"""The cell's figures: open-circuit voltage and hysteresis voltage."""

import itertools
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..cell import InterpolatedCurve
from ..cell.curves import KNOTS
from .sources import cell_of
from .style import (
    BLACK,
    BLUE,
    GREY,
    SKY_BLUE,
    VERMILLION,
    draw_points,
    figure_style,
    finish,
    finish_axes,
    is_column,
    make_figure,
)

if TYPE_CHECKING:
    from ..cell import AbstractCurve, CellModel, OcvPoint
    from ..results import Result


CURVE_SAMPLES = 1001
# More points than this (a slow sweep has them) would hide the curve under full-size markers.
FEW_POINTS = 50
SMALLEST_RANGE_MV = 1.0


@figure_style()
def plot_ocv(cell: "CellModel | Result | str | Path") -> Figure:
    """OCV points and curves over SOC; below, what each curve leaves at its own points, in mV.

    A branch that was not measured is not drawn, and then there is no average either. A result or
    the path of a `result.json` serves as well as the cell in it.

    >>> from barnax import bundled_file, characterize, read_record
    >>> tests = [read_record(bundled_file(name)) for name in ("ocv_charge", "ocv_discharge")]
    >>> [axes.get_ylabel() for axes in plot_ocv(characterize(tests)).axes]
    ['Open-circuit voltage [V]', 'Residual [mV]\\n(point − curve)']
    """
    cell = cell_of(cell)
    figure = make_figure()
    ocv, residual = figure.subplots(2, 1, sharex=True, height_ratios=[2.2, 1.0])
    residual.axhline(0.0, color=BLACK, linewidth=0.6)
    branches: list[tuple[str, AbstractCurve, tuple[OcvPoint, ...], str, str, str]] = [
        ("charge", cell.charge, cell.charge_points, VERMILLION, "^", "--"),
        ("discharge", cell.discharge, cell.discharge_points, BLUE, "v", "-"),
    ]
    measured = [branch for branch in branches if branch[2]]
    for name, curve, points, color, marker, line_style in measured:
        point_soc = np.array([point.soc for point in points])
        point_v = np.array([point.voltage_v for point in points])
        soc = np.linspace(curve.soc[0], curve.soc[-1], CURVE_SAMPLES)
        size = 4.5 if len(points) <= FEW_POINTS else 1.8
        symbol = {"color": color, "markerfacecolor": "white", "markeredgewidth": 0.9}
        ocv.plot(soc, curve(soc), color=color, linestyle=line_style, label=f"{name} curve")
        draw_points(ocv, point_soc, point_v, marker, size, **symbol, label=f"{name} points")
        missed_mv = 1e3 * (point_v - curve(point_soc))
        draw_points(residual, point_soc, missed_mv, marker, size, **symbol)
    if len(measured) == 2:
        soc = np.linspace(*cell.soc_range, CURVE_SAMPLES)
        ocv.plot(soc, cell.average_ocv_v(soc), color=BLACK, linestyle="-.", label="average")
    ocv.set_ylabel("Open-circuit voltage [V]")
    residual.set_ylabel("Residual [mV]\n(point − curve)")
    residual.set_xlabel("State of charge [-]")
    low, high = residual.get_ylim()
    # Curves through their points leave rounding errors, which must not look like a finding.
    residual.set_ylim(min(low, -SMALLEST_RANGE_MV), max(high, SMALLEST_RANGE_MV))
    return finish(figure, ocv, residual)


SAME_MV = 0.1
NOT_MEASURED = "not measured: the OCV is of one branch only"


@figure_style()
def plot_hysteresis(cell: "CellModel | Result | str | Path") -> Figure:
    """Charge minus discharge OCV in mV, on a scale that includes zero; dotted lines are the knots.

    Filled points are what the segments were fitted to: the difference of both branch curves at
    the SOC of every OCV point; the thin line is that difference everywhere. Open points are the
    difference with PCHIP through the measured points in place of the curves, drawn where that is
    another: a polynomial that misses its points makes hysteresis that was not measured. A result
    or the path of a `result.json` serves as well as the cell in it. Of a cell with one branch it
    says that no hysteresis was measured.

    >>> from barnax import bundled_file, characterize, read_record
    >>> tests = [read_record(bundled_file(name)) for name in ("ocv_charge", "ocv_discharge")]
    >>> plot_hysteresis(characterize(tests)).axes[0].get_ylabel()
    'Hysteresis voltage [mV]\\n(charge − discharge OCV)'
    """
    cell = cell_of(cell)
    figure = make_figure()
    axes = figure.subplots()
    axes.set_xlabel("State of charge [-]")
    axes.set_ylabel("Hysteresis voltage [mV]\n(charge − discharge OCV)")
    if not cell.hysteresis.points:
        place = {"transform": axes.transAxes, "ha": "center", "va": "center"}
        axes.text(0.5, 0.5, NOT_MEASURED, **place)
        axes.set_yticks([])
        finish_axes(axes)
        return figure
    axes.axhline(0.0, color=BLACK, linewidth=0.6)
    for knot in KNOTS[1:-1]:
        axes.axvline(knot, color=GREY, linestyle=":", linewidth=0.9)
    _draw_difference(axes, cell)
    for index, (left, right) in enumerate(itertools.pairwise(KNOTS)):
        ends_mv = 1e3 * np.array(cell.hysteresis.ends_v[index])
        label = f"five segments ({cell.hysteresis.kind})" if index == 0 else "_segment"
        axes.plot([left, right], ends_mv, color=VERMILLION, linewidth=2.0, label=label)
    axes.set_xticks(KNOTS[1:-1], minor=True)
    return finish(figure, axes, columns=1 if is_column() else 2)


def _draw_difference(axes: Axes, cell: "CellModel") -> None:
    soc, fitted_v = np.array(cell.hysteresis.points).T
    inside = np.linspace(soc[0], soc[-1], CURVE_SAMPLES)
    gap_mv = 1e3 * (cell.charge(inside) - cell.discharge(inside))
    label = "difference of the branch curves"
    axes.plot(inside, gap_mv, color=SKY_BLUE, linewidth=1.2, label=label)
    label = "the same at the OCV points"
    draw_points(axes, soc, 1e3 * fitted_v, "o", 3.2, color=BLUE, label=label)
    through_charge = InterpolatedCurve(cell.charge.points)
    through_discharge = InterpolatedCurve(cell.discharge.points)
    measured_mv = 1e3 * (through_charge(soc) - through_discharge(soc))
    if np.max(np.abs(measured_mv - 1e3 * fitted_v)) > SAME_MV:
        symbol = {"color": BLACK, "markerfacecolor": "white", "markeredgewidth": 0.8}
        label = "difference of the measured points (PCHIP)"
        draw_points(axes, soc, measured_mv, "D", 3.6, **symbol, label=label)

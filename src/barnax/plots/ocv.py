"""Open-circuit voltage of a cell: measured points, fitted branches and their average."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from .sources import cell_of
from .style import BLACK, BLUE, VERMILLION, figure_style, finish_axes, legend_above, make_figure

if TYPE_CHECKING:
    from ..cell import AbstractCurve, CellModel, OcvPoint
    from ..result import Result

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
        symbol = {
            "color": color,
            "linestyle": "none",
            "marker": marker,
            "markersize": size,
            "markerfacecolor": "white",
            "markeredgewidth": 0.9,
        }
        ocv.plot(soc, curve(soc), color=color, linestyle=line_style, label=f"{name} curve")
        ocv.plot(point_soc, point_v, **symbol, label=f"{name} points")
        residual.plot(point_soc, 1e3 * (point_v - curve(point_soc)), **symbol)
    if len(measured) == 2:
        soc = np.linspace(*cell.soc_range, CURVE_SAMPLES)
        ocv.plot(soc, cell.average_ocv_v(soc), color=BLACK, linestyle="-.", label="average")
    ocv.set_ylabel("Open-circuit voltage [V]")
    residual.set_ylabel("Residual [mV]\n(point − curve)")
    residual.set_xlabel("State of charge [-]")
    low, high = residual.get_ylim()
    # Curves through their points leave rounding errors, which must not look like a finding.
    residual.set_ylim(min(low, -SMALLEST_RANGE_MV), max(high, SMALLEST_RANGE_MV))
    finish_axes(ocv, residual)
    legend_above(figure, ocv, columns=3)
    return figure

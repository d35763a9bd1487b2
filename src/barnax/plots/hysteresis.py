"""Hysteresis voltage over the state of charge, and its five segments."""

import itertools
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..cell import InterpolatedCurve
from ..cell.hysteresis import KNOTS
from .sources import cell_of
from .style import (
    BLACK,
    BLUE,
    GREY,
    SKY_BLUE,
    VERMILLION,
    figure_style,
    finish_axes,
    legend_above,
    make_figure,
)

if TYPE_CHECKING:
    from ..cell import CellModel
    from ..result import Result

CURVE_SAMPLES = 1001
SAME_MV = 0.1


@figure_style()
def plot_hysteresis(cell: "CellModel | Result | str | Path") -> Figure:
    """Charge minus discharge OCV in mV, on a scale that includes zero; dotted lines are the knots.

    Filled points are what the segments were fitted to: the difference of both branch curves at
    the SOC of every OCV point; the thin line is that difference everywhere. Open points are the
    difference with PCHIP through the measured points in place of the curves, drawn where that is
    another: a polynomial that misses its points makes hysteresis that was not measured. A result
    or the path of a `result.json` serves as well as the cell in it.

    >>> from barnax import bundled_file, characterize, read_record
    >>> tests = [read_record(bundled_file(name)) for name in ("ocv_charge", "ocv_discharge")]
    >>> plot_hysteresis(characterize(tests)).axes[0].get_ylabel()
    'Hysteresis voltage [mV]\\n(charge − discharge OCV)'
    """
    cell = cell_of(cell)
    figure = make_figure()
    axes = figure.subplots()
    axes.axhline(0.0, color=BLACK, linewidth=0.6)
    for knot in KNOTS[1:-1]:
        axes.axvline(knot, color=GREY, linestyle=":", linewidth=0.9)
    if cell.hysteresis.points:
        _draw_difference(axes, cell)
    for index, (left, right) in enumerate(itertools.pairwise(KNOTS)):
        axes.plot(
            [left, right],
            1e3 * np.array(cell.hysteresis.ends_v[index]),
            color=VERMILLION,
            linewidth=2.0,
            label=f"five segments ({cell.hysteresis.kind})" if index == 0 else "_segment",
        )
    axes.set_xticks(KNOTS[1:-1], minor=True)
    axes.set_xlabel("State of charge [-]")
    axes.set_ylabel("Hysteresis voltage [mV]\n(charge − discharge OCV)")
    finish_axes(axes)
    legend_above(figure, axes, columns=2)
    return figure


def _draw_difference(axes: Axes, cell: "CellModel") -> None:
    soc, fitted_v = np.array(cell.hysteresis.points).T
    inside = np.linspace(soc[0], soc[-1], CURVE_SAMPLES)
    axes.plot(
        inside,
        1e3 * (cell.charge(inside) - cell.discharge(inside)),
        color=SKY_BLUE,
        linewidth=1.2,
        label="difference of the branch curves",
    )
    axes.plot(
        soc,
        1e3 * fitted_v,
        color=BLUE,
        linestyle="none",
        marker="o",
        markersize=3.2,
        label="the same at the OCV points",
    )
    through_charge = InterpolatedCurve(cell.charge.points)
    through_discharge = InterpolatedCurve(cell.discharge.points)
    measured_mv = 1e3 * (through_charge(soc) - through_discharge(soc))
    if np.max(np.abs(measured_mv - 1e3 * fitted_v)) > SAME_MV:
        axes.plot(
            soc,
            measured_mv,
            color=BLACK,
            linestyle="none",
            marker="D",
            markersize=3.6,
            markerfacecolor="white",
            markeredgewidth=0.8,
            label="difference of the measured points (PCHIP)",
        )

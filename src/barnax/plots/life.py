"""Ageing over time: every cell of a fleet, and one cell with what each of its records told."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .pictures import illustration
from .style import BLACK, BLUE, GREY, SKY_BLUE, VERMILLION, finish, make_figure

if TYPE_CHECKING:
    from ..life import Life

# Labels of the axes, and the factors to their units.
LABELS = {
    "capacity [A.h]": ("Capacity [A.h]", 1.0),
    "R0 [Ohm]": ("R0 [mOhm]", 1e3),
    "R [Ohm]": ("All resistances [mOhm]", 1e3),
    "OCV shift [V]": ("OCV shift [mV]", 1e3),
}
AGES = {"A.h": "Throughput [A.h]", "cycle": "Age [cycles]"}
# The most cells drawn of a large fleet, beside those that are odd.
MOST_DRAWN = 500


@illustration(
    "Smooth trends of {}; colored: cells that depart from the fleet in that quantity.",
    "Capacity, resistances and OCV shift of every cell over its age",
    is_main=True,
)
def plot_fleet_life(life: "Life") -> Figure:
    """The smooth trends of all cells, and in color those that are flagged.

    Args:
        life: A fleet's ageing.
    """
    figure, panels = _panels(life)
    for axes, (quantity, (_, scale)) in zip(panels, LABELS.items(), strict=True):
        odd = {fault.cell for fault in life.faults if fault.quantity == quantity}
        drawn = life.of(quantity)
        for trend in [*drawn[:MOST_DRAWN], *(one for one in drawn if one.cell in odd)]:
            is_odd = trend.cell in odd
            style = {"color": VERMILLION, "zorder": 3} if is_odd else {"color": GREY, "alpha": 0.5}
            axes.plot(trend.age, scale * trend.smooth[:, 0], linewidth=0.8, **style)
        _say_where_empty(axes, drawn)
    return finish(figure, *panels, columns=2)


@illustration(
    "Ageing of {}: what each record tells with its 95 % interval, the smooth trend with its own, "
    "and dashed the age at which it departs from the fleet.",
    "Capacity, resistances and OCV shift of one cell over its age",
    is_main=True,
)
def plot_cell_life(life: "Life", cell: str) -> Figure:
    """The estimates of one cell, its smooth trends, and where it departs from the fleet.

    Args:
        life: A fleet's ageing.
        cell: The name of the cell.
    """
    figure, panels = _panels(life)
    for axes, (quantity, (_, scale)) in zip(panels, LABELS.items(), strict=True):
        found = life.of(quantity, cell)
        for trend in found:
            if not trend.estimates:
                continue
            value, low, high = scale * trend.measured.T
            reach = np.stack([value - low, high - value])
            dots = {"fmt": "o", "markersize": 3.0, "linewidth": 0.8, "color": BLACK}
            axes.errorbar(trend.age, value, reach, **dots)
            age, smooth = life.along(trend)
            value, low, high = scale * smooth.T
            axes.fill_between(age, low, high, color=SKY_BLUE, alpha=0.45, linewidth=0.0)
            axes.plot(age, value, color=BLUE)
        for fault in life.faults:
            if (fault.cell, fault.quantity) == (cell, quantity) and fault.kind in ("knee", "step"):
                axes.axvline(fault.age, color=VERMILLION, linewidth=0.8, linestyle="--")
        _say_where_empty(axes, found)
    return finish(figure, *panels, columns=2)


def _panels(life: "Life") -> tuple[Figure, list[Axes]]:
    figure = make_figure(height_in=4.8)
    panels = [*figure.subplots(2, 2, sharex=True).ravel()]
    for axes, (label, _) in zip(panels, LABELS.values(), strict=True):
        axes.set_ylabel(label)
        axes.margins(x=0.03)
    for axes in panels[2:]:
        axes.set_xlabel(AGES.get(life.unit, f"Age [{life.unit}s]"))
    return figure, panels


def _say_where_empty(axes: Axes, trends: list) -> None:
    if not any(trend.estimates for trend in trends):
        middle = {"ha": "center", "va": "center", "transform": axes.transAxes}
        axes.text(0.5, 0.5, "not determined", color=GREY, **middle)

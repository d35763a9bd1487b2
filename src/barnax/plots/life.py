"""Ageing over time: every cell of a fleet, and one cell with what each of its records told."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .pictures import illustration
from .style import (
    BLACK,
    BLUE,
    GREY,
    ROW_COLORS,
    VERMILLION,
    RowLook,
    finish,
    make_figure,
    row_looks,
)

if TYPE_CHECKING:
    from ..life import Life
    from ..life.ageing import Trend

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
# So few cells are drawn by name, with what their records tell, a little apart.
MOST_NAMED = len(ROW_COLORS)
APART = 0.008
MARGIN = 0.03


@illustration(
    "Smooth trends of {}. Few cells have names, and the 95 % intervals of their records (bars) and "
    "trends (bands). Of many, those that depart from the fleet in that quantity are red, and a "
    "black bar is the median 95 % interval of the trends.",
    "Capacity, resistances and OCV shift of every cell over its age",
    is_main=True,
)
def plot_fleet_life(life: "Life") -> Figure:
    """The smooth trends of all cells, and in color those that are flagged; few cells by name, with
    what each record tells.

    Args:
        life: A fleet's ageing.
    """
    figure, panels = _panels(life)
    looks = row_looks(life.cells)
    is_named = len(life.cells) <= MOST_NAMED
    for axes, (quantity, (_, scale)) in zip(panels, LABELS.items(), strict=True):
        odd = {fault.cell for fault in life.faults if fault.quantity == quantity}
        drawn = life.of(quantity)
        told = [trend for trend in drawn if trend.estimates]
        if is_named:
            for place, trend in enumerate(told):
                apart = APART * life.span * (place - (len(told) - 1) / 2)
                _draw_estimates(axes, life, trend, looks[trend.cell], apart, trend.cell)
        else:
            for trend in [*drawn[:MOST_DRAWN], *(one for one in drawn if one.cell in odd)]:
                is_odd = trend.cell in odd
                style = (
                    {"color": VERMILLION, "zorder": 3} if is_odd else {"color": GREY, "alpha": 0.5}
                )
                axes.plot(trend.age, scale * trend.smooth[:, 0], linewidth=0.8, **style)
            _draw_median(axes, scale * np.concatenate([trend.smooth for trend in drawn]),
                         life.first_age + life.span * (1 + MARGIN / 2))  # fmt: skip
        _say_where_empty(axes, drawn)
    return finish(figure, *panels, columns=MOST_NAMED)


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
    for axes, quantity in zip(panels, LABELS, strict=True):
        found = life.of(quantity, cell)
        for trend in found:
            if trend.estimates:
                _draw_estimates(axes, life, trend, RowLook(BLUE, "-", "o"))
        for fault in life.faults:
            if (fault.cell, fault.quantity) == (cell, quantity) and fault.kind in ("knee", "step"):
                axes.axvline(fault.age, color=VERMILLION, linewidth=0.8, linestyle="--")
        _say_where_empty(axes, found)
    return finish(figure, *panels, columns=2)


def _draw_estimates(
    axes: Axes, life: "Life", trend: "Trend", look: RowLook, apart: float = 0.0, label: str = ""
) -> None:
    """What the records tell of a quantity, and its trend, both with their intervals."""
    _, scale = LABELS[trend.quantity]
    value, low, high = scale * trend.measured.T
    reach = np.stack([value - low, high - value])
    dots = {"fmt": look.marker, "markersize": 3.0, "elinewidth": 0.8, "color": look.color}
    axes.errorbar(trend.age + apart, value, reach, **dots)
    age, smooth = life.along(trend)
    value, low, high = scale * smooth.T
    axes.fill_between(age, low, high, color=look.color, alpha=0.12, linewidth=0.0)
    axes.plot(age, value, color=look.color, linestyle=look.line, label=label)


def _draw_median(axes: Axes, smooth: np.ndarray, age: float) -> None:
    """The median trend and its median interval as a bar, where any trend is known."""
    known = smooth[np.isfinite(smooth).all(axis=1)]
    if len(known):
        value, low, high = np.median(known, axis=0)
        bar = {"color": BLACK, "capsize": 2.0, "label": "median 95 % interval"}
        axes.errorbar([age], [value], [[value - low], [high - value]], **bar)


def _panels(life: "Life") -> tuple[Figure, list[Axes]]:
    figure = make_figure(height_in=4.8)
    panels = [*figure.subplots(2, 2, sharex=True).ravel()]
    for axes, (label, _) in zip(panels, LABELS.values(), strict=True):
        axes.set_ylabel(label)
        axes.margins(x=MARGIN)
    for axes in panels[2:]:
        axes.set_xlabel(AGES.get(life.unit, f"Age [{life.unit}s]"))
    return figure, panels


def _say_where_empty(axes: Axes, trends: list) -> None:
    if not any(trend.estimates for trend in trends):
        middle = {"ha": "center", "va": "center", "transform": axes.transAxes}
        axes.text(0.5, 0.5, "not determined", color=GREY, **middle)

"""Many cells: distributions of a fleet's quantities, the cells of a pack, and ageing."""

import math
import re
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from . import style

if TYPE_CHECKING:
    from ..fit.pack import PackFit
    from ..life import Life
    from ..life.ageing import Trend

HISTOGRAMS_ACROSS: Final = 3
HISTOGRAM_IN: Final = 0.62 * style.HEIGHT_IN
BINS: Final = 24


@style.figure_style()
def plot_distributions(quantities: Mapping[str, Float[np.ndarray, "cells"]]) -> Figure:
    """A histogram of each positive quantity over the cells, and its median.

    Args:
        quantities: Positive values over the cells, by name.

    >>> figure = plot_distributions({"R0 [Ohm]": np.array([0.01, 0.02, 0.02])})
    >>> figure.axes[0].get_xlabel()
    'R0 [Ohm]'
    """
    figure, panels = style.make_panels(len(quantities), HISTOGRAMS_ACROSS, (HISTOGRAM_IN, 0.0))
    for axes, (name, values) in zip(panels, quantities.items(), strict=True):
        low, high = values.min(), values.max()
        bins = min(BINS, 2 * math.ceil(math.sqrt(len(values))))
        edges = np.geomspace(low, high, bins + 1) if high > low else 1
        axes.hist(values, edges, color=style.BLUE)  # pyrefly: ignore
        axes.axvline(float(np.median(values)), color=style.VERMILLION, linestyle="--")
        axes.set(xlabel=name, ylabel="Cells [-]")
        axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
        if high > 3 * low:
            axes.set_xscale("log")
            style.label_plainly(axes.xaxis)
    return style.finish(figure, *panels)


# Panel labels of a pack's quantities, and the factors to their units.
PACK: Final = {
    "R0 [Ohm]": ("R0 [mOhm]", 1e3),
    "total R [Ohm]": ("Total R [mOhm]", 1e3),
    "SOC shift": ("SOC shift [%]", 100.0),
    "capacity ratio": ("Capacity, of the\nmean cell's [%]", 100.0),
}


@style.figure_style()
def plot_pack(fit: "PackFit", odd: Collection[tuple[str, str]] = (), weakest: str = "") -> Figure:
    """R0, total R, SOC shift and capacity of every cell of a pack.

    Args:
        fit: The cells.
        odd: Names of outlying cells, each with the quantity concerned.
        weakest: The name of the weakest cell.
    """
    shown = [name for name in PACK if any(name in cell.values for cell in fit.cells)]
    figure, panels = style.make_panels(len(shown), 1, (1.15, 1.0), "Cell", sharex=True)
    for axes, name in zip(panels, shown, strict=True):
        label, scale = PACK[name]
        cells = [(number, cell) for number, cell in enumerate(fit.cells, 1) if name in cell.values]
        median = scale * float(np.median([cell.values[name].value for _, cell in cells]))
        axes.axhline(median, color=style.GREY, linestyle="--", linewidth=0.8)
        for number, cell in cells:
            value = cell.values[name]
            color = style.VERMILLION if (cell.name, name) in odd else style.BLUE
            axes.plot([number] * 2, [scale * value.low, scale * value.high], color=color, lw=1.0)
            axes.plot(number, scale * value.value, "o", color=color, markersize=3.0)
            if cell.name == weakest:
                ring = {"markersize": 8.0, "markerfacecolor": "none", "color": style.BLACK}
                axes.plot(number, scale * value.value, "o", **ring)
        axes.set_ylabel(label)
        axes.margins(y=0.2)
    step = -(-len(fit.cells) // 24)
    names = numbers_of([cell.name for cell in fit.cells])[::step]
    is_long = max(map(len, names)) > 4
    ticks = np.arange(1, len(fit.cells) + 1, step)
    panels[-1].set_xticks(ticks, names, rotation=90 if is_long else 0)
    panels[-1].set_xlim(0.5, len(fit.cells) + 0.5)
    style.title(panels[0], "95 % intervals; dashed: the median; ring: the weakest cell")
    return style.finish(figure, *panels)


def numbers_of(names: Sequence[str]) -> list[str]:
    """The numbers that distinguish names, if the words around them are the same.

    >>> numbers_of(["Cell 9 voltage [V]", "Cell 10 voltage [V]"])
    ['9', '10']
    >>> numbers_of(["A1", "B1"]), numbers_of(["Cell 1 (2023)", "Cell 2 (2023)"])
    (['A1', 'B1'], ['1', '2'])
    """
    numbers = [list(re.finditer(r"\d+", name)) for name in names]
    apart = []
    if len({re.sub(r"\d+", "#", name) for name in names}) == 1:
        columns = enumerate(zip(*numbers, strict=True))
        apart = [column for column, digits in columns if len({each[0] for each in digits}) > 1]
    if not apart:
        return [*names]
    return [
        name[digits[apart[0]].start() : digits[apart[-1]].end()]
        for name, digits in zip(names, numbers, strict=True)
    ]


# Panel labels of a life's quantities, and the factors to their units.
LIFE: Final = {
    "capacity [A.h]": ("Capacity [A.h]", 1.0),
    "R0 [Ohm]": ("R0 [mOhm]", 1e3),
    "R [Ohm]": ("All resistances [mOhm]", 1e3),
    "OCV shift [V]": ("OCV shift [mV]", 1e3),
}
AGES: Final = {"A.h": "Throughput [A.h]", "cycle": "Age [cycles]"}
# The most cells drawn of a large fleet, in addition to flagged ones.
MOST_DRAWN: Final = 500
# Up to this many cells are drawn by name, with the estimates from their records, slightly apart.
MOST_NAMED: Final = len(style.ROW_COLORS)
APART: Final = 0.008
MARGIN: Final = 0.03


@style.figure_style()
def plot_fleet_life(life: "Life") -> Figure:
    """The smooth trends of all cells, with flagged ones in color; for few cells by name, with the
    estimate from each record.

    Args:
        life: A fleet's ageing.
    """
    figure, panels = _life_panels(life)
    looks = style.row_looks(life.cells)
    for quantity, axes in panels.items():
        trends = life.of(quantity)
        determined = [trend for trend in trends if trend.estimates]
        if len(life.cells) > MOST_NAMED:
            _draw_many(axes, life, quantity, trends)
        else:
            for number, trend in enumerate(determined):
                apart = APART * life.span * (number - (len(determined) - 1) / 2)
                _draw_trend(axes, life, trend, looks[trend.cell], apart, trend.cell)
        _say_where_empty(axes, determined)
    return style.finish(figure, *panels.values(), columns=MOST_NAMED)


@style.figure_style()
def plot_cell_life(life: "Life", cell: str) -> Figure:
    """The estimates of one cell, its smooth trends, and its departures from the fleet.

    Args:
        life: A fleet's ageing.
        cell: The name of the cell.
    """
    figure, panels = _life_panels(life)
    for quantity, axes in panels.items():
        determined = [trend for trend in life.of(quantity, cell) if trend.estimates]
        for trend in determined:
            _draw_trend(axes, life, trend, style.RowLook(style.BLUE, "-", "o"))
        for fault in life.faults:
            if (fault.cell, fault.quantity) == (cell, quantity) and fault.kind in ("knee", "step"):
                axes.axvline(fault.age, color=style.VERMILLION, linewidth=0.8, linestyle="--")
        _say_where_empty(axes, determined)
    return style.finish(figure, *panels.values(), columns=2)


def _life_panels(life: "Life") -> tuple[Figure, dict[str, Axes]]:
    """A figure with a panel for every quantity."""
    below = AGES.get(life.unit, f"Age [{life.unit}s]")
    figure, panels = style.make_panels(len(LIFE), 2, (2.4, 0.0), below, sharex=True)
    for axes, (label, _) in zip(panels, LIFE.values(), strict=True):
        axes.set_ylabel(label)
        axes.margins(x=MARGIN)
    return figure, dict(zip(LIFE, panels, strict=True))


def _draw_trend(
    axes: Axes, life: "Life", trend: "Trend", look: style.RowLook, apart: float = 0, name: str = ""
) -> None:
    """Draw the records' values of a quantity, and its trend, both with their intervals."""
    _, scale = LIFE[trend.quantity]
    value, low, high = scale * trend.measured.T
    reach = np.stack([value - low, high - value])
    dots = {"fmt": look.marker, "markersize": 3.0, "elinewidth": 0.8, "color": look.color}
    axes.errorbar(trend.age + apart, value, reach, **dots)
    age, smooth = life.along(trend)
    value, low, high = scale * smooth.T
    axes.fill_between(age, low, high, color=look.color, alpha=0.12, linewidth=0.0)
    axes.plot(age, value, color=look.color, linestyle=look.line, label=name)


def _draw_many(axes: Axes, life: "Life", quantity: str, trends: "Sequence[Trend]") -> None:
    """The trends of many cells, flagged ones red, and their median interval as a bar."""
    _, scale = LIFE[quantity]
    odd = {fault.cell for fault in life.faults if fault.quantity == quantity}
    for trend in [*trends[:MOST_DRAWN], *(trend for trend in trends if trend.cell in odd)]:
        look: dict[str, Any] = {"color": style.GREY, "alpha": 0.5}
        if trend.cell in odd:
            look = {"color": style.VERMILLION, "zorder": 3}
        axes.plot(trend.age, scale * trend.smooth[:, 0], linewidth=0.8, **look)
    smooth = scale * np.concatenate([trend.smooth for trend in trends])
    determined = smooth[np.isfinite(smooth).all(axis=1)]
    if len(determined):
        value, low, high = np.median(determined, axis=0)
        bar = {"color": style.BLACK, "capsize": 2.0, "label": "median 95 % interval"}
        age = life.first_age + life.span * (1 + MARGIN / 2)
        axes.errorbar([age], [value], [[value - low], [high - value]], **bar)


def _say_where_empty(axes: Axes, determined: "Sequence[Trend]") -> None:
    if not determined:
        middle = {"ha": "center", "va": "center", "transform": axes.transAxes}
        axes.text(0.5, 0.5, "not determined", color=style.GREY, **middle)

"""Tables over SOC at several temperatures: over SOC, a line a temperature, and over temperature."""

from typing import TYPE_CHECKING, Final

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .style import figure_style, finish, label_plainly, make_figure

if TYPE_CHECKING:
    from ..over_soc import TableFit, TableFits

ACROSS: Final = 2
PANEL_IN: Final = 2.1
# States of charge that are drawn over temperature: the nodes nearest to these.
SOC: Final = (0.1, 0.3, 0.5, 0.7, 0.9)
COLORS: Final = "plasma"
# The end of the colors is too light for a line.
LIGHTEST: Final = 0.85
# What is interpolated is drawn at so many temperatures.
POINTS: Final = 101


@figure_style()
def plot_tables_by_temperature(found: "TableFits") -> Figure:
    """Every table over SOC at the nodes that samples visit, a line with its band a temperature."""
    degc, fits = _degc(found), found.fits
    named = fits[0].tables.tables
    figure, panels = _panels(len(named))
    colors = _colors(len(degc))
    for axes, name in zip(panels, named, strict=True):
        for temperature, fit, color in zip(degc, fits, colors, strict=True):
            soc, value, low, high = _visited(fit, name)
            label = f"{temperature:.3g} degC"
            axes.plot(soc, value, color=color, marker="o", markersize=3, linewidth=1.2, label=label)
            axes.fill_between(soc, low, high, color=color, alpha=0.18, linewidth=0.0)
        is_resistance = name.endswith("[Ohm]")
        axes.set_ylabel(f"{name.partition(' [')[0]} [{'mOhm' if is_resistance else 'mV'}]")
        _limit(axes, [_visited(fit, name)[1] for fit in fits], is_resistance)
    for axes in panels[-ACROSS:]:
        axes.set_xlabel("State of charge [-]")
        axes.tick_params(labelbottom=True)
    return finish(figure, *panels, columns=5)


@figure_style()
def plot_over_temperature(found: "TableFits") -> Figure:
    """Every resistance over temperature, a line a state of charge.

    Marks with intervals are the measured temperatures, lines what is interpolated between them.
    """
    degc, fits, tables = _degc(found), found.fits, found.tables
    assert tables is not None, "asked by _degc"
    names = [name for name in fits[0].tables.tables if name.endswith("[Ohm]")]
    nodes, places = fits[0].tables.nodes, _places(fits)
    fine = np.linspace(degc[0], degc[-1], POINTS)
    between = [tables.at(float(each)).tables for each in fine]
    figure, panels = _panels(len(names))
    colors = _colors(len(places))
    for axes, name in zip(panels, names, strict=True):
        for place, color in zip(places, colors, strict=True):
            course = [1e3 * each[name][place] for each in between]
            label = f"SOC {100 * nodes[place]:g} %"
            axes.plot(fine, course, color=color, linewidth=1.2, label=label)
            for temperature, fit in zip(degc, fits, strict=True):
                soc, value, low, high = _visited(fit, name)
                at = int(np.argmin(np.abs(soc - nodes[place])))
                if np.isfinite(low[at]) and np.isfinite(high[at]):
                    axes.plot([temperature] * 2, [max(low[at], 0.0), high[at]], color=color)
                axes.plot(temperature, value[at], color=color, marker="o", markersize=3.6)
        axes.set_ylabel(f"{name.partition(' [')[0]} [mOhm]")
        axes.margins(x=0.05)
        values = np.array([[each[name][place] for place in places] for each in between])
        if values.min() > 0:
            axes.set_yscale("log")
            axes.set_ylim(1e3 * values.min() / 1.5, 1e3 * values.max() * 1.5)
            label_plainly(axes.yaxis)
    for axes in panels[-ACROSS:]:
        axes.set_xlabel("Temperature [degC]")
        axes.tick_params(labelbottom=True)
    return finish(figure, *panels, columns=5)


def _degc(found: "TableFits") -> tuple[float, ...]:
    if found.over_temperature is None:
        raise ValueError("these tables are of one temperature")
    return found.over_temperature.temperatures_degc


def _visited(fit: "TableFit", name: str) -> tuple[np.ndarray, ...]:
    """SOC, value, and interval of a table at the visited nodes, in mOhm or mV; NaN where open."""
    known = {each.soc: each for each in fit.of_table(name)}
    rows = []
    for soc, value, seen in zip(
        fit.tables.nodes, fit.tables.tables[name], fit.tables.visited, strict=True
    ):
        each = known.get(soc)
        ends = (None, None) if each is None else (each.low, each.high)
        rows += [(soc, value, *ends)] if seen else []
    soc, *values = np.array(rows, float).T
    return soc, *(1e3 * each for each in values)


def _places(fits: "tuple[TableFit, ...]") -> list[int]:
    """The nodes nearest to `SOC` of those that samples of every temperature visit."""
    seen = np.all([fit.tables.visited for fit in fits], axis=0)
    nodes = np.array(fits[0].tables.nodes)
    known = np.flatnonzero(seen) if seen.any() else np.arange(len(nodes))
    return sorted({int(known[np.argmin(np.abs(nodes[known] - soc))]) for soc in SOC})


def _limit(axes: Axes, values: list[np.ndarray], is_resistance: bool) -> None:
    """A scale of the values: a band may reach beyond it."""
    flat = np.concatenate(values)
    low, high = float(flat.min()), float(flat.max())
    margin = 0.12 * ((high - low) or 1.0)
    axes.set_ylim(0.0 if is_resistance else low - margin, high + margin)


def _colors(count: int) -> np.ndarray:
    return matplotlib.colormaps[COLORS](np.linspace(0.0, LIGHTEST, count))


def _panels(count: int) -> tuple[Figure, list[Axes]]:
    rows, across = -(-count // ACROSS), min(ACROSS, count)
    figure = make_figure(height_in=0.7 + PANEL_IN * rows)
    panels = figure.subplots(rows, across, sharex=True, squeeze=False).ravel()
    for axes in panels[count:]:
        axes.remove()
    return figure, list(panels[:count])

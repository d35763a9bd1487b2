"""Figures of a fleet: how quantities are spread, and what they change with."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from .style import BLUE, HEIGHT_IN, VERMILLION, figure_style, finish, label_plainly, make_panels

Values = Float[np.ndarray, "cells"]
COLUMNS = 3
ROW_IN = 0.62 * HEIGHT_IN
BINS = 24


@figure_style()
def plot_distributions(quantities: Mapping[str, Values]) -> Figure:
    """A histogram of each positive quantity over the cells, and its median.

    >>> figure = plot_distributions({"R0 [Ohm]": np.array([0.01, 0.02, 0.02])})
    >>> figure.axes[0].get_xlabel()
    'R0 [Ohm]'
    """
    figure, panels = make_panels(len(quantities), COLUMNS, row_in=ROW_IN)
    for axes, (name, values) in zip(panels, quantities.items(), strict=True):
        low, high = values.min(), values.max()
        bins = min(BINS, 2 * math.ceil(math.sqrt(len(values))))
        spread = np.geomspace(low, high, bins + 1) if high > low else 1
        axes.hist(values, spread, color=BLUE)
        axes.axvline(float(np.median(values)), color=VERMILLION, linestyle="--")
        axes.set(xlabel=name, ylabel="Cells [-]")
        axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
        if high > 3 * low:
            axes.set_xscale("log")
            label_plainly(axes.xaxis)
    return finish(figure, *panels)


@figure_style()
def plot_fleet_trends(trends: Sequence[tuple[str, Values, str, Values]]) -> Figure:
    """Quantities over what they change with: name and values of the one, then of the other.

    >>> age, r0_ohm = np.array([1.0, 2.0]), np.array([0.01, 0.02])
    >>> plot_fleet_trends([("age", age, "R0 [Ohm]", r0_ohm)]).axes[0].get_xlabel()
    'age'
    """
    figure, panels = make_panels(len(trends), COLUMNS, row_in=ROW_IN)
    for axes, (by, places, name, values) in zip(panels, trends, strict=True):
        axes.plot(places, values, "o", color=BLUE, markersize=3)
        axes.set(xlabel=by, ylabel=name)
    return finish(figure, *panels)

"""Circuits side by side: parameters of seeds and rows, over SOC, and of the cells of a fleet."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ..cell import CircuitParameters
from ..cell.elements import names_of
from .pictures import illustration
from .style import (
    BLACK,
    BLUE,
    GREY,
    HEIGHT_IN,
    OPEN,
    VERMILLION,
    RowLook,
    draw_points,
    finish,
    label_plainly,
    make_panels,
    opened,
    row_looks,
)

if TYPE_CHECKING:
    from ..comparison import ComparisonResult
    from ..comparison.result import RowPart

Values = Float[np.ndarray, "cells"]
RMSE: Final = "RMSE [mV]"
COLUMNS: Final = 3
LINE_IN: Final = 0.26
FURNITURE_IN: Final = 0.65
LEGEND_IN: Final = 0.3
# Seeds are spread evenly about their row's line, so that equal answers show.
SPREAD: Final = 0.56
MARGIN: Final = 0.06
GOLDEN_RATIO: Final = 0.6180339887498949


def readable(parameters: Mapping[str, float]) -> dict[str, float]:
    """Resistances in mOhm, capacitances in F and time constants in s, by a name with its unit.

    `parameters` are PyBaMM's names, as `result.json` holds them.

    >>> readable({"R0 [Ohm]": 0.05, "R1 [Ohm]": 0.02, "C1 [F]": 500.0})
    {'R0 [mOhm]': 50.0, 'R1 [mOhm]': 20.0, 'C1 [F]': 500.0, 'tau1 [s]': 10.0}
    """
    circuit = CircuitParameters.from_dict(parameters)
    values = {"R0 [mOhm]": 1e3 * circuit.r0}
    pairs = zip(names_of(circuit.elements), circuit.r, circuit.c, circuit.tau_s, strict=True)
    for names, r, c, tau_s in pairs:
        values[names.resistance.replace("[Ohm]", "[mOhm]")] = 1e3 * r
        if names.capacitance is not None:
            values[names.capacitance] = c
        values[names.tau] = tau_s
    if circuit.gamma is not None:
        values["gamma [1/SOC]"] = circuit.gamma
    return values


@illustration(
    "The answer of every seed, before refinement. Bar: the median seed; diamond: the "
    "same after refinement; dotted: a bound.",
    "Parameters of every seed of every row",
    is_dense=False,
)
def plot_compared_parameters(comparison: "ComparisonResult | str | Path") -> Figure:
    """Every seed's own parameters and RMSE: a panel for each, a line for each row.

    Marks are the seeds before refinement, the tall stroke their median seed, the white diamond
    what Levenberg-Marquardt made of that. Dotted lines are bounds that all models share, where
    they lie in view.

    Args:
        comparison: A comparison, or the path of a `comparison.json`.
    """
    from ..comparison import ComparisonResult

    result = opened(comparison, ComparisonResult)
    rows = [row for row in result.rows if row.seeds]
    looks = row_looks([row.name for row in rows])
    names = _quantities(rows)
    row_in = FURNITURE_IN + LINE_IN * len(rows)
    size = {"row_in": row_in, "around_in": LEGEND_IN}
    figure, panels = make_panels(len(names), COLUMNS, **size, sharey=True)
    bounds = _shared_bounds(result)
    for axes, name in zip(panels, names, strict=True):
        for place, row in enumerate(rows):
            _draw_row(axes, place, row, looks[row.name], name)
        axes.set(xscale="log", xlabel=name)
        axes.margins(x=MARGIN)
        _draw_bounds(axes, bounds.get(name, ()))
        label_plainly(axes.xaxis)
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.set_yticks(range(len(rows)), [row.name for row in rows], parse_math=False)
    return finish(figure, *panels, legend_of=panels[:1])


def _quantities(rows: "Sequence[RowPart]") -> list[str]:
    """The quantities with a panel: RMSE, resistances, time constants, the rate of a hysteresis."""
    found = dict.fromkeys(name for row in rows for name in readable(row.seeds[0].parameters))
    kinds = ("R", "tau", "gamma")
    return [RMSE, *(name for kind in kinds for name in found if name.startswith(kind))]


def _value(name: str, rmse_v: float, parameters: Mapping[str, float]) -> float:
    return 1e3 * rmse_v if name == RMSE else readable(parameters).get(name, np.nan)


def _draw_row(axes: Axes, place: int, row: "RowPart", look: RowLook, name: str) -> None:
    values = np.array([_value(name, seed.rmse_v, seed.parameters) for seed in row.seeds])
    offset = SPREAD * ((np.arange(len(values)) * GOLDEN_RATIO + 0.5) % 1 - 0.5)
    style = {"color": look.color, "markeredgewidth": 0.0, "alpha": 0.75, "label": "one seed"}
    draw_points(axes, values, place + offset, look.marker, 3.2, **style)
    if row.identification is not None and row.parameters is not None:
        median = _value(name, row.identification.metrics.rmse_v, row.parameters)
        stroke = [place - 0.42, place + 0.42]
        axes.plot([median] * 2, stroke, color=BLACK, linewidth=1.4, label="median seed")
    if row.refined_rmse_v is not None and row.refined_parameters is not None:
        refined = _value(name, row.refined_rmse_v, row.refined_parameters)
        style = {**OPEN, "label": "median seed, refined", "zorder": 3}
        draw_points(axes, refined, place, "D", 4.6, **style)


def _shared_bounds(result: "ComparisonResult") -> dict[str, tuple[float, float]]:
    """Bounds in readable units of what every model bounds alike."""
    of_models = [model.bounds for model in result.models.values()]
    shared = {}
    for name, limits in of_models[0].items() if of_models else ():
        if all(bounds.get(name) == limits for bounds in of_models):
            scale = 1e3 if name.endswith("[Ohm]") else 1.0
            low, high = limits
            shared[name.replace("[Ohm]", "[mOhm]")] = (scale * low, scale * high)
    return shared


def _draw_bounds(axes: Axes, limits: Sequence[float]) -> None:
    low, high = axes.get_xlim()
    for limit in limits:
        # A bound just outside the data still shows that they end at it.
        if low / 1.3 <= limit <= high * 1.3:
            axes.axvline(limit, color=GREY, linestyle=":", linewidth=1.1, zorder=1)


ROW_IN: Final = 0.62 * HEIGHT_IN
BINS: Final = 24


@illustration(
    "Distribution of each quantity over the cells; the dashed line is the median.",
    "Histograms of the quantities over the cells, each with its median",
    is_dense=False,
)
def plot_distributions(quantities: Mapping[str, Values]) -> Figure:
    """A histogram of each positive quantity over the cells, and its median.

    Args:
        quantities: Positive values over the cells, by name.

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

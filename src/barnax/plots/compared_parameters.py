"""The parameters that every seed of every row ended with."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .log_axis import label_plainly
from .quantities import readable
from .rows import RowLook, row_looks
from .sources import comparison_of
from .style import BLACK, GREY, figure_style, finish_axes, legend_above, make_figure

if TYPE_CHECKING:
    from ..comparison import ComparisonResult
    from ..comparison.parts import RowPart

RMSE = "RMSE [mV]"
COLUMNS = 3
LINE_IN = 0.26
FURNITURE_IN = 0.65
LEGEND_IN = 0.3
# Seeds are spread about their row's line, evenly and without a draw, so equal answers show.
SPREAD = 0.56
MARGIN = 0.06
GOLDEN_RATIO = 0.6180339887498949


@figure_style()
def plot_compared_parameters(comparison: "ComparisonResult | str | Path") -> Figure:
    """Every seed's own parameters and RMSE: a panel for each, a line for each row.

    Marks are the seeds before refinement, the tall stroke their median seed, the white diamond
    what Levenberg-Marquardt made of that. Dotted lines are bounds that all models share, where
    they lie in view. `comparison` may be the path of a `comparison.json`.
    """
    result = comparison_of(comparison)
    rows = [row for row in result.rows if row.seeds]
    looks = row_looks(row.name for row in rows)
    names = _quantities(rows)
    lines = -(-len(names) // COLUMNS)
    figure = make_figure(height_in=LEGEND_IN + lines * (FURNITURE_IN + LINE_IN * len(rows)))
    grid = figure.subplots(lines, COLUMNS, squeeze=False, sharey=True)
    bounds = _shared_bounds(result)
    for axes, name in zip(grid.flat, names, strict=False):
        for place, row in enumerate(rows):
            _draw_row(axes, place, row, looks[row.name], name)
        axes.set(xscale="log", xlabel=name)
        axes.margins(x=MARGIN)
        _draw_bounds(axes, bounds.get(name, ()))
        label_plainly(axes.xaxis)
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.set_yticks(range(len(rows)), [row.name for row in rows], parse_math=False)
    for axes in grid.flat[len(names) :]:
        axes.set_visible(False)
    finish_axes(*grid.flat[: len(names)])
    legend_above(figure, grid[0, 0], columns=3)
    return figure


def _quantities(rows: "Sequence[RowPart]") -> list[str]:
    """What has a panel: the RMSE, resistances, time constants, the rate of a hysteresis."""
    found = dict.fromkeys(name for row in rows for name in readable(row.seeds[0].parameters))
    kinds = ("R", "tau", "gamma")
    return [RMSE, *(name for kind in kinds for name in found if name.startswith(kind))]


def _value(name: str, rmse_v: float, parameters: Mapping[str, float]) -> float:
    return 1e3 * rmse_v if name == RMSE else readable(parameters).get(name, np.nan)


def _draw_row(axes: Axes, place: int, row: "RowPart", look: RowLook, name: str) -> None:
    values = np.array([_value(name, seed.rmse_v, seed.parameters) for seed in row.seeds])
    offset = SPREAD * ((np.arange(len(values)) * GOLDEN_RATIO + 0.5) % 1 - 0.5)
    is_first = place == 0
    axes.plot(
        values,
        place + offset,
        linestyle="none",
        marker=look.marker,
        color=look.color,
        markersize=3.2,
        markeredgewidth=0.0,
        alpha=0.75,
        label="one seed" if is_first else "_seed",
    )
    if row.identification is not None and row.parameters is not None:
        median = _value(name, row.identification.metrics.rmse_v, row.parameters)
        axes.plot(
            [median, median],
            [place - 0.42, place + 0.42],
            color=BLACK,
            linewidth=1.4,
            label="median seed" if is_first else "_median",
        )
    if row.refined_rmse_v is not None and row.refined_parameters is not None:
        axes.plot(
            _value(name, row.refined_rmse_v, row.refined_parameters),
            place,
            linestyle="none",
            marker="D",
            markersize=4.6,
            markerfacecolor="white",
            markeredgecolor=BLACK,
            markeredgewidth=0.9,
            label="the median seed, refined" if is_first else "_refined",
            zorder=3,
        )


def _shared_bounds(result: "ComparisonResult") -> dict[str, tuple[float, float]]:
    """Bounds in readable units of what every model bounds alike."""
    each = [model.bounds for model in result.models.values()]
    shared = {}
    for name, limits in each[0].items() if each else ():
        if all(bounds.get(name) == limits for bounds in each):
            scale = 1e3 if name.endswith("[Ohm]") else 1.0
            low, high = limits
            shared[name.replace("[Ohm]", "[mOhm]")] = (scale * low, scale * high)
    return shared


def _draw_bounds(axes: Axes, limits: Sequence[float]) -> None:
    low, high = axes.get_xlim()
    for limit in limits:
        # Just outside the data a bound still says that the data end at it.
        if low / 1.3 <= limit <= high * 1.3:
            axes.axvline(limit, color=GREY, linestyle=":", linewidth=1.1, zorder=1)

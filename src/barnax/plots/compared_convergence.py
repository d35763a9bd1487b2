"""How the best RMSE of every row fell during the search, with the spread over its seeds."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .log_axis import label_plainly
from .rows import RowLook, row_looks
from .sources import comparison_of
from .style import figure_style, finish_axes, legend_above, make_figure

if TYPE_CHECKING:
    from ..comparison import ComparisonResult
    from ..comparison.parts import RowPart

BAND = (10, 90)
MARKERS_PER_LINE = 6
# Regret below this is rounding, and zero has no place on a logarithmic axis.
LEAST_REGRET_PERCENT = 1e-6
HEIGHT_IN = 4.8


@figure_style()
def plot_compared_convergence(comparison: "ComparisonResult | str | Path") -> Figure:
    """Best RMSE of each row over the evaluations of one seed: its median, and a band of seeds.

    The band holds the seeds from the tenth to the ninetieth percentile. Rows without a history,
    such as least squares, are a mark at what they spent. Where the global optimum of a model is
    known, a second panel shows the excess over it, in percent; excesses under 1e-6 % are drawn
    there. Generations count as equally expensive, and those before a seed's first finite error
    as infinite. `comparison` may be the path of a `comparison.json`.
    """
    result = comparison_of(comparison)
    optima_v = {name: model.optimum_rmse_v for name, model in result.models.items()}
    rows = [row for row in result.rows if row.seeds]
    looks = row_looks(row.name for row in rows)
    has_regret = any(optima_v.get(row.model) for row in rows)
    figure = make_figure(height_in=HEIGHT_IN)
    panels = figure.subplots(1, 2 if has_regret else 1, squeeze=False)[0]
    for row in rows:
        population = result.budget.population
        _draw(panels[0], row, looks[row.name], population, lambda rmse_v: 1e3 * rmse_v)
        optimum_v = optima_v.get(row.model)
        if has_regret and optimum_v:
            _draw(
                panels[1],
                row,
                looks[row.name],
                population,
                lambda rmse_v, optimum_v=optimum_v: np.maximum(
                    100 * (rmse_v / optimum_v - 1), LEAST_REGRET_PERCENT
                ),
            )
    panels[0].set_ylabel("Best RMSE [mV]")
    if has_regret:
        panels[1].set_ylabel("Best RMSE above the global optimum [%]")
    for axes in panels:
        axes.set(xscale="log", yscale="log", xlabel="Evaluations of one seed [-]")
        label_plainly(axes.yaxis)
    finish_axes(*panels)
    legend_above(figure, *panels, columns=3)
    return figure


def _draw(axes: Axes, row: "RowPart", look: RowLook, population: int, scale) -> None:
    style = {"color": look.color, "marker": look.marker, "markersize": 4.0}
    histories = [seed.history_v for seed in row.seeds if seed.history_v]
    spent = float(np.median([seed.evaluations for seed in row.seeds]))
    if len(histories) < len(row.seeds):
        rmse_v = np.median([seed.rmse_v for seed in row.seeds])
        axes.plot(max(spent, 1.0), scale(rmse_v), linestyle="none", label=row.name, **style)
        return
    values = scale(np.array(histories))
    evaluations = np.linspace(population, spent, values.shape[1])
    # Between infinite errors nothing can be interpolated; what comes of it is not drawn.
    with np.errstate(invalid="ignore"):
        low, median, high = np.percentile(values, [BAND[0], 50, BAND[1]], axis=0)
    if len(histories) > 1:
        axes.fill_between(
            evaluations, _finite(low), _finite(high), color=look.color, alpha=0.16, linewidth=0.0
        )
    # Evenly along a logarithmic axis.
    marked = np.unique(
        np.searchsorted(
            evaluations, np.geomspace(evaluations[0], evaluations[-1], MARKERS_PER_LINE)
        )
    )
    axes.plot(
        evaluations,
        _finite(median),
        linestyle=look.line,
        linewidth=1.3,
        markerfacecolor="white",
        markevery=[int(place) for place in np.minimum(marked, len(evaluations) - 1)],
        label=row.name,
        **style,
    )


def _finite(values: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(values), values, np.nan)

"""How every seed's best RMSE fell during the search."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullLocator

from .style import BLACK, SKY_BLUE, VERMILLION, figure_style, finish_axes, legend_above, make_figure

if TYPE_CHECKING:
    from ..identification import Identification
    from ..refinement import CrossCheck

Histories = Float[np.ndarray, "seeds generations"]

# Excess below this is rounding, and zero has no place on a logarithmic axis.
LEAST_EXCESS_PERCENT = 1e-6


@figure_style()
def plot_convergence(
    identification: "Identification", checked: "CrossCheck | None" = None
) -> Figure:
    """Best RMSE of each seed in mV over the evaluations it has spent, and the median of all seeds.

    With `checked`, a second panel shows how far each is above the refined RMSE, in percent;
    excesses under 1e-6 % are drawn there. Generations count as equally expensive. Generations
    before a seed's first finite error are not drawn, and count as infinite in the median.
    """
    population = identification.optimizer.population
    history_mv = 1e3 * np.array([seed.history_v for seed in identification.seeds])
    evaluations = np.array(
        [
            np.linspace(population, seed.evaluations, history_mv.shape[1])
            for seed in identification.seeds
        ]
    )
    # A refined RMSE of zero, as of data without noise, has neither excess nor a logarithm.
    refined_mv = 0.0 if checked is None else 1e3 * checked.rmse_v
    figure = make_figure()
    rmse, *excess = figure.subplots(1, 2 if refined_mv > 0 else 1, squeeze=False)[0]
    _draw_seeds(rmse, evaluations, history_mv)
    rmse.set_ylabel("Best RMSE [mV]")
    if refined_mv > 0:
        rmse.axhline(
            refined_mv, color=VERMILLION, linestyle="--", label=f"refined, {refined_mv:.4g} mV"
        )
        excess_percent = 100 * (history_mv / refined_mv - 1)
        _draw_seeds(excess[0], evaluations, np.maximum(excess_percent, LEAST_EXCESS_PERCENT))
        excess[0].set_ylabel("Best RMSE above the refined [%]")
    for axes in (rmse, *excess):
        axes.set_xlabel("Evaluations of one seed [-]")
        axes.set_xscale("log")
        _scale_logarithmically(axes)
    finish_axes(rmse, *excess)
    legend_above(figure, rmse, columns=3)
    return figure


def _draw_seeds(axes: Axes, evaluations: Histories, values: Histories) -> None:
    shown = np.where(np.isfinite(values), values, np.nan)
    for index, (spent, value) in enumerate(zip(evaluations, shown, strict=True)):
        axes.plot(
            spent,
            value,
            color=SKY_BLUE,
            linewidth=0.8,
            drawstyle="steps-post",
            label=_count(len(shown)) if index == 0 else "_seed",
        )
    if len(shown) > 1:
        median = np.median(values, axis=0)
        axes.plot(
            np.median(evaluations, axis=0),
            np.where(np.isfinite(median), median, np.nan),
            color=BLACK,
            linewidth=2.0,
            drawstyle="steps-post",
            label="median",
        )


def _count(seeds: int) -> str:
    return "one seed" if seeds == 1 else f"each of {seeds} seeds"


def _scale_logarithmically(axes: Axes) -> None:
    """A logarithmic vertical axis with plain numbers, also where it spans less than a decade."""
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    if high / low > 1e4:
        return
    is_short = high / low < 10
    axes.yaxis.set_major_locator(MaxNLocator(6) if is_short else LogLocator(subs=(1, 2, 5)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_locator(NullLocator())

"""The error over both time constants: has the problem one basin, and who ended where in it?"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter

from .compared_records import row_looks
from .style import OPEN, figure_style, finish_axes, finish_bar, legend_above, make_figure

if TYPE_CHECKING:
    from ..cell import CircuitParameters
    from ..global_optimum import Landscape

# Excess over the lowest RMSE, in percent: narrow steps near the bottom, where basins part.
STEPS_PERCENT: Final = (0.0, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500)
COLOR_MAP: Final = "viridis"
HEIGHT_IN: Final = 5.6
ANSWER: Final = {"markersize": 6.0, "markeredgecolor": "white", "markeredgewidth": 0.9}
REFINED: Final[dict[str, Any]] = OPEN | {"marker": "P", "markersize": 8.0}
OPTIMUM: Final[dict[str, Any]] = REFINED | {"marker": "*", "markersize": 14.0}


@figure_style()
def plot_landscape(
    landscape: "Landscape",
    *,
    answers: "Mapping[str, Sequence[CircuitParameters]] | None" = None,
    refined: "Sequence[CircuitParameters]" = (),
    optimum: "CircuitParameters | None" = None,
    others: "Sequence[CircuitParameters]" = (),
) -> Figure:
    """The lowest RMSE that the resistances can reach, over both time constants.

    Where the circuit has a rate gamma too, the best one counts. Steps of color are the excess
    over the lowest value, in percent: a problem with two basins shows two dark patches. `answers`
    are each row's circuits, one a seed; `refined` what Levenberg-Marquardt made of some;
    `optimum` the global optimum and `others` the local ones. Circuits beyond the box are drawn at
    its edge. Raises `ValueError` for what has not two time constants to choose.

    >>> from barnax.global_optimum import Landscape
    >>> tau_s = np.geomspace(1.0, 1e4, 30)
    >>> rmse_v = 0.01 + 1e-3 * np.abs(np.log(tau_s[:, None] * tau_s / 1e4))
    >>> landscape = Landscape((tau_s, tau_s), None, rmse_v, np.zeros((3, 30, 30)))
    >>> plot_landscape(landscape).axes[0].get_xlabel()
    'Time constant tau1 [s]'
    """
    if not has_landscape(landscape):
        raise ValueError("a landscape is drawn over two time constants, neither of them held")
    tau1_s, tau2_s = landscape.tau_s
    rmse_v = least_over_gamma(landscape)
    # Alike pairs are ordered, and there is nothing where tau1 exceeds tau2.
    is_ordered = bool(np.isnan(rmse_v[-1, 0]))
    figure = make_figure(height_in=HEIGHT_IN)
    axes = figure.subplots()
    _draw_excess(figure, axes, tau1_s, tau2_s, rmse_v)

    box = ((tau1_s[0], tau2_s[0]), (tau1_s[-1], tau2_s[-1]))

    def mark(circuits, label, layer, style):
        taus = [sorted(each.tau_s) if is_ordered else each.tau_s for each in circuits]
        _mark(axes, taus, box, label, layer, style)

    rows = answers or {}
    for label, look in row_looks(rows).items():
        look_of_row = {"marker": look.marker, "markerfacecolor": look.color}
        mark(rows[label], label, 3.0, look_of_row | ANSWER)
    mark(refined, "refined by Levenberg-Marquardt", 3.2, REFINED)
    mark(others, "other local optima", 3.1, REFINED | {"marker": "o"})
    mark([optimum] if optimum else [], "global optimum", 3.1, OPTIMUM)
    axes.set(
        xscale="log",
        yscale="log",
        xlim=(tau1_s[0], tau1_s[-1]),
        ylim=(tau2_s[0], tau2_s[-1]),
        xlabel=f"{'Shorter time' if is_ordered else 'Time'} constant tau1 [s]",
        ylabel=f"{'Longer time' if is_ordered else 'Time'} constant tau2 [s]",
    )
    finish_axes(axes)
    axes.grid(visible=False)
    if axes.get_legend_handles_labels()[0]:
        if is_ordered:
            axes.legend(loc="lower right", markerscale=0.9)
        else:
            legend_above(figure, axes, columns=3)
    return figure


def has_landscape(landscape: "Landscape") -> bool:
    """Whether there are two time constants to draw it over."""
    return [len(each) > 1 for each in landscape.tau_s] == [True, True]


def least_over_gamma(landscape: "Landscape") -> Float[np.ndarray, "first second"]:
    """The RMSE of the best gamma, NaN where there is no value; as it is where there is none."""
    if landscape.gamma is None:
        return landscape.rmse_v
    known_v = np.where(np.isnan(landscape.rmse_v), np.inf, landscape.rmse_v).min(axis=-1)
    return np.where(np.isfinite(known_v), known_v, np.nan)


def _draw_excess(
    figure: Figure, axes: Axes, tau1_s: np.ndarray, tau2_s: np.ndarray, rmse_v: np.ndarray
) -> None:
    known = np.ma.masked_invalid(rmse_v)
    lowest_v = float(known.min())
    excess_percent = 100 * (known / lowest_v - 1)
    colors = matplotlib.colormaps[COLOR_MAP]
    steps = list(STEPS_PERCENT)
    drawn = (tau1_s, tau2_s, excess_percent.T)
    norm = BoundaryNorm(steps, colors.N, extend="max")
    filled = axes.contourf(*drawn, levels=steps, norm=norm, cmap=colors, extend="max")
    axes.contour(*drawn, levels=steps[1:], colors="white", linewidths=0.4)
    bar = figure.colorbar(filled, ax=axes, pad=0.02, aspect=30)
    bar.set_label(f"RMSE above the lowest, {1e3 * lowest_v:.4g} mV [%]")
    bar.ax.yaxis.set_major_locator(FixedLocator(steps))
    bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    finish_bar(bar)


def _mark(
    axes: Axes,
    taus_s: Sequence[Sequence[float]],
    box: tuple[tuple[float, float], tuple[float, float]],
    label: str,
    layer: float,
    style: dict[str, Any],
) -> None:
    if not taus_s:
        return
    if any(len(each) != 2 for each in taus_s):
        raise ValueError(f"{label}: a landscape over two time constants needs two RC pairs")
    # What a method found beyond the box stands at its edge, and is said to.
    shown_s = np.clip(taus_s, *box)
    if not np.allclose(shown_s, taus_s):
        label += " (partly outside the bounds)" if len(taus_s) > 1 else " (outside the bounds)"
    tau1_s, tau2_s = shown_s.T
    # At the limits of the box a mark would be cut in half.
    axes.plot(tau1_s, tau2_s, linestyle="none", label=label, zorder=layer, clip_on=False, **style)

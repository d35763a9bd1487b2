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

from .rows import row_looks
from .style import BLACK, TICKS, figure_style, finish_axes, legend_above, make_figure

if TYPE_CHECKING:
    from ..cell import CircuitParameters

# Excess over the lowest RMSE, in percent: narrow steps near the bottom, where basins part.
STEPS_PERCENT: Final = (0.0, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500)
COLOR_MAP: Final = "viridis"
HEIGHT_IN: Final = 5.6
ANSWER: Final[dict[str, Any]] = {
    "markersize": 6.0,
    "markeredgecolor": "white",
    "markeredgewidth": 0.9,
}
REFINED: Final[dict[str, Any]] = {
    "marker": "P",
    "markersize": 8.0,
    "markerfacecolor": "white",
    "markeredgecolor": BLACK,
    "markeredgewidth": 0.9,
}
OPTIMUM: Final[dict[str, Any]] = REFINED | {"marker": "*", "markersize": 14.0}


@figure_style()
def plot_landscape(
    tau1_s: Float[np.ndarray, "first"],
    tau2_s: Float[np.ndarray, "second"],
    rmse_v: Float[np.ndarray, "first second"],
    *,
    answers: "Mapping[str, Sequence[CircuitParameters]] | None" = None,
    refined: "Sequence[CircuitParameters]" = (),
    optimum: "CircuitParameters | None" = None,
    others: "Sequence[CircuitParameters]" = (),
) -> Figure:
    """The lowest RMSE that the resistances can reach, over both time constants.

    `rmse_v` is NaN where there is no value, as where tau1 exceeds tau2. Steps of color are the
    excess over its lowest value, in percent: a problem with two basins shows two dark patches.
    `answers` are each row's circuits, one a seed; `refined` what Levenberg-Marquardt made of
    some; `optimum` the global optimum and `others` the local ones. Raises `ValueError` for
    circuits that have not two RC pairs, and where `rmse_v` has no value at all.

    >>> tau_s = np.geomspace(1.0, 1e4, 30)
    >>> rmse_v = 0.01 + 1e-3 * np.abs(np.log(tau_s[:, None] * tau_s / 1e4))
    >>> plot_landscape(tau_s, tau_s, rmse_v).axes[0].get_xlabel()
    'Shorter time constant tau1 [s]'
    """
    figure = make_figure(height_in=HEIGHT_IN)
    axes = figure.subplots()
    _draw_excess(figure, axes, tau1_s, tau2_s, rmse_v)
    rows = answers or {}
    for label, look in row_looks(rows).items():
        style = {"marker": look.marker, "markerfacecolor": look.color} | ANSWER
        _mark(axes, rows[label], label, 3.0, style)
    _mark(axes, refined, "refined by Levenberg-Marquardt", 3.2, REFINED)
    _mark(axes, others, "other local optima", 3.1, REFINED | {"marker": "o"})
    _mark(axes, [optimum] if optimum else [], "global optimum", 3.1, OPTIMUM)
    axes.set(
        xscale="log",
        yscale="log",
        xlim=(tau1_s[0], tau1_s[-1]),
        ylim=(tau2_s[0], tau2_s[-1]),
        xlabel="Shorter time constant tau1 [s]",
        ylabel="Longer time constant tau2 [s]",
    )
    finish_axes(axes)
    axes.grid(visible=False)
    if axes.get_legend_handles_labels()[0]:
        # Where tau1 exceeds tau2 there is nothing to hide.
        if np.isnan(rmse_v[-1, 0]):
            axes.legend(loc="lower right", markerscale=0.9)
        else:
            legend_above(figure, axes, columns=3)
    return figure


def _draw_excess(
    figure: Figure, axes: Axes, tau1_s: np.ndarray, tau2_s: np.ndarray, rmse_v: np.ndarray
) -> None:
    known = np.ma.masked_invalid(rmse_v)
    if known.count() == 0:
        raise ValueError("the landscape has no finite error to draw")
    lowest_v = float(known.min())
    excess_percent = 100 * (known / lowest_v - 1)
    colors = matplotlib.colormaps[COLOR_MAP]
    steps = list(STEPS_PERCENT)
    filled = axes.contourf(
        tau1_s,
        tau2_s,
        excess_percent.T,
        levels=steps,
        norm=BoundaryNorm(steps, colors.N, extend="max"),
        cmap=colors,
        extend="max",
    )
    axes.contour(tau1_s, tau2_s, excess_percent.T, levels=steps[1:], colors="white", linewidths=0.4)
    bar = figure.colorbar(filled, ax=axes, pad=0.02, aspect=30)
    bar.set_label(f"RMSE above the lowest, {1e3 * lowest_v:.4g} mV [%]")
    bar.ax.yaxis.set_major_locator(FixedLocator(steps))
    bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    bar.ax.tick_params(which="both", **TICKS)


def _mark(
    axes: Axes,
    circuits: "Sequence[CircuitParameters]",
    label: str,
    layer: float,
    style: dict[str, Any],
) -> None:
    if not circuits:
        return
    if any(len(circuit.tau_s) != 2 for circuit in circuits):
        raise ValueError(f"{label}: a landscape over two time constants needs two RC pairs")
    tau1_s, tau2_s = np.array([sorted(circuit.tau_s) for circuit in circuits]).T
    # At the limits of the box the mark is cut in half otherwise.
    axes.plot(tau1_s, tau2_s, linestyle="none", label=label, zorder=layer, clip_on=False, **style)

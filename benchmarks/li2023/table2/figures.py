"""The paper's Fig. 6 again, with evaluations on the axis."""

import numpy as np
from matplotlib.figure import Figure

from .runs import OPTIMIZERS, POPULATION
from .tournament import Tournament

SHOWN = ("F1", "F4", "F5", "F6", "F7", "F8")
FLOOR = {"F5": 1e-6}
# Okabe and Ito's colors, which the color-blind can tell apart, and black.
COLORS = ("#E69F00", "#56B4E9", "#009E73", "#F0E442", "#0072B2", "#CC79A7", "#000000", "#D55E00")


def convergence_figure(results: Tournament) -> Figure:
    """The median over runs of the best loss so far, one panel a function."""
    figure = Figure(figsize=(11, 6.5), layout="constrained")
    panels = figure.subplots(2, 3)
    for function, axes in zip(SHOWN, panels.flat, strict=True):
        floor = FLOOR.get(function, 1e-20)
        top = floor
        for optimizer, color in zip(OPTIMIZERS, COLORS, strict=True):
            runs = results[function, optimizer]
            median = np.median(runs.histories, axis=0)
            per_generation = (runs.evaluations - POPULATION) / (len(median) - 1)
            evaluations = POPULATION + per_generation * np.arange(len(median))
            style = "--" if optimizer == "ibmo" else "-"
            axes.plot(
                evaluations,
                np.maximum(median, floor / 1e3),
                style,
                color=color,
                label=optimizer.upper(),
                linewidth=1.6,
            )
            top = max(top, median[0])
        axes.set(yscale="log", ylim=(floor, 3 * top), title=function)
        axes.set(xlabel="evaluations", ylabel="best loss so far (median of runs)")
        axes.grid(alpha=0.3)
    figure.legend(
        *panels[0, 0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=8,
        frameon=False,
    )
    return figure

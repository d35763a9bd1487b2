"""Average ranks with their critical difference (Demsar, 2006)."""

import numpy as np
from matplotlib.figure import Figure

from benchmarks.li2023.test_functions import FUNCTIONS

from .runs import Losses
from .statistics import critical_difference, friedman, losses_of, methods_under


def critical_difference_figure(results: Losses) -> Figure:
    """One panel a condition: methods at their Friedman ranks, bars over those not told apart."""
    figure = Figure(figsize=(10, 6.5), layout="constrained")
    panels = figure.subplots(2, 1)
    titles = {"shifted": "shifted", "rotated": "shifted and rotated"}
    for axes, (condition, title) in zip(panels, titles.items(), strict=True):
        methods = methods_under(results, condition)
        ranks, _ = friedman(losses_of(results, condition, methods))
        width = critical_difference(len(methods), len(FUNCTIONS))
        _draw(axes, np.array(methods), ranks, width)
        axes.set_title(f"F1 to F9 {title}: average rank, critical difference {width:.2f}")
    return figure


def _draw(axes, methods, ranks, width):
    order = np.argsort(ranks)
    methods, ranks = methods[order], ranks[order]
    count = len(methods)
    half = (count + 1) // 2
    axes.hlines(0, 1, count, color="black", linewidth=1)
    for tick in range(1, count + 1):
        axes.vlines(tick, 0, 0.12, color="black", linewidth=1)
        axes.text(tick, 0.2, str(tick), ha="center", va="bottom")
    for place, (method, rank) in enumerate(zip(methods, ranks, strict=True)):
        is_left = place < half
        depth = -1.0 - 0.55 * (place if is_left else count - 1 - place)
        end = 0.6 if is_left else count + 0.4
        weight = "bold" if method == "ibmo-centered" else "normal"
        axes.plot([rank, rank, end], [0, depth, depth], color="black", linewidth=0.8)
        axes.text(
            end,
            depth,
            f" {method} {rank:.2f} ",
            va="center",
            weight=weight,
            ha="right" if is_left else "left",
        )
    for level, (first, last) in enumerate(_groups(ranks, width)):
        height = -0.2 - 0.13 * level
        axes.plot(ranks[[first, last]] + [-0.05, 0.05], [height] * 2, color="#D55E00", linewidth=3)
    axes.set(xlim=(-0.8, count + 2), ylim=(-1.5 - 0.55 * half, 0.8))
    axes.axis("off")


def _groups(ranks, width):
    """The longest stretches of methods within one critical difference."""
    lasts = [int(np.flatnonzero(ranks <= rank + width)[-1]) for rank in ranks]
    runs = [(first, last) for first, last in enumerate(lasts) if last > first]
    return [
        (first, last)
        for place, (first, last) in enumerate(runs)
        if place == 0 or last > runs[place - 1][1]
    ]

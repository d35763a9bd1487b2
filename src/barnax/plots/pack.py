"""The cells of a pack side by side, each value with its interval."""

import re
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from .pictures import illustration
from .style import BLACK, BLUE, GREY, VERMILLION, finish, make_figure, title

if TYPE_CHECKING:
    from ..over_soc.pack import PackFit

# Labels of the panels, and the factors to their units.
PANELS = {
    "R0 [Ohm]": ("R0 [mOhm]", 1e3),
    "total R [Ohm]": ("Total R [mOhm]", 1e3),
    "SOC shift": ("SOC shift [%]", 100.0),
    "capacity ratio": ("Capacity, of the\nmean cell's [%]", 100.0),
}


@illustration(
    "Every cell with its 95 % interval; dashed: the median of the cells. Odd cells are red, and "
    "the weakest has a ring.",
    "Resistances, SOC shift and capacity of every cell of a pack",
    is_main=True,
)
def plot_pack(fit: "PackFit", odd: Collection[tuple[str, str]] = (), weakest: str = "") -> Figure:
    """R0, total R, SOC shift and capacity of every cell of a pack.

    Args:
        fit: The cells.
        odd: Names of odd cells, each with the quantity that is odd.
        weakest: The name of the weakest cell.
    """
    shown = [name for name in PANELS if any(name in cell.values for cell in fit.cells)]
    figure = make_figure(height_in=1.0 + 1.15 * len(shown))
    panels = np.atleast_1d(figure.subplots(len(shown), 1, sharex=True))
    for axes, name in zip(panels, shown, strict=True):
        label, scale = PANELS[name]
        known = [(k, e, e.values[name]) for k, e in enumerate(fit.cells, 1) if name in e.values]
        axes.axhline(
            scale * float(np.median([value.value for *_, value in known])),
            color=GREY, linestyle="--", linewidth=0.8,
        )  # fmt: skip
        for place, cell, value in known:
            color = VERMILLION if (cell.name, name) in odd else BLUE
            axes.plot([place] * 2, [scale * value.low, scale * value.high], color=color, lw=1.0)
            axes.plot(place, scale * value.value, "o", color=color, markersize=3.0)
            if cell.name == weakest:
                ring = {"markersize": 8.0, "markerfacecolor": "none", "color": BLACK}
                axes.plot(place, scale * value.value, "o", **ring)
        axes.set_ylabel(label)
        axes.margins(y=0.2)
    step = -(-len(fit.cells) // 24)
    places = np.arange(1, len(fit.cells) + 1, step)
    names = numbers_of([cell.name for cell in fit.cells])[::step]
    is_long = max(map(len, names)) > 4
    panels[-1].set_xticks(places, names, rotation=90 if is_long else 0)
    panels[-1].set_xlim(0.5, len(fit.cells) + 0.5)
    panels[-1].set_xlabel("Cell")
    title(panels[0], "95 % intervals; dashed: the median; ring: the weakest cell")
    return finish(figure, *panels)


def numbers_of(names: Sequence[str]) -> list[str]:
    """What tells the names apart, where the words around their numbers are the same.

    >>> numbers_of(["Cell 9 voltage [V]", "Cell 10 voltage [V]"])
    ['9', '10']
    >>> numbers_of(["A1", "B1"]), numbers_of(["Cell 1 (2023)", "Cell 2 (2023)"])
    (['A1', 'B1'], ['1', '2'])
    """
    if len({re.sub(r"\d+", "#", name) for name in names}) > 1:
        return [*names]
    numbers = [list(re.finditer(r"\d+", name)) for name in names]
    apart = [
        place
        for place, own in enumerate(zip(*numbers, strict=True))
        if len({n[0] for n in own}) > 1
    ]
    if not apart:
        return [*names]
    return [
        name[own[apart[0]].start() : own[apart[-1]].end()]
        for name, own in zip(names, numbers, strict=True)
    ]
